//! The floor plan: spaces, doors, stairs and openings.

use super::rect::LatticeRect;

/// The height from one floor to the next: twenty steps.
pub(super) const STOREY: i32 = STEPS * RISE;
/// The thickness of a slab.
pub(super) const SLAB: i32 = 16;
/// The height from a floor to its ceiling.
pub(super) const CEILING: i32 = STOREY - SLAB;
/// The thickness of a wall.
pub(super) const WALL: i32 = 12;
/// The number of steps from one floor to the next.
pub(super) const STEPS: i32 = 20;
/// The height of a step: 0.172 m.
pub(super) const RISE: i32 = 11;
/// The depth of a step: 0.281 m.
pub(super) const RUN: i32 = 18;

/// The floor plan of a building. Lengths are in lattice units.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The number of storeys.
    pub storeys: usize,
    /// The spaces of all storeys.
    pub spaces: Vec<PlanSpace>,
    /// Passages between spaces of the same storey.
    pub doors: Vec<PlanDoor>,
    /// Flights of steps from one storey to the next.
    pub stairs: Vec<Stair>,
    /// The hall that is open over all storeys, without its galleries.
    pub void: Option<LatticeRect>,
    /// The outline of the building, the same on every storey: the union of these rectangles.
    pub(super) outlines: Vec<LatticeRect>,
    /// Solid parts inside spaces, by storey.
    pub(super) blocks: Vec<Vec<LatticeRect>>,
    /// Holes through walls, doors included, by storey.
    pub(super) openings: Vec<Vec<WallOpening>>,
}

/// A part of one storey between walls, where people can stand.
#[derive(Clone, Debug)]
pub struct PlanSpace {
    /// The name; for a room, its storey, wing and number.
    pub name: String,
    /// The use of the space.
    pub kind: SpaceKind,
    /// The storey; 0 is at ground level.
    pub storey: usize,
    /// The floor between its walls.
    pub rect: LatticeRect,
    /// The sRGB colours of its walls: of most of them, and of the accent wall.
    pub colours: [[u8; 3]; 2],
    /// The direction in which the accent wall faces.
    pub(super) accent: WallSide,
}

/// A direction in which a wall faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct WallSide {
    /// 0 for x, 1 for z.
    pub axis: usize,
    /// Whether it faces along the axis, or against it.
    pub positive: bool,
}

/// The use of a space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpaceKind {
    /// A room with a door.
    Room,
    /// A corridor that leads to rooms.
    Corridor,
    /// The floor around the hall. At ground level, the floor of the hall too.
    Gallery,
    /// A staircase between landings.
    Stairs,
}

/// A passage between two spaces of one storey.
#[derive(Clone, Copy, Debug)]
pub struct PlanDoor {
    /// The indices of the two spaces. The second is `None` when the door leads outside.
    pub spaces: (usize, Option<usize>),
    /// The part of the wall that it takes.
    pub rect: LatticeRect,
    /// The storey.
    pub storey: usize,
}

/// A flight of steps between two spaces.
#[derive(Clone, Copy, Debug)]
pub struct Stair {
    /// The indices of the lower and the upper space.
    pub spaces: [usize; 2],
    /// The floor that the steps cover.
    pub flight: LatticeRect,
    /// Whether the steps rise towards greater z.
    pub towards_z: bool,
    /// The storey of the lower space.
    pub storey: usize,
}

/// A hole through a wall.
#[derive(Clone, Copy, Debug)]
pub(super) struct WallOpening {
    /// The part of the wall that it takes.
    pub rect: LatticeRect,
    /// The axis of the way through: 0 for x, 1 for z.
    pub axis: usize,
    /// The height of its lower edge above the floor.
    pub sill: i32,
    /// The height of its upper edge above the floor.
    pub head: i32,
    pub kind: OpeningKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OpeningKind {
    Door,
    Arch,
    Glazed,
}

impl Plan {
    /// The number of rooms.
    pub fn room_count(&self) -> usize {
        self.spaces.iter().filter(|space| space.kind == SpaceKind::Room).count()
    }

    /// The height of a floor.
    pub fn floor(&self, storey: usize) -> i32 {
        storey as i32 * STOREY
    }

    /// Whether a rectangle lies outside the building.
    pub(super) fn is_outside(&self, rect: &LatticeRect) -> bool {
        !self.outlines.iter().any(|outline| outline.overlaps(rect))
    }

    /// The doors and arches of one storey.
    pub(super) fn doors_on(&self, storey: usize) -> impl Iterator<Item = &PlanDoor> {
        self.doors.iter().filter(move |door| door.storey == storey)
    }
}
