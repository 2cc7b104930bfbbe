//! How long the engine's ticks take.

use std::{
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use serde::{Deserialize, Serialize};
use sightline_cli::percentile::percentile;
use sightline_engine::{Counts, Stats};

use super::Histogram;

/// How many of the last ticks are summarised: 1.7 minutes at 20 ticks a second.
const TICKS_MAX: usize = 2_048;

/// The times of the last ticks, and the engine's own statistics after the last one. The engine's
/// task records, any task reads.
#[derive(Debug, Default)]
pub(crate) struct TickMetrics(Mutex<Recorded>);

#[derive(Debug, Default)]
struct Recorded {
    /// Ticks since the start.
    ticks: u64,
    /// How long the last ticks took: a ring of at most [`TICKS_MAX`].
    times: Vec<Stages>,
    by_stage: StageTimes,
    round_trips: Histogram,
    counts: Counts,
    stats: Stats,
}

/// How long the stages of all ticks took.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageTimes {
    /// Taking in what clients did.
    pub take: Histogram,
    /// The engine's own tick.
    pub engine: Histogram,
    /// Handing out what clients are told.
    pub tell: Histogram,
}

/// How long the stages of one tick took.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Stages {
    /// Taking in what clients did.
    pub(crate) taken: Duration,
    /// The engine's own tick.
    pub(crate) ticked: Duration,
    /// Handing out what clients are told.
    pub(crate) told: Duration,
}

/// How long the last ticks took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TickSummary {
    /// Ticks since the start.
    pub ticks: u64,
    /// The median, in microseconds.
    pub median_us: u64,
    /// The 99th percentile, in microseconds.
    pub p99_us: u64,
    /// The longest, in microseconds.
    pub max_us: u64,
    /// Of the stage that takes in what clients did: the 99th percentile, in microseconds.
    pub take_p99_us: u64,
    /// Of the engine's own tick: the 99th percentile, in microseconds.
    pub engine_p99_us: u64,
    /// Of the stage that hands out what clients are told: the 99th percentile, in microseconds.
    pub tell_p99_us: u64,
}

impl TickMetrics {
    /// Records a tick: how long its stages took, and the engine's statistics after it.
    pub(crate) fn record(&self, time: Stages, counts: Counts, stats: Stats) {
        let mut recorded = self.recorded();
        let place = recorded.ticks as usize % TICKS_MAX;
        recorded.ticks += 1;
        (recorded.counts, recorded.stats) = (counts, stats);
        recorded.by_stage.take.record(time.taken);
        recorded.by_stage.engine.record(time.ticked);
        recorded.by_stage.tell.record(time.told);
        match recorded.times.get_mut(place) {
            Some(slot) => *slot = time,
            None => recorded.times.push(time),
        }
        debug_assert!(recorded.times.len() <= TICKS_MAX, "the ring has a limit");
    }

    /// Records the clients' round trips at one time.
    pub(crate) fn record_round_trips(&self, times: impl Iterator<Item = Duration>) {
        let mut recorded = self.recorded();
        times.for_each(|time| recorded.round_trips.record(time));
    }

    /// How long the stages of all ticks took, and the round trips of all clients, each once a
    /// second.
    pub(crate) fn histograms(&self) -> (StageTimes, Histogram) {
        let recorded = self.recorded();
        (recorded.by_stage, recorded.round_trips)
    }

    /// How many clients were in each state after the last tick, and the engine's statistics.
    pub(crate) fn engine(&self) -> (Counts, Stats) {
        let recorded = self.recorded();
        (recorded.counts, recorded.stats)
    }

    /// The summary of the last ticks.
    pub(crate) fn summary(&self) -> TickSummary {
        let (ticks, times) = {
            let recorded = self.recorded();
            (recorded.ticks, recorded.times.clone())
        };
        let us = |of: fn(&Stages) -> Duration, percent| {
            let mut times: Vec<Duration> = times.iter().map(of).collect();
            times.sort_unstable();
            percentile(&times, percent).unwrap_or_default().as_micros() as u64
        };
        let whole = |stages: &Stages| stages.taken + stages.ticked + stages.told;
        TickSummary {
            ticks,
            median_us: us(whole, 50),
            p99_us: us(whole, 99),
            max_us: us(whole, 100),
            take_p99_us: us(|stages| stages.taken, 99),
            engine_p99_us: us(|stages| stages.ticked, 99),
            tell_p99_us: us(|stages| stages.told, 99),
        }
    }

    fn recorded(&self) -> MutexGuard<'_, Recorded> {
        // A panic while the lock is held leaves at worst one wrong time.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_summary_covers_the_last_ticks_only() {
        let metrics = TickMetrics::default();
        assert_eq!(metrics.summary(), TickSummary::default());
        let record = |ticked| {
            let counts = Counts { live: 3, ..Counts::default() };
            metrics.record(Stages { ticked, ..Stages::default() }, counts, Stats::default());
        };
        record(Duration::from_secs(9));
        for us in 0..TICKS_MAX as u64 {
            record(Duration::from_micros(us));
        }
        let summary = metrics.summary();
        assert_eq!(summary.ticks, TICKS_MAX as u64 + 1);
        assert_eq!((summary.median_us, summary.p99_us, summary.max_us), (1_023, 2_027, 2_047));
        assert_eq!((summary.engine_p99_us, summary.tell_p99_us), (2_027, 0));
        assert_eq!(metrics.engine().0.live, 3);
        metrics.record_round_trips([Duration::from_millis(40); 2].into_iter());
        let (stages, round_trips) = metrics.histograms();
        assert_eq!((stages.engine.count(), round_trips.count()), (TICKS_MAX as u64 + 1, 2));
        assert!(stages.engine.sum() > stages.tell.sum());
    }
}
