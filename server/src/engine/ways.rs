//! Whether a way leads from one place to another: what a claim is held against besides speed.

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::Vec3;
use sightline_shared::{
    geometry::Aabb,
    world::{Cells, Node, World},
};

use super::{fit::Fit, reach::POKE_M};

/// No search looks at more gates: 0.1 ms. What is undecided by then counts as led to.
const GATES_MAX: u32 = 1_000;

/// The space that an accepted eye is in, or poked out of into something solid; none for one that was
/// put into something solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(super) struct Footing(Option<u32>);

/// The ways through a building: gates, and the spaces that they join.
///
/// Spaces are convex and open all through, so that whoever stays in one needs no search. Whoever
/// is in another has come through gates, and its way is at least as long as the gaps between the
/// boxes around each two of them, the first one and where it was, and the last one and where it is.
/// So no way that was walked is denied; what is granted beyond are short cuts within gates, and,
/// where a gate is slanted, within the box around it.
#[derive(Clone, Debug)]
pub(super) struct Ways {
    /// For each space what it fills, in own axes; empty where that is no box.
    boxes: Vec<Aabb>,
    /// Through which gates bodies fit.
    fit: Fit,
    /// A metre down counts for so much.
    fall: f32,
    search: u32,
    /// For each gate, the search that came to it last, and the shortest way to it.
    come: Vec<(u32, f32)>,
    /// Gates that were come to: those with the shortest way by them first.
    waiting: BinaryHeap<Reverse<(u32, u32)>>,
}

impl Ways {
    /// Bodies fall so many times as fast as they move of their own power.
    pub(super) fn new(world: &World, fall_ratio: f32) -> Self {
        let cells = &world.cells;
        Self {
            boxes: boxes(cells),
            fit: Fit::new(world),
            fall: 1.0 / fall_ratio.max(1.0),
            search: 0,
            come: vec![(0, 0.0); cells.gates.len()],
            waiting: BinaryHeap::new(),
        }
    }

    /// Of an eye that may be wherever it is, in own axes.
    pub(super) fn footing(&self, cells: &Cells, eye: Vec3) -> Footing {
        Footing(cells.at_own(eye).map(|cell| cells.cells[cell.0 as usize].space))
    }

    /// The footing of an eye that claims to have come from one place to another, both in own axes, and
    /// how long its way was at least, if a way that is no longer than a limit leads there.
    /// Nothing is said of the length, but zero, where no wall is in between.
    ///
    /// Of eyes in something solid this is the rule: one that came from a space may be as far in as
    /// bodies poke into walls ([`POKE_M`]), and keeps its footing in a space that it has reached;
    /// one that has no footing is free to move until it is in a space.
    pub(super) fn lead(
        &mut self,
        world: &World,
        (from, footing): (Vec3, Footing),
        to: Vec3,
        way_m: f32,
    ) -> Option<(Footing, f32)> {
        let Footing(Some(space)) = footing else {
            return Some((self.footing(&world.cells, to), 0.0));
        };
        if self.boxes[space as usize].contains(to) {
            return Some((footing, 0.0));
        }
        match self.footing(&world.cells, to) {
            Footing(Some(there)) if there == space => Some((footing, 0.0)),
            Footing(Some(there)) => self.search(world, (from, space), (to, &[there]), way_m),
            Footing(None) => {
                let beside = beside(&world.cells, to);
                if beside.contains(&space) {
                    return Some((footing, 0.0));
                }
                self.search(world, (from, space), (to, &beside), way_m)
            }
        }
    }

    /// Looks for a way from a space into one of several others.
    fn search(
        &mut self,
        world: &World,
        (from, space): (Vec3, u32),
        (to, goals): (Vec3, &[u32]),
        way_m: f32,
    ) -> Option<(Footing, f32)> {
        self.begin();
        let to = Aabb::new(to, to);
        // An eye in a wall counts as if it were where the space begins.
        let bounds = &world.cells.spaces[space as usize].bounds;
        let from = from.clamp(bounds.min, bounds.max);
        self.go_on(world, space, (&Aabb::new(from, from), 0.0), (&to, way_m));
        let mut looked_at = 0;
        while let Some(Reverse((whole, gate))) = self.waiting.pop() {
            let come_m = self.come[gate as usize].1;
            let gate = &world.cells.gates[gate as usize];
            if let Some(goal) = gate.spaces.iter().find(|space| goals.contains(space)) {
                return Some((Footing(Some(*goal)), f32::from_bits(whole)));
            }
            looked_at += 1;
            if looked_at > GATES_MAX {
                return goals.first().map(|goal| (Footing(Some(*goal)), 0.0));
            }
            let gap = gate.polygon.bounds();
            gate.spaces.iter().for_each(|s| self.go_on(world, *s, (&gap, come_m), (&to, way_m)));
        }
        None
    }

    fn begin(&mut self) {
        self.search = self.search.wrapping_add(1);
        if self.search == 0 {
            self.come.fill((0, 0.0));
            self.search = 1;
        }
        self.waiting.clear();
    }

    /// Goes from somewhere in a space to those of its gates by which a way to a place may lead.
    fn go_on(
        &mut self,
        world: &World,
        space: u32,
        (from, come_m): (&Aabb, f32),
        (to, way_m): (&Aabb, f32),
    ) {
        for index in &world.cells.spaces[space as usize].gates {
            let gap = world.cells.gates[*index as usize].polygon.bounds();
            let come_m = come_m + self.between(from, &gap);
            let whole_m = come_m + self.between(&gap, to);
            let known = &mut self.come[*index as usize];
            let is_nearer = known.0 != self.search || come_m < known.1;
            if whole_m <= way_m && is_nearer && self.fit.through(world, *index) {
                *known = (self.search, come_m);
                // Ways are never negative, so that their bits are in order.
                self.waiting.push(Reverse((whole_m.to_bits(), *index)));
            }
        }
    }

    /// No body has less way from a point of one box to a point of another. Up, down and along the
    /// ground are counted apart, and the longest of them counts: bodies that jump or fall while
    /// they run are as fast along the ground as others.
    fn between(&self, from: &Aabb, to: &Aabb) -> f32 {
        let up = to.min - from.max;
        let down = from.min - to.max;
        let gap = up.max(down).max(Vec3::ZERO);
        gap.x.hypot(gap.z).max(up.y).max(down.y * self.fall)
    }
}

/// The spaces that a place in something solid is so close to that bodies poke into it from there.
fn beside(cells: &Cells, place: Vec3) -> Vec<u32> {
    let mut found = Vec::new();
    cells.overlapping(&Aabb::around(place, POKE_M), &mut found);
    let mut spaces: Vec<u32> =
        found.into_iter().map(|cell| cells.cells[cell.0 as usize].space).collect();
    spaces.dedup();
    spaces
}

/// What each space fills, if it is a box: one that no slanted plane bounds.
fn boxes(cells: &Cells) -> Vec<Aabb> {
    let mut boxes: Vec<Aabb> = cells.spaces.iter().map(|space| space.bounds).collect();
    let mut is_slanted = vec![false; cells.tree.len()];
    for (index, node) in cells.tree.iter().enumerate() {
        let slanted = is_slanted[index];
        match node {
            Node::Axial { sides, .. } => {
                sides.iter().for_each(|side| is_slanted[*side as usize] = slanted);
            }
            Node::Plane { sides, .. } => {
                sides.iter().for_each(|side| is_slanted[*side as usize] = true);
            }
            Node::Leaf(cell) if slanted => {
                boxes[cells.cells[cell.0 as usize].space as usize] = Aabb::EMPTY;
            }
            Node::Leaf(_) | Node::Solid => {}
        }
    }
    boxes
}

#[cfg(test)]
mod tests;
