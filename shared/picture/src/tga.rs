//! TGA files: true colour, grey and palettes, raw and run-length encoded.
//!
//! Source: Truevision, *TGA File Format Specification*, version 2.0 (1991).

use crate::{
    Picture,
    limits::{DecodeError, DecodeLimits},
};

/// The part of the header that matters.
struct Header {
    id_bytes: usize,
    has_palette: bool,
    kind: Kind,
    is_run_length_encoded: bool,
    palette_first: usize,
    palette_entries: usize,
    palette_bits: u8,
    width: usize,
    height: usize,
    pixel_bits: u8,
    is_right_to_left: bool,
    is_top_to_bottom: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Palette,
    Colour,
    Grey,
}

/// Decodes a file.
///
/// # Errors
/// When the file is damaged, of a kind that is not supported, or beyond the limits.
pub(crate) fn decode(bytes: &[u8], limits: DecodeLimits) -> Result<Picture, DecodeError> {
    let mut rest = bytes;
    let header = Header::read(&mut rest)?;
    let Header { width, height, .. } = header;
    limits.check(width, height, 3)?;
    take(&mut rest, header.id_bytes)?;
    let palette = header.palette(&mut rest)?;
    let size = usize::from(header.pixel_bits.div_ceil(8));
    let indices = if header.is_run_length_encoded {
        unpacked(rest, width * height, size)?
    } else {
        take(&mut rest, width * height * size)?.to_vec()
    };
    let mut pixels = Vec::with_capacity(width * height);
    for value in indices.chunks_exact(size) {
        pixels.push(match header.kind {
            Kind::Palette => {
                let index = value.iter().rev().fold(0, |sum, &byte| sum << 8 | usize::from(byte));
                let entry = index.checked_sub(header.palette_first).and_then(|i| palette.get(i));
                *entry.ok_or(DecodeError::Tga("an index is not in the palette"))?
            }
            Kind::Colour => colour(value),
            Kind::Grey => [value[0]; 3],
        });
    }
    if !header.is_top_to_bottom {
        pixels = pixels.rchunks_exact(width).flatten().copied().collect();
    }
    if header.is_right_to_left {
        pixels.chunks_exact_mut(width).for_each(<[[u8; 3]]>::reverse);
    }
    Picture::from_pixels(width as u32, height as u32, pixels).ok_or(DecodeError::Empty)
}

impl Header {
    fn read(rest: &mut &[u8]) -> Result<Self, DecodeError> {
        let bytes = take(rest, 18)?;
        let word = |at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
        let kind = match bytes[2] & !8 {
            1 => Kind::Palette,
            2 => Kind::Colour,
            3 => Kind::Grey,
            _ => return Err(DecodeError::Tga("it has no pixels of a known kind")),
        };
        let header = Self {
            id_bytes: usize::from(bytes[0]),
            has_palette: bytes[1] == 1,
            kind,
            is_run_length_encoded: bytes[2] & 8 != 0,
            palette_first: word(3),
            palette_entries: word(5),
            palette_bits: bytes[7],
            width: word(12),
            height: word(14),
            pixel_bits: bytes[16],
            is_right_to_left: bytes[17] & 0x10 != 0,
            is_top_to_bottom: bytes[17] & 0x20 != 0,
        };
        let is_known = match kind {
            Kind::Palette => header.has_palette && matches!(header.pixel_bits, 8 | 16),
            Kind::Colour => matches!(header.pixel_bits, 15 | 16 | 24 | 32),
            Kind::Grey => matches!(header.pixel_bits, 8 | 16),
        };
        if is_known { Ok(header) } else { Err(DecodeError::Tga("pixels of that size")) }
    }

    /// The colours of the palette; none when the pixels do not use it.
    fn palette(&self, rest: &mut &[u8]) -> Result<Vec<[u8; 3]>, DecodeError> {
        if !self.has_palette {
            return Ok(Vec::new());
        }
        if !matches!(self.palette_bits, 15 | 16 | 24 | 32) {
            return Err(DecodeError::Tga("a palette of that size"));
        }
        let size = usize::from(self.palette_bits.div_ceil(8));
        let entries = take(rest, self.palette_entries * size)?;
        Ok(entries.chunks_exact(size).map(colour).collect())
    }
}

/// The colour of 2 to 4 bytes: 5 bits each, or bytes, blue first.
fn colour(bytes: &[u8]) -> [u8; 3] {
    match *bytes {
        [low, high] => {
            let value = u32::from(u16::from_le_bytes([low, high]));
            // The nearest of 255 steps to each of 31.
            [10, 5, 0].map(|shift| (((value >> shift & 31) * 510 + 31) / 62) as u8)
        }
        [blue, green, red, ..] => [red, green, blue],
        _ => [0; 3],
    }
}

/// Pixels of some bytes each, of which runs are stored once.
fn unpacked(mut rest: &[u8], pixels: usize, size: usize) -> Result<Vec<u8>, DecodeError> {
    let mut values = Vec::with_capacity(pixels * size);
    while values.len() < pixels * size {
        let packet = take(&mut rest, 1)?[0];
        let left = pixels - values.len() / size;
        let count = (usize::from(packet & 0x7f) + 1).min(left);
        if packet & 0x80 == 0 {
            values.extend(take(&mut rest, count * size)?);
        } else {
            let value = take(&mut rest, size)?;
            (0..count).for_each(|_| values.extend(value));
        }
    }
    Ok(values)
}

fn take<'a>(rest: &mut &'a [u8], count: usize) -> Result<&'a [u8], DecodeError> {
    rest.split_off(..count).ok_or(DecodeError::Tga("it ends too early"))
}
