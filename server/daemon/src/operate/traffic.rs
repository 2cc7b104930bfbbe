//! What was sent to a client and received from it.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use serde::Serialize;

/// Counters of a client's application messages, without what QUIC itself adds.
#[derive(Debug, Default)]
pub(crate) struct TrafficCounters {
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

/// The counts of a client's application messages at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Traffic {
    /// Control messages received.
    pub frames_in: u64,
    /// Bytes of control messages received, with their length prefixes.
    pub frame_bytes_in: u64,
    /// Datagrams received.
    pub datagrams_in: u64,
    /// Bytes of datagrams received.
    pub datagram_bytes_in: u64,
    /// Control messages sent.
    pub frames_out: u64,
    /// Bytes of control messages sent, with their length prefixes.
    pub frame_bytes_out: u64,
    /// Datagrams sent.
    pub datagrams_out: u64,
    /// Bytes of datagrams sent.
    pub datagram_bytes_out: u64,
    /// Bytes of the world file sent.
    pub world_bytes_out: u64,
}

impl TrafficCounters {
    /// Counts a control message that was received.
    pub(crate) fn frame_in(&self, bytes: usize) {
        self.frames_in.fetch_add(1, Relaxed);
        self.frame_bytes_in.fetch_add(bytes as u64, Relaxed);
    }

    /// Counts a datagram that was received.
    pub(crate) fn datagram_in(&self, bytes: usize) {
        self.datagrams_in.fetch_add(1, Relaxed);
        self.datagram_bytes_in.fetch_add(bytes as u64, Relaxed);
    }

    /// Counts control messages that were sent, and their bytes together.
    pub(crate) fn frames_out(&self, frames: u64, bytes: usize) {
        debug_assert!((frames == 0) == (bytes == 0), "{frames} frames in {bytes} bytes");
        self.frames_out.fetch_add(frames, Relaxed);
        self.frame_bytes_out.fetch_add(bytes as u64, Relaxed);
    }

    /// Counts a datagram that was sent.
    pub(crate) fn datagram_out(&self, bytes: usize) {
        self.datagrams_out.fetch_add(1, Relaxed);
        self.datagram_bytes_out.fetch_add(bytes as u64, Relaxed);
    }

    /// Counts a piece of the world file that was sent.
    pub(crate) fn world_out(&self, bytes: usize) {
        self.world_bytes_out.fetch_add(bytes as u64, Relaxed);
    }

    /// The counts at present.
    pub(crate) fn traffic(&self) -> Traffic {
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
