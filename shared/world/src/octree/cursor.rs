//! A position in the tree, for walks outside of inner loops.

use super::{InnerNode, Material, Octree};

/// A node of an octree, inner node or leaf: its level, children and material.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a> {
    octree: &'a Octree,
    /// An index into `leaves` when `level` is the tree's depth, otherwise into `inner`.
    index: u32,
    level: u8,
}

impl<'a> Cursor<'a> {
    pub(super) fn root(octree: &'a Octree) -> Option<Self> {
        (!octree.inner.is_empty()).then_some(Self { octree, index: 0, level: 0 })
    }

    /// The number of levels below the root.
    pub fn level(self) -> u8 {
        self.level
    }

    /// Whether the node is a leaf, that is a voxel.
    pub fn is_leaf(self) -> bool {
        self.level == self.octree.depth
    }

    /// The inner node; `None` for a leaf.
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

    /// The index of the material in [`Octree::materials`].
    pub fn material_index(self) -> u16 {
        match self.inner() {
            Some(inner) => inner.material,
            None => self.octree.leaves[self.index as usize],
        }
    }

    /// The material; an inner node's is the mean of the leaves below.
    pub fn material(self) -> &'a Material {
        &self.octree.materials[usize::from(self.material_index())]
    }

    /// Whether the node can be seen through: all leaves below are glass.
    pub fn is_glass(self) -> bool {
        self.material().is_glass()
    }
}
