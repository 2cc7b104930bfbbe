//! Frames of messages on a stream: two bytes of length, little-endian, and then the message.

use serde::{Serialize, de::DeserializeOwned};

use super::DecodeError;

/// The greatest length of a message, in bytes.
pub const FRAME_BYTES_MAX: usize = 2_048;

/// Encodes a message as a frame.
///
/// # Panics
///
/// When the message is longer than [`FRAME_BYTES_MAX`]. The tests encode the longest message of
/// each kind.
pub fn encode<M: Serialize>(message: &M) -> Vec<u8> {
    let mut bytes = vec![0; 2];
    bytes = postcard::to_extend(message, bytes).expect("messages hold nothing but plain data");
    let length = bytes.len() - 2;
    assert!(length <= FRAME_BYTES_MAX, "a message of {length} bytes");
    bytes[..2].copy_from_slice(&(length as u16).to_le_bytes());
    bytes
}

/// Decodes a message that fills all the bytes.
pub fn decode<M: DeserializeOwned>(bytes: &[u8]) -> Result<M, DecodeError> {
    let (message, rest) = postcard::take_from_bytes(bytes).map_err(|_| DecodeError::Malformed)?;
    if rest.is_empty() { Ok(message) } else { Err(DecodeError::Trailing) }
}

/// Reassembles frames from the pieces of a stream. It holds at most one frame and one piece.
#[derive(Clone, Debug, Default)]
pub struct FrameBuffer {
    bytes: Vec<u8>,
    /// The index in `bytes` of the first unread byte.
    start: usize,
}

impl FrameBuffer {
    /// Appends a piece of the stream. Take all frames with [`FrameBuffer::next_frame`] before the
    /// next call.
    pub fn push(&mut self, piece: &[u8]) {
        debug_assert!(self.start <= self.bytes.len());
        self.bytes.drain(..self.start);
        self.start = 0;
        self.bytes.extend_from_slice(piece);
    }

    /// The next complete message, without its length. `None` when more of the stream is needed.
    /// After an error the stream cannot be read any further.
    pub fn next_frame(&mut self) -> Result<Option<&[u8]>, DecodeError> {
        let unread = &self.bytes[self.start..];
        let Some((length, rest)) = unread.split_first_chunk::<2>() else { return Ok(None) };
        let bytes = usize::from(u16::from_le_bytes(*length));
        if bytes > FRAME_BYTES_MAX {
            return Err(DecodeError::TooLong { bytes, bytes_max: FRAME_BYTES_MAX });
        }
        let Some(frame) = rest.get(..bytes) else { return Ok(None) };
        self.start += 2 + bytes;
        Ok(Some(frame))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn frames_come_out_whole_however_the_stream_is_cut(
            texts in proptest::collection::vec(".{0,300}", 0..12),
            cuts in proptest::collection::vec(1usize..600, 1..40),
        ) {
            let stream: Vec<u8> = texts.iter().flat_map(encode).collect();
            let (mut buffer, mut got, mut at) = (FrameBuffer::default(), Vec::<String>::new(), 0);
            let mut cuts = cuts.iter().cycle();
            while at < stream.len() {
                let end = (at + cuts.next().unwrap()).min(stream.len());
                buffer.push(&stream[at..end]);
                while let Some(frame) = buffer.next_frame().unwrap() {
                    got.push(decode(frame).unwrap());
                }
                prop_assert!(buffer.bytes.len() - buffer.start <= FRAME_BYTES_MAX + 2);
                at = end;
            }
            prop_assert_eq!(got, texts);
        }
    }

    #[test]
    fn a_frame_that_claims_too_much_is_refused_before_it_arrives() {
        let mut buffer = FrameBuffer::default();
        buffer.push(&[0x01, 0x08]);
        assert!(matches!(buffer.next_frame(), Err(DecodeError::TooLong { bytes: 2049, .. })));
    }

    #[test]
    fn bytes_after_the_end_are_refused() {
        assert_eq!(decode::<u8>(&[7]), Ok(7));
        assert_eq!(decode::<u8>(&[7, 0]), Err(DecodeError::Trailing));
        assert_eq!(decode::<u8>(&[]), Err(DecodeError::Malformed));
    }
}
