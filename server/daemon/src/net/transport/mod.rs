//! How a client is connected. Sessions, outboxes and the entrance know this module alone, and no
//! kind of connection.
//!
//! Each kind has a control stream, whose bytes arrive in order, and datagrams, of which only the
//! newest matter. A writer of datagrams first asks [how large one may
//! be](Transport::datagram_room): while the path is busy, poses wait where newer ones replace them.

mod quic;
#[cfg(feature = "web")]
mod web_socket;
#[cfg(feature = "web")]
mod web_transport;

use std::{net::SocketAddr, time::Duration};

use bytes::Bytes;
use sightline_protocol::fingerprint::KeyFingerprint;

pub use quic::{PieceStream, QuicTransport, WorldStream};
use quic::{QuicReader, QuicWriter};
#[cfg(feature = "web")]
pub use web_socket::WebSocketTransport;
#[cfg(feature = "web")]
use web_socket::{WebSocketReader, WebSocketWriter};
#[cfg(feature = "web")]
pub use web_transport::{VISIT_PATH, WebTransport};
#[cfg(feature = "web")]
use web_transport::{WebTransportReader, WebTransportWriter};

/// A client's connection.
pub enum Transport {
    /// A native client's.
    Quic(QuicTransport),
    /// A browser's.
    #[cfg(feature = "web")]
    WebTransport(WebTransport),
    /// A browser's, where there is no WebTransport.
    #[cfg(feature = "web")]
    WebSocket(WebSocketTransport),
}

/// The half of the control stream on which the client is heard.
pub enum ControlReader {
    Quic(QuicReader),
    #[cfg(feature = "web")]
    WebTransport(WebTransportReader),
    #[cfg(feature = "web")]
    WebSocket(WebSocketReader),
}

/// The half of the control stream on which the client is told something.
pub enum ControlWriter {
    Quic(QuicWriter),
    #[cfg(feature = "web")]
    WebTransport(WebTransportWriter),
    #[cfg(feature = "web")]
    WebSocket(WebSocketWriter),
}

/// Why nothing more arrives or is sent.
#[derive(Clone, Debug, thiserror::Error)]
pub enum TransportError {
    /// The client itself closed the connection, or ended the stream.
    #[error("the client closed it")]
    Closed,
    /// The connection broke.
    #[error("{0}")]
    Lost(String),
    /// The client sent what no client sends.
    #[cfg(feature = "web")]
    #[error("{0}")]
    Breach(&'static str),
}

/// Why the server closes a connection.
#[derive(Clone, Copy, Debug)]
pub enum CloseCode {
    /// The session is over, and the client was told.
    Ended = 0,
    /// There was no hello.
    NoHello = 1,
    /// There are too many connections: QUIC's own code for it (RFC 9000, section 20.1).
    Refused = 2,
    /// The session failed.
    Failed = 3,
}

impl Transport {
    /// Waits until the client has opened its control stream.
    pub async fn control(&self) -> Result<(ControlWriter, ControlReader), TransportError> {
        match self {
            Self::Quic(quic) => {
                let (writer, reader) = quic.control().await?;
                Ok((ControlWriter::Quic(writer), ControlReader::Quic(reader)))
            }
            #[cfg(feature = "web")]
            Self::WebTransport(web) => {
                let (writer, reader) = web.control().await?;
                Ok((ControlWriter::WebTransport(writer), ControlReader::WebTransport(reader)))
            }
            #[cfg(feature = "web")]
            Self::WebSocket(socket) => {
                let (writer, reader) = socket.control().await?;
                Ok((ControlWriter::WebSocket(writer), ControlReader::WebSocket(reader)))
            }
        }
    }

    /// The greatest length of a datagram that may be sent now, in bytes; `None` while the path is
    /// busy.
    pub fn datagram_room(&self) -> Option<usize> {
        match self {
            Self::Quic(quic) => quic.datagram_room(),
            #[cfg(feature = "web")]
            Self::WebTransport(web) => web.datagram_room(),
            #[cfg(feature = "web")]
            Self::WebSocket(socket) => socket.datagram_room(),
        }
    }

    /// Sends a datagram, which may be lost.
    pub fn send_datagram(&self, datagram: Vec<u8>) -> Result<(), TransportError> {
        match self {
            Self::Quic(quic) => quic.send_datagram(datagram),
            #[cfg(feature = "web")]
            Self::WebTransport(web) => web.send_datagram(datagram),
            #[cfg(feature = "web")]
            Self::WebSocket(socket) => socket.send_datagram(&datagram),
        }
    }

    /// The next datagram from the client. May be cancelled.
    pub async fn receive_datagram(&self) -> Result<Bytes, TransportError> {
        match self {
            Self::Quic(quic) => quic.receive_datagram().await,
            #[cfg(feature = "web")]
            Self::WebTransport(web) => web.receive_datagram().await,
            #[cfg(feature = "web")]
            Self::WebSocket(socket) => socket.receive_datagram().await,
        }
    }

    /// The name of its kind.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Quic(_) => "quic",
            #[cfg(feature = "web")]
            Self::WebTransport(_) => "web_transport",
            #[cfg(feature = "web")]
            Self::WebSocket(_) => "web_socket",
        }
    }

    /// Whether its client can be sent worlds. Browsers fetch them by HTTP, and keep them.
    pub fn carries_worlds(&self) -> bool {
        matches!(self, Self::Quic(_))
    }

    /// Opens a stream for a world file. `None` when the connection is lost, or carries no worlds.
    pub async fn open_world_stream(&self) -> Option<WorldStream> {
        match self {
            Self::Quic(quic) => quic.open_world_stream().await,
            #[cfg(feature = "web")]
            Self::WebTransport(_) | Self::WebSocket(_) => None,
        }
    }

    /// The next stream that the client opens for pieces. It never comes from browsers. May be
    /// cancelled.
    pub async fn piece_stream(&self) -> Result<PieceStream, TransportError> {
        match self {
            Self::Quic(quic) => quic.piece_stream().await,
            #[cfg(feature = "web")]
            Self::WebTransport(_) | Self::WebSocket(_) => std::future::pending().await,
        }
    }

    /// The key that the client has proved to hold; `None` when it showed none.
    pub fn key(&self) -> Option<KeyFingerprint> {
        match self {
            Self::Quic(quic) => quic.key(),
            #[cfg(feature = "web")]
            Self::WebTransport(_) | Self::WebSocket(_) => None,
        }
    }

    /// The address that the client has now.
    pub fn remote_address(&self) -> SocketAddr {
        match self {
            Self::Quic(quic) => quic.remote_address(),
            #[cfg(feature = "web")]
            Self::WebTransport(web) => web.remote_address(),
            #[cfg(feature = "web")]
            Self::WebSocket(socket) => socket.remote_address(),
        }
    }

    /// How long the way to the client and back takes, as measured last.
    pub fn round_trip(&self) -> Duration {
        match self {
            Self::Quic(quic) => quic.round_trip(),
            #[cfg(feature = "web")]
            Self::WebTransport(web) => web.round_trip(),
            #[cfg(feature = "web")]
            Self::WebSocket(socket) => socket.round_trip(),
        }
    }

    /// Closes the connection at once. What was sent before may not arrive.
    pub fn close(&self, code: CloseCode, reason: &str) {
        match self {
            Self::Quic(quic) => quic.close(code, reason),
            #[cfg(feature = "web")]
            Self::WebTransport(web) => web.close(code, reason),
            #[cfg(feature = "web")]
            Self::WebSocket(socket) => socket.close(code, reason),
        }
    }
}

impl ControlReader {
    /// The next bytes; `None` when the client has ended the stream. May be cancelled: no byte is
    /// lost.
    pub async fn read(&mut self) -> Result<Option<Bytes>, TransportError> {
        match self {
            Self::Quic(quic) => quic.read().await,
            #[cfg(feature = "web")]
            Self::WebTransport(web) => web.read().await,
            #[cfg(feature = "web")]
            Self::WebSocket(socket) => socket.read().await,
        }
    }
}

impl ControlWriter {
    /// Writes whole frames, or a part of them. Returns how many bytes were taken. Waits while the
    /// client does not read. May be cancelled: then none were taken.
    pub async fn write(&mut self, frames: &[u8]) -> Result<usize, TransportError> {
        match self {
            Self::Quic(quic) => quic.write(frames).await,
            #[cfg(feature = "web")]
            Self::WebTransport(web) => web.write(frames).await,
            #[cfg(feature = "web")]
            Self::WebSocket(socket) => socket.write(frames).await,
        }
    }

    /// Ends the stream, and waits until all of it has arrived, or at least is on its way.
    pub async fn finish(&mut self) {
        match self {
            Self::Quic(quic) => quic.finish().await,
            #[cfg(feature = "web")]
            Self::WebTransport(web) => web.finish().await,
            #[cfg(feature = "web")]
            Self::WebSocket(socket) => socket.finish().await,
        }
    }
}
