//! How often the engine may fail. Its world begins anew each time, and its visitors come back; an
//! engine that fails again and again would only keep them busy.

use std::{collections::VecDeque, time::Duration};

/// The server ends at this number of faults within [`WITHIN`].
const FAULTS_MAX: usize = 3;
const WITHIN: Duration = Duration::from_secs(60);

/// The engine's last faults.
#[derive(Debug, Default)]
pub struct EngineFaults {
    times: VecDeque<Duration>,
}

impl EngineFaults {
    /// Takes in a fault. Returns whether the world may begin anew.
    pub fn take(&mut self, now: Duration) -> bool {
        self.times.retain(|time| now.saturating_sub(*time) < WITHIN);
        self.times.push_back(now);
        self.times.len() < FAULTS_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rare_faults_are_survived_and_frequent_ones_are_not() {
        let at = Duration::from_secs;
        let mut faults = EngineFaults::default();
        assert!([0, 50, 100, 150].into_iter().all(|second| faults.take(at(second))));
        assert!(!faults.take(at(159)));
        assert!(faults.take(at(300)));
    }
}
