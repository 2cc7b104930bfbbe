//! A native client's connection: QUIC with streams and datagrams.

use std::{net::SocketAddr, time::Duration};

use bytes::Bytes;
use quinn::{
    Connection, ConnectionError, ReadError, RecvStream, SendDatagramError, SendStream, VarInt,
    WriteError,
};
use sightline_protocol::{
    fingerprint::KeyFingerprint, frame::FRAME_BYTES_MAX, pose_stream::DATAGRAM_BYTES_MAX,
};

use super::{super::client_keys::key_of, CloseCode, TransportError};

/// A datagram is sent only while QUIC's own queue of datagrams has room for one of any length. In
/// it poses would grow old.
pub(super) const DATAGRAM_SPACE_MIN: usize = DATAGRAM_BYTES_MAX;

/// A connection of QUIC.
pub struct QuicTransport(Connection);

/// The half of the control stream from the client.
pub struct QuicReader(RecvStream);

/// The half of the control stream to the client.
pub struct QuicWriter(SendStream);

/// A stream on which a world file is sent, with a lower priority than control messages.
pub struct WorldStream(SendStream);

/// A stream by which a client gets pieces of the world, with a lower priority than control
/// messages.
pub struct PieceStream {
    to: SendStream,
    from: RecvStream,
}

impl QuicTransport {
    pub fn new(connection: Connection) -> Self {
        Self(connection)
    }

    pub(super) async fn control(&self) -> Result<(QuicWriter, QuicReader), TransportError> {
        let (send, receive) = self.0.accept_bi().await?;
        Ok((QuicWriter(send), QuicReader(receive)))
    }

    pub(super) fn datagram_room(&self) -> Option<usize> {
        let has_room = self.0.datagram_send_buffer_space() >= DATAGRAM_SPACE_MIN;
        self.0.max_datagram_size().filter(|_| has_room)
    }

    pub(super) fn send_datagram(&self, datagram: Vec<u8>) -> Result<(), TransportError> {
        match self.0.send_datagram(datagram.into()) {
            // The path has just become too narrow for it: it counts as lost.
            Ok(()) | Err(SendDatagramError::TooLarge) => Ok(()),
            Err(SendDatagramError::ConnectionLost(error)) => Err(error.into()),
            Err(error) => Err(lost(error)),
        }
    }

    pub(super) async fn receive_datagram(&self) -> Result<Bytes, TransportError> {
        Ok(self.0.read_datagram().await?)
    }

    pub(super) async fn open_world_stream(&self) -> Option<WorldStream> {
        let stream = self.0.open_uni().await.ok()?;
        // Control messages go first.
        let _ = stream.set_priority(-1);
        Some(WorldStream(stream))
    }

    pub(super) async fn piece_stream(&self) -> Result<PieceStream, TransportError> {
        let (to, from) = self.0.accept_bi().await?;
        // Control messages go first.
        let _ = to.set_priority(-1);
        Ok(PieceStream { to, from })
    }

    pub(super) fn key(&self) -> Option<KeyFingerprint> {
        key_of(&self.0)
    }

    pub(super) fn remote_address(&self) -> SocketAddr {
        self.0.remote_address()
    }

    pub(super) fn round_trip(&self) -> Duration {
        self.0.rtt()
    }

    pub(super) fn close(&self, code: CloseCode, reason: &str) {
        self.0.close(VarInt::from_u32(code as u32), reason.as_bytes());
    }
}

impl QuicReader {
    pub(super) async fn read(&mut self) -> Result<Option<Bytes>, TransportError> {
        match self.0.read_chunk(FRAME_BYTES_MAX, true).await {
            Ok(chunk) => Ok(chunk.map(|chunk| chunk.bytes)),
            Err(ReadError::Reset(_)) => Ok(None),
            Err(ReadError::ConnectionLost(error)) => Err(error.into()),
            Err(error) => Err(lost(error)),
        }
    }
}

impl QuicWriter {
    pub(super) async fn write(&mut self, frames: &[u8]) -> Result<usize, TransportError> {
        match self.0.write(frames).await {
            Ok(bytes) => Ok(bytes),
            Err(WriteError::ConnectionLost(error)) => Err(error.into()),
            Err(error) => Err(lost(error)),
        }
    }

    pub(super) async fn finish(&mut self) {
        if self.0.finish().is_ok() {
            let _ = self.0.stopped().await;
        }
    }
}

impl WorldStream {
    /// Writes a piece of the file. `None` when the client does not take it.
    pub async fn write(&mut self, piece: Bytes) -> Option<()> {
        self.0.write_chunk(piece).await.ok()
    }

    /// Ends the file, and waits until all of it has arrived.
    pub async fn finish(mut self) {
        if self.0.finish().is_ok() {
            let _ = self.0.stopped().await;
        }
    }
}

impl PieceStream {
    /// Fills a buffer with what arrives. `None` when the client ends the stream before.
    pub async fn read(&mut self, bytes: &mut [u8]) -> Option<()> {
        self.from.read_exact(bytes).await.ok()
    }

    /// Writes bytes. `None` when the client does not take them.
    pub async fn write(&mut self, bytes: Bytes) -> Option<()> {
        self.to.write_chunk(bytes).await.ok()
    }
}

fn lost(error: impl ToString) -> TransportError {
    TransportError::Lost(error.to_string())
}

impl From<ConnectionError> for TransportError {
    fn from(error: ConnectionError) -> Self {
        match error {
            ConnectionError::ApplicationClosed(_) => Self::Closed,
            error => lost(error),
        }
    }
}
