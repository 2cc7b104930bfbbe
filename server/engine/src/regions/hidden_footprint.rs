//! Hidden footprints: where an avatar can be for a longer time, by sectors.

use sightline_visibility::rooms::{RoomIndex, RoomOverlap};
use sightline_world::{Cell, CellId, geometry::Aabb};

use super::{CoverBoxes, Occupied, Reach, ReachSearch, footprint::room_overlap, reach::Piece};
use crate::{
    building::{Building, Sectors},
    sphere::Sphere,
};

/// What a TBV covers, or what a live avatar can reach before a hidden one that it reveals can be
/// told of.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct HiddenFootprint {
    pub(crate) sectors: Occupied,
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
    pub(crate) fn of_reach(building: &Building, search: &mut ReachSearch, reach: &Reach) -> Self {
        let bodies = reach.bodies(search, building);
        let cover = FootprintCover { eyes: reach.eye_cover(), bodies: bodies.cover };
        Self::new(building, reach.pieces(), &bodies.pieces, cover)
    }

    /// The footprint of an avatar whose eye stays in a ball, whatever walls are in it.
    ///
    /// Its cells and sectors are those of the ball. Its cover boxes are those around the ball,
    /// because sight tests take boxes.
    pub(crate) fn of_sphere(building: &Building, sphere: &Sphere) -> Self {
        let boxes = [sphere.bounds(), building.body.around_box(&sphere.bounds())];
        let bounds = |cell: &CellId| &building.cells().cells[cell.0 as usize].bounds;
        let eyes = pieces_in(building, &boxes[0], |cell| sphere.touches(bounds(cell)));
        let touches = |cell: &CellId| sphere.body_touches(&building.body, bounds(cell));
        let bodies = pieces_in(building, &boxes[1], touches);
        let cover = boxes.map(|region| CoverBoxes::covering([region].into_iter()));
        let [eye_cover, body_cover] = cover;
        let cover = FootprintCover { eyes: eye_cover, bodies: body_cover };
        Self::new(building, &eyes, &bodies, cover)
    }

    fn new(building: &Building, eyes: &[Piece], bodies: &[Piece], cover: FootprintCover) -> Self {
        Self {
            sectors: occupied_sectors(building, eyes, bodies),
            eye_rooms: room_overlap(building, &cover.eyes, eyes),
            body_rooms: room_overlap(building, &cover.bodies, bodies),
            cover,
        }
    }

    /// Whether, by sectors, an eye here may see a body in another footprint, or the other way
    /// round.
    pub(crate) fn meets(&self, other: &Self, sectors: &Sectors) -> bool {
        let Occupied { eyes, bodies } = &self.sectors;
        sectors.any_sees(eyes, &other.sectors.bodies)
            || sectors.any_sees(&other.sectors.eyes, bodies)
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

/// The sectors of the places of an eye, and of its body.
fn occupied_sectors(building: &Building, eyes: &[Piece], bodies: &[Piece]) -> Occupied {
    let spaces = |pieces: &[Piece]| pieces.iter().map(|piece| piece.space).collect::<Vec<u32>>();
    let [eyes, bodies] = [eyes, bodies].map(|pieces| building.sectors.of(&spaces(pieces)));
    Occupied { eyes, bodies }
}

/// What a box covers of each space, by the cells that are wanted.
fn pieces_in(
    building: &Building,
    region: &Aabb,
    is_wanted: impl Fn(&CellId) -> bool,
) -> Vec<Piece> {
    let mut found = Vec::new();
    building.cells().overlapping(region, &mut found);
    let mut pieces: Vec<Piece> = Vec::new();
    for cell in found.iter().filter(|cell| is_wanted(cell)) {
        let Cell { bounds, space, .. } = &building.cells().cells[cell.0 as usize];
        let part = bounds.intersection(region);
        match pieces.last_mut() {
            Some(last) if last.space == *space => last.region = last.region.union(&part),
            _ => pieces.push(Piece { space: *space, region: part }),
        }
    }
    pieces
}
