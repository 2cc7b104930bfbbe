//! Who may come in, and how much a peer may send: counts and budgets, without sockets or clocks.

use std::{
    collections::HashMap,
    net::{IpAddr, Ipv6Addr},
    time::Duration,
};

/// How many connections each address has. An IPv6 address stands for its /64, as one subscriber
/// has at least that. At most as many entries as there are connections.
#[derive(Debug, Default)]
pub struct AddressCounts {
    counts: HashMap<IpAddr, usize>,
}

impl AddressCounts {
    /// Counts a connection in, if its address has fewer than `connections_max`. The own machine
    /// has no limit.
    pub fn admit(&mut self, address: IpAddr, connections_max: usize) -> bool {
        let count = self.counts.entry(network(address)).or_default();
        if *count >= connections_max && !address.to_canonical().is_loopback() {
            return false;
        }
        *count += 1;
        true
    }

    /// Counts out a connection that was admitted.
    pub fn release(&mut self, address: IpAddr) {
        let network = network(address);
        if let Some(count) = self.counts.get_mut(&network) {
            *count -= 1;
            if *count == 0 {
                self.counts.remove(&network);
            }
        }
    }
}

fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => {
            let [a, b, c, d, ..] = v6.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
        v4 => v4,
    }
}

/// A token bucket: so much at once, and so much a second.
#[derive(Clone, Debug)]
pub struct Bucket {
    per_second: f64,
    burst: f64,
    level: f64,
    filled_at: Duration,
}

impl Bucket {
    /// A full bucket.
    pub fn new(per_second: f64, burst: f64, now: Duration) -> Self {
        Self { per_second, burst, level: burst, filled_at: now }
    }

    /// Takes an amount out, if there is as much.
    pub fn take(&mut self, amount: f64, now: Duration) -> bool {
        let passed = now.saturating_sub(self.filled_at).as_secs_f64();
        self.level = (self.level + passed * self.per_second).min(self.burst);
        self.filled_at = self.filled_at.max(now);
        let enough = self.level >= amount;
        if enough {
            self.level -= amount;
        }
        enough
    }
}

/// What one client may send: messages and bytes. A client that goes on after its budget is spent
/// is not worth listening to.
#[derive(Clone, Debug)]
pub struct Budget {
    messages: Bucket,
    bytes: Bucket,
    /// For what may go over the budget before the client has to go.
    patience: Bucket,
}

/// What becomes of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Listen to it.
    Take,
    /// Ignore it.
    Ignore,
    /// End the connection.
    Kick,
}

impl Budget {
    /// Messages that may come at once, as after a stall of the path.
    const MESSAGES_BURST: f64 = 128.0;
    /// Bytes for each message of the budget, on average.
    const MESSAGE_BYTES: f64 = 128.0;

    /// A budget of twice as many messages as there are ticks.
    pub fn new(tick_hz: u32, now: Duration) -> Self {
        let per_second = 2.0 * f64::from(tick_hz);
        let (rate, burst) = (per_second * Self::MESSAGE_BYTES, 16.0 * 1_024.0);
        Self {
            messages: Bucket::new(per_second, Self::MESSAGES_BURST, now),
            bytes: Bucket::new(rate, burst, now),
            patience: Bucket::new(per_second, 4.0 * Self::MESSAGES_BURST, now),
        }
    }

    /// Accounts for a message.
    pub fn judge(&mut self, bytes: usize, now: Duration) -> Verdict {
        if self.messages.take(1.0, now) && self.bytes.take(bytes as f64, now) {
            Verdict::Take
        } else if self.patience.take(1.0, now) {
            Verdict::Ignore
        } else {
            Verdict::Kick
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_capped_by_network_and_the_own_machine_is_not() {
        let mut counts = AddressCounts::default();
        let far: IpAddr = "203.0.113.9".parse().unwrap();
        let mapped: IpAddr = "::ffff:203.0.113.9".parse().unwrap();
        assert!(counts.admit(far, 2) && counts.admit(mapped, 2));
        assert!(!counts.admit(far, 2));
        counts.release(mapped);
        assert!(counts.admit(far, 2));
        let (six, same, other) = ("2001:db8::1", "2001:db8::2:0:0:0", "2001:db8:0:1::1");
        let [six, same, other] = [six, same, other].map(|a| a.parse::<IpAddr>().unwrap());
        assert!(counts.admit(six, 1) && !counts.admit(same, 1) && counts.admit(other, 1));
        for _ in 0..100 {
            assert!(counts.admit("127.0.0.1".parse().unwrap(), 1));
            assert!(counts.admit("::1".parse().unwrap(), 1));
        }
        for _ in 0..100 {
            counts.release("127.0.0.1".parse().unwrap());
            counts.release("::1".parse().unwrap());
        }
        for address in [far, far, six, other] {
            counts.release(address);
        }
        assert!(counts.counts.is_empty(), "nothing is remembered of those who left");
    }

    #[test]
    fn a_steady_client_is_heard_and_a_flood_is_kicked() {
        let mut budget = Budget::new(20, Duration::ZERO);
        for i in 0..10_000 {
            let now = Duration::from_millis(i * 25);
            assert_eq!(budget.judge(60, now), Verdict::Take, "at the limit of 40 a second");
        }
        let now = Duration::from_secs(300);
        let verdicts: Vec<_> = (0..2_000).map(|_| budget.judge(60, now)).collect();
        let count = |verdict| verdicts.iter().filter(|v| **v == verdict).count();
        assert_eq!((count(Verdict::Take), count(Verdict::Ignore)), (128, 512));
        assert_eq!(verdicts.last(), Some(&Verdict::Kick));
    }

    #[test]
    fn big_messages_spend_the_budget_of_bytes() {
        let mut budget = Budget::new(20, Duration::ZERO);
        let taken = (0..100).filter(|_| budget.judge(1_200, Duration::ZERO) == Verdict::Take);
        assert_eq!(taken.count(), 13);
    }

    #[test]
    fn a_clock_that_goes_back_fills_nothing() {
        let mut bucket = Bucket::new(10.0, 1.0, Duration::from_secs(9));
        assert!(bucket.take(1.0, Duration::from_secs(9)));
        assert!(!bucket.take(1.0, Duration::from_secs(1)));
        assert!(!bucket.take(1.0, Duration::from_secs(9)));
        assert!(bucket.take(1.0, Duration::from_secs(10)));
    }
}
