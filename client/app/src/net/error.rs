//! Why a connection fails or ends.

use std::{io, net::SocketAddr};

use quinn::ConnectionError;
use sightline_client_core::replica::ReplicaError;
use sightline_protocol::{DecodeError, message::Refusal};
use sightline_world::ReadError;

use super::trust::TrustError;

/// The QUIC error code of a server that accepts no more connections (RFC 9000, section 20.1).
const CONNECTION_REFUSED: u64 = 2;

/// Why there is no session, or none any more.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// The system refuses a socket.
    #[error("cannot open a socket: {0}")]
    Socket(#[source] io::Error),
    /// TLS cannot be set up.
    #[error("cannot set up TLS: {0}")]
    Tls(#[from] rustls::Error),
    /// No connection can be made to the address.
    #[error("cannot connect to {address}: {reason}")]
    Address {
        /// The server's address.
        address: SocketAddr,
        /// Why not.
        reason: String,
    },
    /// The server did not answer in time.
    #[error("no answer from {0}")]
    NoAnswer(SocketAddr),
    /// The server accepts no more connections.
    #[error("the server accepts no more connections (from this address)")]
    NotAccepted,
    /// The server is not the expected one.
    #[error(transparent)]
    Trust(#[from] TrustError),
    /// The server refused this client.
    #[error("{0}")]
    Refused(Refusal),
    /// The server said goodbye.
    #[error("{reason}")]
    Goodbye {
        /// The reason.
        reason: String,
        /// Whether the client may come back by itself.
        may_return: bool,
    },
    /// The connection ended.
    #[error("connection lost: {0}")]
    Lost(String),
    /// The server sent bytes that are no message.
    #[error("the server sent a {0}")]
    Malformed(#[from] DecodeError),
    /// The server sent a message that does not fit the state of the session.
    #[error(transparent)]
    OutOfPlace(#[from] ReplicaError),
    /// The world is damaged, or not the one that the server announced.
    #[error("cannot use the server's world: {0}")]
    World(#[from] ReadError),
    /// The server announced a world above the size limit.
    #[error("the server's world has {0} bytes, which is more than the limit")]
    WorldTooLarge(u64),
}

impl ConnectError {
    /// Whether another attempt may succeed where this one did not.
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Socket(_) | Self::NoAnswer(_) | Self::NotAccepted | Self::Lost(_) => true,
            Self::Goodbye { may_return, .. } => *may_return,
            Self::Refused(refusal) => {
                matches!(refusal, Refusal::Full | Refusal::Closing | Refusal::Busy { .. })
            }
            Self::Tls(_)
            | Self::Address { .. }
            | Self::Trust(_)
            | Self::Malformed(_)
            | Self::OutOfPlace(_)
            | Self::World(_)
            | Self::WorldTooLarge(_) => false,
        }
    }
}

/// The error of a connection that ended.
pub(super) fn lost(error: ConnectionError) -> ConnectError {
    match error {
        ConnectionError::ConnectionClosed(close)
            if u64::from(close.error_code) == CONNECTION_REFUSED =>
        {
            ConnectError::NotAccepted
        }
        error => ConnectError::Lost(error.to_string()),
    }
}
