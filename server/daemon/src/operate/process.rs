//! What the server's process has used of the machine.

use serde::{Deserialize, Serialize};

/// What the server's process has used of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProcessUse {
    /// Processor time of all threads since the start, in seconds.
    pub cpu_s: f64,
    /// Memory that is resident now, in bytes.
    pub resident_bytes: u64,
}

impl ProcessUse {
    /// What was used up to now. `None` where the system does not tell: only Linux does.
    #[cfg(target_os = "linux")]
    pub fn now() -> Option<Self> {
        let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
        let memory = std::fs::read_to_string("/proc/self/statm").ok()?;
        let (ticks, pages) = (cpu_ticks(&stat)?, memory.split(' ').nth(1)?.parse::<u64>().ok()?);
        let ticks_per_s = rustix::param::clock_ticks_per_second() as f64;
        let resident_bytes = pages * rustix::param::page_size() as u64;
        Some(Self { cpu_s: ticks as f64 / ticks_per_s, resident_bytes })
    }

    /// What was used up to now. `None` where the system does not tell: only Linux does.
    #[cfg(not(target_os = "linux"))]
    pub fn now() -> Option<Self> {
        None
    }
}

/// The processor time in `/proc/self/stat`, in ticks of the system's clock: the fields 14 and 15.
/// The second field is the program's name in brackets, which may have spaces.
#[cfg(target_os = "linux")]
fn cpu_ticks(stat: &str) -> Option<u64> {
    let (_, fields) = stat.rsplit_once(") ")?;
    let mut fields = fields.split(' ').skip(11).map(str::parse::<u64>);
    Some(fields.next()?.ok()? + fields.next()?.ok()?)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_process_has_used_memory_and_time() {
        let used = ProcessUse::now().unwrap();
        assert!(used.resident_bytes > 100_000 && used.cpu_s < 1e6, "{used:?}");
        let stat = "7 (a b) c) S 1 7 7 0 -1 4194560 1 0 0 0 250 50 0 0 20 0 1 0";
        assert_eq!(cpu_ticks(stat), Some(300));
    }
}
