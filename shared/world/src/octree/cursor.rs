//! A place in the tree, for walks that need not be the fastest.

use super::{InnerNode, Material, Octree};

/// A node: its children, and how it materials.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a> {
    octree: &'a Octree,
    /// In `leaves` when `level` is the tree's depth, else in `inner`.
    index: u32,
    level: u8,
}

impl<'a> Cursor<'a> {
    pub(super) fn root(octree: &'a Octree) -> Option<Self> {
        (!octree.inner.is_empty()).then_some(Self { octree, index: 0, level: 0 })
    }

    /// How far it is from the root.
    pub fn level(self) -> u8 {
        self.level
    }

    /// Whether it is a voxel, with nothing below.
    pub fn is_leaf(self) -> bool {
        self.level == self.octree.depth
    }

    /// The inner node, unless it is a leaf.
    pub fn inner(self) -> Option<&'a InnerNode> {
        (!self.is_leaf()).then(|| &self.octree.inner[self.index as usize])
    }

    /// The child in an octant, if there is one.
    pub fn child(self, octant: u8) -> Option<Self> {
        let index = self.inner()?.child(octant)?;
        Some(Self { octree: self.octree, index, level: self.level + 1 })
    }

    /// The children with their octants, in ascending order.
    pub fn children(self) -> impl Iterator<Item = (u8, Self)> {
        (0..8).filter_map(move |octant| Some((octant, self.child(octant)?)))
    }

    /// The index of its materials in [`Octree::materials`].
    pub fn material_index(self) -> u16 {
        match self.inner() {
            Some(inner) => inner.material,
            None => self.octree.leaves[self.index as usize],
        }
    }

    /// How it materials; an inner node as the mean of what is below.
    pub fn material(self) -> &'a Material {
        &self.octree.materials[usize::from(self.material_index())]
    }

    /// Whether everything in it can be seen through.
    pub fn is_glass(self) -> bool {
        self.material().is_glass()
    }
}
