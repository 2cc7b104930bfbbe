//! Poses in datagrams: quantised, and delta-coded against what the client has acknowledged.
//!
//! The server has a [`PoseEncoder`] for each client, the client a [`PoseDecoder`]. Each datagram
//! can be decoded from acknowledged ones alone, so a lost one costs nothing but freshness; a pose
//! whose datagram is not acknowledged is sent again until it is, even when it no longer changes.
//!
//! A datagram to a client is a sequence number, a tick, and an entry for each avatar in ascending
//! order of id: a byte of flags, the step from the preceding id, how many datagrams back the
//! baseline is (when it is not as for the preceding entry; 0 is "none, from zero"), and the
//! differences that the flags announce. A datagram to the server is an [`Ack`] and perhaps a
//! report. All numbers are variable-length.

mod decoder;
mod encoder;
mod entry;

pub use decoder::{PoseDecoder, PoseUpdate};
pub use encoder::PoseEncoder;

use super::{DecodeError, quantise::WirePose, varint};

/// No datagram is longer.
pub const DATAGRAM_BYTES_MAX: usize = 1_200;
/// No datagram tells of more avatars, so that little memory comes of it.
pub const ENTRIES_MAX: usize = 255;
/// No baseline is further back, in datagrams.
pub const BASELINE_DISTANCE_MAX: u32 = 64;

/// What a client has received: the newest sequence, and a bit for each of the 32 before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Ack {
    /// The newest datagram received; 0 is none, as the first has number 1.
    pub newest: u32,
    /// Bit `i` is set when datagram `newest - 1 - i` was received too.
    pub earlier: u32,
}

impl Ack {
    /// Whether it tells that a datagram was received.
    pub fn covers(&self, sequence: u32) -> bool {
        match self.newest.checked_sub(sequence) {
            Some(0) => sequence != 0,
            Some(back @ 1..=32) => self.earlier >> (back - 1) & 1 == 1,
            _ => false,
        }
    }
}

/// A datagram to the server: what came, and where the client is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct ClientDatagram {
    /// What came.
    pub ack: Ack,
    /// The number of the report and the pose; none from a client that only acknowledges.
    pub report: Option<(u32, WirePose)>,
}

impl ClientDatagram {
    /// As bytes.
    pub fn encode(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(40);
        varint::write(&mut out, self.ack.newest);
        // Mostly ones, so that its complement is short.
        varint::write(&mut out, !self.ack.earlier);
        if let Some((sequence, pose)) = &self.report {
            varint::write(&mut out, *sequence);
            entry::write_difference(&mut out, &WirePose::default(), pose);
        }
        out
    }

    /// From bytes.
    pub fn decode(mut bytes: &[u8]) -> Result<Self, DecodeError> {
        check_length(bytes)?;
        let newest = varint::read(&mut bytes)?;
        let ack = Ack { newest, earlier: !varint::read(&mut bytes)? };
        if bytes.is_empty() {
            return Ok(Self { ack, report: None });
        }
        let sequence = varint::read(&mut bytes)?;
        let flags = varint::read_byte(&mut bytes)?;
        let pose = entry::read_difference(&mut bytes, flags, &WirePose::default())?;
        if !bytes.is_empty() {
            return Err(DecodeError::Trailing);
        }
        Ok(Self { ack, report: Some((sequence, pose)) })
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
