//! The octree as bytes.
//!
//! ```text
//! origin 3 × f32 · edge f32 · depth u8                                (little-endian)
//! materials u32 · inner nodes u32 · leaves u32
//! seven times: length u32 · a zstd frame
//! ```
//!
//! The frames are:
//!
//! * the palette: the differences of its ascending keys, as six planes of bytes;
//! * the child masks, a byte for each inner node;
//! * five planes of a byte for each leaf: the luma less that of the leaf before, the two chromas,
//!   and the finish (normal and glass) in two planes.
//!
//! Structure and materials are apart, and bytes of one kind are together, which packs best. Nodes
//! are in the order of memory.
//!
//! Indices of nodes are not stored, so no bytes can make a cycle. The reader computes the materials
//! of inner nodes from the leaves. It takes at most 12 bytes for an inner node and 2 for a leaf.
//! With [`INNER_MAX`] and [`LEAVES_MAX`] that is at most 1.1 GiB, however hostile the bytes.

use std::io::Read;

use glam::Vec3;
use rustc_hash::FxHashMap;
use thiserror::Error;

use super::{
    DEPTH_MAX, INNER_MAX, LEAVES_MAX, MATERIALS_MAX, Material, Octree,
    blend::average,
    layout::TreeLayout,
    palette::{KEY_MAX, Key, Palette, to_ycocg},
};
use crate::packing::{self, Unpacker};

/// Why an octree cannot be built or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum OctreeError {
    /// The depth is zero or greater than [`DEPTH_MAX`].
    #[error("an octree has 1 to {DEPTH_MAX} levels")]
    Depth,
    /// There are more nodes than [`INNER_MAX`] or [`LEAVES_MAX`], or more materials than
    /// [`MATERIALS_MAX`].
    #[error("an octree has more than {INNER_MAX} inner nodes or {LEAVES_MAX} leaves")]
    TooLarge,
    /// A voxel or a block lies outside of the tree, or is out of order.
    #[error("a voxel lies outside its octree")]
    Outside,
    /// There are too few bytes or too many.
    #[error("an octree has too few or too many bytes")]
    Length,
    /// A number is out of its range.
    #[error("an octree's {0} is invalid")]
    Nonsense(&'static str),
}

/// The greatest coordinate and the greatest edge, in metres.
const EXTENT_MAX: f32 = 1.0e6;

/// The number of bytes of a key.
const KEY_BYTES: usize = 6;

/// The number of planes, and so of bytes for each leaf.
pub(super) const PLANES: usize = 5;

/// The number of leaves that are unpacked at a time.
const CHUNK: usize = 1 << 15;

/// Higher levels take much longer and gain little.
const ZSTD_LEVEL: i32 = 7;

impl Octree {
    /// The bytes of the tree.
    pub fn to_bytes(&self) -> Vec<u8> {
        debug_assert!(self.inner.len() <= INNER_MAX && self.leaves.len() <= LEAVES_MAX);
        debug_assert_eq!(self.materials.len(), self.keys.len(), "a key for each material");
        let mut bytes = head(self);
        for count in [self.materials.len(), self.inner.len(), self.leaves.len()] {
            bytes.extend((count as u32).to_le_bytes());
        }
        put_frame(&mut bytes, &palette_planes(&self.keys));
        put_frame(&mut bytes, &self.inner.iter().map(|node| node.mask).collect::<Vec<_>>());
        let coded = coded(&self.materials);
        let plane = |plane: usize| {
            let value = |&leaf: &u16| coded[usize::from(leaf)][plane];
            self.leaves.iter().map(value).collect::<Vec<u8>>()
        };
        put_frame(&mut bytes, &differences(plane(0)));
        (1..PLANES).for_each(|which| put_frame(&mut bytes, &plane(which)));
        bytes
    }

    /// Reads the bytes that [`Octree::to_bytes`] wrote. Any bytes give a valid tree or an error.
    ///
    /// # Errors
    ///
    /// When the bytes are not exactly one octree.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, OctreeError> {
        let mut rest = bytes;
        let mut octree = read_head(&mut rest)?;
        let mut count = |max: usize| {
            let count = u32::from_le_bytes(take(&mut rest)?) as usize;
            if count <= max { Ok(count) } else { Err(OctreeError::TooLarge) }
        };
        let (materials, inner, leaves) =
            (count(MATERIALS_MAX)?, count(INNER_MAX)?, count(LEAVES_MAX)?);
        let keys = read_palette(&mut PackedPlane::take(&mut rest)?, materials)?;
        let masks = PackedPlane::take(&mut rest)?.all(inner)?;
        let layout = TreeLayout::link(&masks, octree.depth)?;
        drop(masks);
        if layout.leaves != leaves {
            return Err(OctreeError::Length);
        }
        octree.inner = layout.inner;
        let mut palette = Palette::closed(keys);
        octree.leaves = read_leaves(&mut rest, leaves, &palette)?;
        if !rest.is_empty() {
            return Err(OctreeError::Length);
        }
        average(&mut octree.inner, &layout.roots, &octree.leaves, octree.depth, &mut palette)
            .ok_or(OctreeError::Nonsense("palette"))?;
        (octree.materials, octree.keys) = (palette.materials, palette.keys);
        Ok(octree)
    }
}

/// The origin, edge and depth.
pub(super) fn head(octree: &Octree) -> Vec<u8> {
    let numbers = octree.origin.to_array().into_iter().chain([octree.edge]);
    numbers.flat_map(f32::to_le_bytes).chain([octree.depth]).collect()
}

pub(super) fn put_frame(bytes: &mut Vec<u8>, content: &[u8]) {
    let packed = packing::pack(content, ZSTD_LEVEL);
    bytes.extend((packed.len() as u32).to_le_bytes());
    bytes.extend(packed);
}

/// A plane of bytes in a frame that is being unpacked.
pub(super) struct PackedPlane<'a>(Unpacker<'a>);

impl<'a> PackedPlane<'a> {
    pub(super) fn take(rest: &mut &'a [u8]) -> Result<Self, OctreeError> {
        let length = u32::from_le_bytes(take(rest)?) as usize;
        let (packed, tail) = rest.split_at_checked(length).ok_or(OctreeError::Length)?;
        *rest = tail;
        Self::of(packed)
    }

    fn fill(&mut self, values: &mut [u8]) -> Result<(), OctreeError> {
        self.0.read_exact(values).map_err(|_| OctreeError::Length)
    }

    fn end(&mut self) -> Result<(), OctreeError> {
        match self.0.read(&mut [0]) {
            Ok(0) => Ok(()),
            _ => Err(OctreeError::Length),
        }
    }

    /// The frame that fills all of some bytes.
    pub(super) fn of(packed: &'a [u8]) -> Result<Self, OctreeError> {
        Unpacker::new(packed).map(Self).map_err(|_| OctreeError::Length)
    }

    /// All bytes, up to the most. Memory is taken as they are unpacked.
    pub(super) fn up_to(mut self, most: usize) -> Result<Vec<u8>, OctreeError> {
        let mut values = Vec::new();
        let mut limited = self.0.by_ref().take(most as u64);
        limited.read_to_end(&mut values).map_err(|_| OctreeError::Length)?;
        self.end().map(|()| values)
    }

    /// All bytes. Their number must be `length`. Memory is taken as they are unpacked.
    pub(super) fn all(mut self, length: usize) -> Result<Vec<u8>, OctreeError> {
        let mut values = Vec::new();
        let mut limited = self.0.by_ref().take(length as u64);
        limited.read_to_end(&mut values).map_err(|_| OctreeError::Length)?;
        if values.len() != length {
            return Err(OctreeError::Length);
        }
        self.end().map(|()| values)
    }
}

pub(super) fn palette_planes(keys: &[Key]) -> Vec<u8> {
    let before = [0].iter().chain(keys);
    let differences: Vec<_> = keys.iter().zip(before).map(|(key, before)| key - before).collect();
    let plane =
        |byte: usize| differences.iter().map(move |difference| (difference >> (8 * byte)) as u8);
    (0..KEY_BYTES).flat_map(plane).collect()
}

pub(super) fn read_palette(
    plane: &mut PackedPlane<'_>,
    materials: usize,
) -> Result<Vec<Key>, OctreeError> {
    let mut bytes = vec![0; KEY_BYTES * materials];
    plane.fill(&mut bytes)?;
    plane.end()?;
    let mut key = 0;
    let mut next = |i: usize| {
        key += (0..KEY_BYTES)
            .map(|byte| Key::from(bytes[byte * materials + i]) << (8 * byte))
            .sum::<Key>();
        key
    };
    let keys: Vec<Key> = (0..materials).map(&mut next).collect();
    let is_sound =
        keys.is_sorted_by(|a, b| a < b) && keys.last().is_none_or(|&last| last <= KEY_MAX);
    if is_sound { Ok(keys) } else { Err(OctreeError::Nonsense("palette")) }
}

/// A material without its colour: the normal and the flags.
type Finish = ([i8; 3], u8);

/// The distinct finishes of all materials, in ascending order.
fn finishes(materials: &[Material]) -> Vec<Finish> {
    let mut finishes: Vec<_> = materials.iter().map(|m| (m.normal, m.flags)).collect();
    finishes.sort_unstable();
    finishes.dedup();
    finishes
}

/// The bytes of a material in the planes: luma, the low bytes of both chromas and of the finish,
/// and the high bits of these three.
fn to_plane_bytes(material: &Material, finishes: &[Finish]) -> [u8; PLANES] {
    let [luma, orange, green] = to_ycocg(material.colour);
    let finish = finishes.partition_point(|&known| known < (material.normal, material.flags));
    let high = (finish >> 8) as u8 | (orange >> 8 << 6 & 0x40) as u8 | (green >> 8 << 7) as u8;
    [luma as u8, orange as u8, green as u8, finish as u8, high]
}

pub(super) fn coded(materials: &[Material]) -> Vec<[u8; PLANES]> {
    let finishes = finishes(materials);
    materials.iter().map(|material| to_plane_bytes(material, &finishes)).collect()
}

fn differences(mut lumas: Vec<u8>) -> Vec<u8> {
    let mut before = 0;
    for luma in &mut lumas {
        (before, *luma) = (*luma, luma.wrapping_sub(before));
    }
    lumas
}

/// The entries of a palette by the bytes of their materials in the planes.
pub(super) fn known(palette: &Palette) -> FxHashMap<[u8; PLANES], u16> {
    let coded = coded(&palette.materials).into_iter().zip(&palette.materials);
    let first = |(coded, material)| Some((coded, palette.first_like(material)?));
    coded.filter_map(first).collect()
}

fn read_leaves(rest: &mut &[u8], count: usize, palette: &Palette) -> Result<Vec<u16>, OctreeError> {
    let known = known(palette);
    let mut planes = Vec::with_capacity(PLANES);
    for _ in 0..PLANES {
        planes.push((PackedPlane::take(rest)?, vec![0; CHUNK]));
    }
    let mut leaves = Vec::new();
    let (mut luma, mut last) = (0u8, None);
    while leaves.len() < count {
        let chunk = CHUNK.min(count - leaves.len());
        for (plane, values) in &mut planes {
            plane.fill(&mut values[..chunk])?;
        }
        for i in 0..chunk {
            let mut coded: [u8; PLANES] = std::array::from_fn(|plane| planes[plane].1[i]);
            luma = luma.wrapping_add(coded[0]);
            coded[0] = luma;
            let index = match last {
                Some((before, index)) if before == coded => index,
                _ => *known.get(&coded).ok_or(OctreeError::Nonsense("material"))?,
            };
            last = Some((coded, index));
            leaves.push(index);
        }
    }
    planes.iter_mut().try_for_each(|(plane, _)| plane.end())?;
    Ok(leaves)
}

/// Reads the origin, edge and depth of a tree, and gives it without nodes.
pub(super) fn read_head(rest: &mut &[u8]) -> Result<Octree, OctreeError> {
    let mut float = || take(rest).map(f32::from_le_bytes);
    let origin = Vec3::new(float()?, float()?, float()?);
    let edge = float()?;
    let [depth] = take(rest)?;
    if !(origin.is_finite() && origin.abs().max_element() <= EXTENT_MAX) {
        return Err(OctreeError::Nonsense("origin"));
    }
    if !(edge > 0.0 && edge <= EXTENT_MAX && edge.is_normal()) {
        return Err(OctreeError::Nonsense("edge"));
    }
    if !(1..=DEPTH_MAX).contains(&depth) {
        return Err(OctreeError::Depth);
    }
    Ok(Octree::empty(origin, edge, depth))
}

pub(super) fn take<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N], OctreeError> {
    let (head, tail) = rest.split_first_chunk::<N>().ok_or(OctreeError::Length)?;
    *rest = tail;
    Ok(*head)
}

#[cfg(test)]
mod tests {
    use glam::UVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::octree::{Voxel, morton};

    fn octree() -> impl Strategy<Value = Octree> {
        let materials = (any::<[u8; 3]>(), any::<[i8; 3]>(), 0u8..2);
        let voxel = (prop::array::uniform3(0u32..500), materials).prop_map(
            |(at, (colour, normal, flags))| Voxel {
                key: morton(UVec3::from(at)),
                colour,
                normal,
                flags,
            },
        );
        // Shallow trees are at most one block.
        (1u8..=9, prop::collection::vec(voxel, 0..100)).prop_map(|(depth, mut voxels)| {
            voxels.iter_mut().for_each(|voxel| voxel.key &= (1 << (3 * depth)) - 1);
            Octree::from_voxels(Vec3::new(1.0, -2.0, 3.0), 0.125, depth, voxels).expect("small")
        })
    }

    /// Whether no index is out of range, and every node but the root has exactly one parent.
    fn is_sound(octree: &Octree) -> bool {
        let (mut inner, mut leaves) = (0, 0);
        let mut stack: Vec<_> = octree.root().into_iter().collect();
        while let Some(node) = stack.pop() {
            node.material();
            *(if node.is_leaf() { &mut leaves } else { &mut inner }) += 1;
            stack.extend(node.children().map(|(_, child)| child));
        }
        inner == octree.inner.len() && leaves == octree.leaves.len()
    }

    proptest! {
        #[test]
        fn a_written_tree_reads_back_equal(octree in octree()) {
            prop_assert!(is_sound(&octree));
            prop_assert_eq!(Octree::from_bytes(&octree.to_bytes()), Ok(octree));
        }

        #[test]
        fn any_damage_gives_a_sound_tree_or_an_error(
            octree in octree(),
            at in any::<prop::sample::Index>(),
            flip in 1u8..,
            cut in any::<prop::sample::Index>(),
        ) {
            let mut bytes = octree.to_bytes();
            prop_assert!(Octree::from_bytes(&bytes[..cut.index(bytes.len())]).is_err());
            let at = at.index(bytes.len());
            bytes[at] ^= flip;
            if let Ok(other) = Octree::from_bytes(&bytes) {
                prop_assert!(is_sound(&other));
                prop_assert_eq!(Octree::from_bytes(&other.to_bytes()), Ok(other));
            }
        }

        #[test]
        fn the_reader_survives_noise(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            if let Ok(octree) = Octree::from_bytes(&bytes) {
                prop_assert!(is_sound(&octree));
            }
        }
    }

    #[test]
    fn a_count_is_checked_before_memory_is_taken() {
        let empty = Octree::empty(Vec3::ZERO, 1.0, 5).to_bytes();
        for at in [17, 21, 25] {
            let mut bytes = empty.clone();
            bytes[at] = 1;
            assert_eq!(Octree::from_bytes(&bytes), Err(OctreeError::Length));
            bytes[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
            assert_eq!(Octree::from_bytes(&bytes), Err(OctreeError::TooLarge));
        }
    }
}
