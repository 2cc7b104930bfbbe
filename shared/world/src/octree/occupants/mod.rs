//! An octree of moving objects.
//!
//! An object is one or more boxes, its *primitives*: for instance a TBV, or what a mover may fill.
//! [`Occupants`] keeps each primitive at the nodes that it overlaps, by the following rules. They
//! make the tree depend on its content alone, and not on its history.
//!
//! * A primitive has a level: the deepest level whose nodes are at least as large as its longest
//!   side. At that level it overlaps at most eight nodes. A primitive that reaches out of the
//!   region has level 0, the root's.
//! * A node is split while several primitives overlap it and one of them may go deeper. A split
//!   node keeps the primitives of its own level; others are at the children that they overlap.
//! * A node exists when its parent is split and a primitive overlaps it. The root always exists.
//!
//! [`Occupants::move_to`] is method B of Sudarsky and Gotsman 1996 (*Output-Sensitive Visibility
//! Algorithms for Dynamic Scenes*, section 3.1.1). It climbs from a node of the object to the
//! lowest common ancestor of all primitives, at their old and new places. The coordinates of the
//! cells tell how far. It never visits nodes above. Below, all primitives leave their old nodes,
//! then all enter their new nodes, and only then are empty nodes deleted. So no node is deleted and
//! made again, and nodes in which a primitive stays are not touched. [`Occupants::move_all`] shares
//! the climb and the nodes among several objects.
//!
//! The depth is at most [`DEPTH_MAX`]. A primitive takes about 130 bytes, and a node 90. A
//! primitive has at most 8 nodes on each level down to its own: 12 kB at depth 16. Bodies in a
//! building have about one node each. There are at most [`PRIMITIVES_MAX`] primitives.

mod grid;
mod group;
mod naive;
#[cfg(test)]
mod tests;
mod tree;
mod walk;

use glam::Vec3;
use thiserror::Error;

use super::DEPTH_MAX;
use crate::geometry::Aabb;
use grid::{CellRange, OccupantGrid};
use tree::{OccupantTree, ROOT};
pub use walk::Visit;

/// The greatest number of primitives in a tree.
pub const PRIMITIVES_MAX: usize = 1 << 20;

/// The number of an object in [`Occupants`]. Numbers are dense. Those of removed objects are
/// reused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct OccupantId(pub u32);

/// Why objects cannot be inserted or moved. The tree is unchanged then.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum OccupantError {
    /// An object has no box.
    #[error("an object needs at least one box")]
    NoPrimitive,
    /// A box is empty or not finite.
    #[error("a box is empty or not finite")]
    BadBox,
    /// There would be more than [`PRIMITIVES_MAX`] boxes.
    #[error("more than {PRIMITIVES_MAX} boxes")]
    TooMany,
    /// No object has this number, or a list of moves names it twice.
    #[error("there is no such object")]
    Unknown,
}

/// Counts of the tree's work so far. They do not depend on the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct WorkCounters {
    /// The nodes visited to move, insert or remove objects.
    pub visited: u64,
    /// The nodes created.
    pub created: u64,
    /// The nodes deleted.
    pub deleted: u64,
}

/// An octree of moving objects over a cube.
///
/// ```
/// use glam::Vec3;
/// use sightline_world::{geometry::Aabb, octree::occupants::Occupants};
///
/// let mut occupants = Occupants::new(Vec3::ZERO, 64.0, 12);
/// let avatar = occupants.insert(&[Aabb::around(Vec3::splat(10.0), 0.5)])?;
/// occupants.move_to(avatar, &[Aabb::around(Vec3::new(10.5, 10.0, 10.0), 0.5)])?;
/// let here = Aabb::around(Vec3::splat(10.0), 2.0);
/// assert_eq!(occupants.meeting(&here), [avatar]);
/// # Ok::<(), sightline_world::octree::occupants::OccupantError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Occupants {
    tree: OccupantTree,
    /// The primitives of each object; none for a number that is not in use.
    objects: Vec<Vec<u32>>,
    free: Vec<u32>,
    scratch: MoveScratch,
}

/// Buffers for moves, kept to save allocations.
#[derive(Clone, Debug, Default)]
struct MoveScratch {
    /// The cells of an object's new boxes.
    spans: Vec<CellRange>,
    /// The primitives that are to enter nodes.
    entering: Vec<u32>,
    /// The nodes that primitives have left.
    left: Vec<u32>,
}

/// The part of an object that moves to other nodes.
struct Change {
    /// The cells of the primitives that change nodes, before and after.
    span: CellRange,
    /// One of these primitives, or one near them.
    anchor: u32,
}

impl Occupants {
    /// An empty tree over a cube that should contain all objects. `origin` is its corner with the
    /// least coordinates, `edge` its edge in metres, and `depth` the greatest depth of nodes.
    ///
    /// # Panics
    ///
    /// When the cube is not finite or has no volume, or the depth exceeds [`DEPTH_MAX`].
    pub fn new(origin: Vec3, edge: f32, depth: u8) -> Self {
        assert!(origin.is_finite() && edge.is_finite() && edge > 0.0, "not a cube");
        assert!(depth <= DEPTH_MAX, "too deep");
        let tree = OccupantTree::new(OccupantGrid::new(Aabb::new(origin, origin + edge), depth));
        Self { tree, objects: Vec::new(), free: Vec::new(), scratch: MoveScratch::default() }
    }

    /// Inserts an object.
    ///
    /// # Errors
    ///
    /// When it has no box, a box is empty or not finite, or there are too many boxes.
    pub fn insert(&mut self, primitives: &[Aabb]) -> Result<OccupantId, OccupantError> {
        self.check(primitives, 0)?;
        let id = self.free.pop().unwrap_or_else(|| {
            self.objects.push(Vec::new());
            (self.objects.len() - 1) as u32
        });
        for bounds in primitives {
            let span = self.tree.grid.span(bounds);
            let primitive = self.tree.add(id, *bounds, span);
            self.objects[id as usize].push(primitive);
            self.tree.insert(ROOT, primitive);
        }
        Ok(OccupantId(id))
    }

    /// Moves an object (method B). The number of its boxes may change.
    ///
    /// # Errors
    ///
    /// When there is no such object, or the boxes are invalid as for [`Occupants::insert`].
    pub fn move_to(
        &mut self,
        object: OccupantId,
        primitives: &[Aabb],
    ) -> Result<(), OccupantError> {
        let held = self.held(object)?;
        self.check(primitives, held.len())?;
        self.measure(primitives);
        let change = self.change(object);
        let start = change.map(|change| {
            let depth = self.tree.grid.common_depth(&change.span);
            self.tree.ancestor(change.anchor, depth)
        });
        self.leave(object, primitives);
        if let Some(start) = start {
            self.enter(start);
            self.tidy();
        }
        Ok(())
    }

    /// Removes an object. Returns whether it existed.
    pub fn remove(&mut self, object: OccupantId) -> bool {
        if self.held(object).is_err() {
            return false;
        }
        for primitive in std::mem::take(&mut self.objects[object.0 as usize]) {
            self.tree.leave(primitive, None, &mut self.scratch.left);
            self.tree.forget(primitive);
        }
        self.tidy();
        self.free.push(object.0);
        true
    }

    /// The boxes of an object, in the order in which they were given. None when it does not exist.
    pub fn primitives(&self, object: OccupantId) -> impl Iterator<Item = &Aabb> {
        let held = self.held(object).unwrap_or_default();
        held.iter().map(|&primitive| &self.tree.primitives[primitive as usize].bounds)
    }

    /// The number of objects.
    pub fn len(&self) -> usize {
        self.objects.len() - self.free.len()
    }

    /// Whether there are no objects.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of nodes, the root included.
    pub fn node_count(&self) -> usize {
        self.tree.node_count()
    }

    /// The depth of the deepest node; the root's is 0. It takes time proportional to the number of
    /// nodes.
    pub fn depth(&self) -> u8 {
        self.tree.nodes_in_use().map(|(_, node)| node.cell.depth).max().unwrap_or(0)
    }

    /// Counts of the work since the tree was made.
    pub fn counters(&self) -> WorkCounters {
        self.tree.counters
    }

    /// The primitives of an object.
    fn held(&self, object: OccupantId) -> Result<&[u32], OccupantError> {
        let held = self.objects.get(object.0 as usize).filter(|held| !held.is_empty());
        held.map(Vec::as_slice).ok_or(OccupantError::Unknown)
    }

    /// Checks boxes that are to replace `held` boxes.
    fn check(&self, primitives: &[Aabb], held: usize) -> Result<(), OccupantError> {
        if primitives.is_empty() {
            return Err(OccupantError::NoPrimitive);
        }
        if primitives.iter().any(|b| b.is_empty() || !b.min.is_finite() || !b.max.is_finite()) {
            return Err(OccupantError::BadBox);
        }
        if self.tree.primitive_count() - held + primitives.len() > PRIMITIVES_MAX {
            return Err(OccupantError::TooMany);
        }
        Ok(())
    }

    /// Finds the cells of an object's new boxes.
    fn measure(&mut self, primitives: &[Aabb]) {
        self.scratch.spans.clear();
        self.scratch.spans.extend(primitives.iter().map(|bounds| self.tree.grid.span(bounds)));
    }

    /// The part of an object that moves to other nodes, once its new boxes are measured. `None`
    /// when all boxes stay in their cells.
    fn change(&self, object: OccupantId) -> Option<Change> {
        let held = &self.objects[object.0 as usize];
        let spans = &self.scratch.spans;
        let primitive = |of: u32| &self.tree.primitives[of as usize];
        let mut change: Option<Change> = None;
        let mut add = |of: u32, span: &CellRange| {
            let span = primitive(of).span.union(span);
            change = Some(match &change {
                Some(change) => Change { span: change.span.union(&span), ..*change },
                None => Change { span, anchor: of },
            });
        };
        for (&of, span) in
            held.iter().zip(spans).filter(|(of, span)| primitive(**of).span != **span)
        {
            add(of, span);
        }
        // The first box shows where an object with more or fewer boxes is.
        for span in spans.iter().skip(held.len()) {
            add(held[0], &primitive(held[0]).span.union(span));
        }
        for &of in held.iter().skip(spans.len()) {
            add(of, &primitive(of).span);
        }
        change
    }

    /// Stores an object's new boxes, once they are measured, and detaches primitives from the nodes
    /// that they leave.
    fn leave(&mut self, object: OccupantId, primitives: &[Aabb]) {
        let MoveScratch { spans, entering, left } = &mut self.scratch;
        let held = &mut self.objects[object.0 as usize];
        for extra in held.drain(primitives.len().min(held.len())..) {
            self.tree.leave(extra, None, left);
            self.tree.forget(extra);
        }
        for (index, (bounds, span)) in primitives.iter().zip(spans).enumerate() {
            let Some(&primitive) = held.get(index) else {
                held.push(self.tree.add(object.0, *bounds, *span));
                entering.push(held[index]);
                continue;
            };
            if self.tree.primitives[primitive as usize].span != *span {
                self.tree.leave(primitive, Some(span), left);
                entering.push(primitive);
            }
            let of = &mut self.tree.primitives[primitive as usize];
            (of.bounds, of.span) = (*bounds, *span);
        }
    }

    /// Attaches the entering primitives to their nodes, below a node that contains them all.
    fn enter(&mut self, start: u32) {
        for primitive in self.scratch.entering.drain(..) {
            self.tree.insert(start, primitive);
        }
    }

    /// Deletes the nodes that are not needed any more.
    fn tidy(&mut self) {
        for at in self.scratch.left.drain(..) {
            self.tree.tidy(at);
        }
    }
}
