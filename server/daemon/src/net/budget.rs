//! Limits on how often something may happen: messages and bytes of each client, lines of the log.
//! No clocks are needed here.

use std::time::Duration;

use super::config::Limits;

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

    /// Whether nothing was taken out for a while.
    pub fn is_full(&self, now: Duration) -> bool {
        let passed = now.saturating_sub(self.filled_at).as_secs_f64();
        self.level + passed * self.per_second >= self.burst
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

/// All messages over the budget are forgiven after this time, in seconds.
const FORGIVEN_S: f64 = 60.0;

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
    /// A full budget. More messages than usual arrive at once after the path has stalled.
    pub fn new(tick_hz: u32, limits: &Limits, now: Duration) -> Self {
        let per_second = limits.messages_per_tick * f64::from(tick_hz);
        let bytes_per_second = per_second * limits.message_bytes;
        Self {
            messages: TokenBucket::new(per_second, limits.messages_burst, now),
            bytes: TokenBucket::new(bytes_per_second, limits.bytes_burst, now),
            tolerated: TokenBucket::new(
                limits.messages_tolerated / FORGIVEN_S,
                limits.messages_tolerated,
                now,
            ),
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

/// What QUIC, UDP and IP add to a datagram, in bytes.
const PACKET_BYTES: f64 = 60.0;

/// How many bytes one client may be sent. Poses wait while it is spent; control messages do not,
/// and leave less to poses. Time passes by ticks.
#[derive(Clone, Debug)]
pub struct SendBudget {
    /// Seconds from tick to tick.
    tick_s: f64,
    /// What is left. It is at most, and at least but for the sign, what a second brings.
    level: f64,
    tick: u32,
}

impl SendBudget {
    /// A budget of which nothing is spent, at a server with this time from tick to tick.
    pub fn new(tick_interval: Duration) -> Self {
        Self { tick_s: tick_interval.as_secs_f64(), level: f64::INFINITY, tick: 0 }
    }

    /// Takes in that it is another tick, and how much a second brings.
    pub fn pass(&mut self, tick: u32, per_second: f64) {
        let passed_s = f64::from(tick.saturating_sub(self.tick)) * self.tick_s;
        self.level = (self.level + passed_s * per_second).clamp(-per_second, per_second);
        self.tick = tick;
    }

    /// How long a datagram may be.
    pub fn room(&self) -> usize {
        (self.level - PACKET_BYTES).max(0.0) as usize
    }

    /// Takes in that control messages are sent.
    pub fn spend(&mut self, bytes: usize) {
        self.level -= bytes as f64;
    }

    /// Takes in that a datagram is sent.
    pub fn spend_datagram(&mut self, bytes: usize) {
        self.level -= bytes as f64 + PACKET_BYTES;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_client_is_accepted_and_a_flood_disconnects() {
        let mut budget = MessageBudget::new(20, &Limits::default(), Duration::ZERO);
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
    fn a_client_that_always_sends_a_little_too_much_is_disconnected() {
        let mut budget = MessageBudget::new(20, &Limits::default(), Duration::ZERO);
        let is_over = |i: u64| {
            let decision = budget.charge(60, Duration::from_millis(i * 1_000 / 60));
            decision == BudgetDecision::Disconnect
        };
        let first = (0..60 * 600).position(is_over).expect("60 a second are too many");
        assert!((60 * 20..60 * 120).contains(&first), "after {} s", first / 60);
    }

    #[test]
    fn poses_take_what_control_messages_leave() {
        let mut budget = SendBudget::new(Duration::from_millis(50));
        let mut sent = 0;
        for tick in 1..=200 {
            budget.pass(tick, 10_000.0);
            if (101..=120).contains(&tick) {
                budget.spend(1_000);
            }
            let room = budget.room().min(1_150);
            if room >= 128 {
                budget.spend_datagram(room);
                sent += room + 60;
            }
        }
        // What is there at the first tick and what 199 more bring, without control messages.
        let most = 10_000 + 199 * 500 - 20_000;
        assert!((most - 300..=most).contains(&sent), "{sent} bytes");
        (0..100).for_each(|_| budget.spend(1_000_000));
        budget.pass(201, 10_000.0);
        budget.pass(222, 10_000.0);
        assert!(budget.room() > 128, "no debt is older than a second");
    }

    #[test]
    fn large_messages_spend_the_budget_of_bytes() {
        let mut budget = MessageBudget::new(20, &Limits::default(), Duration::ZERO);
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
