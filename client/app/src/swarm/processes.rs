//! What processes of this machine use: the swarm's own, and the server's if it runs beside it.
//! Known on Linux only, from `/proc`.

use std::{fs, net::SocketAddr, time::Duration};

/// The unit of processor times in `/proc`, which is the same on all common machines.
const TICK: Duration = Duration::from_millis(10);

/// A process of this machine.
#[derive(Clone, Debug)]
pub(super) struct Process {
    /// Its folder in `/proc`.
    folder: String,
}

/// What a process has used.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Usage {
    /// Processor time since it started.
    pub(super) cpu: Duration,
    /// Memory at present, in bytes.
    pub(super) memory_bytes: u64,
}

impl Process {
    /// This process.
    pub(super) fn own() -> Self {
        Self { folder: "/proc/self".to_owned() }
    }

    /// The processes that listen on addresses of this machine, if they may be looked at. One that
    /// listens on several is there once.
    pub(super) fn listening_on<'a>(addresses: impl Iterator<Item = &'a SocketAddr>) -> Vec<Self> {
        let mut found: Vec<Self> = addresses.filter_map(|at| Self::behind(*at)).collect();
        found.sort_unstable_by(|a, b| a.folder.cmp(&b.folder));
        found.dedup_by(|a, b| a.folder == b.folder);
        found
    }

    fn behind(address: SocketAddr) -> Option<Self> {
        if !address.ip().to_canonical().is_loopback() {
            return None;
        }
        let socket = ["/proc/net/udp", "/proc/net/udp6"]
            .into_iter()
            .filter_map(|table| fs::read_to_string(table).ok())
            .find_map(|table| socket_of(&table, address.port()))?;
        let link = format!("socket:[{socket}]");
        let processes = fs::read_dir("/proc").ok()?.flatten();
        // Processes have numbers. `/proc/self` is one of them under another name.
        let is_process = |name: &str| name.bytes().all(|byte| byte.is_ascii_digit());
        let mut folders = processes
            .filter(|entry| entry.file_name().to_str().is_some_and(is_process))
            .map(|entry| entry.path());
        let has_socket = |folder: &std::path::PathBuf| {
            let files = fs::read_dir(folder.join("fd")).into_iter().flatten().flatten();
            files
                .filter_map(|file| fs::read_link(file.path()).ok())
                .any(|to| to.as_os_str() == link.as_str())
        };
        let folder = folders.find(has_socket)?;
        Some(Self { folder: folder.to_str()?.to_owned() })
    }

    /// What processes have used together; `None` when there is none, or the system does not tell.
    pub(super) fn usage_of(all: &[Self]) -> Option<Usage> {
        let used: Option<Vec<Usage>> = all.iter().map(Self::usage).collect();
        used?.into_iter().reduce(|one, other| Usage {
            cpu: one.cpu + other.cpu,
            memory_bytes: one.memory_bytes + other.memory_bytes,
        })
    }

    /// What it has used; `None` when the system does not tell.
    pub(super) fn usage(&self) -> Option<Usage> {
        let stat = fs::read_to_string(format!("{}/stat", self.folder)).ok()?;
        let status = fs::read_to_string(format!("{}/status", self.folder)).ok()?;
        Some(Usage { cpu: cpu_of(&stat)?, memory_bytes: memory_of(&status)? })
    }
}

/// The number of the socket on a port, in a table of sockets.
fn socket_of(table: &str, port: u16) -> Option<u64> {
    let suffix = format!(":{port:04X}");
    let mut rows = table.lines().skip(1).map(|row| row.split_whitespace().collect::<Vec<_>>());
    let row = rows.find(|row| row.get(1).is_some_and(|local| local.ends_with(&suffix)))?;
    row.get(9)?.parse().ok()
}

/// User and system time. The name of the program, in brackets, may have spaces.
fn cpu_of(stat: &str) -> Option<Duration> {
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |i: usize| fields.get(i)?.parse::<u32>().ok();
    Some(TICK * (ticks(11)? + ticks(12)?))
}

fn memory_of(status: &str) -> Option<u64> {
    let row = status.lines().find_map(|row| row.strip_prefix("VmRSS:"))?;
    let kib: u64 = row.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1_024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_of_the_system_are_read() {
        let table = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   \
                     uid  timeout inode ref pointer drops\n\
                     1: 0100007F:12A9 00000000:0000 07 00000000:00000000 00:00000000 00000000     \
                     0        0 4711 2 0000000000000000 0\n";
        assert_eq!((socket_of(table, 4_777), socket_of(table, 4_778)), (Some(4_711), None));
        let stat = "12 (a b) c) S 1 2 3 4 5 6 7 8 9 10 250 50 0 0 20 0 1 0 1 1 1";
        assert_eq!(cpu_of(stat), Some(Duration::from_secs(3)));
        assert_eq!(cpu_of("nonsense"), None);
        assert_eq!(memory_of("Name:\tx\nVmRSS:\t     2 kB\n"), Some(2_048));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_process_behind_a_socket_is_found() {
        let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        let other = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        let addresses = [&socket, &other].map(|socket| socket.local_addr().unwrap());
        let found = Process::listening_on(addresses.iter());
        assert_eq!(found.len(), 1, "one process has both");
        assert!(found[0].folder.ends_with(&std::process::id().to_string()), "{found:?}");
        assert!(Process::usage_of(&found).unwrap().memory_bytes > 1 << 16);
        let elsewhere = Process::listening_on(["192.0.2.1:4777".parse().unwrap()].iter());
        assert!(elsewhere.is_empty() && Process::usage_of(&elsewhere).is_none());
    }
}
