//! How many lines of the log one peer may cause. No sockets and no clocks are needed here.

use std::{collections::HashMap, net::IpAddr, time::Duration};

use super::budget::TokenBucket;
use crate::address::network;

/// Counts the lines that each peer causes. Peers of one network count as one.
#[derive(Debug)]
pub struct LogLimits {
    /// Lines in a second that a peer may cause, in the long run and at once: twice as many in any
    /// second at most.
    lines_per_s: f64,
    /// The most peers that are told apart. All others count as one.
    peers_max: usize,
    peers: HashMap<IpAddr, Peer>,
}

#[derive(Debug)]
struct Peer {
    lines: TokenBucket,
    suppressed: u64,
}

impl LogLimits {
    /// No peers yet.
    pub fn new(lines_per_s: f64, peers_max: usize) -> Self {
        Self { lines_per_s, peers_max, peers: HashMap::new() }
    }

    /// Whether a line is to be logged. Otherwise it counts as suppressed.
    pub fn allows(&mut self, address: IpAddr, now: Duration) -> bool {
        let mut key = network(address);
        if self.peers.len() >= self.peers_max && !self.peers.contains_key(&key) {
            key = IpAddr::V4(std::net::Ipv4Addr::UNSPECIFIED);
        }
        let (rate, burst) = (self.lines_per_s, self.lines_per_s.max(1.0));
        let new = || Peer { lines: TokenBucket::new(rate, burst, now), suppressed: 0 };
        let peer = self.peers.entry(key).or_insert_with(new);
        let is_allowed = peer.lines.take(1.0, now);
        peer.suppressed += u64::from(!is_allowed);
        is_allowed
    }

    /// How many lines of each peer were suppressed since the last call. Forgets peers that cause
    /// none any more. To be called every few seconds.
    pub fn summaries(&mut self, now: Duration) -> Vec<(IpAddr, u64)> {
        let mut summaries = Vec::new();
        self.peers.retain(|address, peer| {
            let suppressed = std::mem::take(&mut peer.suppressed);
            if suppressed > 0 {
                summaries.push((*address, suppressed));
            }
            suppressed > 0 || !peer.lines.is_full(now)
        });
        summaries
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PEERS_MAX: usize = 1_024;

    #[test]
    fn one_peer_causes_few_lines_and_silences_no_other() {
        let mut limits = LogLimits::new(5.0, PEERS_MAX);
        let [loud, calm] = ["203.0.113.9", "198.51.100.7"].map(|a| a.parse::<IpAddr>().unwrap());
        let logged = |limits: &mut LogLimits, address, ms: std::ops::Range<u64>| {
            ms.filter(|ms| limits.allows(address, Duration::from_millis(*ms))).count()
        };
        assert_eq!(logged(&mut limits, loud, 0..1_000), 9);
        assert!(logged(&mut limits, loud, 1_000..10_000) <= 45);
        assert_eq!(logged(&mut limits, calm, 9_999..10_000), 1);
        let now = Duration::from_secs(10);
        assert_eq!(limits.summaries(now), [(loud, 10_000 - 54)]);
        assert_eq!(limits.summaries(now + Duration::from_secs(10)), []);
        assert!(limits.peers.is_empty(), "a silent peer is forgotten");
    }

    #[test]
    fn the_memory_for_peers_has_a_limit() {
        let mut limits = LogLimits::new(5.0, PEERS_MAX);
        for i in 0..5_000_u32 {
            limits.allows(IpAddr::V4(i.to_be_bytes().into()), Duration::ZERO);
        }
        assert!(limits.peers.len() <= PEERS_MAX + 1);
    }
}
