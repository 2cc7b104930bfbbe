//! The octree of static voxels. Moving objects have an octree of their own: [`occupants`].
//!
//! All leaves are at the greatest depth. An inner node ([`InnerNode`]) takes eight bytes. A leaf
//! takes two: an index into the palette of materials ([`Material`]). An inner node has the mean
//! material of the leaves below it, from the same palette. So the material of any node is one
//! look-up away, and a renderer shades the palette once instead of every pixel.
//!
//! Octant bit 0 is +x, bit 1 is +y, bit 2 is +z. The children of a node are contiguous and in
//! ascending octant order. The order of nodes in memory keeps a walk through a part of the building
//! within a few kilobytes:
//!
//! * First come all nodes at least [`BLOCK_LEVELS`] above the leaves, breadth-first. The lowest of
//!   these are the roots of the blocks.
//! * Then come the inner nodes below each root, block by block in the order of the roots, and
//!   breadth-first within a block.
//! * The leaves are apart, in depth-first order, which is the order of [`morton`].
//!
//! A [`Cursor`] walks the tree without knowledge of this order. [`Octree::from_voxels`] and
//! [`Octree::from_blocks`] build a tree. [`Octree::to_bytes`] and [`Octree::from_bytes`] store it.

mod blend;
mod build;
mod census;
mod codec;
mod cursor;
mod flat;
mod layout;
mod material;
pub mod occupants;
mod palette;
pub mod pieces;

use glam::Vec3;

pub use build::{Voxel, VoxelBlock, morton};
pub use codec::OctreeError;
pub use cursor::Cursor;
pub use material::Material;

use crate::geometry::Aabb;

/// The greatest number of inner nodes: they take 512 MiB.
pub const INNER_MAX: usize = 1 << 26;

/// The greatest number of leaves: they take 256 MiB.
pub const LEAVES_MAX: usize = 1 << 27;

/// The greatest number of materials: as many as an index of 16 bits can tell apart.
pub const MATERIALS_MAX: usize = 1 << 16;

/// The greatest depth.
pub const DEPTH_MAX: u8 = 16;

/// The number of levels of a block, which is 2^6 voxels wide. A shallower tree is one block.
pub const BLOCK_LEVELS: u8 = 6;

/// A node above the leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct InnerNode {
    /// The index of the first child: in [`Octree::leaves`] for a node just above the leaves,
    /// otherwise in [`Octree::inner`].
    pub first: u32,
    /// The mean material of the leaves below: an index into [`Octree::materials`].
    pub material: u16,
    /// Bit `i` is set when the child in octant `i` is not empty. Never zero.
    pub mask: u8,
    /// [`InnerNode::GLASS`], [`InnerNode::SOME_GLASS`], and the bits that [`InnerNode::flat`]
    /// decodes.
    pub flags: u8,
}

impl InnerNode {
    /// Set when all leaves below are glass.
    pub const GLASS: u8 = Material::GLASS;
    /// Set when some leaf below is glass.
    pub const SOME_GLASS: u8 = 2;

    /// The index of the child in an octant, if there is one.
    pub fn child(&self, octant: u8) -> Option<u32> {
        debug_assert!(octant < 8, "an octant has the number {octant}");
        let bit = 1u8 << octant;
        (self.mask & bit != 0).then(|| self.first + (self.mask & (bit - 1)).count_ones())
    }
}

/// A sparse voxel octree over a cube. The fields are public for renderers to read. They depend on
/// one another, so do not change them.
#[derive(Clone, Debug, PartialEq)]
pub struct Octree {
    /// The cube's corner with the least coordinates, in metres.
    pub origin: Vec3,
    /// The cube's edge, in metres: `voxel` × 2^`depth`.
    pub edge: f32,
    /// The depth of all leaves, from 1 to 16. The root is at depth 0.
    pub depth: u8,
    /// The inner nodes, the root first. Empty when there is no voxel.
    pub inner: Vec<InnerNode>,
    /// The leaves: indices into the materials.
    pub leaves: Vec<u16>,
    /// The palette of materials, opaque ones first and glass last.
    pub materials: Vec<Material>,
    /// The materials' keys, as in the file.
    keys: Vec<palette::Key>,
}

impl Octree {
    /// A tree without voxels.
    pub fn empty(origin: Vec3, edge: f32, depth: u8) -> Self {
        let depth = depth.clamp(1, DEPTH_MAX);
        let (inner, leaves, materials, keys) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { origin, edge, depth, inner, leaves, materials, keys }
    }

    /// The edge of a leaf voxel, in metres.
    pub fn voxel(&self) -> f32 {
        self.edge / (1u32 << self.depth) as f32
    }

    /// The cube that the tree covers.
    pub fn bounds(&self) -> Aabb {
        Aabb::new(self.origin, self.origin + self.edge)
    }

    /// The memory that inner nodes, leaves and materials take, in bytes.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.inner.as_slice())
            + size_of_val(self.leaves.as_slice())
            + size_of_val(self.materials.as_slice())
            + size_of_val(self.keys.as_slice())
    }

    /// The index of the first material that is glass. All later ones are glass too.
    pub fn first_glass(&self) -> usize {
        self.materials.partition_point(|material| !material.is_glass())
    }

    /// The root; `None` in a tree without voxels.
    pub fn root(&self) -> Option<Cursor<'_>> {
        Cursor::root(self)
    }

    /// Whether any voxel, glass included, shares volume with a box. Touching does not count.
    pub fn solid_in(&self, region: &Aabb) -> bool {
        self.root().is_some_and(|root| solid_below(root, self.origin, self.edge, region))
    }

    /// The material of the voxel that contains a point, if there is one.
    pub fn leaf_at(&self, point: Vec3) -> Option<&Material> {
        let mut min = self.origin;
        let mut edge = self.edge;
        let inside = point.cmpge(min) & point.cmplt(min + edge);
        if !inside.all() {
            return None;
        }
        let mut node = self.root()?;
        while !node.is_leaf() {
            edge *= 0.5;
            let octant = point.cmpge(min + edge).bitmask() as u8;
            node = node.child(octant)?;
            min += octant_corner(octant) * edge;
        }
        Some(node.material())
    }

    /// The highest voxel straight below a point, or around it, that reaches above the height
    /// `lowest`: the height of its top, and its material.
    pub fn first_below(&self, point: Vec3, lowest: f32) -> Option<(f32, &Material)> {
        let (min, max) = (self.origin, self.origin + self.edge);
        let is_beside = point.x < min.x || point.x >= max.x || point.z < min.z || point.z >= max.z;
        let root = self.root().filter(|_| !is_beside && point.is_finite())?;
        first_below(root, min, self.edge, point, lowest)
    }
}

fn first_below<'a>(
    node: Cursor<'a>,
    min: Vec3,
    edge: f32,
    point: Vec3,
    lowest: f32,
) -> Option<(f32, &'a Material)> {
    if point.y < min.y || min.y + edge <= lowest {
        return None;
    }
    if node.is_leaf() {
        return Some((min.y + edge, node.material()));
    }
    let half = edge * 0.5;
    let beside = point.cmpge(min + half).bitmask() as u8 & 0b101;
    [beside | 0b010, beside].into_iter().find_map(|octant| {
        let corner = min + octant_corner(octant) * half;
        first_below(node.child(octant)?, corner, half, point, lowest)
    })
}

fn solid_below(node: Cursor<'_>, min: Vec3, edge: f32, region: &Aabb) -> bool {
    let apart = region.min.cmpge(min + edge) | region.max.cmple(min);
    if apart.any() {
        return false;
    }
    let half = edge * 0.5;
    node.is_leaf()
        || node.children().any(|(octant, child)| {
            solid_below(child, min + octant_corner(octant) * half, half, region)
        })
}

/// The corner with the least coordinates of an octant, in a cube of edge 2.
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
        fn the_first_voxel_below_is_the_highest(
            cells in cells(),
            at in prop::array::uniform3(-1.0f32..17.0),
            depth in 0.5f32..20.0,
        ) {
            let octree = octree_of(&cells, 4, 0.5);
            let point = ORIGIN + Vec3::from(at) * 0.5;
            let lowest = point.y - depth * 0.5;
            let column = [at[0].floor() as i64, at[2].floor() as i64];
            let top_of = |cell: &[u32; 3]| ORIGIN.y + (cell[1] + 1) as f32 * 0.5;
            let expected = cells
                .iter()
                .filter(|cell| [i64::from(cell[0]), i64::from(cell[2])] == column)
                .filter(|cell| top_of(cell) - 0.5 <= point.y && top_of(cell) > lowest)
                .map(top_of)
                .reduce(f32::max);
            prop_assert_eq!(octree.first_below(point, lowest).map(|(top, _)| top), expected);
        }

    #[test]
        fn points_lie_in_the_voxels_that_the_tree_was_built_from(cells in cells()) {
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
    fn a_tree_without_voxels_is_empty_everywhere() {
        let empty = octree_of(&BTreeSet::new(), 4, 0.25);
        assert!(!empty.solid_in(&Aabb::around(Vec3::ZERO, 100.0)));
        assert!(empty.leaf_at(ORIGIN + 0.1).is_none());
        assert!(empty.leaf_at(Vec3::NAN).is_none());
    }
}
