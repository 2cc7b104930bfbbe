//! Where a body can get to: what portals lead to, as far as it comes.

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::Vec3;
use sightline_world::{
    CellId, Cells, Polygon,
    geometry::Aabb,
    motion::Body,
    tolerance::{POKE_M, WIRE_BOUNDARY_M},
};

use crate::{claims::clearance::Clearance, regions::cover_boxes::CoverBoxes};

/// Where an eye is, and what it may go through.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Start<'a> {
    pub(crate) cells: &'a Cells,
    /// Which portals its body fits through; all of them, when none.
    pub(crate) fit: Option<&'a Clearance>,
    /// In own axes.
    pub(crate) from: Vec3,
}

/// The parts of cells, in own axes, that an eye can get to: those it comes to through portals that its
/// body fits through.
///
/// What makes cells is opaque and solid, so whoever gets from one cell into another goes through
/// portals. A way through a sequence of portals is at least as long as the gaps between the boxes
/// around each two of them: what is left of the way after the last one bounds what is reached of
/// the cell behind it. Bodies stick out of the cells that their eyes can get to, where there are
/// portals, be they as narrow as they may; elsewhere they stop at the wall, but for [`POKE_M`].
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct Reach {
    /// By cell, ascending.
    pieces: Vec<(CellId, Aabb)>,
}

/// What a search for a reach needs memory for: 8 bytes for each portal and each cell.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    search: u32,
    /// For each portal, the search that came to it last, and the shortest way to it.
    portals: Vec<(u32, f32)>,
    /// For each cell, the search that came to it last, and its place among the pieces.
    cells: Vec<(u32, u32)>,
    /// Portals that were come to, nearest first. Ways are never negative, so that their bits are
    /// in order.
    waiting: BinaryHeap<Reverse<(u32, u32)>>,
    start: Vec<CellId>,
}

impl Scratch {
    fn begin(&mut self, cells: &Cells) {
        self.portals.resize(cells.portals.len(), (0, 0.0));
        self.cells.resize(cells.cells.len(), (0, 0));
        self.search = self.search.wrapping_add(1);
        if self.search == 0 {
            self.portals.fill((0, 0.0));
            self.cells.fill((0, 0));
            self.search = 1;
        }
        self.waiting.clear();
        self.start.clear();
    }

    /// Whether this is a shorter way to a portal than any so far.
    fn is_nearer(&mut self, portal: u32, way_m: f32) -> bool {
        let known = &mut self.portals[portal as usize];
        let is_nearer = known.0 != self.search || way_m < known.1;
        if is_nearer {
            *known = (self.search, way_m);
        }
        is_nearer
    }
}

impl Start<'_> {
    fn leads_through(&self, portal: u32) -> bool {
        self.fit.is_none_or(|fit| fit.through_portal(portal))
    }

    /// Adds the cells that an eye is in that is where it was said to be but for rounding. One in something
    /// solid has poked there from any that is near enough; one further in counts as in the nearest.
    fn find(&self, rounding_m: f32, found: &mut Vec<CellId>) {
        self.cells.overlapping(&Aabb::around(self.from, rounding_m), found);
        if found.is_empty() {
            self.cells.overlapping(&Aabb::around(self.from, POKE_M), found);
        }
        if found.is_empty() {
            found.extend(self.cells.near_own(self.from));
        }
    }
}

impl Reach {
    /// Where an eye that starts somewhere can be when it has stayed in a box, in own axes.
    pub(crate) fn within(scratch: &mut Scratch, start: &Start<'_>, within: &Aabb) -> Self {
        let cells = start.cells;
        scratch.begin(cells);
        let mut reach = Self { pieces: Vec::new() };
        let within = within.intersection(&cells.bounds);
        let mut open = std::mem::take(&mut scratch.start);
        start.find(WIRE_BOUNDARY_M, &mut open);
        open.iter().for_each(|cell| scratch.cells[cell.0 as usize].0 = scratch.search);
        while let Some(id) = open.pop() {
            let cell = &cells.cells[id.0 as usize];
            reach.pieces.push((id, cell.bounds.intersection(&within)));
            for &index in &cell.portals {
                let portal = &cells.portals[index as usize];
                let beyond = portal.cells[usize::from(portal.cells[0] == id)];
                let known = &mut scratch.cells[beyond.0 as usize].0;
                if *known != scratch.search
                    && portal.polygon.bounds().intersects(&within)
                    && start.leads_through(index)
                {
                    *known = scratch.search;
                    open.push(beyond);
                }
            }
        }
        scratch.start = open;
        reach.pieces.sort_unstable_by_key(|(cell, _)| *cell);
        reach
    }

    /// The same, when it has come no further than `way_m` either.
    pub(crate) fn new(scratch: &mut Scratch, start: &Start<'_>, within: &Aabb, way_m: f32) -> Self {
        let cells = start.cells;
        scratch.begin(cells);
        let mut reach = Self { pieces: Vec::new() };
        let within = within.intersection(&cells.bounds);
        start.find(WIRE_BOUNDARY_M.min(way_m), &mut scratch.start);
        for cell in std::mem::take(&mut scratch.start) {
            // An eye in a wall counts as if it were where the cell begins.
            let bounds = &cells.cells[cell.0 as usize].bounds;
            let place = start.from.clamp(bounds.min, bounds.max);
            let place = Aabb::new(place, place);
            reach.enter(scratch, cells, cell, &place, &within, way_m);
            reach.go_on(scratch, start, cell, (&place, 0.0), (&within, way_m));
        }
        while let Some(Reverse((bits, portal))) = scratch.waiting.pop() {
            let come_m = f32::from_bits(bits);
            if scratch.portals[portal as usize].1 < come_m {
                continue;
            }
            let gap = cells.portals[portal as usize].polygon.bounds();
            for cell in cells.portals[portal as usize].cells {
                reach.enter(scratch, cells, cell, &gap, &within, way_m - come_m);
                reach.go_on(scratch, start, cell, (&gap, come_m), (&within, way_m));
            }
        }
        reach.pieces.sort_unstable_by_key(|(cell, _)| *cell);
        reach
    }

    /// Adds what is reached of a cell from somewhere on its boundary, or in it.
    fn enter(
        &mut self,
        scratch: &mut Scratch,
        cells: &Cells,
        cell: CellId,
        from: &Aabb,
        within: &Aabb,
        left_m: f32,
    ) {
        let bounds = &cells.cells[cell.0 as usize].bounds;
        let piece = bounds.intersection(within).intersection(&from.grown(left_m));
        let known = &mut scratch.cells[cell.0 as usize];
        if known.0 == scratch.search {
            let (_, all) = &mut self.pieces[known.1 as usize];
            *all = all.union(&piece);
        } else {
            *known = (scratch.search, self.pieces.len() as u32);
            self.pieces.push((cell, piece));
        }
    }

    /// Goes from somewhere in a cell to its portals.
    fn go_on(
        &self,
        scratch: &mut Scratch,
        start: &Start<'_>,
        cell: CellId,
        (from, come_m): (&Aabb, f32),
        (within, way_m): (&Aabb, f32),
    ) {
        let cells = start.cells;
        for portal in &cells.cells[cell.0 as usize].portals {
            let gap = cells.portals[*portal as usize].polygon.bounds();
            let come_m = come_m + distance(from, &gap);
            if come_m <= way_m
                && gap.intersects(within)
                && start.leads_through(*portal)
                && scratch.is_nearer(*portal, come_m)
            {
                scratch.waiting.push(Reverse((come_m.to_bits(), *portal)));
            }
        }
    }

    /// The cells that the eye can be in, ascending.
    pub(crate) fn eyes(&self) -> Vec<CellId> {
        self.pieces.iter().map(|(cell, _)| *cell).collect()
    }

    /// Boxes around every place the eye can be.
    pub(crate) fn eye_parts(&self, cells: &Cells) -> CoverBoxes {
        CoverBoxes::covering(by_space(cells, self.pieces.iter().copied()).into_iter())
    }

    /// The cells that some part of the body can be in, ascending, and boxes around all its places.
    pub(crate) fn bodies(&self, cells: &Cells, body: &Body) -> (Vec<CellId>, CoverBoxes) {
        let body = &body.in_axes(&cells.axes);
        let filled = self.pieces.iter().map(|(cell, piece)| {
            let filled = filled(cells, *cell, &body.around_box(piece));
            (*cell, filled)
        });
        let (spaces, mut found) = (by_space(cells, filled), Vec::new());
        spaces.iter().for_each(|filled| cells.overlapping(filled, &mut found));
        found.sort_unstable();
        found.dedup();
        (found, CoverBoxes::covering(spaces.into_iter()))
    }
}

/// A box around what is in each space. The cells of a space follow one another.
fn by_space(cells: &Cells, pieces: impl Iterator<Item = (CellId, Aabb)>) -> Vec<Aabb> {
    let mut spaces: Vec<(u32, Aabb)> = Vec::new();
    for (cell, piece) in pieces {
        let space = cells.cells[cell.0 as usize].space;
        match spaces.last_mut() {
            Some((last, all)) if *last == space => *all = all.union(&piece),
            _ => spaces.push((space, piece)),
        }
    }
    spaces.into_iter().map(|(_, all)| all).collect()
}

/// What bodies can fill of a box about eyes in a cell: where the box meets no portal on a side of
/// the cell, it ends there.
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
            // It may be part of any side.
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
fn distance(a: &Aabb, b: &Aabb) -> f32 {
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
        let start = Start { cells, fit: None, from };
        Reach::new(&mut Scratch::default(), &start, &Aabb::around(from, way_m), way_m)
    }

    #[test]
    fn eyes_go_through_portals_and_bodies_stick_out() {
        let mut world = stage::row(5);
        let from = Vec3::new(18.0, 1.6, 5.0);
        let check = |world: &sightline_world::World, way_m: f32| {
            let reach = ball(&world.cells, from, way_m);
            (ids(&reach.eyes()), ids(&reach.bodies(&world.cells, &world.body).0))
        };
        assert_eq!(check(&world, 1.0), (vec![1], vec![1]));
        assert_eq!(check(&world, 1.9), (vec![1], vec![1, 2]));
        assert_eq!(check(&world, 2.0), (vec![1, 2], vec![1, 2]));
        assert_eq!(check(&world, 12.1), (vec![0, 1, 2, 3], vec![0, 1, 2, 3]));
        // A wall between the rooms 1 and 2: no way, but elbows stick into it.
        let Polygon::Rectangle { bounds, .. } = &mut world.cells.portals[1].polygon else {
            unreachable!("rooms in a row join in rectangles")
        };
        bounds.max.z = 1.0;
        assert_eq!(check(&world, 2.0), (vec![1], vec![1, 2]));
        assert_eq!(check(&world, 9.0), (vec![0, 1, 2], vec![0, 1, 2]));
    }

    #[test]
    fn eyes_stay_before_what_is_too_narrow_and_elbows_do_not() {
        let world = stage::row(3);
        let mut gates = BitSet::default();
        gates.insert(1);
        let fit = &Clearance::narrow(&world.cells, gates);
        let reach = |x: f32, fit: Option<&Clearance>, is_limited: bool| {
            let (from, way_m, scratch) = (Vec3::new(x, 1.6, 5.0), 3.0, &mut Scratch::default());
            let (start, around) =
                (Start { cells: &world.cells, fit, from }, Aabb::around(from, way_m));
            let reach = if is_limited {
                Reach::new(scratch, &start, &around, way_m)
            } else {
                Reach::within(scratch, &start, &around)
            };
            (ids(&reach.eyes()), ids(&reach.bodies(&world.cells, &world.body).0))
        };
        for is_limited in [false, true] {
            let reach = |x: f32, fit: Option<&Clearance>| reach(x, fit, is_limited);
            assert_eq!(reach(12.0, Some(fit)), (vec![0, 1], vec![0, 1]));
            assert_eq!(reach(18.0, Some(fit)), (vec![1], vec![1, 2]));
            assert_eq!(reach(22.0, Some(fit)), (vec![2], vec![1, 2]));
            assert_eq!(reach(18.0, None).0, [1, 2], "whoever was put where nobody fits");
        }
    }

    #[test]
    fn an_eye_in_a_wall_may_have_come_from_either_side() {
        // A wall of 8 cm between the two cells, and nothing that joins them.
        let mut world = stage::row(2);
        world.cells.tree[0] = Node::Axial { axis: 0, at: 10.0, sides: [2, 1] };
        world.cells.tree[1] = Node::Axial { axis: 0, at: 10.08, sides: [3, 4] };
        world.cells.tree.truncate(2);
        world.cells.tree.extend([Node::Leaf(CellId(0)), Node::Solid, Node::Leaf(CellId(1))]);
        world.cells.cells[1].bounds.min.x = 10.08;
        world.cells.cells.iter_mut().for_each(|cell| cell.portals.clear());
        let reach = |x: f32| ids(&ball(&world.cells, Vec3::new(x, 1.6, 5.0), 0.0).eyes());
        assert_eq!((reach(9.9), reach(10.01), reach(10.04)), (vec![0], vec![0], vec![0, 1]));
        assert_eq!((reach(10.07), reach(10.1)), (vec![1], vec![1]));
    }

    #[test]
    fn a_way_round_two_corners_is_longer_than_the_straight_one() {
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
            reach.pieces.last().map(|(cell, piece)| (cell.0, piece.max.x))
        };
        // 1 m to the first door, 12.81 m from the one to the other.
        assert_eq!(reached(13.8), Some((1, 20.0)));
        let (cell, x) = reached(15.0).unwrap();
        assert!(cell == 2 && (x - 21.19).abs() < 0.01, "{cell} {x}");
    }

    #[test]
    fn an_eye_on_a_boundary_is_on_both_sides() {
        let world = stage::row(3);
        let reach = |x: f32| ids(&ball(&world.cells, Vec3::new(x, 1.0, 5.0), 0.0).eyes());
        assert_eq!((reach(10.0), reach(9.9), reach(10.1)), (vec![0, 1], vec![0], vec![1]));
        assert_eq!(ids(&ball(&world.cells, Vec3::new(9.998, 1.0, 5.0), 0.01).eyes()), [0, 1]);
    }

    #[test]
    fn ways_without_end_lead_wherever_the_box_does() {
        let world = stage::row(6);
        for (x, radius) in [(5.0, 2.0), (18.0, 7.0), (30.0, 14.0), (9.999, 0.5)] {
            let from = Vec3::new(x, 1.6, 5.0);
            let (region, scratch) = (Aabb::around(from, radius), &mut Scratch::default());
            let start = Start { cells: &world.cells, fit: None, from };
            let limited = Reach::new(scratch, &start, &region, 1e6);
            assert_eq!(Reach::within(scratch, &start, &region), limited);
        }
    }
}
