//! The protocol between server and client, as bytes.
//!
//! * [`message`]: the control messages, [`ClientMessage`](message::ClientMessage) and
//!   [`ServerMessage`](message::ServerMessage), in [`frame`]s on a reliable stream.
//! * [`pose_stream`]: poses in datagrams. The server's [`PoseEncoder`](pose_stream::PoseEncoder)
//!   codes them against what the client's [`PoseDecoder`](pose_stream::PoseDecoder) has
//!   acknowledged.
//! * [`piece_stream`]: how pieces of a world are asked for, and sent.
//! * [`quantise`]: the only conversions between domain types and wire types.
//! * [`text`]: names and chat lines that are fit to be shown.
//! * [`fingerprint`]: how a client recognises a server, and a server its visitors.
//! * `outbound` (feature `engine`): the engine's output as messages and datagrams.
//! * `bus` (feature `engine`): what stations tell each other.
//!
//! A connection has one bidirectional stream, which the client opens. The server opens a
//! unidirectional stream to send the world when it is asked for it. Where the world is offered in
//! pieces, the client may open a second bidirectional stream for them. Client and server send each
//! other no floating-point number, so no NaN either. No length, index or character is trusted: a value that decodes
//! is valid.
//!
//! This crate knows no socket. A server sends a pose like this:
//!
//! ```
//! use std::time::Duration;
//!
//! use glam::Vec3;
//! use sightline_protocol::pose_stream::{PoseDecoder, PoseEncoder};
//! use sightline_world::motion::{AvatarId, Pose};
//!
//! let pose = Pose { eye: Vec3::new(2.0, 1.6, -3.0), ..Pose::default() };
//! let tick = Duration::from_millis(50);
//! let (mut server, mut client) = (PoseEncoder::new(tick), PoseDecoder::new(tick));
//! let viewer = Vec3::new(0.0, 1.6, 0.0);
//! server.tell(1, viewer, &[(AvatarId(7), pose)]);
//! let datagram = server.encode(1).expect("there is news");
//! let update = client.decode(&datagram)?.expect("it is new");
//! let shown = Pose::from(update.pose(AvatarId(7)).expect("it has this avatar"));
//! assert!(shown.eye.distance(pose.eye) < 0.002);
//! server.acknowledge(client.ack());
//! server.tell(2, viewer, &[(AvatarId(7), pose)]);
//! assert!(server.encode(2).is_none(), "nothing has changed");
//! # Ok::<(), sightline_protocol::DecodeError>(())
//! ```

#[cfg(feature = "engine")]
pub mod bus;
pub mod fingerprint;
pub mod frame;
pub mod message;
#[cfg(feature = "engine")]
pub mod outbound;
pub mod piece_stream;
pub mod pose_stream;
pub mod quantise;
pub mod text;
mod varint;

/// The version of the protocol, which both ends must share.
pub const VERSION: u32 = 12;
/// The TLS application protocol. It has no version, so that the server can tell a client of another
/// version the reason in words.
pub const ALPN: &[u8] = b"sightline";

/// Why bytes from a peer cannot be decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The bytes end too early, or a value is out of its range.
    #[error("malformed message")]
    Malformed,
    /// Bytes follow the last field.
    #[error("a message with bytes after its end")]
    Trailing,
    /// The message is longer than allowed.
    #[error("a message of {bytes} bytes, where {bytes_max} is the most")]
    TooLong {
        /// The length that it claims, in bytes.
        bytes: usize,
        /// The greatest length allowed, in bytes.
        bytes_max: usize,
    },
    /// A pose is coded against a datagram that the decoder does not hold.
    #[error("a pose coded against an unknown datagram")]
    NoBaseline,
}
