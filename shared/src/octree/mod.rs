//! The one octree: static voxels, their colours and normals. Objects that come, move and go have
//! one of their own, over a cube as well: [`occupants`].
//!
//! Nodes are stored breadth-first or in any order in which the children of one node are
//! contiguous and in ascending octant order. Octant bit 0 is +x, bit 1 is +y, bit 2 is +z.

//!
//! A walk from the root halves cubes. [`Octree::from_voxels`] makes the tree, [`Octree::to_bytes`]
//! and [`Octree::from_bytes`] keep it.

mod build;
mod codec;
pub mod occupants;

use glam::Vec3;

pub use build::{Voxel, morton};
pub use codec::OctreeError;

use crate::geometry::Aabb;

/// No octree has more nodes: 768 MiB of them.
pub const NODES_MAX: usize = 64 << 20;

/// No octree is deeper.
pub const DEPTH_MAX: u8 = 16;

/// A node: a leaf voxel when `child_mask` is zero, else an inner node with averaged looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Node {
    /// Index of the first child in [`Octree::nodes`]; meaningless in a leaf.
    pub first_child: u32,
    /// Bit `i` is set when the child in octant `i` is not empty.
    pub child_mask: u8,
    /// sRGB colour, shaded by nothing.
    pub colour: [u8; 3],
    /// The surface normal, as signed hundred-and-twenty-sevenths; zero when it has none.
    pub normal: [i8; 3],
    /// Material bits: see [`Node::GLASS`].
    pub flags: u8,
}

impl Node {
    /// Blocks bodies, not sight; drawn as a tint. An inner node has it when all its leaves do.
    pub const GLASS: u8 = 1;

    /// Whether there is nothing below.
    pub fn is_leaf(&self) -> bool {
        self.child_mask == 0
    }

    /// Whether everything in it can be seen through.
    pub fn is_glass(&self) -> bool {
        self.flags & Self::GLASS != 0
    }

    /// The index of the child in an octant, if there is one.
    pub fn child(&self, octant: u8) -> Option<u32> {
        let bit = 1u8 << octant;
        (self.child_mask & bit != 0)
            .then(|| self.first_child + (self.child_mask & (bit - 1)).count_ones())
    }
}

/// A sparse voxel octree over a cube.
#[derive(Clone, Debug, PartialEq)]
pub struct Octree {
    /// The cube's corner with the least coordinates, in metres.
    pub origin: Vec3,
    /// The cube's edge, in metres: `voxel` × 2^`depth`.
    pub edge: f32,
    /// Leaves are at most this deep; the root is at depth 0. At most 16.
    pub depth: u8,
    /// The root comes first. Empty when there is no voxel.
    pub nodes: Vec<Node>,
}

impl Octree {
    /// The edge of a leaf voxel, in metres.
    pub fn voxel(&self) -> f32 {
        self.edge / (1u32 << self.depth) as f32
    }

    /// The cube.
    pub fn bounds(&self) -> Aabb {
        Aabb::new(self.origin, self.origin + self.edge)
    }

    /// Whether any voxel, glass included, shares volume with a box; touching does not count.
    pub fn solid_in(&self, region: &Aabb) -> bool {
        !self.nodes.is_empty() && self.solid_below(0, self.origin, self.edge, region)
    }

    fn solid_below(&self, index: u32, min: Vec3, edge: f32, region: &Aabb) -> bool {
        let apart = region.min.cmpge(min + edge) | region.max.cmple(min);
        if apart.any() {
            return false;
        }
        let node = &self.nodes[index as usize];
        if node.is_leaf() {
            return true;
        }
        let half = edge * 0.5;
        (0..8).any(|octant| {
            node.child(octant).is_some_and(|child| {
                self.solid_below(child, min + octant_corner(octant) * half, half, region)
            })
        })
    }

    /// The leaf voxel that a point lies in, if there is one.
    pub fn leaf_at(&self, point: Vec3) -> Option<&Node> {
        let mut min = self.origin;
        let mut edge = self.edge;
        let inside = point.cmpge(min) & point.cmplt(min + edge);
        if !inside.all() {
            return None;
        }
        let mut node = self.nodes.first()?;
        while !node.is_leaf() {
            edge *= 0.5;
            let octant = point.cmpge(min + edge).bitmask() as u8;
            node = &self.nodes[node.child(octant)? as usize];
            min += octant_corner(octant) * edge;
        }
        Some(node)
    }
}

/// The least corner of an octant within a cube of edge 2.
fn octant_corner(octant: u8) -> Vec3 {
    Vec3::new((octant & 1) as f32, (octant >> 1 & 1) as f32, (octant >> 2 & 1) as f32)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use glam::{IVec3, UVec3};
    use proptest::prelude::*;

    use super::*;

    const ORIGIN: Vec3 = Vec3::new(-3.0, 1.0, 0.5);

    fn octree_of(cells: &BTreeSet<[u32; 3]>, depth: u8, voxel: f32) -> Octree {
        let voxels =
            cells.iter().map(|&c| Voxel { key: morton(UVec3::from(c)), ..Voxel::default() });
        Octree::from_voxels(ORIGIN, voxel, depth, voxels.collect()).expect("small")
    }

    fn cells() -> impl Strategy<Value = BTreeSet<[u32; 3]>> {
        prop::collection::btree_set(prop::array::uniform3(0u32..16), 0..200)
    }

    proptest! {
        #[test]
        fn points_lie_in_the_voxels_that_were_put_in(cells in cells()) {
            let octree = octree_of(&cells, 4, 0.25);
            for i in 0..4096u32 {
                let cell = UVec3::new(i & 15, i >> 4 & 15, i >> 8);
                let jitter = Vec3::new((i % 7) as f32, (i % 5) as f32, (i % 3) as f32) * 0.03;
                let point = ORIGIN + (cell.as_vec3() + 0.05) * 0.25 + jitter;
                prop_assert_eq!(octree.leaf_at(point).is_some(), cells.contains(&cell.to_array()));
            }
        }

        #[test]
        fn a_box_is_solid_where_a_voxel_overlaps_it(
            cells in cells(),
            corner in prop::array::uniform3(-8i32..72),
            size in prop::array::uniform3(1i32..24),
        ) {
            // Quarters of a voxel, so that boxes often just touch.
            let octree = octree_of(&cells, 4, 0.25);
            let (low, high) = (IVec3::from(corner), IVec3::from(corner) + IVec3::from(size));
            let at = |quarters: IVec3| ORIGIN + quarters.as_vec3() * 0.0625;
            let naive = cells.iter().any(|&c| {
                let min = UVec3::from(c).as_ivec3() * 4;
                (min.cmplt(high) & (min + 4).cmpgt(low)).all()
            });
            prop_assert_eq!(octree.solid_in(&Aabb::new(at(low), at(high))), naive);
        }
    }

    #[test]
    fn nothing_is_nowhere() {
        let empty = octree_of(&BTreeSet::new(), 4, 0.25);
        assert!(!empty.solid_in(&Aabb::around(Vec3::ZERO, 100.0)));
        assert!(empty.leaf_at(ORIGIN + 0.1).is_none());
        assert!(empty.leaf_at(Vec3::NAN).is_none());
    }
}
