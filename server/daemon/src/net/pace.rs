//! How often the engine ticks when the machine cannot keep up. No clock is needed here.

use std::time::Duration;

/// The rate falls by these factors, step by step.
const FACTORS: [u32; 3] = [1, 2, 4];
/// The rate falls when this number of ticks in a row take longer than their time.
const OVERRUNS: u32 = 3;
/// The rate rises when ticks would have fitted into this part of the shorter time, in per cent.
const SPARE_PER_CENT: u32 = 60;
/// How long they must have fitted. Two steps take less than five seconds.
const CALM: Duration = Duration::from_millis(1_500);

/// How often the engine ticks.
#[derive(Clone, Debug)]
pub struct Pace {
    interval: Duration,
    step: usize,
    /// How many of the last ticks in a row took longer than their time.
    overruns: u32,
    /// For how long ticks have been short enough for a higher rate.
    calm: Duration,
}

impl Pace {
    /// The full rate, of a tick in each interval.
    pub fn new(interval: Duration) -> Self {
        Self { interval, step: 0, overruns: 0, calm: Duration::ZERO }
    }

    /// How many steps the rate is below the full rate: 0 to 2.
    pub fn step(&self) -> usize {
        self.step
    }

    /// By how much the rate is lower than the full rate: 1, 2 or 4.
    pub fn factor(&self) -> u32 {
        FACTORS[self.step]
    }

    /// The time from tick to tick.
    pub fn interval(&self) -> Duration {
        self.interval * self.factor()
    }

    /// Takes in how long a tick was at work, or half of the time by which it was late for want of a
    /// processor: whichever is more.
    /// Returns whether the rate changes.
    pub fn take(&mut self, spent: Duration) -> bool {
        if spent > self.interval() {
            self.overruns += 1;
        } else {
            self.overruns = 0;
        }
        let faster = self.step.saturating_sub(1);
        let would_fit = spent < self.interval * FACTORS[faster] * SPARE_PER_CENT / 100;
        self.calm = if would_fit { self.calm + self.interval() } else { Duration::ZERO };
        let step = if self.overruns >= OVERRUNS {
            (self.step + 1).min(FACTORS.len() - 1)
        } else if self.calm >= CALM {
            faster
        } else {
            self.step
        };
        let changes = step != self.step;
        if changes {
            (self.step, self.overruns, self.calm) = (step, 0, Duration::ZERO);
        }
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: Duration = Duration::from_millis(50);

    fn after(pace: &mut Pace, ticks: u32, spent_ms: u64) -> u32 {
        for _ in 0..ticks {
            pace.take(Duration::from_millis(spent_ms));
        }
        pace.factor()
    }

    #[test]
    fn the_rate_falls_in_steps_while_ticks_take_too_long() {
        let mut pace = Pace::new(TICK);
        assert_eq!(after(&mut pace, 100, 49), 1);
        assert_eq!(after(&mut pace, 2, 3_000), 1, "a stop alone is no overload");
        assert_eq!(after(&mut pace, 1, 10), 1);
        assert_eq!(after(&mut pace, 3, 60), 2);
        assert_eq!(after(&mut pace, 100, 60), 2, "at half of the rate it fits");
        assert_eq!(after(&mut pace, 3, 120), 4);
        assert_eq!(after(&mut pace, 100, 10_000), 4, "there is no lower rate");
    }

    #[test]
    fn the_rate_recovers_within_five_seconds() {
        let mut pace = Pace::new(TICK);
        after(&mut pace, 6, 1_000);
        assert_eq!((pace.factor(), pace.step()), (4, 2));
        let mut passed = Duration::ZERO;
        while pace.step() > 0 {
            passed += pace.interval();
            pace.take(Duration::from_millis(20));
        }
        assert!(passed <= Duration::from_secs(5), "{passed:?}");
        assert_eq!(after(&mut pace, 100, 20), 1);
    }
}
