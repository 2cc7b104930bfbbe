//! What a session's methods and its task share.

use std::{
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use quinn::Connection;
use sightline_client_core::presence::Presence;

use super::super::piece_traffic::PieceTraffic;

/// The state of a session, shared by its methods and its task.
pub(super) struct SharedState {
    started: Instant,
    locked: Mutex<LockedState>,
    pub(super) messages_in: AtomicU64,
    pub(super) messages_out: AtomicU64,
    pub(super) bytes_in: AtomicU64,
    pub(super) bytes_out: AtomicU64,
}

/// The part of the state behind a lock.
pub(super) struct LockedState {
    pub(super) connection: Connection,
    pub(super) presence: Presence,
    /// The pieces of its world, where that comes in pieces.
    pub(super) pieces: Option<Arc<PieceTraffic>>,
    /// Why the session ended; `None` while it runs.
    pub(super) end: Option<String>,
    pub(super) meter: RateMeter,
    /// The UDP bytes received and sent on connections that broke.
    udp_before: [u64; 2],
}

/// Measures UDP bytes per second in both directions, once a second.
#[derive(Default)]
pub(super) struct RateMeter {
    /// When the current second began.
    at: Duration,
    /// The bytes received and sent until then.
    bytes: [u64; 2],
    /// The bytes received and sent in the second before it, per second.
    rate: [f64; 2],
}

impl SharedState {
    /// The state of a session that starts now.
    pub(super) fn new(
        connection: Connection,
        presence: Presence,
        pieces: Option<Arc<PieceTraffic>>,
    ) -> Self {
        let locked = LockedState {
            connection,
            presence,
            pieces,
            end: None,
            meter: RateMeter::default(),
            udp_before: [0; 2],
        };
        Self {
            started: Instant::now(),
            locked: Mutex::new(locked),
            messages_in: AtomicU64::new(0),
            messages_out: AtomicU64::new(0),
            bytes_in: AtomicU64::new(0),
            bytes_out: AtomicU64::new(0),
        }
    }

    /// The time since the session started.
    pub(super) fn now(&self) -> Duration {
        self.started.elapsed()
    }

    /// A moment as the time since the session started.
    pub(super) fn time_of(&self, moment: Instant) -> Duration {
        moment.saturating_duration_since(self.started)
    }

    /// Locks the state. A panic elsewhere leaves it usable: no holder of the lock stops half way.
    pub(super) fn lock(&self) -> MutexGuard<'_, LockedState> {
        self.locked.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a received message.
    pub(super) fn count_received(&self, bytes: usize) {
        self.messages_in.fetch_add(1, Relaxed);
        self.bytes_in.fetch_add(bytes as u64, Relaxed);
    }

    /// Counts a sent message.
    pub(super) fn count_sent(&self, bytes: usize) {
        self.messages_out.fetch_add(1, Relaxed);
        self.bytes_out.fetch_add(bytes as u64, Relaxed);
    }
}

impl LockedState {
    /// The UDP bytes received and sent so far.
    pub(super) fn udp_bytes(&self) -> [u64; 2] {
        let stats = self.connection.stats();
        [self.udp_before[0] + stats.udp_rx.bytes, self.udp_before[1] + stats.udp_tx.bytes]
    }

    /// Goes on counting on another connection.
    pub(super) fn change_connection(&mut self, connection: Connection) {
        self.udp_before = self.udp_bytes();
        self.connection = connection;
    }
}

impl RateMeter {
    /// Takes in the bytes received and sent since the connection opened.
    pub(super) fn read(&mut self, now: Duration, bytes: [u64; 2]) {
        let passed = now.saturating_sub(self.at).as_secs_f64();
        if passed >= 1.0 {
            let rate = |i: usize| bytes[i].saturating_sub(self.bytes[i]) as f64 / passed;
            self.rate = [rate(0), rate(1)];
            (self.at, self.bytes) = (now, bytes);
        }
    }

    /// The bytes received and sent in the last second, per second.
    pub(super) fn rate(&self) -> [f64; 2] {
        self.rate
    }
}
