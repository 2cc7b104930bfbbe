//! What travels between server and client.
//!
//! * [`message`]: control messages, on the one stream of a connection, in [`frame`]s.
//! * [`pose_stream`]: poses, in datagrams, delta-coded against what the client acknowledged.
//! * [`fingerprint`]: how a client knows a server.
//! * [`quantise`]: the one place where domain types become wire types and back.
//! * [`text`]: names and lines that are fit to be shown.
//!
//! A connection has one bidirectional stream, which the client opens, and one unidirectional
//! stream, which the server opens to send the world when it is asked to. No float travels, so no
//! NaN can; no length, index or character is trusted, so a value that decodes is a valid one.

pub mod fingerprint;
pub mod frame;
pub mod message;
#[cfg(feature = "engine")]
pub mod outbound;
pub mod pose_stream;
pub mod quantise;
pub mod text;
mod varint;

/// Both ends must speak the same version.
pub const VERSION: u32 = 2;
/// The TLS application protocol. It does not carry the version, so that a client of another
/// version can be told so in words.
pub const ALPN: &[u8] = b"sightline";

/// Why bytes from a peer are not what they should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The bytes end too early, or a value is out of its range.
    #[error("malformed message")]
    Malformed,
    /// Bytes are left over after the last field.
    #[error("a message with bytes after its end")]
    Trailing,
    /// Longer than any message may be.
    #[error("a message of {bytes} bytes, where {bytes_max} is the most")]
    TooLong {
        /// How long it claims to be.
        bytes: usize,
        /// How long it may be.
        bytes_max: usize,
    },
    /// Coded against a datagram that is not held any more.
    #[error("a pose coded against a datagram that is not at hand")]
    NoBaseline,
}
