//! Whether a way leads from one place to another: what a claim is held against besides speed.

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::Vec3;
use sightline_world::{Cells, Node, World, geometry::Aabb, tolerance::POKE_M};

use crate::claims::clearance::Clearance;

/// No search looks at more gates: 0.1 ms. What is undecided by then counts as led to.
const GATES_MAX: u32 = 1_000;

/// What an accepted eye stands on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct WalkState {
    /// The space that it is in, or poked out of into something solid; none for one that was put into
    /// something solid.
    space: Option<u32>,
    /// It was put where a body has no room, and has not been where it has since. It gets out through
    /// any gate.
    is_stuck: bool,
}

/// The ways through a building: gates, and the spaces that they join.
///
/// Spaces are convex and open all through, so that whoever stays in one needs no search. Whoever
/// is in another has come through gates, and its way is at least as long as the gaps between the
/// boxes around each two of them, the first one and where it was, and the last one and where it is.
/// So no way that was walked is denied; what is granted beyond are short cuts within gates, and,
/// where a gate is slanted, within the box around it.
#[derive(Clone, Debug)]
pub(crate) struct Walkways {
    /// For each space what it fills, in own axes; empty where that is no box.
    boxes: Vec<Aabb>,
    /// Through which gates bodies fit.
    pub(crate) fit: Clearance,
    /// A metre down counts for so much.
    fall: f32,
    search: u32,
    /// This search goes through any gate.
    is_stuck: bool,
    /// For each gate, the search that came to it last, and the shortest way to it.
    come: Vec<(u32, f32)>,
    /// Gates that were come to: those with the shortest way by them first.
    waiting: BinaryHeap<Reverse<(u32, u32)>>,
}

impl Walkways {
    /// Bodies fall so many times as fast as they move of their own power.
    pub(crate) fn new(world: &World, fall_ratio: f32) -> Self {
        let cells = &world.cells;
        Self {
            boxes: boxes(cells),
            fit: Clearance::new(world),
            fall: 1.0 / fall_ratio.max(1.0),
            search: 0,
            is_stuck: false,
            come: vec![(0, 0.0); cells.gates.len()],
            waiting: BinaryHeap::new(),
        }
    }

    /// Of an eye that may be wherever it is, in own axes.
    pub(crate) fn footing(&self, world: &World, eye: Vec3) -> WalkState {
        let is_stuck = !self.fit.has_room(world, world.cells.axes.world(eye));
        WalkState { space: space_at(&world.cells, eye), is_stuck }
    }

    /// Through which gates somebody may go.
    pub(crate) fn fit_of(&self, footing: WalkState) -> Option<&Clearance> {
        (!footing.is_stuck).then_some(&self.fit)
    }

    /// The footing of an eye that claims to have come from one place to another, both in own axes, and
    /// how long its way was at least, if a way that is no longer than a limit leads there.
    /// Nothing is said of the length, but zero, where no wall is in between.
    ///
    /// Of eyes in something solid this is the rule: one that came from a space may be as far in as
    /// bodies poke into walls ([`POKE_M`]), and keeps its footing in a space that it has reached;
    /// one that has no footing is free to move until it is in a space.
    pub(crate) fn lead(
        &mut self,
        world: &World,
        (from, footing): (Vec3, WalkState),
        to: Vec3,
        way_m: f32,
    ) -> Option<(WalkState, f32)> {
        let (space, led_m) = self.lead_into(world, (from, footing), to, way_m)?;
        let is_stuck = footing.is_stuck && !self.fit.has_room(world, world.cells.axes.world(to));
        Some((WalkState { space, is_stuck }, led_m))
    }

    fn lead_into(
        &mut self,
        world: &World,
        (from, footing): (Vec3, WalkState),
        to: Vec3,
        way_m: f32,
    ) -> Option<(Option<u32>, f32)> {
        let Some(space) = footing.space else {
            return Some((space_at(&world.cells, to), 0.0));
        };
        if self.boxes[space as usize].contains(to) {
            return Some((footing.space, 0.0));
        }
        let mut search = |goals: &[u32]| {
            let led = self.search(world, (from, space, footing.is_stuck), (to, goals), way_m)?;
            Some((Some(led.0), led.1))
        };
        match space_at(&world.cells, to) {
            Some(there) if there == space => Some((footing.space, 0.0)),
            Some(there) => search(&[there]),
            None => {
                let beside = beside(&world.cells, to);
                if beside.contains(&space) {
                    return Some((footing.space, 0.0));
                }
                search(&beside)
            }
        }
    }

    /// Looks for a way from a space into one of several others: which of them it leads into, and how
    /// long it is at least. Who is wedged goes through any gate.
    fn search(
        &mut self,
        world: &World,
        (from, space, is_stuck): (Vec3, u32, bool),
        (to, goals): (Vec3, &[u32]),
        way_m: f32,
    ) -> Option<(u32, f32)> {
        self.begin(is_stuck);
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
                return Some((*goal, f32::from_bits(whole)));
            }
            looked_at += 1;
            if looked_at > GATES_MAX {
                return goals.first().map(|goal| (*goal, 0.0));
            }
            let gap = gate.polygon.bounds();
            gate.spaces.iter().for_each(|s| self.go_on(world, *s, (&gap, come_m), (&to, way_m)));
        }
        None
    }

    fn begin(&mut self, is_stuck: bool) {
        self.is_stuck = is_stuck;
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
            let fits = self.is_stuck || self.fit.through_gate(*index);
            if whole_m <= way_m && is_nearer && fits {
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

/// The space that a place in own axes is in; none in something solid.
fn space_at(cells: &Cells, place: Vec3) -> Option<u32> {
    cells.at_own(place).map(|cell| cells.cells[cell.0 as usize].space)
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
