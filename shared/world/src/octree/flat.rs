//! Flat nodes: nodes whose leaves form one complete layer of voxels.
//!
//! Walls and floors consist of these. A renderer needs no tree there: the leaves below a node are
//! contiguous, so the index of each voxel follows from its position.

use super::InnerNode;

/// The greatest height above the leaves at which flat nodes are marked. The flags have no bits for
/// the place of a layer in larger nodes.
pub(super) const LEVELS_MAX: u32 = 4;

/// The first of two bits in [`InnerNode::flags`] with the axis plus one, and the first of four bits
/// with the place.
const AXIS_SHIFT: u32 = 2;
const PLACE_SHIFT: u32 = 4;

/// The child masks of the lower half along each axis.
const LOWER: [u8; 3] = [0x55, 0x33, 0x0f];

/// The bits for [`InnerNode::flat`] of the node at `index`; zero when its leaves are not one
/// complete layer. The children have their flags already. From `bottom` on the children of nodes
/// are leaves.
pub(super) fn flags(inner: &[InnerNode], index: usize, bottom: usize) -> u8 {
    flags_at(inner, index, || {
        let (mut levels, mut below) = (1, index);
        while below < bottom {
            below = inner[below].first as usize;
            levels += 1;
        }
        levels
    })
}

/// Like [`flags`], for a node that is this number of levels above the leaves.
pub(super) fn flags_at(inner: &[InnerNode], index: usize, levels: impl FnOnce() -> u32) -> u8 {
    let node = inner[index];
    let layer = LOWER.iter().position(|&lower| node.mask == lower || node.mask == !lower);
    let Some(axis) = layer else { return 0 };
    let side = u8::from(node.mask != LOWER[axis]);
    let pack = |place: u8| (axis as u8 + 1) << AXIS_SHIFT | place << PLACE_SHIFT;
    let levels = levels() - 1;
    if levels == 0 {
        return pack(side);
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
    /// The axis of the layer and the number of voxels before it along the axis, when the leaves
    /// below are exactly one complete layer of voxels. The leaves are then contiguous in memory, in
    /// the order of [`morton`](super::morton).
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

    /// Checks what the root says of a layer that lacks its first `without` voxels.
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
    fn complete_layers_are_flat() {
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
    fn stairs_are_not_flat() {
        let voxels = (0..16).map(|i| {
            let at = UVec3::new(i % 4, i / 4, i / 8);
            Voxel { key: morton(at), ..Voxel::default() }
        });
        let octree = Octree::from_voxels(Vec3::ZERO, 1.0, 2, voxels.collect()).expect("small");
        assert_eq!(octree.inner[0].flat(), None);
    }
}
