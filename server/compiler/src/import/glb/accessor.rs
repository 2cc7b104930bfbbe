//! Accessors, with every offset and count checked.

use gltf::{
    Accessor,
    accessor::{DataType, Dimensions, sparse::IndexType},
    buffer::View,
};

use super::{
    error::{GlbError, VERTICES_MAX},
    resources::Resources,
};

/// The vectors of an accessor as floats. Normalised integers become 0 to 1 or -1 to 1. Components
/// beyond `N` are left out. At least `at_least` components are required; missing ones become 1.
pub(super) fn vectors<const N: usize>(
    accessor: &Accessor<'_>,
    resources: &Resources,
    at_least: usize,
) -> Result<Vec<[f32; N]>, GlbError> {
    let components = match accessor.dimensions() {
        Dimensions::Vec2 => 2,
        Dimensions::Vec3 => 3,
        Dimensions::Vec4 => 4,
        _ => return Err(fault(accessor, "is not a vector")),
    };
    if components < at_least {
        return Err(fault(accessor, "has too few components"));
    }
    let (kind, normalised) = (accessor.data_type(), accessor.normalized());
    let size = kind.size();
    let decode = |bytes: &[u8]| {
        let mut vector = [1.0; N];
        for (value, bytes) in vector.iter_mut().zip(bytes.chunks_exact(size)).take(components) {
            *value = component(kind, normalised, bytes);
        }
        vector
    };
    elements(accessor, resources, components * size, decode)
}

/// The scalars of an accessor.
pub(super) fn scalars(
    accessor: &Accessor<'_>,
    resources: &Resources,
) -> Result<Vec<f32>, GlbError> {
    if accessor.dimensions() != Dimensions::Scalar {
        return Err(fault(accessor, "is not made of numbers"));
    }
    let (kind, normalised) = (accessor.data_type(), accessor.normalized());
    elements(accessor, resources, kind.size(), |bytes| component(kind, normalised, bytes))
}

/// By what a component is divided: the greatest integer of its type when it is normalised, or 1.
pub(super) fn greatest(accessor: &Accessor<'_>) -> f64 {
    match accessor.data_type() {
        _ if !accessor.normalized() => 1.0,
        DataType::U16 => 65_535.0,
        DataType::U8 => 255.0,
        DataType::I16 => 32_767.0,
        DataType::I8 => 127.0,
        DataType::U32 | DataType::F32 => 1.0,
    }
}

/// The indices of an accessor.
pub(super) fn indices(
    accessor: &Accessor<'_>,
    resources: &Resources,
) -> Result<Vec<u32>, GlbError> {
    let kind = accessor.data_type();
    let is_index = matches!(kind, DataType::U8 | DataType::U16 | DataType::U32);
    if accessor.dimensions() != Dimensions::Scalar || !is_index {
        return Err(fault(accessor, "is not made of indices"));
    }
    elements(accessor, resources, kind.size(), whole)
}

fn fault(accessor: &Accessor<'_>, reason: &'static str) -> GlbError {
    GlbError::Accessor { index: accessor.index(), reason }
}

/// All elements, with sparse ones in their places.
fn elements<T: Clone>(
    accessor: &Accessor<'_>,
    resources: &Resources,
    size: usize,
    decode: impl Fn(&[u8]) -> T,
) -> Result<Vec<T>, GlbError> {
    let count = accessor.count();
    // A triangle has three indices.
    if count > 3 * VERTICES_MAX {
        return Err(GlbError::TooMany("elements in an accessor"));
    }
    let beyond = || fault(accessor, "reaches beyond its bytes");
    let mut elements: Vec<T> = match accessor.view() {
        Some(view) => strided(&view, resources, accessor.offset(), count, size)
            .ok_or_else(beyond)?
            .map(&decode)
            .collect(),
        // Zeros need no bytes in the file, so their number says nothing of what it holds.
        None if accessor.sparse().is_some() && count <= resources.byte_len() => {
            vec![decode(&vec![0; size]); count]
        }
        None => return Err(fault(accessor, "has no bytes")),
    };
    let Some(sparse) = accessor.sparse() else { return Ok(elements) };
    let (places, values) = (sparse.indices(), sparse.values());
    let place_size = match places.index_type() {
        IndexType::U8 => 1,
        IndexType::U16 => 2,
        IndexType::U32 => 4,
    };
    let count = sparse.count();
    let places = strided(&places.view(), resources, places.offset(), count, place_size);
    let values = strided(&values.view(), resources, values.offset(), count, size);
    for (place, value) in places.ok_or_else(beyond)?.zip(values.ok_or_else(beyond)?) {
        let element = elements.get_mut(whole(place) as usize).ok_or_else(beyond)?;
        *element = decode(value);
    }
    Ok(elements)
}

/// `count` slices of `size` bytes each. `None` when one of them reaches beyond the view.
fn strided<'a>(
    view: &View<'_>,
    resources: &'a Resources,
    offset: usize,
    count: usize,
    size: usize,
) -> Option<impl Iterator<Item = &'a [u8]> + use<'a>> {
    let bytes = resources.view(view)?.get(offset..)?;
    let stride = view.stride().unwrap_or(size);
    let length = count.checked_sub(1)?.checked_mul(stride)?.checked_add(size)?;
    let bytes = bytes.get(..length)?;
    Some((0..count).map(move |i| &bytes[i * stride..i * stride + size]))
}

/// A little-endian whole number of at most four bytes.
fn whole(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

/// One component, by its type.
fn component(kind: DataType, normalised: bool, bytes: &[u8]) -> f32 {
    let bits = whole(bytes);
    let (value, greatest) = match kind {
        DataType::F32 => return f32::from_bits(bits),
        DataType::U32 => (bits as f32, u32::MAX as f32),
        DataType::U16 => (bits as f32, 65_535.0),
        DataType::U8 => (bits as f32, 255.0),
        DataType::I16 => (f32::from(bits as u16 as i16), 32_767.0),
        DataType::I8 => (f32::from(bits as u8 as i8), 127.0),
    };
    if normalised { (value / greatest).max(-1.0) } else { value }
}
