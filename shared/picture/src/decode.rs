//! Picture files, decoded within limits.

use std::io::Cursor;

use png::{BitDepth, ColorType};
use zune_jpeg::{
    JpegDecoder,
    zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions},
};

use crate::{
    Picture,
    limits::{DecodeError, DecodeLimits},
    tga,
};

const PNG_MARK: &[u8] = b"\x89PNG\r\n\x1a\n";
/// The mark of WebP is at the ninth byte.
const WEBP_MARK: &[u8] = b"WEBP";
const JPEG_MARK: &[u8] = &[0xff, 0xd8, 0xff];

/// How a file is encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As the first bytes say: PNG, JPEG or WebP.
    Marked,
    /// TGA, which has no mark of its own.
    Tga,
}

/// Decodes a file. Grey becomes colour, 16 bits become 8, transparency is dropped.
///
/// # Errors
/// When the file is damaged, of another kind, or beyond the limits.
pub fn decode(
    bytes: &[u8],
    encoding: Encoding,
    limits: DecodeLimits,
) -> Result<Picture, DecodeError> {
    match encoding {
        Encoding::Tga => tga::decode(bytes, limits),
        Encoding::Marked if bytes.starts_with(PNG_MARK) => decode_png(bytes, limits),
        Encoding::Marked if bytes.starts_with(JPEG_MARK) => decode_jpeg(bytes, limits),
        Encoding::Marked if bytes.get(8..12) == Some(WEBP_MARK) => decode_webp(bytes, limits),
        Encoding::Marked => Err(DecodeError::Unmarked),
    }
}

fn decode_png(bytes: &[u8], limits: DecodeLimits) -> Result<Picture, DecodeError> {
    let png_limits = png::Limits { bytes: limits.bytes_max };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png_limits);
    // Palettes become colours, and 1, 2 and 4 bits become 8.
    decoder.set_transformations(png::Transformations::EXPAND);
    let header = decoder.read_header_info()?;
    limits.check(header.width as usize, header.height as usize, 1)?;
    let mut reader = decoder.read_info()?;
    let size = reader.output_buffer_size().filter(|size| *size <= limits.bytes_max);
    let mut decoded = vec![0; size.ok_or(DecodeError::Memory)?];
    let frame = reader.next_frame(&mut decoded)?;
    let channels: Vec<u8> = match frame.bit_depth {
        BitDepth::Sixteen => decoded.as_chunks().0.iter().map(|c| narrowed(*c)).collect(),
        _ => decoded,
    };
    let pixels = match frame.color_type {
        ColorType::Grayscale => channels.iter().map(|&grey| [grey; 3]).collect(),
        ColorType::GrayscaleAlpha => pixels_of(&channels, |&[grey, _]| [grey; 3]),
        ColorType::Rgba => pixels_of(&channels, |&[r, g, b, _]| [r, g, b]),
        ColorType::Rgb | ColorType::Indexed => pixels_of(&channels, |&rgb| rgb),
    };
    Picture::from_pixels(frame.width, frame.height, pixels).ok_or(DecodeError::Empty)
}

fn decode_webp(bytes: &[u8], limits: DecodeLimits) -> Result<Picture, DecodeError> {
    let mut decoder = image_webp::WebPDecoder::new(Cursor::new(bytes))?;
    let (width, height) = decoder.dimensions();
    limits.check(width as usize, height as usize, 4)?;
    decoder.set_memory_limit(limits.bytes_max);
    let size = decoder.output_buffer_size().filter(|size| *size <= limits.bytes_max);
    let mut channels = vec![0; size.ok_or(DecodeError::Memory)?];
    decoder.read_image(&mut channels)?;
    let pixels = match decoder.has_alpha() {
        true => pixels_of(&channels, |&[r, g, b, _]| [r, g, b]),
        false => pixels_of(&channels, |&rgb| rgb),
    };
    Picture::from_pixels(width, height, pixels).ok_or(DecodeError::Empty)
}

/// The nearest value of 8 bits to one of 16.
fn narrowed(big_endian: [u8; 2]) -> u8 {
    ((u32::from(u16::from_be_bytes(big_endian)) + 128) / 257) as u8
}

fn pixels_of<const N: usize>(
    channels: &[u8],
    colour: impl Fn(&[u8; N]) -> [u8; 3],
) -> Vec<[u8; 3]> {
    channels.as_chunks().0.iter().map(colour).collect()
}

fn decode_jpeg(bytes: &[u8], limits: DecodeLimits) -> Result<Picture, DecodeError> {
    let edge = limits.edge_max as usize;
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(edge)
        .set_max_height(edge)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(DecodeError::Jpeg)?;
    let (width, height) = decoder.dimensions().ok_or(DecodeError::Empty)?;
    limits.check(width, height, 3)?;
    let is_grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
    if is_grey {
        decoder.set_options(options.jpeg_set_out_colorspace(ColorSpace::Luma));
    }
    let channels = decoder.decode().map_err(DecodeError::Jpeg)?;
    let pixels = if is_grey {
        channels.iter().map(|&grey| [grey; 3]).collect()
    } else {
        pixels_of(&channels, |&rgb| rgb)
    };
    Picture::from_pixels(width as u32, height as u32, pixels).ok_or(DecodeError::Empty)
}
