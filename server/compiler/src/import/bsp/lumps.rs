//! The lumps of a BSP file: byte ranges and records, every range checked.

use glam::{Vec2, Vec3};

use super::error::BspError;

/// The file, and its directory of lumps.
pub(super) struct Lumps<'a> {
    bytes: &'a [u8],
    directory: [(i32, i32); LUMPS],
}

impl<'a> Lumps<'a> {
    pub(super) fn parse(bytes: &'a [u8]) -> Result<Self, BspError> {
        let header = bytes.get(..8 + LUMPS * 8).ok_or(BspError::Truncated)?;
        let mut fields = Fields(header);
        if fields.take() != *b"IBSP" {
            return Err(BspError::Magic);
        }
        let version = fields.int();
        if version != VERSION {
            return Err(BspError::Version(version));
        }
        let directory = std::array::from_fn(|_| (fields.int(), fields.int()));
        Ok(Self { bytes, directory })
    }

    pub(super) fn bytes(&self, lump: usize) -> Result<&'a [u8], BspError> {
        let (offset, length) = self.directory[lump];
        let range = range(offset, length, self.bytes.len()).ok_or(BspError::Lump { lump })?;
        Ok(&self.bytes[range])
    }

    pub(super) fn records<const N: usize>(
        &self,
        lump: usize,
        what: &'static str,
        max: usize,
    ) -> Result<&'a [[u8; N]], BspError> {
        let (records, rest) = self.bytes(lump)?.as_chunks::<N>();
        match (rest.is_empty(), records.len() <= max) {
            (false, _) => Err(BspError::Lump { lump }),
            (_, false) => Err(BspError::TooMany(what)),
            _ => Ok(records),
        }
    }
}

/// Reads little-endian fields one after the other. Beyond the end, all bytes are zero.
pub(super) struct Fields<'a>(pub &'a [u8]);

impl Fields<'_> {
    pub(super) fn take<const N: usize>(&mut self) -> [u8; N] {
        match self.0.split_first_chunk() {
            Some((field, rest)) => {
                self.0 = rest;
                *field
            }
            None => [0; N],
        }
    }

    pub(super) fn skip(&mut self, bytes: usize) {
        self.0 = self.0.get(bytes..).unwrap_or_default();
    }

    pub(super) fn int(&mut self) -> i32 {
        i32::from_le_bytes(self.take())
    }

    pub(super) fn float(&mut self) -> f32 {
        f32::from_le_bytes(self.take())
    }

    pub(super) fn vec2(&mut self) -> Vec2 {
        Vec2::new(self.float(), self.float())
    }

    pub(super) fn vec3(&mut self) -> Vec3 {
        Vec3::new(self.float(), self.float(), self.float())
    }
}

/// A range of indices, when it lies within a number of elements.
pub(super) fn range(first: i32, count: i32, within: usize) -> Option<std::ops::Range<usize>> {
    let (first, count) = (usize::try_from(first).ok()?, usize::try_from(count).ok()?);
    let end = first.checked_add(count)?;
    (end <= within).then_some(first..end)
}

/// An index, when it lies within a number of elements.
pub(super) fn index(value: i32, within: usize) -> Option<usize> {
    usize::try_from(value).ok().filter(|&index| index < within)
}

/// The version of Quake III maps.
const VERSION: i32 = 46;

/// The number of lumps.
const LUMPS: usize = 17;
