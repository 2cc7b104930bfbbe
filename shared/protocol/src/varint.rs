//! Variable-length integers (LEB128): one to five bytes with seven bits each, the least significant
//! first.

use super::DecodeError;

/// Appends a number.
pub fn write(out: &mut Vec<u8>, mut value: u32) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// How many bytes a number takes.
pub fn length(value: u32) -> usize {
    (32 - (value | 1).leading_zeros()).div_ceil(7) as usize
}

/// Appends a signed number (zigzag-coded, so that small numbers of either sign are short).
pub fn write_signed(out: &mut Vec<u8>, value: i32) {
    write(out, ((value << 1) ^ (value >> 31)) as u32);
}

/// Takes a byte off the front.
pub fn read_byte(bytes: &mut &[u8]) -> Result<u8, DecodeError> {
    let (&first, rest) = bytes.split_first().ok_or(DecodeError::Malformed)?;
    *bytes = rest;
    Ok(first)
}

/// Takes a number off the front.
pub fn read(bytes: &mut &[u8]) -> Result<u32, DecodeError> {
    let mut value = 0u32;
    for shift in [0, 7, 14, 21, 28] {
        let byte = read_byte(bytes)?;
        let bits = u32::from(byte & 0x7f);
        if shift == 28 && bits > 0x0f {
            return Err(DecodeError::Malformed);
        }
        value |= bits << shift;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(DecodeError::Malformed)
}

/// Takes a signed number off the front.
pub fn read_signed(bytes: &mut &[u8]) -> Result<i32, DecodeError> {
    let value = read(bytes)?;
    Ok((value >> 1) as i32 ^ -((value & 1) as i32))
}

/// Takes a signed number of 16 bits off the front.
pub fn read_signed_16(bytes: &mut &[u8]) -> Result<i16, DecodeError> {
    i16::try_from(read_signed(bytes)?).map_err(|_| DecodeError::Malformed)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn numbers_decode_to_themselves(value: u32, signed: i32) {
            let mut out = Vec::new();
            write(&mut out, value);
            write_signed(&mut out, signed);
            prop_assert!(out.len() <= 10);
            let mut bytes = out.as_slice();
            prop_assert_eq!(read(&mut bytes), Ok(value));
            prop_assert_eq!(read_signed(&mut bytes), Ok(signed));
            prop_assert!(bytes.is_empty());
        }
    }

    #[test]
    fn small_numbers_of_either_sign_take_a_byte_and_long_ones_are_refused() {
        for value in -64..64 {
            let mut out = Vec::new();
            write_signed(&mut out, value);
            assert_eq!(out.len(), 1);
        }
        let endless = [0xff; 9];
        assert_eq!(read(&mut endless.as_slice()), Err(DecodeError::Malformed));
        assert_eq!(read(&mut [0x80, 0x80].as_slice()), Err(DecodeError::Malformed));
        assert_eq!(
            read(&mut [0xff, 0xff, 0xff, 0xff, 0x1f].as_slice()),
            Err(DecodeError::Malformed)
        );
    }
}
