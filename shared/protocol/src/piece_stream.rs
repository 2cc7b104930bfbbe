//! What travels on the stream by which a native client gets pieces of a world.
//!
//! The client opens the stream, and begins with the number of the world. Then it sends requests:
//! how many pieces, and their numbers. The server answers each request in order: of each piece the
//! number and the length, and then its bytes. Of one that it does not hand out now, the length is
//! [`REFUSED`], and no bytes follow. All integers have the lowest byte first.

use super::DecodeError;

/// The number by which a world's head is asked for. No piece has it.
pub const HEAD: u32 = u32::MAX;

/// In place of the length of a piece that is not handed out now. No piece is so long.
pub const REFUSED: u32 = u32::MAX;

/// The most pieces of a request.
pub const REQUEST_MAX: usize = 256;

/// The bytes with which a client begins: the number of the world.
pub const BEGIN_BYTES: usize = 4;

/// The bytes with which a request begins: how many pieces it asks for.
pub const COUNT_BYTES: usize = 2;

/// The bytes of the number of a piece in a request.
pub const NUMBER_BYTES: usize = 4;

/// The bytes before those of a piece: its number and its length.
pub const BEFORE_PIECE_BYTES: usize = 8;

/// Requests for pieces, as few as there can be.
pub fn requests(numbers: &[u32]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for numbers in numbers.chunks(REQUEST_MAX) {
        bytes.extend((numbers.len() as u16).to_le_bytes());
        numbers.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
    }
    bytes
}

/// How many pieces a request asks for.
///
/// # Errors
/// When it asks for none, or for more than [`REQUEST_MAX`].
pub fn request_count(begin: [u8; COUNT_BYTES]) -> Result<usize, DecodeError> {
    let count = usize::from(u16::from_le_bytes(begin));
    if (1..=REQUEST_MAX).contains(&count) { Ok(count) } else { Err(DecodeError::Malformed) }
}

/// The numbers of a request.
pub fn request_numbers(bytes: &[u8]) -> impl Iterator<Item = u32> {
    bytes.as_chunks::<NUMBER_BYTES>().0.iter().map(|number| u32::from_le_bytes(*number))
}

/// What comes before a piece.
pub fn before_piece(number: u32, bytes: u32) -> [u8; BEFORE_PIECE_BYTES] {
    (u64::from(bytes) << 32 | u64::from(number)).to_le_bytes()
}

/// The number and the length of the piece that follows.
pub fn read_before_piece(before: [u8; BEFORE_PIECE_BYTES]) -> (u32, u32) {
    let both = u64::from_le_bytes(before);
    (both as u32, (both >> 32) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_are_cut_into_requests_that_a_server_takes() {
        let numbers: Vec<u32> = (0..600).map(|i| i * 7).chain([HEAD]).collect();
        let mut bytes = requests(&numbers).as_slice().to_vec();
        let (mut read, mut counts) = (Vec::new(), Vec::new());
        while !bytes.is_empty() {
            let count = request_count([bytes[0], bytes[1]]).unwrap();
            let end = COUNT_BYTES + count * NUMBER_BYTES;
            read.extend(request_numbers(&bytes[COUNT_BYTES..end]));
            counts.push(count);
            bytes.drain(..end);
        }
        assert_eq!((read, counts), (numbers, vec![256, 256, 89]));
    }

    #[test]
    fn requests_for_nothing_or_too_much_are_refused() {
        for count in [0u16, 257, u16::MAX] {
            assert_eq!(request_count(count.to_le_bytes()), Err(DecodeError::Malformed));
        }
    }

    #[test]
    fn what_comes_before_a_piece_is_its_number_and_its_length() {
        for pair in [(0, 0), (7, 1 << 20), (HEAD, u32::MAX)] {
            assert_eq!(read_before_piece(before_piece(pair.0, pair.1)), pair);
        }
        assert_eq!(before_piece(1, 2), [1, 0, 0, 0, 2, 0, 0, 0]);
    }
}
