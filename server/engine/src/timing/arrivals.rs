//! Arrivals: when a client's reports arrive, against when it made them.

use std::{collections::VecDeque, time::Duration};

use crate::{bus::Lags, config::Margin};

/// How many reports are kept.
const REPORTS_MAX: usize = 64;
/// With fewer reports than this nothing is known of the jitter.
const REPORTS_MIN: usize = 16;
/// An older report is forgotten if enough newer ones are there.
const REPORT_AGE_MAX: Duration = Duration::from_secs(20);
/// The margin is this multiple of the measured spread, over [`SAFETY_PER`], for jitter that has not
/// been seen yet.
const SAFETY: u32 = 5;
const SAFETY_PER: u32 = 4;
/// The time that a report between two ticks carries may be too late, by up to a tick divided by
/// this number: the times of a client's reports ascend, however shortly one follows another.
const AHEAD_PARTS: u32 = 16;
/// That time may be too early, by up to a tick divided by this number: it is rounded down on the
/// wire.
const ROUNDING_PARTS: u32 = 64;
/// The part of the margin for clocks and threads.
const MARGIN_MIN: Duration = Duration::from_millis(2);

/// When a client's reports arrive.
///
/// Reports carry the client's own time. The *lag* of a report is the time between that and its
/// arrival, on two clocks, so it is known up to a constant. A message takes half of the round trip
/// of its time, and jitter. The spread of the lags is the measured jitter. A message that a stream
/// had to send again counts as jitter, too. What delays reports also delays what is sent to the
/// client.
#[derive(Clone, Debug)]
pub(crate) struct Arrivals {
    margin: Margin,
    measured: Option<Duration>,
    /// The last reports, oldest first.
    reports: VecDeque<Arrival>,
    /// The least and the greatest lag of these.
    lags_us: [i64; 2],
    /// The least lag of these, at most.
    least_us: i64,
    /// The greatest lag of these less half of the round trip of its time, without those that were
    /// later than the margin allows.
    slowest_us: i64,
}

#[derive(Clone, Copy, Debug)]
struct Arrival {
    heard: Duration,
    lag_us: i64,
    /// The least and the greatest lag that it may have had.
    within_us: [i64; 2],
    /// Half of the round trip that was known then.
    one_way_us: i64,
}

impl Arrival {
    /// The least lag that it may have had, less half of the round trip of its time: the difference
    /// of both clocks, and jitter.
    fn beyond_us(&self) -> i64 {
        self.within_us[0] - self.one_way_us
    }
}

/// The last moment of which a client's word is known for sure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LastKnown {
    /// How long after the last report that is, on the client's clock.
    pub(crate) after: Duration,
    /// How long ago that is at most.
    pub(crate) age: Duration,
}

impl Arrivals {
    pub(crate) fn new(margin: Margin) -> Self {
        Self {
            margin,
            measured: None,
            reports: VecDeque::new(),
            lags_us: [0; 2],
            least_us: 0,
            slowest_us: 0,
        }
    }

    /// What another station has found of a client of its own.
    pub(crate) fn relayed(lags: &Lags) -> Self {
        let Lags { margin, least_us, slowest_us, quickest_us } = *lags;
        let lags_us = [quickest_us; 2];
        Self { lags_us, least_us, slowest_us, ..Self::new(Margin::Fixed(margin)) }
    }

    /// What another station is told.
    pub(crate) fn lags(&self) -> Lags {
        let Self { least_us, slowest_us, lags_us: [quickest_us, _], .. } = *self;
        Lags { margin: self.margin(), least_us, slowest_us, quickest_us }
    }

    /// The time by which a message may be later than half of the round trip.
    pub(crate) fn margin(&self) -> Duration {
        match self.margin {
            Margin::Fixed(margin) => margin,
            Margin::Measured { first, most } => self.measured.unwrap_or(first).min(most),
        }
    }

    /// Takes in the arrival of a report that was made at a time on the client's clock. A message
    /// takes `one_way` at least, as far as is known now.
    pub(crate) fn hear(
        &mut self,
        now: Duration,
        made: Duration,
        tick: Duration,
        one_way: Duration,
    ) {
        let lag_us = micros(now) - micros(made);
        let is_at_tick = made.as_nanos().is_multiple_of(tick.as_nanos().max(1));
        let within_us = if is_at_tick {
            [lag_us; 2]
        } else {
            [lag_us - micros(tick / ROUNDING_PARTS), lag_us + micros(tick / AHEAD_PARTS)]
        };
        let one_way_us = micros(one_way);
        self.reports.push_back(Arrival { heard: now, lag_us, within_us, one_way_us });
        let is_old = |oldest: &Arrival| oldest.heard + REPORT_AGE_MAX < now;
        while self.reports.len() > REPORTS_MAX
            || self.reports.len() > REPORTS_MIN && self.reports.front().is_some_and(is_old)
        {
            self.reports.pop_front();
        }
        let lags = || self.reports.iter().map(|arrival| arrival.lag_us);
        self.lags_us = [lags().min().unwrap_or(0), lags().max().unwrap_or(0)];
        self.least_us = self.reports.iter().map(|a| a.within_us[1]).min().unwrap_or(0);
        if self.reports.len() >= REPORTS_MIN {
            self.measured = Some(self.spread() * SAFETY / SAFETY_PER + MARGIN_MIN);
        }
        let beyond = || self.reports.iter().map(Arrival::beyond_us);
        let on_time_us = beyond().min().unwrap_or(0) + micros(self.margin());
        self.slowest_us = beyond().filter(|us| *us <= on_time_us).max().unwrap_or(0);
    }

    /// The last of the client's ticks of which it is known by now whether it reported, or the time
    /// of its last report, which was made at `made`.
    ///
    /// A report that the client made at its own time `c` has arrived by `c` + least lag + margin.
    /// So what was not heard by then was not said.
    pub(crate) fn last_known(&self, now: Duration, made: Duration, tick: Duration) -> LastKnown {
        let margin_us = micros(self.margin());
        let heard_us = micros(now) - self.least_us - margin_us;
        let tick_us = micros(tick).max(1);
        let known_us = (heard_us.div_euclid(tick_us) * tick_us).max(micros(made));
        // Each report took half of the round trip of its time and the margin at most. The slowest
        // one says the most about the clocks. One that was later says nothing.
        let age_us = (micros(now) - known_us - self.slowest_us + margin_us).max(0);
        LastKnown {
            after: Duration::from_micros((known_us - micros(made)).unsigned_abs()),
            age: Duration::from_micros(age_us.unsigned_abs()),
        }
    }

    /// How long after a report that was made at `made` the client makes what arrives now, if it is
    /// not late.
    pub(crate) fn after(&self, now: Duration, made: Duration) -> Duration {
        let after_us = micros(now) - self.lags_us[0] - micros(made);
        Duration::from_micros(after_us.max(0).unsigned_abs())
    }

    /// By how much a report that was made at `made` and arrives now is later than the fastest of
    /// the last ones.
    pub(crate) fn lateness(&self, now: Duration, made: Duration) -> Duration {
        if self.reports.is_empty() {
            return Duration::ZERO;
        }
        Duration::from_micros((micros(now) - micros(made) - self.least_us).max(0).unsigned_abs())
    }

    /// By how much the slowest of the last reports was later than the fastest.
    fn spread(&self) -> Duration {
        let [least_us, most_us] = self.lags_us;
        Duration::from_micros(most_us.abs_diff(least_us))
    }
}

fn micros(time: Duration) -> i64 {
    i64::try_from(time.as_micros()).unwrap_or(i64::MAX / 4)
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::SmallRng};

    use super::*;

    const TICK: Duration = Duration::from_millis(50);
    const ONE_WAY: Duration = Duration::from_millis(40);
    const MARGIN: Margin =
        Margin::Measured { first: Duration::from_millis(25), most: Duration::from_millis(100) };

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// The arrivals of reports that are each as late as a random part of the jitter. The client's
    /// clock is 300 ms behind.
    fn heard(reports: u32, jitter: Duration) -> Arrivals {
        let (mut known, mut rng) = (Arrivals::new(MARGIN), SmallRng::seed_from_u64(7));
        for made in (1..=reports).map(|i| TICK * i) {
            known.hear(ms(300) + made + jitter.mul_f64(rng.random()), made, TICK, ONE_WAY);
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
        assert_eq!(Arrivals::new(Margin::Fixed(ms(7))).margin(), ms(7));
    }

    #[test]
    fn silence_is_no_jitter_and_a_late_report_is_forgotten_in_time() {
        let mut known = heard(100, Duration::ZERO);
        for i in 0..30 {
            let made = Duration::from_secs(60 + i);
            let late = if i == 2 { ms(30) } else { Duration::ZERO };
            known.hear(ms(300) + made + late, made, TICK, ONE_WAY);
            assert_eq!(known.margin() > ms(30), (2..=22).contains(&i), "{i}");
        }
    }

    #[test]
    fn silence_speaks_for_ticks_whose_reports_would_have_arrived() {
        let known = heard(100, Duration::ZERO);
        let made = TICK * 100;
        // Reports arrive 300 ms after the client's own time, and at most 2 ms later.
        let at = |now_ms: u64| known.last_known(made + ms(300 + now_ms), made, TICK);
        assert_eq!(at(0), LastKnown { after: ms(0), age: ms(42) });
        assert_eq!(at(51), LastKnown { after: ms(0), age: ms(93) });
        assert_eq!(at(52), LastKnown { after: TICK, age: ms(44) });
        assert_eq!(at(1_002), LastKnown { after: TICK * 20, age: ms(44) });
    }

    #[test]
    fn a_message_that_is_too_late_does_not_show_that_the_others_were_fast() {
        let mut known = Arrivals::new(Margin::Fixed(ms(20)));
        known.hear(TICK + ms(300), TICK, TICK, ONE_WAY);
        known.hear(TICK * 2 + ms(308), TICK * 2, TICK, ONE_WAY);
        let age = |known: &Arrivals| known.last_known(TICK * 3 + ms(300), TICK * 3, TICK).age;
        assert_eq!(age(&known), ms(40 + 12));
        known.hear(TICK * 3 + ms(400), TICK * 3, TICK, ONE_WAY);
        assert_eq!(age(&known), ms(40 + 12));
    }

    #[test]
    fn a_round_trip_that_falls_makes_nothing_younger() {
        let mut known = Arrivals::new(Margin::Fixed(ms(25)));
        // Both reports of a longer round trip are on time, and so is the one of a shorter.
        let reports = [(40, 0), (40, 24), (20, 24)];
        for (i, (one_way_ms, late_ms)) in (1..).zip(reports) {
            let way = ms(one_way_ms + late_ms);
            known.hear(TICK * i + ms(300) + way, TICK * i, TICK, ms(one_way_ms));
        }
        let heard = TICK * 3 + ms(300 + 20 + 24);
        assert_eq!(known.last_known(heard, TICK * 3, TICK).age, ms(20 + 25));
    }

    #[test]
    fn an_answer_that_bears_a_later_time_makes_no_report_early() {
        let mut known = heard(100, Duration::ZERO);
        let (made, later) = (TICK * 100, TICK / 32);
        known.hear(made + ms(300), made + later, TICK, ONE_WAY);
        let at = made + TICK + ms(301);
        assert_eq!(known.last_known(at, made + later, TICK).after, Duration::ZERO);
    }

    #[test]
    fn what_counts_as_known_was_said_whatever_the_jitter() {
        let mut rng = SmallRng::seed_from_u64(3);
        for _ in 0..200 {
            let (jitter_ms, one_way_ms) = (rng.random_range(0..60), rng.random_range(0..100));
            let mut known = Arrivals::new(Margin::Fixed(ms(jitter_ms)));
            let clock = ms(rng.random_range(0..1_000));
            let mut last: Option<Duration> = None;
            for i in 1..200u32 {
                let made = TICK * i;
                let truly = made + clock;
                if rng.random_bool(0.1) {
                    let way = ms(one_way_ms + rng.random_range(0..=jitter_ms));
                    known.hear(truly + way, made, TICK, ms(one_way_ms));
                    last = Some(made);
                }
                let Some(last) = last else { continue };
                let now = truly + ms(rng.random_range(200..400));
                let found = known.last_known(now, last, TICK);
                // Any report made by then has arrived, and it was not longer ago than that.
                let then = last + found.after + clock;
                assert!(found.after.is_zero() || then + ms(one_way_ms + jitter_ms) <= now);
                assert!(then + found.age >= now, "{found:?}");
            }
        }
    }
}
