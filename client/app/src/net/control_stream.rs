//! The reliable stream of control messages.

use quinn::{Connection, RecvStream, SendStream};
use sightline_protocol::{
    frame::{self, FRAME_BYTES_MAX, FrameBuffer},
    message::{ClientMessage, ServerMessage},
};

use super::error::{ConnectError, lost};

/// The bytes that precede each frame: its length.
const LENGTH_BYTES: usize = 2;

/// A stream of framed control messages in both directions.
pub(super) struct ControlStream {
    /// The connection that the stream belongs to.
    pub(super) connection: Connection,
    pub(super) sender: ControlSender,
    pub(super) receiver: ControlReceiver,
}

/// The way to the server.
pub(super) struct ControlSender(SendStream);

/// The way from the server.
pub(super) struct ControlReceiver {
    stream: RecvStream,
    buffer: FrameBuffer,
    /// The bytes of the last received message, its length included.
    frame_bytes: usize,
}

impl ControlStream {
    /// Opens the stream on a connection.
    pub(super) async fn open(connection: &Connection) -> Result<Self, ConnectError> {
        let (send, stream) = connection.open_bi().await.map_err(lost)?;
        let receiver = ControlReceiver { stream, buffer: FrameBuffer::default(), frame_bytes: 0 };
        Ok(Self { connection: connection.clone(), sender: ControlSender(send), receiver })
    }
}

impl ControlSender {
    /// Sends a message. Returns the number of bytes it took.
    pub(super) async fn send(&mut self, message: &ClientMessage) -> Result<usize, ConnectError> {
        let frame = frame::encode(message);
        match self.0.write_all(&frame).await {
            Ok(()) => Ok(frame.len()),
            Err(quinn::WriteError::ConnectionLost(error)) => Err(lost(error)),
            Err(error) => Err(ConnectError::Lost(error.to_string())),
        }
    }

    /// Waits until everything that was sent has arrived.
    pub(super) async fn finish(&mut self) {
        if self.0.finish().is_ok() {
            let _ = self.0.stopped().await;
        }
    }
}

impl ControlReceiver {
    /// The bytes of the last received message, its length included.
    pub(super) fn frame_bytes(&self) -> usize {
        self.frame_bytes
    }

    /// Receives the next message. Cancelling loses nothing: the bytes read so far stay in the
    /// buffer.
    pub(super) async fn receive(&mut self) -> Result<ServerMessage, ConnectError> {
        let mut piece = [0; FRAME_BYTES_MAX];
        loop {
            if let Some(frame) = self.buffer.next_frame()? {
                debug_assert!(frame.len() <= FRAME_BYTES_MAX, "the buffer limits frames");
                self.frame_bytes = frame.len() + LENGTH_BYTES;
                return Ok(ServerMessage::decode(frame)?);
            }
            match self.stream.read(&mut piece).await {
                Ok(Some(bytes)) => self.buffer.push(piece.get(..bytes).unwrap_or_default()),
                Ok(None) => {
                    return Err(ConnectError::Lost("the server ended the stream".to_owned()));
                }
                Err(quinn::ReadError::ConnectionLost(error)) => return Err(lost(error)),
                Err(error) => return Err(ConnectError::Lost(error.to_string())),
            }
        }
    }
}
