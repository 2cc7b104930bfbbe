//! Messages between simulated clients and the server, as bytes.

use std::time::Duration;

use sightline_client_core::{replica::Outgoing, reporting::ReportReason};
use sightline_protocol::{
    frame::{self, FrameBuffer},
    message::{ClientMessage, ServerMessage},
    pose_stream::Ack,
    quantise::WireReport,
};
use sightline_world::motion::{AvatarId, Pose};

/// The avatar colour of every simulated client, sRGB.
pub(super) const COLOUR: [u8; 3] = [128; 3];

/// A message on its way.
#[derive(Clone, Debug)]
pub(super) enum Packet {
    Up(Uplink),
    Down(AvatarId, Payload),
}

/// Bytes on the wire.
#[derive(Clone, Debug)]
pub(super) enum Payload {
    /// A whole frame of a stream.
    Frame(Vec<u8>),
    /// A datagram.
    Datagram(Vec<u8>),
}

/// A message to the server.
#[derive(Clone, Debug)]
pub(super) struct Uplink {
    pub(super) avatar: AvatarId,
    /// When the client first sent what is in it; a pose in it is the one of that moment.
    pub(super) sent: Duration,
    /// What kind of report is in it, if there is one.
    pub(super) kind: ReportKind,
    pub(super) request: Request,
}

/// Why a message to the server has a report, if it has one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ReportKind {
    /// It has none, or the client reports at every tick.
    Routine,
    /// The client would be silent otherwise.
    ByException,
    /// The avatar departs from its course, of which the client would be silent otherwise.
    Departure,
}

impl ReportKind {
    /// The kind of a report that is due for a reason.
    pub(super) fn of(reason: Option<ReportReason>) -> Self {
        match reason {
            None | Some(ReportReason::EveryTick) => Self::Routine,
            Some(ReportReason::Departed) => Self::Departure,
            Some(_) => Self::ByException,
        }
    }
}

/// What a client tells the server.
#[derive(Clone, Debug)]
pub(super) enum Request {
    /// A message of the protocol.
    Bytes(Payload),
    /// The avatar was put elsewhere. A game's host announces that; the protocol has no message for
    /// it. Here it travels on the stream, as long as a report.
    Relocate { pose: Pose, ack: Option<Ack> },
}

impl Packet {
    /// The client that sends or receives it.
    pub(super) fn client(&self) -> AvatarId {
        match self {
            Self::Up(uplink) => uplink.avatar,
            Self::Down(to, _) => *to,
        }
    }

    pub(super) fn is_up(&self) -> bool {
        matches!(self, Self::Up(_))
    }

    /// The kind of the report in it.
    pub(super) fn kind(&self) -> ReportKind {
        match self {
            Self::Up(uplink) => uplink.kind,
            Self::Down(..) => ReportKind::Routine,
        }
    }

    /// Whether it says that the avatar was put elsewhere.
    pub(super) fn is_jump(&self) -> bool {
        matches!(self, Self::Up(Uplink { request: Request::Relocate { .. }, .. }))
    }

    /// Whether it travels in a datagram. All other packets travel on a stream.
    pub(super) fn is_datagram(&self) -> bool {
        match self {
            Self::Up(Uplink { request: Request::Bytes(payload), .. }) | Self::Down(_, payload) => {
                matches!(payload, Payload::Datagram(_))
            }
            Self::Up(Uplink { request: Request::Relocate { .. }, .. }) => false,
        }
    }
}

impl Uplink {
    /// What a client's replica sends at a time.
    pub(super) fn new(avatar: AvatarId, sent: Duration, outgoing: Outgoing) -> Self {
        let payload = match outgoing {
            Outgoing::Datagram(bytes) => Payload::Datagram(bytes),
            Outgoing::Message(message) => Payload::Frame(frame::encode(&message)),
        };
        let request = Request::Bytes(payload);
        Self { avatar, sent, kind: ReportKind::Routine, request }
    }

    /// Its length on the wire, in bytes.
    pub(super) fn length(&self) -> usize {
        match &self.request {
            Request::Bytes(payload) => payload.length(),
            Request::Relocate { pose, ack } => {
                let report = WireReport { made: 0, orders: 0, pose: pose.into() };
                let ack = ack.unwrap_or_default();
                frame::encode(&ClientMessage::Report { report, ack }).len()
            }
        }
    }
}

impl Payload {
    /// A message to a client.
    pub(super) fn of(message: &ServerMessage) -> Self {
        Self::Frame(frame::encode(message))
    }

    /// The length on the wire, in bytes.
    pub(super) fn length(&self) -> usize {
        match self {
            Self::Frame(bytes) | Self::Datagram(bytes) => bytes.len(),
        }
    }
}

/// Decodes a frame, as the reader of a stream does.
///
/// # Panics
/// When the bytes are no frame. Both ends are this program, so they are one.
pub(super) fn unframe<M>(
    bytes: &[u8],
    decode: impl Fn(&[u8]) -> Result<M, sightline_protocol::DecodeError>,
) -> M {
    let mut buffer = FrameBuffer::default();
    buffer.push(bytes);
    let frame = buffer.next_frame().ok().flatten();
    let message = frame.and_then(|frame| decode(frame).ok());
    message.expect("a frame that this program encoded")
}
