//! The nodes: primitives are attached and detached, nodes are split and deleted.

use super::{
    WorkCounters,
    grid::{CellRange, GridCell, OccupantGrid},
};
use crate::geometry::Aabb;

/// Stands for no node.
const NONE: u32 = u32::MAX;
/// The depth of a node that is not in use.
const FREE: u8 = u8::MAX;

pub(super) const ROOT: u32 = 0;

/// A box of an object, and the nodes that it is attached to.
#[derive(Clone, Debug)]
pub(super) struct Primitive {
    pub(super) object: u32,
    pub(super) bounds: Aabb,
    pub(super) span: CellRange,
    nodes: [u32; 8],
    node_count: u8,
}

/// A node. It is split while several primitives overlap it and one of them may go deeper.
#[derive(Clone, Debug)]
pub(super) struct OccupantNode {
    pub(super) cell: GridCell,
    pub(super) parent: u32,
    children: [u32; 8],
    /// Bit `i` is set when there is a child in octant `i`. Zero when the node is not split.
    pub(super) child_mask: u8,
    /// The attached primitives, in no particular order. A split node has only primitives of its own
    /// level.
    pub(super) primitives: Vec<u32>,
}

/// All nodes and primitives.
#[derive(Clone, Debug)]
pub(super) struct OccupantTree {
    pub(super) grid: OccupantGrid,
    pub(super) nodes: Vec<OccupantNode>,
    nodes_free: Vec<u32>,
    pub(super) primitives: Vec<Primitive>,
    primitives_free: Vec<u32>,
    pub(super) counters: WorkCounters,
}

impl Primitive {
    pub(super) fn nodes(&self) -> &[u32] {
        &self.nodes[..usize::from(self.node_count)]
    }

    fn attach(&mut self, node: u32) {
        // A primitive overlaps at most eight cells of its level, and each of its nodes contains
        // one.
        self.nodes[usize::from(self.node_count)] = node;
        self.node_count += 1;
    }

    fn detach(&mut self, node: u32) {
        let at = self.nodes().iter().position(|&of| of == node).expect("attached both ways");
        self.node_count -= 1;
        self.nodes[at] = self.nodes[usize::from(self.node_count)];
    }
}

impl OccupantNode {
    fn new(cell: GridCell, parent: u32) -> Self {
        Self { cell, parent, children: [NONE; 8], child_mask: 0, primitives: Vec::new() }
    }

    pub(super) fn is_split(&self) -> bool {
        self.child_mask != 0
    }

    pub(super) fn child(&self, octant: u8) -> Option<u32> {
        let child = self.children[usize::from(octant)];
        (child != NONE).then_some(child)
    }

    pub(super) fn children(&self) -> impl Iterator<Item = u32> + '_ {
        self.children.iter().copied().filter(|&child| child != NONE)
    }
}

impl OccupantTree {
    pub(super) fn new(grid: OccupantGrid) -> Self {
        Self {
            grid,
            nodes: vec![OccupantNode::new(GridCell::ROOT, NONE)],
            nodes_free: Vec::new(),
            primitives: Vec::new(),
            primitives_free: Vec::new(),
            counters: WorkCounters::default(),
        }
    }

    pub(super) fn primitive_count(&self) -> usize {
        self.primitives.len() - self.primitives_free.len()
    }

    pub(super) fn node_count(&self) -> usize {
        self.nodes.len() - self.nodes_free.len()
    }

    /// The nodes in use with their indices.
    pub(super) fn nodes_in_use(&self) -> impl Iterator<Item = (u32, &OccupantNode)> {
        (0..).zip(&self.nodes).filter(|(_, node)| node.cell.depth != FREE)
    }

    /// The first node at most this deep on the way up from a primitive.
    pub(super) fn ancestor(&mut self, primitive: u32, depth: u8) -> u32 {
        let mut at = self.primitives[primitive as usize].nodes()[0];
        while self.nodes[at as usize].cell.depth > depth {
            self.counters.visited += 1;
            at = self.nodes[at as usize].parent;
        }
        at
    }

    /// Adds a primitive that is not attached to any node.
    pub(super) fn add(&mut self, object: u32, bounds: Aabb, span: CellRange) -> u32 {
        let primitive = Primitive { object, bounds, span, nodes: [NONE; 8], node_count: 0 };
        if let Some(free) = self.primitives_free.pop() {
            self.primitives[free as usize] = primitive;
            return free;
        }
        self.primitives.push(primitive);
        (self.primitives.len() - 1) as u32
    }

    /// Forgets a primitive that is not attached to any node.
    pub(super) fn forget(&mut self, primitive: u32) {
        debug_assert!(self.primitives[primitive as usize].nodes().is_empty());
        self.primitives_free.push(primitive);
    }

    /// Attaches a primitive to its nodes, below a node that contains all its cells. Nodes that it
    /// is attached to already keep it.
    pub(super) fn insert(&mut self, at: u32, primitive: u32) {
        self.counters.visited += 1;
        let node = &self.nodes[at as usize];
        let span = self.primitives[primitive as usize].span;
        let deepest = node.cell.depth == span.level;
        if !node.is_split() {
            if node.primitives.contains(&primitive) {
                return;
            }
            if node.primitives.is_empty() {
                self.attach(at, primitive);
                return;
            }
            self.push_down(at);
        }
        if !deepest {
            self.insert_below(at, primitive);
        } else if !self.nodes[at as usize].primitives.contains(&primitive) {
            self.attach(at, primitive);
        }
    }

    fn insert_below(&mut self, at: u32, primitive: u32) {
        let cell = self.nodes[at as usize].cell;
        let mut octants = self.grid.octants(cell, &self.primitives[primitive as usize].span);
        while octants != 0 {
            let octant = octants.trailing_zeros() as u8;
            octants &= octants - 1;
            let child = self.child_or_new(at, octant);
            self.insert(child, primitive);
        }
    }

    /// Moves the primitive that may go deeper from a node to its children.
    fn push_down(&mut self, at: u32) {
        let node = &self.nodes[at as usize];
        let deeper = |&&of: &&u32| self.primitives[of as usize].span.level > node.cell.depth;
        // A node that is not split has at most one such primitive.
        if let Some(&primitive) = node.primitives.iter().find(deeper) {
            self.detach(at, primitive);
            self.insert_below(at, primitive);
        }
    }

    fn attach(&mut self, at: u32, primitive: u32) {
        self.nodes[at as usize].primitives.push(primitive);
        self.primitives[primitive as usize].attach(at);
    }

    fn detach(&mut self, at: u32, primitive: u32) {
        let held = &mut self.nodes[at as usize].primitives;
        let index = held.iter().position(|&of| of == primitive).expect("attached both ways");
        held.swap_remove(index);
        self.primitives[primitive as usize].detach(at);
    }

    /// Detaches a primitive from its nodes, except from those that overlap its new cells too.
    /// Appends the nodes that it left, which still have to be tidied.
    pub(super) fn leave(&mut self, primitive: u32, new: Option<&CellRange>, left: &mut Vec<u32>) {
        let of = &self.primitives[primitive as usize];
        let new = new.filter(|new| new.level == of.span.level);
        let (nodes, count) = (of.nodes, of.nodes().len());
        for &at in &nodes[..count] {
            let cell = self.nodes[at as usize].cell;
            if !new.is_some_and(|new| self.grid.meets(cell, new)) {
                self.detach(at, primitive);
                left.push(at);
            }
        }
    }

    /// Deletes nodes that are not needed any more, from a node that was left upwards.
    ///
    /// It stops at a node that must stay split. If that is because of another node that is still to
    /// be tidied, tidying that one comes back here.
    pub(super) fn tidy(&mut self, mut at: u32) {
        if self.nodes[at as usize].cell.depth == FREE {
            return;
        }
        loop {
            self.counters.visited += 1;
            if self.nodes[at as usize].is_split() {
                if self.must_stay_split(at) {
                    return;
                }
                self.merge(at);
            }
            if at == ROOT {
                return;
            }
            let parent = self.nodes[at as usize].parent;
            if self.nodes[at as usize].primitives.is_empty() {
                self.delete(at);
            }
            at = parent;
        }
    }

    /// Whether several primitives overlap a split node.
    fn must_stay_split(&self, at: u32) -> bool {
        let node = &self.nodes[at as usize];
        let mut found = node.primitives.first().copied();
        for child in node.children() {
            let child = &self.nodes[child as usize];
            if child.is_split() {
                return true;
            }
            for &primitive in &child.primitives {
                if found.is_some_and(|found| found != primitive) {
                    return true;
                }
                found = Some(primitive);
            }
        }
        false
    }

    /// Deletes the children, none of which is split, and attaches their last primitive to the node.
    fn merge(&mut self, at: u32) {
        let children = self.nodes[at as usize].children;
        let mut last = None;
        for child in children.into_iter().filter(|&child| child != NONE) {
            while let Some(&primitive) = self.nodes[child as usize].primitives.last() {
                self.detach(child, primitive);
                last = Some(primitive);
            }
            self.delete(child);
        }
        if let Some(primitive) = last {
            self.attach(at, primitive);
        }
    }

    fn child_or_new(&mut self, at: u32, octant: u8) -> u32 {
        if let Some(child) = self.nodes[at as usize].child(octant) {
            return child;
        }
        self.counters.created += 1;
        let cell = self.nodes[at as usize].cell.child(octant);
        let child = if let Some(free) = self.nodes_free.pop() {
            let node = &mut self.nodes[free as usize];
            (node.cell, node.parent) = (cell, at);
            free
        } else {
            self.nodes.push(OccupantNode::new(cell, at));
            (self.nodes.len() - 1) as u32
        };
        let node = &mut self.nodes[at as usize];
        node.children[usize::from(octant)] = child;
        node.child_mask |= 1 << octant;
        child
    }

    /// Deletes a node without primitives and children.
    fn delete(&mut self, at: u32) {
        self.counters.deleted += 1;
        let node = &mut self.nodes[at as usize];
        debug_assert!(node.primitives.is_empty() && !node.is_split());
        let (octant, parent) = (node.cell.octant(), node.parent);
        node.cell.depth = FREE;
        let parent = &mut self.nodes[parent as usize];
        parent.children[usize::from(octant)] = NONE;
        parent.child_mask &= !(1 << octant);
        self.nodes_free.push(at);
    }
}
