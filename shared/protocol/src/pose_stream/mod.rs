//! Pose streams: quantised poses in datagrams, delta-coded against what the client has
//! acknowledged. A pose begins a course: it holds until a newer one arrives.
//!
//! The server has a [`PoseEncoder`] for each client; the client has a [`PoseDecoder`]. A datagram
//! depends on acknowledged datagrams only, so a lost one costs nothing but freshness. A pose is
//! sent again until its datagram is acknowledged, even when it no longer changes.
//!
//! A datagram to a client has a sequence number, a tick, and an entry for each avatar in ascending
//! order of id. An entry has:
//!
//! * a byte of flags;
//! * the step from the preceding entry's id;
//! * the distance to the baseline in datagrams, unless it is that of the preceding entry (0 stands
//!   for the default pose). The baseline is where the pose in that datagram leads by this tick, if
//!   the avatar keeps its velocity;
//! * the differences that the flags announce.
//!
//! A datagram to the server has an [`Ack`], and a report if there is one. All numbers have variable
//! length.

mod courses;
mod decoder;
mod draft;
mod encoder;
mod entry;
mod priority;

pub use decoder::{PoseDecoder, PoseUpdate};
pub use encoder::{PoseEncoder, RESEND_TICKS};
pub use priority::{NEAR_M, OVERDUE};

use serde::{Deserialize, Serialize};

use super::{
    DecodeError,
    quantise::{WirePose, WireReport},
    varint,
};

/// The greatest length of a datagram, in bytes.
pub const DATAGRAM_BYTES_MAX: usize = 1_150;
/// The greatest number of entries in a datagram. It bounds the memory that a datagram can demand.
pub const ENTRIES_MAX: usize = 255;
/// The greatest distance to a baseline, in datagrams.
pub const BASELINE_DISTANCE_MAX: u32 = 64;

/// Gaps that are farther back were acknowledged already.
const GAP_MAX: u32 = 3;

/// An acknowledgement: the newest datagram that a client has received, and which of the 32 before
/// it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Ack {
    /// The sequence number of the newest datagram received; 0 for none. The first datagram has 1.
    pub newest: u32,
    /// Bit `i` is set when datagram `newest - 1 - i` was received too.
    pub earlier: u32,
}

impl Ack {
    /// Whether one of the last few datagrams before the newest is missing.
    pub fn has_gap(&self) -> bool {
        let before = self.newest.saturating_sub(1).min(GAP_MAX);
        (0..before).any(|back| self.earlier >> back & 1 == 0)
    }

    /// Whether this acknowledges a datagram.
    pub fn covers(&self, sequence: u32) -> bool {
        match self.newest.checked_sub(sequence) {
            Some(0) => sequence != 0,
            Some(back @ 1..=32) => self.earlier >> (back - 1) & 1 == 1,
            _ => false,
        }
    }
}

/// A datagram to the server: an acknowledgement, and a report if there is one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct ClientDatagram {
    /// The datagrams that the client has received.
    pub ack: Ack,
    /// The report. `None` from a client that only acknowledges.
    pub report: Option<WireReport>,
}

impl ClientDatagram {
    /// Encodes the datagram.
    pub fn encode(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(40);
        varint::write(&mut out, self.ack.newest);
        // The bits are mostly ones, so the complement is a short number.
        varint::write(&mut out, !self.ack.earlier);
        if let Some(WireReport { made, orders, pose }) = &self.report {
            varint::write(&mut out, *made);
            varint::write(&mut out, *orders);
            entry::write_difference(&mut out, &WirePose::default(), pose);
        }
        debug_assert!(out.len() <= DATAGRAM_BYTES_MAX);
        out
    }

    /// Decodes a datagram from a client.
    pub fn decode(mut bytes: &[u8]) -> Result<Self, DecodeError> {
        check_length(bytes)?;
        let newest = varint::read(&mut bytes)?;
        let ack = Ack { newest, earlier: !varint::read(&mut bytes)? };
        if bytes.is_empty() {
            return Ok(Self { ack, report: None });
        }
        let (made, orders) = (varint::read(&mut bytes)?, varint::read(&mut bytes)?);
        let flags = varint::read_byte(&mut bytes)?;
        let pose = entry::read_difference(&mut bytes, flags, &WirePose::default())?;
        if !bytes.is_empty() {
            return Err(DecodeError::Trailing);
        }
        Ok(Self { ack, report: Some(WireReport { made, orders, pose }) })
    }
}

fn check_length(bytes: &[u8]) -> Result<(), DecodeError> {
    if bytes.len() > DATAGRAM_BYTES_MAX {
        let (bytes, bytes_max) = (bytes.len(), DATAGRAM_BYTES_MAX);
        return Err(DecodeError::TooLong { bytes, bytes_max });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
