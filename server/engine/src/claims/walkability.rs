//! Walkability: whether a way on foot leads from one place to another.

use std::{cmp::Reverse, collections::BinaryHeap, time::Duration};

use glam::Vec3;
use sightline_world::{Cells, Node, World, geometry::Aabb, tolerance::POKE_M};

use super::Clearance;
use crate::generation::Generational;

/// How far a course is followed from one test for walls to the next, in metres.
const COURSE_STEP_M: f32 = 0.25;
/// The most gates that one search visits, in 0.1 ms. A claim that is undecided by then is accepted.
const GATES_MAX: u32 = 1_000;

/// What an accepted eye stands on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct WalkState {
    /// The space that the eye is in, or from which it pokes into something solid. `None` for an eye
    /// that the host put into something solid.
    space: Option<u32>,
    /// The body was put where it has no room, and has not been where it has room since. It gets out
    /// through any gate.
    is_stuck: bool,
}

impl WalkState {
    /// The state of an avatar of another station.
    pub(crate) fn relayed(space: Option<u32>, is_stuck: bool) -> Self {
        Self { space, is_stuck }
    }

    /// What another station is told: the space, and whether the body is stuck.
    pub(crate) fn parts(self) -> (Option<u32>, bool) {
        (self.space, self.is_stuck)
    }
}

/// A claimed step on foot. Both places are in own axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Walk {
    pub(crate) from: Vec3,
    /// The state at `from`.
    pub(crate) state: WalkState,
    pub(crate) to: Vec3,
}

/// A way that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Way {
    /// The state at its end.
    pub(crate) state: WalkState,
    /// A lower bound of its length, in metres; zero where no wall is in between.
    pub(crate) length_m: f32,
}

/// What bounds ways through a building: gates, and the spaces that they join.
///
/// Spaces are convex and open inside, so a walk that stays in one needs no search. A walk into
/// another space goes through gates. Its way is at least as long as the gaps between the boxes
/// around successive gates, including both ends. So no way that was walked is denied. A way that is
/// granted may be a short cut within a gate or, where a gate is slanted, within the box around it.
#[derive(Clone, Debug)]
pub(crate) struct Walkways {
    /// The box that each space fills, in own axes; empty where a space is not a box.
    boxes: Vec<Aabb>,
    pub(crate) clearance: Clearance,
    /// How much a metre downwards counts, in metres.
    fall: f32,
}

/// The memory of a search for a way: 8 bytes for each gate.
#[derive(Clone, Debug, Default)]
pub(crate) struct WaySearch {
    /// The shortest way to each gate that the search has visited, in metres.
    ways_m: Generational<f32>,
    /// Gates to visit, those with the shortest way by them first. Lengths are never negative, so
    /// their bits are in order.
    waiting: BinaryHeap<Reverse<(u32, u32)>>,
}

/// Where a search goes, and how far.
struct Goal<'a> {
    to: Aabb,
    /// The spaces that `to` may be reached from.
    spaces: &'a [u32],
    longest_m: f32,
    /// The search goes through gates of any width.
    is_stuck: bool,
}

impl Walkways {
    /// Bodies fall `fall_ratio` times as fast as they run.
    pub(crate) fn new(world: &World, fall_ratio: f32) -> Self {
        let boxes = boxes(&world.cells);
        debug_assert_eq!(boxes.len(), world.cells.spaces.len());
        Self { boxes, clearance: Clearance::new(world), fall: 1.0 / fall_ratio.max(1.0) }
    }

    /// The state of an eye that may be wherever it is, in own axes.
    pub(crate) fn state_at(&self, world: &World, eye: Vec3) -> WalkState {
        let is_stuck = !self.clearance.has_room(world, world.cells.axes.world(eye));
        WalkState { space: space_at(&world.cells, eye), is_stuck }
    }

    /// The gates that a body fits through; `None` while it is stuck and may go through any.
    pub(crate) fn clearance_of(&self, state: WalkState) -> Option<&Clearance> {
        (!state.is_stuck).then_some(&self.clearance)
    }

    /// The space that the eye was in, if that is a box and all of a region is inside it.
    pub(crate) fn space_around(&self, state: WalkState, region: &Aabb) -> Option<u32> {
        state.space.filter(|space| {
            let Aabb { min, max } = &self.boxes[*space as usize];
            (min.cmplt(region.min) & region.max.cmplt(*max)).all()
        })
    }

    /// Finds a way for a walk that is no longer than a limit.
    ///
    /// An eye that came from a space may be as far inside something solid as bodies poke into walls
    /// ([`POKE_M`]), and keeps that space. An eye without a space moves freely until it is in one.
    pub(crate) fn find_way(
        &self,
        search: &mut WaySearch,
        world: &World,
        walk: &Walk,
        longest_m: f32,
    ) -> Option<Way> {
        let (space, length_m) = self.find_way_into(search, world, walk, longest_m)?;
        debug_assert!(length_m >= 0.0, "no way is shorter than nothing");
        let is_stuck =
            walk.state.is_stuck && !self.clearance.has_room(world, world.cells.axes.world(walk.to));
        Some(Way { state: WalkState { space, is_stuck }, length_m })
    }

    /// For how long an eye can follow a course of some steps, all of the same time, before a wall
    /// or a narrow gate is in its way. `at` gives its place after each step, in own axes.
    pub(crate) fn time_ahead(
        &self,
        search: &mut WaySearch,
        world: &World,
        start: &Walk,
        most: Duration,
        at: impl Fn(Duration) -> Vec3,
    ) -> Duration {
        let steps = (start.from.distance(at(most)) / COURSE_STEP_M).ceil().max(1.0) as u32;
        let mut walk = *start;
        for step in 1..=steps {
            walk.to = at(most * step / steps);
            let longest_m = 2.0 * COURSE_STEP_M;
            let Some(way) = self.find_way(search, world, &walk, longest_m) else {
                return most * (step - 1) / steps;
            };
            walk = Walk { from: walk.to, state: way.state, to: walk.to };
        }
        most
    }

    /// The space that a way leads into, and the length of the way.
    fn find_way_into(
        &self,
        search: &mut WaySearch,
        world: &World,
        walk: &Walk,
        longest_m: f32,
    ) -> Option<(Option<u32>, f32)> {
        let to = walk.to;
        let Some(space) = walk.state.space else {
            return Some((space_at(&world.cells, to), 0.0));
        };
        if self.boxes[space as usize].contains(to) {
            return Some((Some(space), 0.0));
        }
        let mut search = |spaces: &[u32]| {
            let is_stuck = walk.state.is_stuck;
            let goal = Goal { to: Aabb::new(to, to), spaces, longest_m, is_stuck };
            let (space, length_m) = self.search(search, world, walk.from, space, &goal)?;
            Some((Some(space), length_m))
        };
        match space_at(&world.cells, to) {
            Some(there) if there == space => Some((Some(space), 0.0)),
            Some(there) => search(&[there]),
            None => {
                let beside = spaces_beside(&world.cells, to);
                if beside.contains(&space) {
                    return Some((Some(space), 0.0));
                }
                search(&beside)
            }
        }
    }

    /// Searches for a way from a space into one of the goal's spaces: which of them the way leads
    /// into, and a lower bound of its length.
    fn search(
        &self,
        search: &mut WaySearch,
        world: &World,
        from: Vec3,
        space: u32,
        goal: &Goal<'_>,
    ) -> Option<(u32, f32)> {
        search.ways_m.clear(world.cells.gates.len());
        search.waiting.clear();
        // An eye in a wall counts as if it were where the space begins.
        let bounds = &world.cells.spaces[space as usize].bounds;
        let from = from.clamp(bounds.min, bounds.max);
        self.visit_gates(
            search,
            world,
            space,
            &Step { from: Aabb::new(from, from), way_m: 0.0 },
            goal,
        );
        let mut visited = 0;
        while let Some(Reverse((whole, index))) = search.waiting.pop() {
            let gate = &world.cells.gates[index as usize];
            if let Some(space) = gate.spaces.iter().find(|space| goal.spaces.contains(space)) {
                return Some((*space, f32::from_bits(whole)));
            }
            visited += 1;
            if visited > GATES_MAX {
                return goal.spaces.first().map(|space| (*space, 0.0));
            }
            let way_m = search.ways_m.get(index).unwrap_or(0.0);
            let step = Step { from: gate.polygon.bounds(), way_m };
            gate.spaces.iter().for_each(|s| self.visit_gates(search, world, *s, &step, goal));
        }
        None
    }

    /// Goes on from somewhere in a space to those of its gates by which a way to the goal may lead.
    fn visit_gates(
        &self,
        search: &mut WaySearch,
        world: &World,
        space: u32,
        step: &Step,
        goal: &Goal<'_>,
    ) {
        for index in &world.cells.spaces[space as usize].gates {
            let gap = world.cells.gates[*index as usize].polygon.bounds();
            let way_m = step.way_m + self.distance_m(&step.from, &gap);
            let whole_m = way_m + self.distance_m(&gap, &goal.to);
            let is_shorter = search.ways_m.get(*index).is_none_or(|known_m| way_m < known_m);
            let fits = goal.is_stuck || self.clearance.admits_gate(*index);
            if whole_m <= goal.longest_m && is_shorter && fits {
                search.ways_m.set(*index, way_m);
                search.waiting.push(Reverse((whole_m.to_bits(), *index)));
            }
        }
    }

    /// A lower bound of the way from a point of one box to a point of another, in metres. Parts
    /// upwards, downwards and along the ground are counted apart, and the longest counts: bodies
    /// that jump or fall while they run are as fast along the ground as others.
    fn distance_m(&self, from: &Aabb, to: &Aabb) -> f32 {
        let up = to.min - from.max;
        let down = from.min - to.max;
        let gap = up.max(down).max(Vec3::ZERO);
        gap.x.hypot(gap.z).max(up.y).max(down.y * self.fall)
    }
}

/// Where a search goes on from.
struct Step {
    /// A point, or the box around a gate.
    from: Aabb,
    /// The shortest way to it, in metres.
    way_m: f32,
}

/// The space that a point in own axes is in; `None` in something solid.
fn space_at(cells: &Cells, point: Vec3) -> Option<u32> {
    cells.at_own(point).map(|cell| cells.cells[cell.0 as usize].space)
}

/// The spaces that are so close to a point in something solid that bodies poke there from them.
fn spaces_beside(cells: &Cells, point: Vec3) -> Vec<u32> {
    let mut found = Vec::new();
    cells.overlapping(&Aabb::around(point, POKE_M), &mut found);
    let mut spaces: Vec<u32> =
        found.into_iter().map(|cell| cells.cells[cell.0 as usize].space).collect();
    spaces.dedup();
    spaces
}

/// The box that each space fills; empty for a space that a slanted plane bounds.
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
