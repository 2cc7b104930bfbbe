//! The one octree: static voxels, their colours and normals.
//!
//! Nodes are stored breadth-first or in any order in which the children of one node are
//! contiguous and in ascending octant order. Octant bit 0 is +x, bit 1 is +y, bit 2 is +z.

use glam::Vec3;

use crate::geometry::Aabb;

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
}
