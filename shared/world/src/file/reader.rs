//! Reads values from the bytes of a section, and checks each.

use glam::{DVec3, Vec3};

use super::ReadError;
use crate::{geometry::Aabb, tolerance::UNIT_F64};

/// The greatest number in a file: a hundred thousand kilometres is farther than any building, and
/// safe to square.
const NUMBER_MAX: f64 = 1e8;

/// The part of a section that is not read yet. No method panics, whatever the bytes.
pub(super) struct SectionReader<'a>(&'a [u8]);

impl<'a> SectionReader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// All bytes that are left.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.0
    }

    /// The bytes that are left, for a format that reads as much as it needs.
    pub(super) fn as_read(&mut self) -> &mut impl std::io::Read {
        &mut self.0
    }

    /// Takes `length` bytes.
    pub(super) fn take(&mut self, length: usize) -> Result<&'a [u8], ReadError> {
        let (head, rest) =
            self.0.split_at_checked(length).ok_or(ReadError::Malformed("it ends too soon"))?;
        self.0 = rest;
        Ok(head)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], ReadError> {
        Ok(self.take(N)?.try_into().expect("as many as taken"))
    }

    /// Takes the section with this tag, which must come next.
    pub(super) fn section(&mut self, tag: &[u8; 4]) -> Result<Self, ReadError> {
        if &self.array::<4>()? != tag {
            return Err(ReadError::Malformed("a section is missing"));
        }
        let length = u64::from_le_bytes(self.array()?);
        let length = usize::try_from(length).map_err(|_| ReadError::Malformed("a length"))?;
        self.take(length).map(Self)
    }

    /// Reads a number of records of at least `record_bytes` each. The bytes that are left must be
    /// enough for all of them, so memory for the records may be taken at once.
    pub(super) fn count(&mut self, record_bytes: usize) -> Result<usize, ReadError> {
        debug_assert!(record_bytes > 0, "a record without bytes bounds no count");
        let count = self.u32()? as usize;
        if count > self.0.len() / record_bytes {
            return Err(ReadError::Malformed("a count"));
        }
        Ok(count)
    }

    pub(super) fn u8(&mut self) -> Result<u8, ReadError> {
        Ok(self.array::<1>()?[0])
    }

    pub(super) fn u32(&mut self) -> Result<u32, ReadError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    /// A finite number of at most [`NUMBER_MAX`].
    pub(super) fn f64(&mut self) -> Result<f64, ReadError> {
        let value = f64::from_le_bytes(self.array()?);
        if value.abs() <= NUMBER_MAX { Ok(value) } else { Err(ReadError::Malformed("a number")) }
    }

    /// A finite number of at most [`NUMBER_MAX`].
    pub(super) fn f32(&mut self) -> Result<f32, ReadError> {
        let value = f32::from_le_bytes(self.array()?);
        if value.abs() <= NUMBER_MAX as f32 {
            Ok(value)
        } else {
            Err(ReadError::Malformed("a number"))
        }
    }

    /// The number of bytes that are left.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// A vector of unit length.
    pub(super) fn direction(&mut self) -> Result<DVec3, ReadError> {
        let value = DVec3::new(self.f64()?, self.f64()?, self.f64()?);
        let is_unit = (value.length_squared() - 1.0).abs() < UNIT_F64;
        if is_unit { Ok(value) } else { Err(ReadError::Malformed("a direction")) }
    }

    pub(super) fn vec3(&mut self) -> Result<Vec3, ReadError> {
        Ok(Vec3::new(self.f32()?, self.f32()?, self.f32()?))
    }

    /// A box that is not empty.
    pub(super) fn aabb(&mut self) -> Result<Aabb, ReadError> {
        let value = Aabb::new(self.vec3()?, self.vec3()?);
        if value.is_empty() { Err(ReadError::Malformed("a box")) } else { Ok(value) }
    }
}
