//! Hidden footprints: where an avatar can be for a longer time, by sectors.

use sightline_visibility::rooms::{RoomIndex, RoomOverlap};
use sightline_world::{CellId, geometry::Aabb};

use super::{CoverBoxes, Reach, footprint::room_overlap};
use crate::{
    building::{Building, OccupiedSectors},
    sphere::Sphere,
};

/// What a TBV covers, or what a live avatar can reach before a hidden one that it reveals can be
/// told of.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct HiddenFootprint {
    pub(crate) sectors: OccupiedSectors,
    pub(crate) cover: FootprintCover,
    /// The rooms of all places of the eye.
    eye_rooms: RoomOverlap,
    /// The rooms of all places of the body.
    body_rooms: RoomOverlap,
}

/// Boxes around all places of an eye, and of its body.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct FootprintCover {
    pub(crate) eyes: CoverBoxes,
    pub(crate) bodies: CoverBoxes,
}

impl FootprintCover {
    /// The parts that are possible while the eye is in a box, in own axes.
    pub(crate) fn clipped(&self, building: &Building, eyes: &Aabb) -> Self {
        let bodies = building.body.around_box(eyes);
        Self { eyes: self.eyes.clipped(eyes), bodies: self.bodies.clipped(&bodies) }
    }
}

impl HiddenFootprint {
    /// The footprint of an avatar that stays in a reach.
    pub(crate) fn of_reach(building: &Building, reach: &Reach) -> Self {
        let cells = building.cells();
        let bodies = reach.bodies(cells, &building.world.body);
        let cover = FootprintCover { eyes: reach.eye_cover(cells), bodies: bodies.cover };
        Self::new(building, &reach.eye_cells(), &bodies.cells, cover)
    }

    /// The footprint of an avatar whose eye stays in a ball, whatever walls are in it.
    ///
    /// Its cells and sectors are those of the ball. Its cover boxes are those around the ball,
    /// because sight tests take boxes.
    pub(crate) fn of_sphere(building: &Building, sphere: &Sphere) -> Self {
        let boxes = [sphere.bounds(), building.body.around_box(&sphere.bounds())];
        let [mut eye_cells, mut body_cells] = boxes.map(|region| {
            let mut found = Vec::new();
            building.cells().overlapping(&region, &mut found);
            found.sort_unstable();
            found
        });
        let bounds = |cell: &CellId| &building.cells().cells[cell.0 as usize].bounds;
        eye_cells.retain(|cell| sphere.touches(bounds(cell)));
        body_cells.retain(|cell| sphere.body_touches(&building.body, bounds(cell)));
        let [eyes, bodies] = boxes.map(|region| CoverBoxes::covering([region].into_iter()));
        Self::new(building, &eye_cells, &body_cells, FootprintCover { eyes, bodies })
    }

    fn new(
        building: &Building,
        eye_cells: &[CellId],
        body_cells: &[CellId],
        cover: FootprintCover,
    ) -> Self {
        Self {
            sectors: building.sectors.occupied(eye_cells, body_cells),
            eye_rooms: room_overlap(building, &cover.eyes, eye_cells),
            body_rooms: room_overlap(building, &cover.bodies, body_cells),
            cover,
        }
    }

    /// The part of the footprint that is possible while the eye is in a box, in own axes. Its
    /// sectors and rooms stay as they are.
    pub(crate) fn clipped(&self, building: &Building, eyes: &Aabb) -> Self {
        Self { cover: self.cover.clipped(building, eyes), ..self.clone() }
    }

    /// Whether rooms let an eye in this footprint see a body in another.
    pub(crate) fn rooms_allow(&self, bodies: &Self, rooms: &RoomIndex) -> bool {
        !rooms.can_rule_out() || rooms.may_see(&self.eye_rooms, &bodies.body_rooms)
    }
}
