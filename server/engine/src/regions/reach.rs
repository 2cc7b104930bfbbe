//! Reach: the places that an eye can get to through gates.

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::Vec3;
use sightline_world::{
    Cells,
    geometry::Aabb,
    tolerance::{POKE_M, WIRE_BOUNDARY_M},
};

use super::CoverBoxes;
use crate::{
    building::{Adjacency, Beside, Building, Exit, ExitSide},
    claims::Clearance,
    generation::Generational,
};

/// Where an eye is, and which gates it may go through.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReachStart<'a> {
    pub(crate) cells: &'a Cells,
    pub(crate) adjacency: &'a Adjacency,
    /// The gates that the body fits through; `None` for all of them.
    pub(crate) clearance: Option<&'a Clearance>,
    /// The eye, in own axes.
    pub(crate) from: Vec3,
    /// The only space that the eye can be in, given how its position is rounded, if that is known.
    pub(crate) space: Option<u32>,
}

/// The parts of spaces that an eye can get to through gates that its body fits through.
///
/// Everything between spaces is opaque and solid, so an eye gets from one space into another
/// through gates. Spaces are convex, so what a box leaves of a space is in one piece. A way through
/// several gates is at least as long as the gaps between the boxes around successive ones. What is
/// left of the longest way behind the last gate bounds what is reached of the space there. Bodies
/// stick out of the spaces that their eyes can get to, through gates of any width. At a wall they
/// end, except for [`POKE_M`].
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct Reach {
    /// One piece for each space, by space, ascending.
    pieces: Vec<Piece>,
}

/// What is reached of a space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Piece {
    pub(crate) space: u32,
    /// In own axes.
    pub(crate) region: Aabb,
}

/// Where bodies can be.
#[derive(Clone, Debug)]
pub(crate) struct BodyReach {
    /// One piece for each space that a part of a body can be in, by space, ascending.
    pub(crate) pieces: Vec<Piece>,
    /// Boxes around all places of a body.
    pub(crate) cover: CoverBoxes,
}

/// The memory of a search for a reach: 8 bytes for each gate and each space.
#[derive(Clone, Debug, Default)]
pub(crate) struct ReachSearch {
    /// The shortest way to each gate that was visited, in metres.
    ways_m: Generational<f32>,
    /// The index of the piece of each space that was visited.
    pieces: Generational<u32>,
    /// Gates to go on from, nearest first. Lengths are never negative, so their bits are in order.
    waiting: BinaryHeap<Reverse<(u32, u32)>>,
    /// Spaces to go on from.
    open: Vec<u32>,
}

impl ReachSearch {
    fn begin(&mut self, cells: &Cells) {
        self.ways_m.clear(cells.gates.len());
        self.pieces.clear(cells.spaces.len());
        self.waiting.clear();
        self.open.clear();
    }

    /// Takes in a way to a gate: whether it is shorter than all before.
    fn is_shorter(&mut self, gate: u32, way_m: f32) -> bool {
        let is_shorter = self.ways_m.get(gate).is_none_or(|known_m| way_m < known_m);
        if is_shorter {
            self.ways_m.set(gate, way_m);
        }
        is_shorter
    }
}

impl ReachStart<'_> {
    fn admits(&self, gate: u32) -> bool {
        self.clearance.is_none_or(|clearance| clearance.admits_gate(gate))
    }

    /// Adds the spaces that the eye can be in, whose position is rounded. An eye in something solid
    /// pokes there from any space that is near enough. An eye further in counts as in the nearest.
    fn find_spaces(&self, rounding_m: f32, found: &mut Vec<u32>) {
        debug_assert!(rounding_m <= WIRE_BOUNDARY_M, "the space holds for no more");
        if let Some(space) = self.space {
            return found.push(space);
        }
        let mut cells = Vec::new();
        self.cells.overlapping(&Aabb::around(self.from, rounding_m), &mut cells);
        if cells.is_empty() {
            self.cells.overlapping(&Aabb::around(self.from, POKE_M), &mut cells);
        }
        if cells.is_empty() {
            cells.extend(self.cells.near_own(self.from));
        }
        found.extend(cells.iter().map(|cell| self.cells.cells[cell.0 as usize].space));
        found.dedup();
    }
}

/// What bounds a search: a box, and the length of ways.
struct Bounds {
    region: Aabb,
    way_m: f32,
}

/// Where a search goes on from.
struct Step {
    /// A point, or the box around a gate.
    from: Aabb,
    /// The shortest way to it, in metres.
    way_m: f32,
}

impl Reach {
    /// What an eye can get to that stays in a box, in own axes.
    pub(crate) fn in_box(search: &mut ReachSearch, start: &ReachStart<'_>, region: &Aabb) -> Self {
        debug_assert!(start.from.is_finite(), "only finite places are accepted");
        let cells = start.cells;
        search.begin(cells);
        let ReachSearch { pieces: visited, open, .. } = search;
        let mut pieces = Vec::with_capacity(8);
        let region = region.intersection(&cells.bounds);
        start.find_spaces(WIRE_BOUNDARY_M, open);
        open.iter().for_each(|space| visited.set(*space, 0));
        while let Some(id) = open.pop() {
            let space = &cells.spaces[id as usize];
            pieces.push(Piece { space: id, region: space.bounds.intersection(&region) });
            for Exit { bounds, gate, beyond, .. } in start.adjacency.exits(id) {
                if bounds.intersects(&region)
                    && visited.get(*beyond).is_none()
                    && start.admits(*gate)
                {
                    visited.set(*beyond, 0);
                    open.push(*beyond);
                }
            }
        }
        pieces.sort_unstable_by_key(|piece| piece.space);
        Self { pieces }
    }

    /// What an eye can get to that stays in a box, on ways no longer than `way_m`, in metres.
    pub(crate) fn on_ways(
        search: &mut ReachSearch,
        start: &ReachStart<'_>,
        region: &Aabb,
        way_m: f32,
    ) -> Self {
        debug_assert!(way_m >= 0.0, "no way is shorter than nothing");
        let cells = start.cells;
        search.begin(cells);
        let mut reach = Self { pieces: Vec::new() };
        let bounds = Bounds { region: region.intersection(&cells.bounds), way_m };
        start.find_spaces(WIRE_BOUNDARY_M.min(way_m), &mut search.open);
        for index in 0..search.open.len() {
            let space = search.open[index];
            // An eye in a wall counts as if it were where the space begins.
            let space_bounds = &cells.spaces[space as usize].bounds;
            let from = start.from.clamp(space_bounds.min, space_bounds.max);
            let step = Step { from: Aabb::new(from, from), way_m: 0.0 };
            reach.enter(search, cells, space, &step, &bounds);
            Self::visit_gates(search, start, space, &step, &bounds);
        }
        while let Some(Reverse((bits, gate))) = search.waiting.pop() {
            let way_m = f32::from_bits(bits);
            if search.ways_m.get(gate).is_some_and(|shortest_m| shortest_m < way_m) {
                continue;
            }
            let gate = &cells.gates[gate as usize];
            let step = Step { from: gate.polygon.bounds(), way_m };
            for space in gate.spaces {
                reach.enter(search, cells, space, &step, &bounds);
                Self::visit_gates(search, start, space, &step, &bounds);
            }
        }
        reach.pieces.sort_unstable_by_key(|piece| piece.space);
        reach
    }

    /// Adds what is reached of a space from somewhere on its boundary, or in it.
    fn enter(
        &mut self,
        search: &mut ReachSearch,
        cells: &Cells,
        space: u32,
        step: &Step,
        bounds: &Bounds,
    ) {
        let near = step.from.grown(bounds.way_m - step.way_m);
        let space_bounds = &cells.spaces[space as usize].bounds;
        let region = space_bounds.intersection(&bounds.region).intersection(&near);
        if let Some(index) = search.pieces.get(space) {
            let piece = &mut self.pieces[index as usize];
            debug_assert_eq!(piece.space, space, "the memory belongs to this search");
            piece.region = piece.region.union(&region);
        } else {
            search.pieces.set(space, self.pieces.len() as u32);
            self.pieces.push(Piece { space, region });
        }
    }

    /// Goes on from somewhere in a space to its gates.
    fn visit_gates(
        search: &mut ReachSearch,
        start: &ReachStart<'_>,
        space: u32,
        step: &Step,
        bounds: &Bounds,
    ) {
        for Exit { bounds: gap, gate, .. } in start.adjacency.exits(space) {
            let way_m = step.way_m + distance_m(&step.from, gap);
            if way_m <= bounds.way_m
                && gap.intersects(&bounds.region)
                && start.admits(*gate)
                && search.is_shorter(*gate, way_m)
            {
                search.waiting.push(Reverse((way_m.to_bits(), *gate)));
            }
        }
    }

    /// What the eye can get to, by space, ascending.
    pub(crate) fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Boxes around every place of the eye.
    pub(crate) fn eye_cover(&self) -> CoverBoxes {
        CoverBoxes::covering(self.pieces.iter().map(|piece| piece.region))
    }

    /// Where the body can be.
    pub(crate) fn bodies(&self, search: &mut ReachSearch, building: &Building) -> BodyReach {
        let of_eyes = self.pieces.iter().filter(|piece| !piece.region.is_empty());
        let filled: Vec<Piece> = of_eyes
            .map(|Piece { space, region }| {
                let bodies = building.body.around_box(region);
                Piece { space: *space, region: filled(building, *space, &bodies) }
            })
            .collect();
        let cover = CoverBoxes::covering(filled.iter().map(|piece| piece.region));
        let mut pieces = Vec::with_capacity(2 * self.pieces.len() + 4);
        // Pieces of one cover box reach the same spaces, so they spread together.
        let mut together = Vec::with_capacity(filled.len());
        for region in cover.boxes() {
            let within = filled.iter().filter(|piece| region.contains_box(&piece.region));
            together.clear();
            together.extend(within);
            spread(search, building, &together, region, &mut pieces);
        }
        pieces.sort_unstable_by_key(|piece: &Piece| piece.space);
        pieces.dedup_by(|next, piece| {
            let is_same = next.space == piece.space;
            if is_same {
                piece.region = piece.region.union(&next.region);
            }
            is_same
        });
        BodyReach { pieces, cover }
    }
}

/// Adds what some boxes, each of which begins in a space, cover of these spaces and of those that
/// they stick into. One box is around them all.
fn spread(
    search: &mut ReachSearch,
    building: &Building,
    filled: &[Piece],
    around: &Aabb,
    pieces: &mut Vec<Piece>,
) {
    let spaces = &building.cells().spaces;
    let covered = |space: u32, bounds: &Aabb| {
        let touching = filled.iter().filter(|piece| piece.region.intersects(bounds));
        let parts = touching.map(|piece| piece.region.intersection(bounds));
        parts.reduce(|all, part| all.union(&part)).map(|region| Piece { space, region })
    };
    let visited = &mut search.pieces;
    visited.clear(spaces.len());
    let mut next = pieces.len();
    for Piece { space, .. } in filled {
        visited.set(*space, 0);
        pieces.extend(covered(*space, &spaces[*space as usize].bounds));
    }
    while let Some(&Piece { space, .. }) = pieces.get(next) {
        next += 1;
        if spaces[space as usize].bounds.contains_box(around) {
            continue;
        }
        for Beside { space, bounds } in building.adjacency.near(space) {
            if bounds.intersects(around)
                && visited.get(*space).is_none()
                && let Some(piece) = covered(*space, bounds)
            {
                visited.set(*space, 0);
                pieces.push(piece);
            }
        }
    }
}

/// The part of a box around bodies that bodies can fill whose eyes are in a space. The box ends at
/// each side of the space on which it meets no gate.
fn filled(building: &Building, space: u32, bodies: &Aabb) -> Aabb {
    let within = &building.cells().spaces[space as usize].bounds;
    let (mut low_open, mut high_open) = ([false; 3], [false; 3]);
    for exit in building.adjacency.exits(space) {
        if exit.bounds.intersects(bodies) {
            match exit.side {
                ExitSide::Low(axis) => low_open[usize::from(axis)] = true,
                ExitSide::High(axis) => high_open[usize::from(axis)] = true,
                ExitSide::Slanted => (low_open, high_open) = ([true; 3], [true; 3]),
            }
        }
    }
    let mut filled = *bodies;
    for axis in 0..3 {
        if !low_open[axis] {
            filled.min[axis] = filled.min[axis].max(within.min[axis] - POKE_M);
        }
        if !high_open[axis] {
            filled.max[axis] = filled.max[axis].min(within.max[axis] + POKE_M);
        }
    }
    filled
}

/// The least distance between points of two boxes, in metres.
fn distance_m(a: &Aabb, b: &Aabb) -> f32 {
    (b.min - a.max).max(a.min - b.max).max(Vec3::ZERO).length()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use sightline_world::{CellId, Node, World};

    use super::*;
    use crate::{Config, bit_set::BitSet, tests::stage};

    fn ids(pieces: &[Piece]) -> Vec<u32> {
        pieces.iter().map(|piece| piece.space).collect()
    }

    fn building(world: &World) -> Building {
        Building::new(Arc::new(world.clone()), &Config::default())
    }

    fn start_in(building: &Building, from: Vec3) -> ReachStart<'_> {
        let Building { adjacency, .. } = building;
        ReachStart { cells: building.cells(), adjacency, clearance: None, from, space: None }
    }

    fn ball(building: &Building, from: Vec3, way_m: f32) -> Reach {
        let start = start_in(building, from);
        Reach::on_ways(&mut ReachSearch::default(), &start, &Aabb::around(from, way_m), way_m)
    }

    #[test]
    fn eyes_go_through_gates_and_bodies_stick_out() {
        let mut world = stage::row(5);
        let from = Vec3::new(18.0, 1.6, 5.0);
        let check = |world: &World, way_m: f32| {
            let building = building(world);
            let reach = ball(&building, from, way_m);
            (ids(reach.pieces()), ids(&reach.bodies(&mut ReachSearch::default(), &building).pieces))
        };
        assert_eq!(check(&world, 1.0), (vec![1], vec![1]));
        assert_eq!(check(&world, 1.9), (vec![1], vec![1, 2]));
        assert_eq!(check(&world, 2.0), (vec![1, 2], vec![1, 2]));
        assert_eq!(check(&world, 12.1), (vec![0, 1, 2, 3], vec![0, 1, 2, 3]));
        // A wall between rooms 1 and 2 stops eyes; elbows stick into it.
        stage::narrow(&mut world, 1, 2, [0.0, 1.0]);
        assert_eq!(check(&world, 2.0), (vec![1], vec![1, 2]));
        assert_eq!(check(&world, 9.0), (vec![0, 1, 2], vec![0, 1, 2]));
    }

    #[test]
    fn eyes_stay_before_narrow_gates_and_elbows_do_not() {
        let building = building(&stage::row(3));
        let mut gates = BitSet::default();
        gates.insert(1);
        let clearance = &Clearance::with_narrow_gates(gates);
        let reach = |x: f32, clearance: Option<&Clearance>, is_limited: bool| {
            let (from, way_m, scratch) = (Vec3::new(x, 1.6, 5.0), 3.0, &mut ReachSearch::default());
            let around = Aabb::around(from, way_m);
            let start = ReachStart { clearance, ..start_in(&building, from) };
            let reach = if is_limited {
                Reach::on_ways(scratch, &start, &around, way_m)
            } else {
                Reach::in_box(scratch, &start, &around)
            };
            (ids(reach.pieces()), ids(&reach.bodies(&mut ReachSearch::default(), &building).pieces))
        };
        for is_limited in [false, true] {
            let reach = |x: f32, clearance: Option<&Clearance>| reach(x, clearance, is_limited);
            assert_eq!(reach(12.0, Some(clearance)), (vec![0, 1], vec![0, 1]));
            assert_eq!(reach(18.0, Some(clearance)), (vec![1], vec![1, 2]));
            assert_eq!(reach(22.0, Some(clearance)), (vec![2], vec![1, 2]));
            assert_eq!(reach(18.0, None).0, [1, 2], "a stuck body goes through any gate");
        }
    }

    #[test]
    fn an_eye_in_a_wall_may_have_come_from_either_side() {
        // A wall of 8 cm is between the two cells, and no portal joins them.
        let mut world = stage::row(2);
        world.cells.tree[0] = Node::Axial { axis: 0, at: 10.0, sides: [2, 1] };
        world.cells.tree[1] = Node::Axial { axis: 0, at: 10.08, sides: [3, 4] };
        world.cells.tree.truncate(2);
        world.cells.tree.extend([Node::Leaf(CellId(0)), Node::Solid, Node::Leaf(CellId(1))]);
        world.cells.cells[1].bounds.min.x = 10.08;
        world.cells.spaces[1].bounds.min.x = 10.08;
        world.cells.spaces.iter_mut().for_each(|space| space.gates.clear());
        let building = building(&world);
        let reach = |x: f32| ids(ball(&building, Vec3::new(x, 1.6, 5.0), 0.0).pieces());
        assert_eq!((reach(9.9), reach(10.01), reach(10.04)), (vec![0], vec![0], vec![0, 1]));
        assert_eq!((reach(10.07), reach(10.1)), (vec![1], vec![1]));
    }

    #[test]
    fn a_way_round_two_corners_is_longer_than_a_straight_one() {
        // Doors at opposite ends of the walls before and behind room 1.
        let mut world = stage::row(3);
        for (gate, z) in [(0, [0.0, 1.0]), (1, [9.0, 10.0])] {
            stage::narrow(&mut world, gate, 2, z);
        }
        let building = building(&world);
        let reached = |way_m: f32| {
            let reach = ball(&building, Vec3::new(9.0, 1.6, 0.5), way_m);
            reach.pieces.last().map(|piece| (piece.space, piece.region.max.x))
        };
        // 1 m to the first door, 12.81 m from the one to the other.
        assert_eq!(reached(13.8), Some((1, 20.0)));
        let (space, x) = reached(15.0).unwrap();
        assert!(space == 2 && (x - 21.19).abs() < 0.01, "{space} {x}");
    }

    #[test]
    fn an_eye_on_a_boundary_is_on_both_sides() {
        let building = building(&stage::row(3));
        let reach = |x: f32| ids(ball(&building, Vec3::new(x, 1.0, 5.0), 0.0).pieces());
        assert_eq!((reach(10.0), reach(9.9), reach(10.1)), (vec![0, 1], vec![0], vec![1]));
        assert_eq!(ids(ball(&building, Vec3::new(9.998, 1.0, 5.0), 0.01).pieces()), [0, 1]);
    }

    #[test]
    fn ways_of_any_length_reach_all_of_the_box() {
        let building = building(&stage::row(6));
        for (x, radius) in [(5.0, 2.0), (18.0, 7.0), (30.0, 14.0), (9.999, 0.5)] {
            let from = Vec3::new(x, 1.6, 5.0);
            let (region, scratch) = (Aabb::around(from, radius), &mut ReachSearch::default());
            let start = start_in(&building, from);
            let limited = Reach::on_ways(scratch, &start, &region, 1e6);
            assert_eq!(Reach::in_box(scratch, &start, &region), limited);
        }
    }
}
