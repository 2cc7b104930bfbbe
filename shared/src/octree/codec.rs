//! The octree as bytes.
//!
//! ```text
//! origin 3 × f32 · edge f32 · depth u8 · grain 3 × u8                    (little-endian)
//! looks u32 · inner nodes u32 · leaves u32
//! looks: eight bytes each, ascending; child masks; leaves: low bytes, high bytes
//! ```
//!
//! All in the order in memory. Indices of nodes are not stored, so that no bytes can make a cycle. Inner
//! nodes get their looks back from the leaves.

use glam::Vec3;
use thiserror::Error;

use super::{
    DEPTH_MAX, INNER_MAX, LEAVES_MAX, LOOKS_MAX, Octree,
    blend::average,
    palette::{Grain, KEY_MAX, Palette},
    shape::Shape,
};

/// Why there is no octree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum OctreeError {
    /// No level, or more than [`DEPTH_MAX`].
    #[error("an octree has 1 to {DEPTH_MAX} levels")]
    Depth,
    /// More nodes than [`INNER_MAX`] or [`LEAVES_MAX`].
    #[error("an octree has more than {INNER_MAX} inner nodes or {LEAVES_MAX} leaves")]
    TooLarge,
    /// A voxel's key does not belong to the tree.
    #[error("a voxel lies outside its octree")]
    Outside,
    /// The bytes stop early, or go on after the end.
    #[error("an octree has too few or too many bytes")]
    Length,
    /// A number has no meaning.
    #[error("an octree's {0} makes no sense")]
    Nonsense(&'static str),
}

/// No coordinate or edge is greater, in metres.
const EXTENT_MAX: f32 = 1.0e6;

impl Octree {
    /// Writes the tree.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        for number in self.origin.to_array().into_iter().chain([self.edge]) {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend([self.depth, self.grain.luma, self.grain.chroma, self.grain.normal]);
        for count in [self.looks.len(), self.inner.len(), self.leaves.len()] {
            bytes.extend((count as u32).to_le_bytes());
        }
        for key in &self.keys {
            bytes.extend(key.to_le_bytes());
        }
        bytes.extend(self.inner.iter().map(|node| node.mask));
        bytes.extend(self.leaves.iter().map(|&leaf| leaf as u8));
        bytes.extend(self.leaves.iter().map(|&leaf| (leaf >> 8) as u8));
        bytes
    }

    /// Reads what [`Octree::to_bytes`] wrote: any bytes give a sound tree or an error. At most eight
    /// times the bytes are held.
    ///
    /// # Errors
    ///
    /// When the bytes are not exactly one octree.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, OctreeError> {
        let mut rest = bytes;
        let mut octree = read_frame(&mut rest)?;
        let mut count = |max: usize| {
            let count = u32::from_le_bytes(take(&mut rest)?) as usize;
            if count <= max { Ok(count) } else { Err(OctreeError::TooLarge) }
        };
        let (looks, inner, leaves) = (count(LOOKS_MAX)?, count(INNER_MAX)?, count(LEAVES_MAX)?);
        let mut plane = |length: usize| {
            let (head, tail) = rest.split_at_checked(length).ok_or(OctreeError::Length)?;
            rest = tail;
            Ok(head)
        };
        let (keys, masks) = (plane(8 * looks)?, plane(inner)?);
        let (low, high) = (plane(leaves)?, plane(leaves)?);
        if !rest.is_empty() {
            return Err(OctreeError::Length);
        }
        let keys: Vec<u64> =
            keys.as_chunks().0.iter().map(|&key| u64::from_le_bytes(key)).collect();
        let grain = octree.grain;
        if !keys.is_sorted_by(|a, b| a < b) || keys.last().is_some_and(|&last| last > KEY_MAX) {
            return Err(OctreeError::Nonsense("palette"));
        }
        let shape = Shape::link(masks, octree.depth)?;
        if shape.leaves != leaves {
            return Err(OctreeError::Length);
        }
        octree.inner = shape.inner;
        let pairs = low.iter().zip(high);
        octree.leaves = pairs.map(|(&low, &high)| u16::from_le_bytes([low, high])).collect();
        if octree.leaves.iter().any(|&leaf| usize::from(leaf) >= looks) {
            return Err(OctreeError::Nonsense("look"));
        }
        let mut palette = Palette::closed(grain, keys);
        average(&mut octree.inner, &shape.roots, &octree.leaves, octree.depth, &mut palette)
            .ok_or(OctreeError::Nonsense("palette"))?;
        (octree.looks, octree.keys) = (palette.looks, palette.keys);
        Ok(octree)
    }
}

/// Where the tree is, and how deep and fine; still empty.
fn read_frame(rest: &mut &[u8]) -> Result<Octree, OctreeError> {
    let mut float = || take(rest).map(f32::from_le_bytes);
    let origin = Vec3::new(float()?, float()?, float()?);
    let edge = float()?;
    let [depth, luma, chroma, normal] = take(rest)?;
    if !(origin.is_finite() && origin.abs().max_element() <= EXTENT_MAX) {
        return Err(OctreeError::Nonsense("origin"));
    }
    if !(edge > 0.0 && edge <= EXTENT_MAX && edge.is_normal()) {
        return Err(OctreeError::Nonsense("edge"));
    }
    if !(1..=DEPTH_MAX).contains(&depth) {
        return Err(OctreeError::Depth);
    }
    let grain = Grain { luma, chroma, normal };
    if !grain.is_sound() {
        return Err(OctreeError::Nonsense("grain"));
    }
    Ok(Octree { grain, ..Octree::empty(origin, edge, depth) })
}

fn take<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N], OctreeError> {
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
        let looks = (any::<[u8; 3]>(), any::<[i8; 3]>(), 0u8..2);
        let voxel =
            (prop::array::uniform3(0u32..500), looks).prop_map(|(at, (colour, normal, flags))| {
                Voxel { key: morton(UVec3::from(at)), colour, normal, flags }
            });
        // Shallow trees are one block or less.
        (1u8..=9, prop::collection::vec(voxel, 0..100)).prop_map(|(depth, mut voxels)| {
            voxels.iter_mut().for_each(|voxel| voxel.key &= (1 << (3 * depth)) - 1);
            Octree::from_voxels(Vec3::new(1.0, -2.0, 3.0), 0.125, depth, voxels).expect("small")
        })
    }

    /// No index is out of range, and every node but the root is the child of exactly one.
    fn is_sound(octree: &Octree) -> bool {
        let (mut inner, mut leaves) = (0, 0);
        let mut stack: Vec<_> = octree.root().into_iter().collect();
        while let Some(node) = stack.pop() {
            node.look();
            *(if node.is_leaf() { &mut leaves } else { &mut inner }) += 1;
            stack.extend(node.children().map(|(_, child)| child));
        }
        inner == octree.inner.len() && leaves == octree.leaves.len()
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(octree in octree()) {
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
        fn noise_is_survived(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            if let Ok(octree) = Octree::from_bytes(&bytes) {
                prop_assert!(is_sound(&octree));
            }
        }
    }

    #[test]
    fn a_count_is_checked_before_memory_is_taken() {
        let empty = Octree::empty(Vec3::ZERO, 1.0, 5).to_bytes();
        for at in [20, 24, 28] {
            let mut bytes = empty.clone();
            bytes[at] = 1;
            assert_eq!(Octree::from_bytes(&bytes), Err(OctreeError::Length));
            bytes[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
            assert_eq!(Octree::from_bytes(&bytes), Err(OctreeError::TooLarge));
        }
    }
}
