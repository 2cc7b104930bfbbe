//! Reach: the places that an eye can get to through portals.

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::Vec3;
use sightline_world::{
    CellId, Cells, Polygon,
    geometry::Aabb,
    motion::Body,
    tolerance::{POKE_M, WIRE_BOUNDARY_M},
};

use super::CoverBoxes;
use crate::{claims::Clearance, generation::Generational};

/// Where an eye is, and which portals it may go through.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReachStart<'a> {
    pub(crate) cells: &'a Cells,
    /// The portals that the body fits through; `None` for all of them.
    pub(crate) clearance: Option<&'a Clearance>,
    /// The eye, in own axes.
    pub(crate) from: Vec3,
}

/// The parts of cells that an eye can get to through portals that its body fits through.
///
/// Everything between cells is opaque and solid, so an eye gets from one cell into another through
/// portals. A way through several portals is at least as long as the gaps between the boxes around
/// successive ones. What is left of the longest way behind the last portal bounds what is reached
/// of the cell there. Bodies stick out of the cells that their eyes can get to, through portals of
/// any width. At a wall they end, except for [`POKE_M`].
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct Reach {
    /// One piece for each cell, by cell, ascending.
    pieces: Vec<Piece>,
}

/// What is reached of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Piece {
    cell: CellId,
    /// In own axes.
    region: Aabb,
}

/// Where bodies can be.
#[derive(Clone, Debug)]
pub(crate) struct BodyReach {
    /// The cells that a part of a body can be in, ascending.
    pub(crate) cells: Vec<CellId>,
    /// Boxes around all places of a body.
    pub(crate) cover: CoverBoxes,
}

/// The memory of a search for a reach: 8 bytes for each portal and each cell.
#[derive(Clone, Debug, Default)]
pub(crate) struct ReachSearch {
    /// The shortest way to each portal that was visited, in metres.
    ways_m: Generational<f32>,
    /// The index of the piece of each cell that was visited.
    pieces: Generational<u32>,
    /// Portals to go on from, nearest first. Lengths are never negative, so their bits are in
    /// order.
    waiting: BinaryHeap<Reverse<(u32, u32)>>,
    /// Cells to go on from.
    open: Vec<CellId>,
}

impl ReachSearch {
    fn begin(&mut self, cells: &Cells) {
        self.ways_m.clear(cells.portals.len());
        self.pieces.clear(cells.cells.len());
        self.waiting.clear();
        self.open.clear();
    }

    /// Takes in a way to a portal: whether it is shorter than all before.
    fn is_shorter(&mut self, portal: u32, way_m: f32) -> bool {
        let is_shorter = self.ways_m.get(portal).is_none_or(|known_m| way_m < known_m);
        if is_shorter {
            self.ways_m.set(portal, way_m);
        }
        is_shorter
    }
}

impl ReachStart<'_> {
    fn admits(&self, portal: u32) -> bool {
        self.clearance.is_none_or(|clearance| clearance.admits_portal(portal))
    }

    /// Adds the cells that the eye can be in, whose position is rounded. An eye in something solid
    /// pokes there from any cell that is near enough. An eye further in counts as in the nearest.
    fn find_cells(&self, rounding_m: f32, found: &mut Vec<CellId>) {
        self.cells.overlapping(&Aabb::around(self.from, rounding_m), found);
        if found.is_empty() {
            self.cells.overlapping(&Aabb::around(self.from, POKE_M), found);
        }
        if found.is_empty() {
            found.extend(self.cells.near_own(self.from));
        }
    }
}

/// What bounds a search: a box, and the length of ways.
struct Bounds {
    region: Aabb,
    way_m: f32,
}

/// Where a search goes on from.
struct Step {
    /// A point, or the box around a portal.
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
        let mut pieces = Vec::new();
        let region = region.intersection(&cells.bounds);
        start.find_cells(WIRE_BOUNDARY_M, open);
        open.iter().for_each(|cell| visited.set(cell.0, 0));
        while let Some(id) = open.pop() {
            let cell = &cells.cells[id.0 as usize];
            pieces.push(Piece { cell: id, region: cell.bounds.intersection(&region) });
            for &index in &cell.portals {
                let portal = &cells.portals[index as usize];
                let beyond = portal.cells[usize::from(portal.cells[0] == id)];
                if visited.get(beyond.0).is_none()
                    && portal.polygon.bounds().intersects(&region)
                    && start.admits(index)
                {
                    visited.set(beyond.0, 0);
                    open.push(beyond);
                }
            }
        }
        pieces.sort_unstable_by_key(|piece| piece.cell);
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
        start.find_cells(WIRE_BOUNDARY_M.min(way_m), &mut search.open);
        for index in 0..search.open.len() {
            let cell = search.open[index];
            // An eye in a wall counts as if it were where the cell begins.
            let cell_bounds = &cells.cells[cell.0 as usize].bounds;
            let from = start.from.clamp(cell_bounds.min, cell_bounds.max);
            let step = Step { from: Aabb::new(from, from), way_m: 0.0 };
            reach.enter(search, cells, cell, &step, &bounds);
            Self::visit_portals(search, start, cell, &step, &bounds);
        }
        while let Some(Reverse((bits, portal))) = search.waiting.pop() {
            let way_m = f32::from_bits(bits);
            if search.ways_m.get(portal).is_some_and(|shortest_m| shortest_m < way_m) {
                continue;
            }
            let portal = &cells.portals[portal as usize];
            let step = Step { from: portal.polygon.bounds(), way_m };
            for cell in portal.cells {
                reach.enter(search, cells, cell, &step, &bounds);
                Self::visit_portals(search, start, cell, &step, &bounds);
            }
        }
        reach.pieces.sort_unstable_by_key(|piece| piece.cell);
        reach
    }

    /// Adds what is reached of a cell from somewhere on its boundary, or in it.
    fn enter(
        &mut self,
        search: &mut ReachSearch,
        cells: &Cells,
        cell: CellId,
        step: &Step,
        bounds: &Bounds,
    ) {
        let near = step.from.grown(bounds.way_m - step.way_m);
        let cell_bounds = &cells.cells[cell.0 as usize].bounds;
        let region = cell_bounds.intersection(&bounds.region).intersection(&near);
        if let Some(index) = search.pieces.get(cell.0) {
            let piece = &mut self.pieces[index as usize];
            debug_assert_eq!(piece.cell, cell, "the memory belongs to this search");
            piece.region = piece.region.union(&region);
        } else {
            search.pieces.set(cell.0, self.pieces.len() as u32);
            self.pieces.push(Piece { cell, region });
        }
    }

    /// Goes on from somewhere in a cell to its portals.
    fn visit_portals(
        search: &mut ReachSearch,
        start: &ReachStart<'_>,
        cell: CellId,
        step: &Step,
        bounds: &Bounds,
    ) {
        let cells = start.cells;
        for portal in &cells.cells[cell.0 as usize].portals {
            let gap = cells.portals[*portal as usize].polygon.bounds();
            let way_m = step.way_m + distance_m(&step.from, &gap);
            if way_m <= bounds.way_m
                && gap.intersects(&bounds.region)
                && start.admits(*portal)
                && search.is_shorter(*portal, way_m)
            {
                search.waiting.push(Reverse((way_m.to_bits(), *portal)));
            }
        }
    }

    /// The cells that the eye can be in, ascending.
    pub(crate) fn eye_cells(&self) -> Vec<CellId> {
        self.pieces.iter().map(|piece| piece.cell).collect()
    }

    /// Boxes around every place of the eye.
    pub(crate) fn eye_cover(&self, cells: &Cells) -> CoverBoxes {
        CoverBoxes::covering(boxes_by_space(cells, self.pieces.iter().copied()).into_iter())
    }

    /// Where the body can be.
    pub(crate) fn bodies(&self, cells: &Cells, body: &Body) -> BodyReach {
        let body = &body.in_axes(&cells.axes);
        let filled = self.pieces.iter().map(|&Piece { cell, region }| Piece {
            cell,
            region: filled(cells, cell, &body.around_box(&region)),
        });
        let (boxes, mut found) = (boxes_by_space(cells, filled), Vec::new());
        boxes.iter().for_each(|region| cells.overlapping(region, &mut found));
        found.sort_unstable();
        found.dedup();
        BodyReach { cells: found, cover: CoverBoxes::covering(boxes.into_iter()) }
    }
}

/// A box around the pieces in each space. The cells of a space follow one another.
fn boxes_by_space(cells: &Cells, pieces: impl Iterator<Item = Piece>) -> Vec<Aabb> {
    let mut spaces: Vec<(u32, Aabb)> = Vec::new();
    for Piece { cell, region } in pieces {
        let space = cells.cells[cell.0 as usize].space;
        match spaces.last_mut() {
            Some((last, all)) if *last == space => *all = all.union(&region),
            _ => spaces.push((space, region)),
        }
    }
    spaces.into_iter().map(|(_, all)| all).collect()
}

/// The part of a box around bodies that bodies can fill whose eyes are in a cell. The box ends at
/// each side of the cell on which it meets no portal.
fn filled(cells: &Cells, cell: CellId, bodies: &Aabb) -> Aabb {
    let cell = &cells.cells[cell.0 as usize];
    let (mut low_open, mut high_open) = ([false; 3], [false; 3]);
    for portal in &cell.portals {
        let polygon = &cells.portals[*portal as usize].polygon;
        let bounds = polygon.bounds();
        if !bounds.intersects(bodies) {
            continue;
        }
        match *polygon {
            Polygon::Rectangle { axis, .. } => {
                let axis = usize::from(axis);
                let is_low = bounds.min[axis] <= cell.bounds.min[axis];
                if is_low { low_open[axis] = true } else { high_open[axis] = true }
            }
            // A slanted portal may be part of any side.
            Polygon::Other { .. } => (low_open, high_open) = ([true; 3], [true; 3]),
        }
    }
    let mut filled = *bodies;
    for axis in 0..3 {
        if !low_open[axis] {
            filled.min[axis] = filled.min[axis].max(cell.bounds.min[axis] - POKE_M);
        }
        if !high_open[axis] {
            filled.max[axis] = filled.max[axis].min(cell.bounds.max[axis] + POKE_M);
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
    use sightline_world::Node;

    use super::*;
    use crate::{bit_set::BitSet, tests::stage};

    fn ids(cells: &[CellId]) -> Vec<u32> {
        cells.iter().map(|cell| cell.0).collect()
    }

    fn ball(cells: &Cells, from: Vec3, way_m: f32) -> Reach {
        let start = ReachStart { cells, clearance: None, from };
        Reach::on_ways(&mut ReachSearch::default(), &start, &Aabb::around(from, way_m), way_m)
    }

    #[test]
    fn eyes_go_through_portals_and_bodies_stick_out() {
        let mut world = stage::row(5);
        let from = Vec3::new(18.0, 1.6, 5.0);
        let check = |world: &sightline_world::World, way_m: f32| {
            let reach = ball(&world.cells, from, way_m);
            (ids(&reach.eye_cells()), ids(&reach.bodies(&world.cells, &world.body).cells))
        };
        assert_eq!(check(&world, 1.0), (vec![1], vec![1]));
        assert_eq!(check(&world, 1.9), (vec![1], vec![1, 2]));
        assert_eq!(check(&world, 2.0), (vec![1, 2], vec![1, 2]));
        assert_eq!(check(&world, 12.1), (vec![0, 1, 2, 3], vec![0, 1, 2, 3]));
        // A wall between rooms 1 and 2 stops eyes; elbows stick into it.
        let Polygon::Rectangle { bounds, .. } = &mut world.cells.portals[1].polygon else {
            unreachable!("rooms in a row join in rectangles")
        };
        bounds.max.z = 1.0;
        assert_eq!(check(&world, 2.0), (vec![1], vec![1, 2]));
        assert_eq!(check(&world, 9.0), (vec![0, 1, 2], vec![0, 1, 2]));
    }

    #[test]
    fn eyes_stay_before_narrow_gates_and_elbows_do_not() {
        let world = stage::row(3);
        let mut gates = BitSet::default();
        gates.insert(1);
        let clearance = &Clearance::with_narrow_gates(&world.cells, gates);
        let reach = |x: f32, clearance: Option<&Clearance>, is_limited: bool| {
            let (from, way_m, scratch) = (Vec3::new(x, 1.6, 5.0), 3.0, &mut ReachSearch::default());
            let (start, around) =
                (ReachStart { cells: &world.cells, clearance, from }, Aabb::around(from, way_m));
            let reach = if is_limited {
                Reach::on_ways(scratch, &start, &around, way_m)
            } else {
                Reach::in_box(scratch, &start, &around)
            };
            (ids(&reach.eye_cells()), ids(&reach.bodies(&world.cells, &world.body).cells))
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
        world.cells.cells.iter_mut().for_each(|cell| cell.portals.clear());
        let reach = |x: f32| ids(&ball(&world.cells, Vec3::new(x, 1.6, 5.0), 0.0).eye_cells());
        assert_eq!((reach(9.9), reach(10.01), reach(10.04)), (vec![0], vec![0], vec![0, 1]));
        assert_eq!((reach(10.07), reach(10.1)), (vec![1], vec![1]));
    }

    #[test]
    fn a_way_round_two_corners_is_longer_than_a_straight_one() {
        // Doors at opposite ends of the walls before and behind room 1.
        let mut world = stage::row(3);
        for (portal, z) in [(0, [0.0, 1.0]), (1, [9.0, 10.0])] {
            let Polygon::Rectangle { bounds, .. } = &mut world.cells.portals[portal].polygon else {
                unreachable!("rooms in a row join in rectangles")
            };
            (bounds.min.z, bounds.max.z) = (z[0], z[1]);
        }
        let reached = |way_m: f32| {
            let reach = ball(&world.cells, Vec3::new(9.0, 1.6, 0.5), way_m);
            reach.pieces.last().map(|piece| (piece.cell.0, piece.region.max.x))
        };
        // 1 m to the first door, 12.81 m from the one to the other.
        assert_eq!(reached(13.8), Some((1, 20.0)));
        let (cell, x) = reached(15.0).unwrap();
        assert!(cell == 2 && (x - 21.19).abs() < 0.01, "{cell} {x}");
    }

    #[test]
    fn an_eye_on_a_boundary_is_on_both_sides() {
        let world = stage::row(3);
        let reach = |x: f32| ids(&ball(&world.cells, Vec3::new(x, 1.0, 5.0), 0.0).eye_cells());
        assert_eq!((reach(10.0), reach(9.9), reach(10.1)), (vec![0, 1], vec![0], vec![1]));
        assert_eq!(ids(&ball(&world.cells, Vec3::new(9.998, 1.0, 5.0), 0.01).eye_cells()), [0, 1]);
    }

    #[test]
    fn ways_of_any_length_reach_all_of_the_box() {
        let world = stage::row(6);
        for (x, radius) in [(5.0, 2.0), (18.0, 7.0), (30.0, 14.0), (9.999, 0.5)] {
            let from = Vec3::new(x, 1.6, 5.0);
            let (region, scratch) = (Aabb::around(from, radius), &mut ReachSearch::default());
            let start = ReachStart { cells: &world.cells, clearance: None, from };
            let limited = Reach::on_ways(scratch, &start, &region, 1e6);
            assert_eq!(Reach::in_box(scratch, &start, &region), limited);
        }
    }
}
