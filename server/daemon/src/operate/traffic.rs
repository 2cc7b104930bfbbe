//! What was sent to clients and received from them.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use serde::Serialize;
use sightline_protocol::message::{ClientMessage, ServerMessage};

use super::Totals;

/// How many kinds of control messages clients have, and one for what is none.
const KINDS_IN: usize = ClientMessage::KINDS.len() + 1;
/// How many kinds of control messages the server has.
const KINDS_OUT: usize = ServerMessage::KINDS.len();

/// Messages and their bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Messages.
    pub messages: u64,
    /// Bytes, without what QUIC itself adds.
    pub bytes: u64,
}

impl Tally {
    /// Counts a message.
    pub(crate) fn add(&mut self, bytes: usize) {
        self.messages += 1;
        self.bytes += bytes as u64;
    }
}

/// A tally that many tasks add to.
#[derive(Debug, Default)]
pub(super) struct SharedTally {
    messages: AtomicU64,
    bytes: AtomicU64,
}

impl SharedTally {
    pub(super) fn add(&self, more: Tally) {
        self.messages.fetch_add(more.messages, Relaxed);
        self.bytes.fetch_add(more.bytes, Relaxed);
    }

    pub(super) fn tally(&self) -> Tally {
        Tally { messages: self.messages.load(Relaxed), bytes: self.bytes.load(Relaxed) }
    }
}

/// The control messages that were sent to a client at one time, by the numbers of their kinds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct SentFrames([Tally; KINDS_OUT]);

impl SentFrames {
    /// Counts a frame, with its length prefix.
    pub(crate) fn add(&mut self, frame: &[u8]) {
        let kind = frame.get(PREFIX_BYTES).copied().map_or(KINDS_OUT, usize::from);
        debug_assert!(kind < KINDS_OUT, "the server sends known kinds only");
        if let Some(tally) = self.0.get_mut(kind) {
            tally.add(frame.len());
        }
    }
}

/// The length prefix of a frame, in bytes.
const PREFIX_BYTES: usize = 2;

/// Counters of application messages, without what QUIC itself adds: of a client, or of all clients
/// since the start.
#[derive(Debug, Default)]
pub(crate) struct TrafficCounters {
    frames_in: [SharedTally; KINDS_IN],
    datagrams_in: SharedTally,
    frames_out: [SharedTally; KINDS_OUT],
    datagrams_out: SharedTally,
    world_out: SharedTally,
}

/// The counts of application messages at one time.
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

impl Traffic {
    /// All messages and bytes, without the kinds.
    pub(crate) fn totals(&self) -> Totals {
        Totals {
            messages_in: self.frames_in + self.datagrams_in,
            bytes_in: self.frame_bytes_in + self.datagram_bytes_in,
            messages_out: self.frames_out + self.datagrams_out,
            bytes_out: self.frame_bytes_out + self.datagram_bytes_out,
            world_bytes_out: self.world_bytes_out,
        }
    }
}

impl TrafficCounters {
    /// Counts a control message that was received, without its length prefix.
    pub(crate) fn frame_in(&self, frame: &[u8]) {
        let kind = frame.first().map_or(KINDS_IN, |kind| usize::from(*kind)).min(KINDS_IN - 1);
        let bytes = (frame.len() + PREFIX_BYTES) as u64;
        self.frames_in[kind].add(Tally { messages: 1, bytes });
    }

    /// Counts a datagram that was received.
    pub(crate) fn datagram_in(&self, bytes: usize) {
        self.datagrams_in.add(Tally { messages: 1, bytes: bytes as u64 });
    }

    /// Counts control messages that were sent.
    pub(crate) fn frames_out(&self, frames: &SentFrames) {
        let sent = self.frames_out.iter().zip(&frames.0).filter(|(_, more)| more.messages > 0);
        sent.for_each(|(tally, more)| tally.add(*more));
    }

    /// Counts a datagram that was sent.
    pub(crate) fn datagram_out(&self, bytes: usize) {
        self.datagrams_out.add(Tally { messages: 1, bytes: bytes as u64 });
    }

    /// Counts a piece of the world file that was sent.
    pub(crate) fn world_out(&self, bytes: usize) {
        self.world_out.add(Tally { messages: 1, bytes: bytes as u64 });
    }

    /// What was received, by the names of kinds.
    pub(crate) fn received(&self) -> impl Iterator<Item = (&'static str, Tally)> + '_ {
        let names = ClientMessage::KINDS.into_iter().chain(["unknown"]);
        let frames = names.zip(self.frames_in.iter().map(SharedTally::tally));
        frames.chain([("datagram", self.datagrams_in.tally())])
    }

    /// What was sent, by the names of kinds. Pieces of the world file are of the kind `download`.
    pub(crate) fn sent(&self) -> impl Iterator<Item = (&'static str, Tally)> + '_ {
        let frames = ServerMessage::KINDS.into_iter().zip(&self.frames_out);
        let frames = frames.map(|(name, tally)| (name, tally.tally()));
        let others = [("poses", &self.datagrams_out), ("download", &self.world_out)];
        frames.chain(others.map(|(name, tally)| (name, tally.tally())))
    }

    /// The counts at present.
    pub(crate) fn traffic(&self) -> Traffic {
        let (frames_in, frames_out) = (sum(&self.frames_in), sum(&self.frames_out));
        let (datagrams_in, datagrams_out) = (self.datagrams_in.tally(), self.datagrams_out.tally());
        Traffic {
            frames_in: frames_in.messages,
            frame_bytes_in: frames_in.bytes,
            datagrams_in: datagrams_in.messages,
            datagram_bytes_in: datagrams_in.bytes,
            frames_out: frames_out.messages,
            frame_bytes_out: frames_out.bytes,
            datagrams_out: datagrams_out.messages,
            datagram_bytes_out: datagrams_out.bytes,
            world_bytes_out: self.world_out.tally().bytes,
        }
    }
}

fn sum(tallies: &[SharedTally]) -> Tally {
    tallies.iter().map(SharedTally::tally).fold(Tally::default(), |sum, more| Tally {
        messages: sum.messages + more.messages,
        bytes: sum.bytes + more.bytes,
    })
}

#[cfg(test)]
mod tests {
    use sightline_protocol::{frame, message::Refusal};

    use super::*;

    #[test]
    fn messages_are_counted_by_kind_each_way() {
        let counters = TrafficCounters::default();
        let goodbye = frame::encode(&ClientMessage::Goodbye);
        counters.frame_in(&goodbye[2..]);
        for unknown in [&[][..], &[7], &[255, 0]] {
            counters.frame_in(unknown);
        }
        counters.datagram_in(40);
        let mut sent = SentFrames::default();
        sent.add(&frame::encode(&ServerMessage::Ask));
        sent.add(&frame::encode(&ServerMessage::Ask));
        sent.add(&frame::encode(&ServerMessage::Refused { reason: Refusal::Full }));
        counters.frames_out(&sent);
        counters.datagram_out(1_000);
        counters.world_out(9);
        let of = |tallies: Vec<(&'static str, Tally)>| {
            let seen = tallies.into_iter().filter(|(_, tally)| tally.messages > 0);
            seen.map(|(name, tally)| (name, tally.messages, tally.bytes)).collect::<Vec<_>>()
        };
        let received = of(counters.received().collect());
        assert_eq!(received, [("goodbye", 1, 3), ("unknown", 3, 9), ("datagram", 1, 40)]);
        let sent = of(counters.sent().collect());
        assert_eq!(
            sent,
            [("refused", 1, 4), ("ask", 2, 6), ("poses", 1, 1_000), ("download", 1, 9)]
        );
        let traffic = counters.traffic();
        assert_eq!((traffic.frames_in, traffic.frame_bytes_in), (4, 12));
        assert_eq!((traffic.frames_out, traffic.frame_bytes_out), (3, 10));
        assert_eq!((traffic.datagrams_out, traffic.world_bytes_out), (1, 9));
    }
}
