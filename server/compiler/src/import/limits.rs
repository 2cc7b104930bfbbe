//! Limits and helpers of all importers.

use std::{
    fs::File,
    io::{self, Read},
    path::Path,
};

use glam::Vec3;
use sightline_picture::{DecodeError, DecodeLimits, Encoding, Picture, decode};

/// The greatest distance of a coordinate from the origin, in metres.
pub(crate) const EXTENT_MAX: f32 = 100_000.0;
/// The most spawn points of a model.
pub(crate) const SPAWNS_MAX: usize = 10_000;
/// The most lamps of a model.
pub(crate) const LAMPS_MAX: usize = 10_000;
/// The brightest light of a surface, as a multiple of white paper in good light.
pub(crate) const EMISSION_MAX: f32 = 1.0e5;
/// The largest file: 1 GiB.
const FILE_BYTES_MAX: u64 = 1 << 30;
/// The greatest width and height of a texture, in pixels.
const TEXTURE_EDGE_MAX: u32 = 8192;
/// The longest title, in characters.
const TITLE_CHARS_MAX: usize = 64;

/// The bytes of a regular file, within the limit of size.
pub(crate) fn read_file(path: &Path) -> io::Result<Vec<u8>> {
    let metadata = std::fs::metadata(path)?;
    if !metadata.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file"));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, "larger than 1 GiB"));
    }
    Ok(bytes)
}

/// The title of a model that has none: the name of the file without its extension.
pub(crate) fn title_of(path: &Path) -> String {
    path.file_stem().map_or_else(|| "building".into(), |stem| stem.to_string_lossy().into_owned())
}

/// A title on one line, of bounded length.
pub(crate) fn tidy_title(title: &str) -> String {
    let printable = title.chars().map(|c| if c.is_control() { ' ' } else { c });
    printable.take(TITLE_CHARS_MAX).collect::<String>().trim().to_owned()
}

/// Whether a point is finite and within [`EXTENT_MAX`].
pub(crate) fn is_sane(point: Vec3) -> bool {
    // A comparison with NaN is false.
    point.abs().cmple(Vec3::splat(EXTENT_MAX)).all()
}

/// Whether a triangle has an area. The limit is far below what is visible.
pub(crate) fn has_area([a, b, c]: [Vec3; 3]) -> bool {
    (b - a).as_dvec3().cross((c - a).as_dvec3()).length_squared() > 1e-18
}

/// The sRGB byte of a linear colour component. NaN becomes 0.
pub(crate) fn srgb_byte(linear: f32) -> u8 {
    let value = linear.clamp(0.0, 1.0);
    let encoded =
        if value <= 0.003_130_8 { value * 12.92 } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

/// The linear component of an sRGB byte.
pub(crate) fn linear(byte: u8) -> f32 {
    let value = f32::from(byte) / 255.0;
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// The most bytes of a decoded texture for each byte of its file. A surface of one colour
/// compresses to a part in a thousand.
const TEXTURE_RATIO_MAX: usize = 1_100;
/// A decoded texture of up to this number of bytes is always allowed.
const TEXTURE_BYTES_FREE: usize = 16 << 20;

/// Decodes a texture of at most `bytes_max` bytes. A few bytes cannot ask for much memory.
pub(crate) fn decode_texture(
    bytes: &[u8],
    encoding: Encoding,
    bytes_max: usize,
) -> Result<Picture, DecodeError> {
    let justified = bytes.len().saturating_mul(TEXTURE_RATIO_MAX).max(TEXTURE_BYTES_FREE);
    let bytes_max = bytes_max.min(justified);
    decode(bytes, encoding, DecodeLimits { edge_max: TEXTURE_EDGE_MAX, bytes_max })
}
