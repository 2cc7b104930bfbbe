//! Queries.

use glam::Vec3;

use super::{OccupantId, Occupants, grid::CellRange, tree::ROOT};
use crate::geometry::Aabb;

/// A step of [`Occupants::front_to_back`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Visit {
    /// A node, by its cube. The answer is whether to enter it.
    Node(Aabb),
    /// An object, when the first of its boxes is reached. The answer does not matter.
    Occupant(OccupantId),
}

impl Occupants {
    /// The objects with a box that shares a point with a region, each once, in order of their
    /// numbers.
    pub fn meeting(&self, region: &Aabb) -> Vec<OccupantId> {
        let mut found = Vec::new();
        if !region.is_empty() {
            self.meeting_below(ROOT, region, &self.tree.grid.cells(region), &mut found);
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    fn meeting_below(&self, at: u32, region: &Aabb, span: &CellRange, found: &mut Vec<OccupantId>) {
        let node = &self.tree.nodes[at as usize];
        for &primitive in &node.primitives {
            let primitive = &self.tree.primitives[primitive as usize];
            if primitive.bounds.intersects(region) {
                found.push(OccupantId(primitive.object));
            }
        }
        if node.is_split() {
            let octants = self.tree.grid.octants(node.cell, span);
            for octant in (0..8).filter(|octant| octants & node.child_mask & 1 << octant != 0) {
                if let Some(child) = node.child(octant) {
                    self.meeting_below(child, region, span, found);
                }
            }
        }
    }

    /// Walks the tree from front to back. A node comes before the nodes that it can hide from the
    /// eye, and the objects at a node before those below it. `visit` is called for each node,
    /// answers whether to enter it, and is called for each object found.
    ///
    /// The union of the cubes of an object's nodes contains the object. The root is entered without
    /// a question, because it also has the objects that reach out of the region.
    pub fn front_to_back(&self, eye: Vec3, mut visit: impl FnMut(Visit) -> bool) {
        let mut seen = vec![0u64; self.objects.len().div_ceil(64)];
        self.walk(ROOT, eye, &mut seen, &mut visit);
    }

    /// `seen` has a bit for each object.
    fn walk(&self, at: u32, eye: Vec3, seen: &mut [u64], visit: &mut impl FnMut(Visit) -> bool) {
        let node = &self.tree.nodes[at as usize];
        let bounds = self.tree.grid.bounds(node.cell);
        if at != ROOT && !visit(Visit::Node(bounds)) {
            return;
        }
        for &primitive in &node.primitives {
            let object = self.tree.primitives[primitive as usize].object;
            let (word, bit) = (object as usize / 64, 1u64 << (object % 64));
            if seen[word] & bit == 0 {
                seen[word] |= bit;
                visit(Visit::Occupant(OccupantId(object)));
            }
        }
        let nearest = eye.cmpge(bounds.centre()).bitmask() as u8;
        for step in NEARER_FIRST {
            if let Some(child) = node.child(nearest ^ step) {
                self.walk(child, eye, seen, visit);
            }
        }
    }
}

/// The octants relative to the nearest one, ordered by the number of middle planes between. An
/// octant that can hide another comes first.
const NEARER_FIRST: [u8; 8] = [0, 1, 2, 4, 3, 5, 6, 7];
