//! Messages between simulated clients and the server.

use std::{ops::Range, time::Duration};

use glam::Vec3;
use sightline_protocol::{
    VERSION, frame,
    message::ClientMessage,
    pose_stream::{Ack, ClientDatagram},
    text::Name,
};
use sightline_world::motion::{AvatarId, Pose, Tbv};

/// The avatar colour of every simulated client, sRGB.
pub(super) const COLOUR: [u8; 3] = [128; 3];

/// A message on its way.
#[derive(Clone, Debug)]
pub(super) enum Packet {
    Up(Uplink),
    Down(AvatarId, Downlink),
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

    /// Whether it travels in a datagram. All other packets travel on a stream.
    pub(super) fn is_datagram(&self) -> bool {
        match self {
            Self::Up(uplink) => matches!(uplink.request, Request::Report { on_stream: false, .. }),
            Self::Down(_, downlink) => matches!(downlink, Downlink::Poses { .. }),
        }
    }
}

/// A message to the server.
#[derive(Clone, Debug)]
pub(super) struct Uplink {
    pub(super) avatar: AvatarId,
    /// When the client looked up its pose.
    pub(super) sampled: Duration,
    /// The datagrams that the client has received.
    pub(super) ack: Ack,
    pub(super) request: Request,
}

/// What a client tells the server.
#[derive(Clone, Debug)]
pub(super) enum Request {
    Join { name: String, eye: Vec3 },
    Leave,
    Report { sequence: u32, pose: Pose, on_stream: bool },
    Relocate { pose: Pose },
}

impl Uplink {
    /// The lengths on the wire of the messages that carry it, in bytes.
    pub(super) fn lengths(&self) -> Vec<usize> {
        let framed = |message: &ClientMessage| frame::encode(message).len();
        match &self.request {
            Request::Join { name, eye } => {
                let hello = Name::new(name).map(|name| {
                    framed(&ClientMessage::Hello { version: VERSION, name, colour: COLOUR })
                });
                let enter = framed(&ClientMessage::Enter { place: Some((*eye).into()) });
                hello.into_iter().chain([enter]).collect()
            }
            Request::Leave => vec![framed(&ClientMessage::Goodbye)],
            Request::Report { sequence, pose, on_stream: true } => {
                vec![framed(&ClientMessage::Report { sequence: *sequence, pose: pose.into() })]
            }
            Request::Report { sequence, pose, on_stream: false } => {
                let report = Some((*sequence, pose.into()));
                vec![ClientDatagram { ack: self.ack, report }.encode().len()]
            }
            Request::Relocate { pose } => {
                vec![framed(&ClientMessage::Report { sequence: 0, pose: pose.into() })]
            }
        }
    }
}

/// A message to a client. Instead of poses it carries the times at which they were sampled, which
/// is all that the audit needs.
#[derive(Clone, Debug)]
pub(super) enum Downlink {
    Entered,
    /// The avatar, and when its pose was sampled.
    Appear(AvatarId, Duration),
    Vanish(AvatarId),
    Poses {
        /// The numbers of the datagrams.
        sequences: Range<u32>,
        /// Each avatar, and when its pose was sampled.
        poses: Vec<(AvatarId, Duration)>,
    },
    Live,
    Quiet(Tbv),
    Ask,
    Correct,
    Drop,
}
