//! Flat nodes: those whose leaves are one whole layer of voxels.
//!
//! Walls and floors are made of them. Whoever draws needs no tree there: which voxel lies where is
//! arithmetic, since the leaves below a node follow one another in memory.

use super::InnerNode;

/// Layers are told up to this many levels above the leaves: the bits of a flag suffice for more
/// no longer.
pub(super) const LEVELS_MAX: u32 = 4;

/// From which bit on, in [`InnerNode::flags`], two tell the axis, from 1 on, and four the place.
const AXIS_SHIFT: u32 = 2;
const PLACE_SHIFT: u32 = 4;

/// The children on the lower side of each axis.
const LOWER: [u8; 3] = [0x55, 0x33, 0x0f];

/// The layer that a node's leaves make up, if it is whole: see [`InnerNode::flat`]. `index` is that of
/// the node, whose children have their flags; from `bottom` on the children of nodes are leaves.
pub(super) fn flags(inner: &[InnerNode], index: usize, bottom: usize) -> u8 {
    let node = inner[index];
    let layer = LOWER.iter().position(|&lower| node.mask == lower || node.mask == !lower);
    let Some(axis) = layer else { return 0 };
    let side = u8::from(node.mask != LOWER[axis]);
    let pack = |place: u8| (axis as u8 + 1) << AXIS_SHIFT | place << PLACE_SHIFT;
    if index >= bottom {
        return pack(side);
    }
    let mut levels = 1;
    let mut below = node.first as usize;
    while below < bottom {
        below = inner[below].first as usize;
        levels += 1;
    }
    let first = node.first as usize;
    let children = &inner[first..first + node.mask.count_ones() as usize];
    let alike = |child: &InnerNode| child.flat() == inner[first].flat();
    match inner[first].flat() {
        Some((same, place))
            if same == axis && levels < LEVELS_MAX && children.iter().all(alike) =>
        {
            pack(place | side << levels)
        }
        _ => 0,
    }
}

impl InnerNode {
    /// When the leaves below are just one whole layer of voxels, its axis, and how many voxels lie
    /// before it. The leaves then follow one another in memory, in the order of [`morton`](super::morton).
    #[inline(always)]
    pub fn flat(&self) -> Option<(usize, u8)> {
        let axis = self.flags >> AXIS_SHIFT & 3;
        (axis != 0).then(|| (usize::from(axis) - 1, self.flags >> PLACE_SHIFT))
    }
}

#[cfg(test)]
mod tests {
    use glam::{UVec3, Vec3};

    use crate::octree::{Octree, Voxel, morton};

    /// A layer without those voxels, and what the root says of it.
    fn check(depth: u8, axis: usize, at: u32, without: u32, expected: Option<(usize, u8)>) {
        let side = 1 << depth;
        let voxels = (without..side * side).map(|i| {
            let mut place = [0; 3];
            (place[axis], place[(axis + 1) % 3], place[(axis + 2) % 3]) = (at, i / side, i % side);
            Voxel { key: morton(UVec3::from(place)), ..Voxel::default() }
        });
        let octree = Octree::from_voxels(Vec3::ZERO, 1.0, depth, voxels.collect()).expect("small");
        assert_eq!(octree.inner[0].flat(), expected, "{depth}, {axis}, {at}, {without}");
        let bytes = octree.to_bytes();
        let again = Octree::from_bytes(&bytes).expect("just written");
        assert_eq!(again.inner[0].flat(), expected);
    }

    #[test]
    fn whole_layers_are_flat() {
        for axis in 0..3 {
            for depth in 1..5 {
                for at in 0..1 << depth {
                    check(depth, axis, at, 0, Some((axis, at as u8)));
                    check(depth, axis, at, 1, None);
                }
            }
            check(5, axis, 3, 0, None);
        }
    }

    #[test]
    fn steps_are_not() {
        let voxels = (0..16).map(|i| {
            let at = UVec3::new(i % 4, i / 4, i / 8);
            Voxel { key: morton(at), ..Voxel::default() }
        });
        let octree = Octree::from_voxels(Vec3::ZERO, 1.0, 2, voxels.collect()).expect("small");
        assert_eq!(octree.inner[0].flat(), None);
    }
}
