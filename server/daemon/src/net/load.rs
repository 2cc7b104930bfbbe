//! What the engine's thread tells the sessions of its load, and they tell it.

use std::{
    sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed},
    time::Duration,
};

use crate::operate::{OverloadStats, Reason};

/// When a client that is refused for overload may come again.
const RETRY: Duration = Duration::from_secs(2);

/// The load of a server.
#[derive(Debug, Default)]
pub struct Load {
    /// When this number of clients wait to enter, others must come again later.
    waiting_max: usize,
    /// How many steps the tick rate is below the full rate.
    step: AtomicUsize,
    /// How many clients wait to enter.
    waiting: AtomicUsize,
    steps_down: AtomicU64,
    steps_up: AtomicU64,
    refused: AtomicU64,
}

impl Load {
    /// No load yet. At most this number of clients may wait to enter.
    pub fn new(waiting_max: usize) -> Self {
        Self { waiting_max, ..Self::default() }
    }

    /// Takes in the step of the tick rate. Returns the one before.
    pub fn set_step(&self, step: usize) -> usize {
        let before = self.step.swap(step, Relaxed);
        let counter = if step > before { &self.steps_down } else { &self.steps_up };
        counter.fetch_add(1, Relaxed);
        before
    }

    /// Takes in that a client waits to enter.
    pub fn waits(&self) {
        self.waiting.fetch_add(1, Relaxed);
    }

    /// Takes in that clients wait no more.
    pub fn entered(&self, clients: usize) {
        self.waiting.fetch_sub(clients, Relaxed);
    }

    /// Whether a newcomer must come again later, why and when. Counts it.
    pub fn refuses(&self) -> Option<(Reason, Duration)> {
        let reason = if self.step.load(Relaxed) > 0 {
            Reason::Overload
        } else if self.waiting.load(Relaxed) >= self.waiting_max {
            Reason::Entering
        } else {
            return None;
        };
        Some((reason, self.refuse()))
    }

    /// Counts a newcomer that must come again later. Returns when.
    pub fn refuse(&self) -> Duration {
        self.refused.fetch_add(1, Relaxed);
        RETRY
    }

    /// What has happened so far.
    pub fn stats(&self) -> OverloadStats {
        OverloadStats {
            step: self.step.load(Relaxed),
            steps_down: self.steps_down.load(Relaxed),
            steps_up: self.steps_up.load(Relaxed),
            joins_refused: self.refused.load(Relaxed),
            joins_waiting: self.waiting.load(Relaxed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newcomers_are_put_off_below_the_full_rate_and_while_many_wait() {
        const WAITING_MAX: usize = 7;
        let load = Load::new(WAITING_MAX);
        assert_eq!(load.refuses(), None);
        assert_eq!(load.set_step(1), 0);
        assert_eq!(load.refuses(), Some((Reason::Overload, RETRY)));
        assert_eq!(load.set_step(0), 1);
        assert_eq!(load.refuses(), None);
        (0..WAITING_MAX).for_each(|_| load.waits());
        assert_eq!(load.refuses(), Some((Reason::Entering, RETRY)));
        load.entered(1);
        assert_eq!(load.refuses(), None);
        let stats = load.stats();
        assert_eq!((stats.steps_down, stats.steps_up, stats.joins_refused), (1, 1, 2));
        assert_eq!((stats.step, stats.joins_waiting), (0, WAITING_MAX - 1));
    }
}
