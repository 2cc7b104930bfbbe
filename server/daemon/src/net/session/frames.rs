//! Whole frames from a client's stream.

use quinn::{ReadError, RecvStream};
use sightline_protocol::frame::{FRAME_BYTES_MAX, FrameBuffer};

use super::SessionEnd;

/// Reads whole frames from a stream.
pub(super) struct FrameReader {
    stream: RecvStream,
    buffer: FrameBuffer,
}

impl FrameReader {
    pub(super) fn new(stream: RecvStream) -> Self {
        Self { stream, buffer: FrameBuffer::default() }
    }

    /// The next frame, without its length prefix. May be cancelled: no byte is lost.
    pub(super) async fn next(&mut self) -> Result<Vec<u8>, SessionEnd> {
        let mut piece = [0; FRAME_BYTES_MAX];
        loop {
            if let Some(frame) = self.buffer.next_frame()? {
                debug_assert!(frame.len() <= FRAME_BYTES_MAX, "frames have a limit");
                return Ok(frame.to_vec());
            }
            match self.stream.read(&mut piece).await {
                Ok(Some(bytes)) => self.buffer.push(piece.get(..bytes).unwrap_or_default()),
                Ok(None) | Err(ReadError::Reset(_)) => return Err(SessionEnd::Left),
                Err(ReadError::ConnectionLost(error)) => return Err(error.into()),
                Err(error) => return Err(SessionEnd::Lost(error.to_string())),
            }
        }
    }
}
