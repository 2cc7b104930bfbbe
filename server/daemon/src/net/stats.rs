//! What the server counts.

use std::{
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
    time::Duration,
};

use serde::Serialize;
use sightline_cli::percentile::percentile;

use sightline_engine as engine;

/// Ticks whose durations are remembered.
const TICKS_MAX: usize = 2_048;

/// What was sent to a client and came from it: application messages, without QUIC's own.
#[derive(Debug, Default)]
pub struct Counters {
    frames_in: AtomicU64,
    frame_bytes_in: AtomicU64,
    datagrams_in: AtomicU64,
    datagram_bytes_in: AtomicU64,
    frames_out: AtomicU64,
    frame_bytes_out: AtomicU64,
    datagrams_out: AtomicU64,
    datagram_bytes_out: AtomicU64,
    world_bytes_out: AtomicU64,
}

/// A copy of `Counters` at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Traffic {
    /// Control messages received.
    pub frames_in: u64,
    /// Their bytes, lengths included.
    pub frame_bytes_in: u64,
    /// Datagrams received.
    pub datagrams_in: u64,
    /// Their bytes.
    pub datagram_bytes_in: u64,
    /// Control messages sent.
    pub frames_out: u64,
    /// Their bytes, lengths included.
    pub frame_bytes_out: u64,
    /// Datagrams sent.
    pub datagrams_out: u64,
    /// Their bytes.
    pub datagram_bytes_out: u64,
    /// Bytes of the world file sent.
    pub world_bytes_out: u64,
}

impl Counters {
    /// A control message came, of so many bytes.
    pub fn frame_in(&self, bytes: usize) {
        self.frames_in.fetch_add(1, Relaxed);
        self.frame_bytes_in.fetch_add(bytes as u64, Relaxed);
    }

    /// A datagram came, of so many bytes.
    pub fn datagram_in(&self, bytes: usize) {
        self.datagrams_in.fetch_add(1, Relaxed);
        self.datagram_bytes_in.fetch_add(bytes as u64, Relaxed);
    }

    /// Control messages went, of so many bytes altogether.
    pub fn frames_out(&self, frames: u64, bytes: usize) {
        self.frames_out.fetch_add(frames, Relaxed);
        self.frame_bytes_out.fetch_add(bytes as u64, Relaxed);
    }

    /// A datagram went, of so many bytes.
    pub fn datagram_out(&self, bytes: usize) {
        self.datagrams_out.fetch_add(1, Relaxed);
        self.datagram_bytes_out.fetch_add(bytes as u64, Relaxed);
    }

    /// A piece of the world file went.
    pub fn world_out(&self, bytes: usize) {
        self.world_bytes_out.fetch_add(bytes as u64, Relaxed);
    }

    /// As it stands.
    pub fn traffic(&self) -> Traffic {
        Traffic {
            frames_in: self.frames_in.load(Relaxed),
            frame_bytes_in: self.frame_bytes_in.load(Relaxed),
            datagrams_in: self.datagrams_in.load(Relaxed),
            datagram_bytes_in: self.datagram_bytes_in.load(Relaxed),
            frames_out: self.frames_out.load(Relaxed),
            frame_bytes_out: self.frame_bytes_out.load(Relaxed),
            datagrams_out: self.datagrams_out.load(Relaxed),
            datagram_bytes_out: self.datagram_bytes_out.load(Relaxed),
            world_bytes_out: self.world_bytes_out.load(Relaxed),
        }
    }
}

/// How the engine does, as of its last tick.
#[derive(Debug, Default)]
pub struct Pulse(Mutex<Beat>);

#[derive(Debug, Default)]
struct Beat {
    ticks: u64,
    /// How long the last ticks took, in a ring.
    times: Vec<Duration>,
    counts: engine::Counts,
    stats: engine::Stats,
}

/// How long ticks took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct TickSummary {
    /// Ticks since the start.
    pub ticks: u64,
    /// Half of the last ticks took no longer, in microseconds.
    pub median_us: u64,
    /// 99 of 100 took no longer, in microseconds.
    pub p99_us: u64,
    /// None took longer, in microseconds.
    pub max_us: u64,
}

impl Pulse {
    /// A tick took so long, and this is how the engine is now.
    pub fn record(&self, time: Duration, counts: engine::Counts, stats: engine::Stats) {
        let mut beat = self.beat();
        let place = beat.ticks as usize % TICKS_MAX;
        beat.ticks += 1;
        (beat.counts, beat.stats) = (counts, stats);
        match beat.times.get_mut(place) {
            Some(slot) => *slot = time,
            None => beat.times.push(time),
        }
    }

    /// How many clients are in which state, and what the engine counted.
    pub fn engine(&self) -> (engine::Counts, engine::Stats) {
        let beat = self.beat();
        (beat.counts, beat.stats)
    }

    /// What the last ticks come to.
    pub fn ticks(&self) -> TickSummary {
        let (ticks, mut times) = {
            let beat = self.beat();
            (beat.ticks, beat.times.clone())
        };
        times.sort_unstable();
        let at = |percent| percentile(&times, percent).unwrap_or_default().as_micros() as u64;
        TickSummary { ticks, median_us: at(50), p99_us: at(99), max_us: at(100) }
    }

    fn beat(&self) -> MutexGuard<'_, Beat> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_ticks_count() {
        let pulse = Pulse::default();
        assert_eq!(pulse.ticks(), TickSummary::default());
        let record = |time| {
            let counts = engine::Counts { live: 3, ..engine::Counts::default() };
            pulse.record(time, counts, engine::Stats::default());
        };
        record(Duration::from_secs(9));
        for us in 0..TICKS_MAX as u64 {
            record(Duration::from_micros(us));
        }
        let ticks = pulse.ticks();
        assert_eq!(ticks.ticks, TICKS_MAX as u64 + 1);
        assert_eq!((ticks.median_us, ticks.p99_us, ticks.max_us), (1_023, 2_027, 2_047));
        assert_eq!(pulse.engine().0.live, 3);
    }
}
