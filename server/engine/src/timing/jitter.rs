//! Jitter: how unevenly a client's messages arrive.

use std::time::Duration;

use crate::config::Margin;

/// How many successive reports are kept: three seconds of them.
const REPORTS: usize = 64;
/// With fewer reports than this nothing is known.
const REPORTS_MIN: usize = 16;
/// The margin is this multiple of the measured spread, over [`SAFETY_PER`], for jitter that has not
/// been seen yet.
const SAFETY: u32 = 5;
const SAFETY_PER: u32 = 4;
/// The part of the margin for clocks and threads.
const MARGIN_MIN: Duration = Duration::from_millis(2);

/// How much longer than half of its round trip a client's messages may take.
///
/// A live client makes a report at each tick, so without jitter reports arrive one tick apart. The
/// spread of the arrivals of the last reports, each against its own tick, is the measured jitter.
/// What delays reports also delays what is sent to the client.
#[derive(Clone, Debug)]
pub(crate) struct Jitter {
    margin: Margin,
    measured: Option<Duration>,
    /// For the last reports without a pause, the time from when each was due to when it arrived, up
    /// to a constant. Not in order.
    late_us: Vec<i64>,
    heard: usize,
}

impl Jitter {
    pub(crate) fn new(margin: Margin) -> Self {
        Self { margin, measured: None, late_us: Vec::new(), heard: 0 }
    }

    /// The time by which a message may be later than half of the round trip.
    pub(crate) fn margin(&self) -> Duration {
        match self.margin {
            Margin::Fixed(margin) => margin,
            Margin::Measured { first, most } => self.measured.unwrap_or(first).min(most),
        }
    }

    /// Takes in the arrival of a live client's report.
    pub(crate) fn hear(&mut self, now: Duration, sequence: u32, tick: Duration) {
        let Margin::Measured { .. } = self.margin else { return };
        let due = i128::from(sequence) * tick.as_micros() as i128;
        let late_us = (now.as_micros() as i128 - due) as i64;
        if self.late_us.len() < REPORTS {
            self.late_us.push(late_us);
        } else {
            self.late_us[self.heard % REPORTS] = late_us;
        }
        self.heard += 1;
        debug_assert!(self.late_us.len() <= REPORTS, "the window is bounded");
        let earliest = self.late_us.iter().min().copied().unwrap_or(0);
        let latest = self.late_us.iter().max().copied().unwrap_or(0);
        if self.late_us.len() >= REPORTS_MIN {
            let spread = Duration::from_micros(latest.abs_diff(earliest));
            self.measured = Some(spread * SAFETY / SAFETY_PER + MARGIN_MIN);
        }
    }

    /// Starts measuring anew after a silence: later reports are not due by earlier ones.
    pub(crate) fn restart(&mut self) {
        self.late_us.clear();
        self.heard = 0;
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::SmallRng};

    use super::*;

    const TICK: Duration = Duration::from_millis(50);
    const MARGIN: Margin =
        Margin::Measured { first: Duration::from_millis(25), most: Duration::from_millis(100) };

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// The jitter of a client after some reports, with delays drawn up to a bound.
    fn heard(reports: u32, jitter: Duration) -> Jitter {
        let (mut known, mut rng) = (Jitter::new(MARGIN), SmallRng::seed_from_u64(7));
        for sequence in 1..=reports {
            let late = jitter.mul_f64(rng.random());
            known.hear(ms(300) + TICK * sequence + late, sequence, TICK);
        }
        known
    }

    #[test]
    fn the_margin_is_the_measured_spread_and_a_little_more() {
        assert_eq!(heard(15, Duration::ZERO).margin(), ms(25), "too early to tell");
        assert_eq!(heard(16, Duration::ZERO).margin(), MARGIN_MIN);
        let uneven = heard(200, ms(40)).margin();
        assert!((ms(40)..ms(53)).contains(&uneven), "{uneven:?}");
        assert_eq!(heard(200, ms(400)).margin(), ms(100), "no more than is allowed");
        assert_eq!(Jitter::new(Margin::Fixed(ms(7))).margin(), ms(7));
    }

    #[test]
    fn a_pause_is_not_jitter_and_the_last_margin_stands() {
        let mut known = heard(100, Duration::ZERO);
        known.restart();
        for sequence in 101..=140 {
            known.hear(Duration::from_secs(60) + TICK * sequence, sequence, TICK);
            assert_eq!(known.margin(), MARGIN_MIN);
        }
        // A late report counts until it is three seconds old.
        for sequence in 141..=220 {
            known.hear(Duration::from_secs(60) + TICK * sequence + ms(30), sequence, TICK);
            assert_eq!(known.margin() > ms(30), sequence < 204, "{sequence}");
        }
    }
}
