//! Limits on what peers may take: connections for each address, messages for each client. No
//! sockets and no clocks are needed here.

use std::{
    collections::HashMap,
    net::{IpAddr, Ipv6Addr},
    time::Duration,
};

/// How many connections each address has. An IPv6 address stands for its /64 network, since one
/// subscriber has at least that. There are at most as many entries as connections.
#[derive(Debug, Default)]
pub struct AddressCounts {
    counts: HashMap<IpAddr, usize>,
}

impl AddressCounts {
    /// Counts a new connection, if its address has fewer than `connections_max`. The server's own
    /// machine has no limit.
    pub fn admit(&mut self, address: IpAddr, connections_max: usize) -> bool {
        let is_own_machine = address.to_canonical().is_loopback();
        let network = network(address);
        let count = self.counts.get(&network).copied().unwrap_or_default();
        if count >= connections_max && !is_own_machine {
            return false;
        }
        self.counts.insert(network, count + 1);
        true
    }

    /// Removes a connection that was admitted.
    pub fn release(&mut self, address: IpAddr) {
        let network = network(address);
        let count = self.counts.get_mut(&network);
        debug_assert!(count.is_some(), "{address} was not admitted");
        if let Some(count) = count {
            *count -= 1;
            if *count == 0 {
                self.counts.remove(&network);
            }
        }
    }
}

/// The network that an address stands for.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => {
            let [a, b, c, d, ..] = v6.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
        v4 => v4,
    }
}

/// A token bucket: it allows a burst at once, and a rate in the long run.
#[derive(Clone, Debug)]
pub struct TokenBucket {
    per_second: f64,
    burst: f64,
    level: f64,
    filled_at: Duration,
}

impl TokenBucket {
    /// A full bucket.
    pub fn new(per_second: f64, burst: f64, now: Duration) -> Self {
        assert!(per_second > 0.0 && burst > 0.0, "{per_second} a second, {burst} at once");
        Self { per_second, burst, level: burst, filled_at: now }
    }

    /// Takes an amount out, if the bucket holds as much.
    pub fn take(&mut self, amount: f64, now: Duration) -> bool {
        let passed = now.saturating_sub(self.filled_at).as_secs_f64();
        self.level = (self.level + passed * self.per_second).min(self.burst);
        self.filled_at = self.filled_at.max(now);
        let holds_enough = self.level >= amount;
        if holds_enough {
            self.level -= amount;
        }
        holds_enough
    }
}

/// How many messages and bytes one client may send. A client that goes on after its budget is spent
/// is disconnected in the end.
#[derive(Clone, Debug)]
pub struct MessageBudget {
    messages: TokenBucket,
    bytes: TokenBucket,
    /// How many messages over the budget are tolerated.
    tolerated: TokenBucket,
}

/// What is done with a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BudgetDecision {
    /// Handle it.
    Accept,
    /// Ignore it.
    Ignore,
    /// Disconnect the client.
    Disconnect,
}

impl MessageBudget {
    /// How many messages may arrive at once, for example after the path has stalled.
    const MESSAGES_BURST: f64 = 128.0;
    /// Bytes for each message of the budget, on average.
    const MESSAGE_BYTES: f64 = 128.0;
    /// How many bytes may arrive at once.
    const BYTES_BURST: f64 = 16.0 * 1_024.0;

    /// A budget of two messages for each tick.
    pub fn new(tick_hz: u32, now: Duration) -> Self {
        let per_second = 2.0 * f64::from(tick_hz);
        let bytes_per_second = per_second * Self::MESSAGE_BYTES;
        Self {
            messages: TokenBucket::new(per_second, Self::MESSAGES_BURST, now),
            bytes: TokenBucket::new(bytes_per_second, Self::BYTES_BURST, now),
            tolerated: TokenBucket::new(per_second, 4.0 * Self::MESSAGES_BURST, now),
        }
    }

    /// Charges a message to the budget.
    pub fn charge(&mut self, bytes: usize, now: Duration) -> BudgetDecision {
        if self.messages.take(1.0, now) && self.bytes.take(bytes as f64, now) {
            BudgetDecision::Accept
        } else if self.tolerated.take(1.0, now) {
            BudgetDecision::Ignore
        } else {
            BudgetDecision::Disconnect
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_are_limited_for_each_network_but_not_for_the_own_machine() {
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
        assert!(counts.counts.is_empty(), "released addresses leave no entry");
    }

    #[test]
    fn a_steady_client_is_accepted_and_a_flood_disconnects() {
        let mut budget = MessageBudget::new(20, Duration::ZERO);
        for i in 0..10_000 {
            let now = Duration::from_millis(i * 25);
            assert_eq!(
                budget.charge(60, now),
                BudgetDecision::Accept,
                "at the limit of 40 a second"
            );
        }
        let now = Duration::from_secs(300);
        let decisions: Vec<_> = (0..2_000).map(|_| budget.charge(60, now)).collect();
        let count = |decision| decisions.iter().filter(|d| **d == decision).count();
        assert_eq!((count(BudgetDecision::Accept), count(BudgetDecision::Ignore)), (128, 512));
        assert_eq!(decisions.last(), Some(&BudgetDecision::Disconnect));
    }

    #[test]
    fn large_messages_spend_the_budget_of_bytes() {
        let mut budget = MessageBudget::new(20, Duration::ZERO);
        let taken =
            (0..100).filter(|_| budget.charge(1_200, Duration::ZERO) == BudgetDecision::Accept);
        assert_eq!(taken.count(), 13);
    }

    #[test]
    fn a_clock_that_goes_back_does_not_fill_the_bucket() {
        let mut bucket = TokenBucket::new(10.0, 1.0, Duration::from_secs(9));
        assert!(bucket.take(1.0, Duration::from_secs(9)));
        assert!(!bucket.take(1.0, Duration::from_secs(1)));
        assert!(!bucket.take(1.0, Duration::from_secs(9)));
        assert!(bucket.take(1.0, Duration::from_secs(10)));
    }
}
