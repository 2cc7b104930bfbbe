//! Whole frames from a client's control stream.

use sightline_protocol::frame::{FRAME_BYTES_MAX, FrameBuffer};

use super::{super::transport::ControlReader, SessionEnd};

/// Reads whole frames from a control stream.
pub(super) struct FrameReader {
    stream: ControlReader,
    buffer: FrameBuffer,
}

impl FrameReader {
    pub(super) fn new(stream: ControlReader) -> Self {
        Self { stream, buffer: FrameBuffer::default() }
    }

    /// The next frame, without its length prefix. May be cancelled: no byte is lost.
    pub(super) async fn next(&mut self) -> Result<Vec<u8>, SessionEnd> {
        loop {
            if let Some(frame) = self.buffer.next_frame()? {
                debug_assert!(frame.len() <= FRAME_BYTES_MAX, "frames have a limit");
                return Ok(frame.to_vec());
            }
            let piece = self.stream.read().await?.ok_or(SessionEnd::Left)?;
            self.buffer.push(&piece);
        }
    }
}
