//! Where a body can get to: a ball, less what lies behind walls.

use glam::Vec3;
use roaring::RoaringBitmap;
use sightline_shared::{
    geometry::Aabb,
    motion::Body,
    world::{CellId, Cells, Polygon},
};

/// A reported eye can be so far on the other side of a boundary by rounding, in metres.
const ROUNDING_M: f32 = 0.004;

/// A body may poke so far into what is solid, in metres: collisions are against voxels, and what
/// comes from elsewhere is rounded. Walls are thicker, so that what is inside them is not in sight.
const POKE_M: f32 = 0.06;

/// The parts of cells, in own axes, that an eye can get to: those it comes to through portals within
/// a ball.
///
/// What makes cells is opaque and solid, so whoever gets from one cell into another without
/// leaving the ball goes through portals that the ball meets. Bodies stick out of the cells that
/// their eyes can get to, where there are portals; elsewhere they stop at the wall, but for
/// [`POKE_M`].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Reach {
    /// By cell, ascending.
    pieces: Vec<(CellId, Aabb)>,
}

impl Reach {
    /// Where an eye that was at a place can be when it has come no further than `way_m`.
    pub(super) fn new(cells: &Cells, from: Vec3, way_m: f32) -> Self {
        let from = cells.axes.own(from);
        let ball = Aabb::around(from, way_m).intersection(&cells.bounds);
        let piece = |cell: CellId| cells.cells[cell.0 as usize].bounds.intersection(&ball);
        let mut open = Vec::new();
        cells.overlapping(&Aabb::around(from, ROUNDING_M.min(way_m)), &mut open);
        if open.is_empty() {
            open.extend(cells.near_own(from));
        }
        let mut pieces: Vec<_> = open.iter().map(|cell| (*cell, piece(*cell))).collect();
        while let Some(cell) = open.pop() {
            for portal in &cells.cells[cell.0 as usize].portals {
                let portal = &cells.portals[*portal as usize];
                let [lesser, greater] = portal.cells;
                let beyond = if lesser == cell { greater } else { lesser };
                if let Err(place) = pieces.binary_search_by_key(&beyond, |(cell, _)| *cell)
                    && is_within(&portal.polygon.bounds(), from, way_m)
                {
                    pieces.insert(place, (beyond, piece(beyond)));
                    open.push(beyond);
                }
            }
        }
        Self { pieces }
    }

    /// The cells that the eye can be in, ascending.
    pub(super) fn eyes(&self) -> Vec<CellId> {
        self.pieces.iter().map(|(cell, _)| *cell).collect()
    }

    /// The cells that some part of the body can be in, ascending.
    pub(super) fn bodies(&self, cells: &Cells, body: &Body) -> Vec<CellId> {
        let body = &cells.axes.own_body(body);
        let mut found = Vec::new();
        for (cell, piece) in &self.pieces {
            cells.overlapping(&filled(cells, *cell, &body.around_box(piece)), &mut found);
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Whether some part of the body can be in one of some cells.
    pub(super) fn body_meets(&self, cells: &Cells, body: &Body, some: &RoaringBitmap) -> bool {
        let body = &cells.axes.own_body(body);
        let mut found = Vec::new();
        self.pieces.iter().any(|(cell, piece)| {
            found.clear();
            cells.overlapping(&filled(cells, *cell, &body.around_box(piece)), &mut found);
            found.iter().any(|cell| some.contains(cell.0))
        })
    }
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

/// Whether some point of a box is within a distance of a place.
fn is_within(region: &Aabb, from: Vec3, way_m: f32) -> bool {
    let nearest = from.clamp(region.min, region.max);
    nearest.distance_squared(from) <= way_m * way_m
}

#[cfg(test)]
mod tests {
    use super::{super::tests::stage, *};

    fn ids(cells: &[CellId]) -> Vec<u32> {
        cells.iter().map(|cell| cell.0).collect()
    }

    #[test]
    fn eyes_go_through_portals_and_bodies_stick_out() {
        let mut world = stage::row(5);
        let from = Vec3::new(18.0, 1.6, 5.0);
        let check = |world: &sightline_shared::world::World, way_m: f32| {
            let reach = Reach::new(&world.cells, from, way_m);
            let bodies = reach.bodies(&world.cells, &world.body);
            for cell in 0..5 {
                let some = RoaringBitmap::from_iter([cell]);
                let meets = reach.body_meets(&world.cells, &world.body, &some);
                assert_eq!(meets, bodies.contains(&CellId(cell)));
            }
            (ids(&reach.eyes()), ids(&bodies))
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
    fn an_eye_on_a_boundary_is_on_both_sides() {
        let world = stage::row(3);
        let reach = |x: f32| ids(&Reach::new(&world.cells, Vec3::new(x, 1.0, 5.0), 0.0).eyes());
        assert_eq!((reach(10.0), reach(9.9), reach(10.1)), (vec![0, 1], vec![0], vec![1]));
        let near = Reach::new(&world.cells, Vec3::new(9.998, 1.0, 5.0), 0.01);
        assert_eq!(ids(&near.eyes()), [0, 1]);
    }
}
