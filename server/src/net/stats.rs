//! What the server counts.

use std::{
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
    time::Duration,
};

use serde::Serialize;

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

/// A copy of [`Counters`] at one time.
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

/// How long the last ticks took.
#[derive(Debug, Default)]
pub struct TickTimes(Mutex<Ring>);

#[derive(Debug, Default)]
struct Ring {
    ticks: u64,
    times: Vec<Duration>,
}

/// What [`TickTimes`] come to.
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

impl TickTimes {
    /// A tick took so long.
    pub fn record(&self, time: Duration) {
        let mut ring = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let place = ring.ticks as usize % TICKS_MAX;
        ring.ticks += 1;
        match ring.times.get_mut(place) {
            Some(slot) => *slot = time,
            None => ring.times.push(time),
        }
    }

    /// What the last ticks come to.
    pub fn summary(&self) -> TickSummary {
        let (ticks, mut times) = {
            let ring = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            (ring.ticks, ring.times.clone())
        };
        times.sort_unstable();
        let at = |hundredths: usize| {
            let place = (times.len() * hundredths / 100).min(times.len().saturating_sub(1));
            times.get(place).map_or(0, |time| time.as_micros() as u64)
        };
        TickSummary { ticks, median_us: at(50), p99_us: at(99), max_us: at(100) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_ticks_count() {
        let times = TickTimes::default();
        assert_eq!(times.summary(), TickSummary::default());
        times.record(Duration::from_secs(9));
        for us in 0..TICKS_MAX as u64 {
            times.record(Duration::from_micros(us));
        }
        let summary = times.summary();
        assert_eq!(summary.ticks, TICKS_MAX as u64 + 1);
        assert_eq!((summary.median_us, summary.max_us), (1_024, 2_047));
        assert_eq!(summary.p99_us, 2_027);
    }
}
