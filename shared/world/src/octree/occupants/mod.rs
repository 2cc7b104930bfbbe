//! Who is where: objects that come, move and go, kept at octree nodes.
//!
//! An object is one or more boxes, its *primitives*: what a TBV or a mover may fill. [`Occupants`]
//! keeps each at the nodes of an octree that it lies in, by one rule, so that the tree depends on
//! what is in it and not on what happened before:
//!
//! * A primitive has a level: the deepest whose nodes are no smaller than its longest side. There it
//!   lies in eight nodes at most. What reaches out of the region has level 0, the root's.
//! * A node is split while several primitives lie in it of which one may go deeper: until they are
//!   apart, or as deep as their levels and the tree's depth let them. Primitives of its own level
//!   stay at a split node itself; others are at the children that they lie in.
//! * A node exists when its parent is split and something lies in it; the root always does.
//!
//! [`Occupants::move_to`] is method B of the paper (Sudarsky and Gotsman, *Output-Sensitive
//! Visibility Algorithms for Dynamic Scenes*, section 3.1.1). It climbs from a node that the object
//! is in to the least node that holds all of the object's primitives, at their old and new places;
//! the cells' coordinates tell how far. Nodes above are never looked at. Below, primitives leave
//! nodes, then all enter the new ones, and only then are nodes deleted that hold nothing any more: so
//! nothing is deleted that would be made again. Nodes that a primitive stays in are left alone.
//! [`Occupants::move_all`] shares the climb, and the nodes, among several objects.
//!
//! Depth is at most [`DEPTH_MAX`]. Memory: about 130 bytes for each primitive and 90 for each node.
//! Of these there are at most 8 for a primitive on each level down to its own, so 12 kB for a
//! primitive at worst, at depth 16; with bodies in a building it is about one node each. There are
//! [`PRIMITIVES_MAX`] primitives at most.

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

/// No tree holds more boxes.
pub const PRIMITIVES_MAX: usize = 1 << 20;

/// An object in [`Occupants`]. The numbers are dense, and given again once an object is removed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct OccupantId(pub u32);

/// Why objects cannot be taken in, or moved. Nothing has changed then.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum OccupantError {
    /// An object has no box.
    #[error("an object needs at least one box")]
    NoPrimitive,
    /// A corner is not finite, or the box contains nothing.
    #[error("a box is empty or not finite")]
    BadBox,
    /// See [`PRIMITIVES_MAX`].
    #[error("more than {PRIMITIVES_MAX} boxes")]
    TooMany,
    /// No object has this number.
    #[error("there is no such object")]
    Unknown,
}

/// What the tree has done so far, in counts that do not depend on the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct WorkCounters {
    /// Nodes looked at to move, insert or remove something.
    pub visited: u64,
    /// Nodes made.
    pub created: u64,
    /// Nodes deleted.
    pub deleted: u64,
}

/// A dynamic octree of objects over a cube.
///
/// ```
/// use glam::Vec3;
/// use sightline_shared::{geometry::Aabb, octree::occupants::Occupants};
///
/// let mut occupants = Occupants::new(Vec3::ZERO, 64.0, 12);
/// let somebody = occupants.insert(&[Aabb::around(Vec3::splat(10.0), 0.5)])?;
/// occupants.move_to(somebody, &[Aabb::around(Vec3::new(10.5, 10.0, 10.0), 0.5)])?;
/// let here = Aabb::around(Vec3::splat(10.0), 2.0);
/// assert_eq!(occupants.meeting(&here), [somebody]);
/// # Ok::<(), crate::octree::occupants::OccupantError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Occupants {
    tree: OccupantTree,
    /// The primitives of each object; none where a number is not in use.
    objects: Vec<Vec<u32>>,
    free: Vec<u32>,
    scratch: MoveScratch,
}

/// What a move needs, kept for its memory.
#[derive(Clone, Debug, Default)]
struct MoveScratch {
    /// Of an object's boxes to come.
    spans: Vec<CellRange>,
    /// Primitives on their way to other nodes.
    entering: Vec<u32>,
    /// Nodes that primitives left.
    left: Vec<u32>,
}

/// What of an object moves to other nodes.
struct Change {
    /// The cells of all its primitives that do, before and after.
    span: CellRange,
    /// One of them, or one near them.
    anchor: u32,
}

impl Occupants {
    /// An empty tree over a cube that should hold all that is put in: its least corner, its edge in
    /// metres, and how deep nodes may be, [`DEPTH_MAX`] at most.
    ///
    /// # Panics
    ///
    /// When the cube is not finite or has no volume, or the depth is too great.
    pub fn new(origin: Vec3, edge: f32, depth: u8) -> Self {
        assert!(origin.is_finite() && edge.is_finite() && edge > 0.0, "not a cube");
        assert!(depth <= DEPTH_MAX, "too deep");
        let tree = OccupantTree::new(OccupantGrid::new(Aabb::new(origin, origin + edge), depth));
        Self { tree, objects: Vec::new(), free: Vec::new(), scratch: MoveScratch::default() }
    }

    /// Takes an object in.
    ///
    /// # Errors
    ///
    /// When it has no box, one that is not finite, or there is no room.
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

    /// Moves an object: method B. It may have another number of boxes than before.
    ///
    /// # Errors
    ///
    /// When there is no such object, or as for [`Occupants::insert`]; then it stays where it was.
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

    /// Removes an object; tells whether it was there.
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

    /// An object's boxes, in the order in which they were given; none when it is not there.
    pub fn primitives(&self, object: OccupantId) -> impl Iterator<Item = &Aabb> {
        let held = self.held(object).unwrap_or_default();
        held.iter().map(|&primitive| &self.tree.primitives[primitive as usize].bounds)
    }

    /// How many objects there are.
    pub fn len(&self) -> usize {
        self.objects.len() - self.free.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How many nodes there are, the root included.
    pub fn node_count(&self) -> usize {
        self.tree.node_count()
    }

    /// How deep the deepest node is; the root's depth is 0. Looks at all nodes.
    pub fn depth(&self) -> u8 {
        self.tree.nodes_in_use().map(|(_, node)| node.cell.depth).max().unwrap_or(0)
    }

    /// What was done since the tree was made.
    pub fn counters(&self) -> WorkCounters {
        self.tree.counters
    }

    fn held(&self, object: OccupantId) -> Result<&[u32], OccupantError> {
        let held = self.objects.get(object.0 as usize).filter(|held| !held.is_empty());
        held.map(Vec::as_slice).ok_or(OccupantError::Unknown)
    }

    /// Whether these boxes may take the place of a number of boxes.
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

    /// Finds the cells of boxes to come.
    fn measure(&mut self, primitives: &[Aabb]) {
        self.scratch.spans.clear();
        self.scratch.spans.extend(primitives.iter().map(|bounds| self.tree.grid.span(bounds)));
    }

    /// What of an object moves to other nodes, once its boxes to come are measured; nothing when all
    /// stay in their cells.
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
        // One box more or less: the first shows where the object is.
        for span in spans.iter().skip(held.len()) {
            add(held[0], &primitive(held[0]).span.union(span));
        }
        for &of in held.iter().skip(spans.len()) {
            add(of, &primitive(of).span);
        }
        change
    }

    /// Puts an object's boxes in place, once they are measured, and takes primitives out of the nodes
    /// where they will not be.
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

    /// Puts primitives where they belong, below a node that holds them all.
    fn enter(&mut self, start: u32) {
        for primitive in self.scratch.entering.drain(..) {
            self.tree.insert(start, primitive);
        }
    }

    fn tidy(&mut self) {
        for at in self.scratch.left.drain(..) {
            self.tree.tidy(at);
        }
    }
}
