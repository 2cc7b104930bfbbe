//! Poses in datagrams: quantised, and delta-coded against what the client has acknowledged.

use crate::motion::{AvatarId, Pose};

/// What a client has received: the newest sequence, and a bit for each of the 32 before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Ack {
    /// The newest datagram received.
    pub newest: u32,
    /// Bit `i` is set when datagram `newest - 1 - i` was received too.
    pub earlier: u32,
}

/// The server's end of one client's pose stream.
#[derive(Clone, Debug, Default)]
pub struct PoseEncoder {}

impl PoseEncoder {
    /// Writes the datagrams, each at most [`DATAGRAM_BYTES_MAX`] long, that tell the client these
    /// poses as they were at a tick.
    pub fn encode(&mut self, _tick: u32, _poses: &[(AvatarId, Pose)]) -> Vec<Vec<u8>> {
        Vec::new()
    }

    /// Takes in what the client says it has received; nonsense is ignored.
    pub fn acknowledge(&mut self, _ack: Ack) {}
}

/// No datagram is longer.
pub const DATAGRAM_BYTES_MAX: usize = 1_200;
