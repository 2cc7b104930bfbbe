//! What a plan consists of.

use super::rect::LatticeRect;

/// From one floor to the next: twenty steps.
pub(super) const STOREY: i32 = STEPS * RISE;
/// The thickness of a slab.
pub(super) const SLAB: i32 = 16;
/// From a floor to its ceiling.
pub(super) const CEILING: i32 = STOREY - SLAB;
/// The thickness of a wall.
pub(super) const WALL: i32 = 12;
/// How many steps lead from one floor to the next.
pub(super) const STEPS: i32 = 20;
/// The height of a step: 0.172 m.
pub(super) const RISE: i32 = 11;
/// The depth of a step: 0.281 m.
pub(super) const RUN: i32 = 18;

/// A building's spaces, and how they join. Lengths are in lattice units.
#[derive(Clone, Debug)]
pub struct Plan {
    /// How many floors there are.
    pub storeys: usize,
    /// Every space, on every storey.
    pub spaces: Vec<PlanSpace>,
    /// Where one can walk from one space to another on the same storey.
    pub doors: Vec<PlanDoor>,
    /// Where one can walk from one storey to the next.
    pub stairs: Vec<Stair>,
    /// The hall that is open over all storeys; its walkable floor is that of its galleries.
    pub void: Option<LatticeRect>,
    /// The building's outline, the same on every storey: the union of these.
    pub(super) outlines: Vec<LatticeRect>,
    /// Solid parts inside spaces, storey by storey.
    pub(super) blocks: Vec<Vec<LatticeRect>>,
    /// Holes through walls, doors among them, storey by storey.
    pub(super) openings: Vec<Vec<WallOpening>>,
}

/// A part of one storey that one can stand in.
#[derive(Clone, Debug)]
pub struct PlanSpace {
    /// What it is called: storey, wing and number for a room.
    pub name: String,
    /// What it is for.
    pub kind: SpaceKind,
    /// Which floor it is on; 0 is at ground level.
    pub storey: usize,
    /// Between its walls.
    pub rect: LatticeRect,
    /// sRGB colours of its walls: most of them, and the one that stands out.
    pub colours: [[u8; 3]; 2],
    /// The axis and the sense in which the wall that stands out faces.
    pub(super) accent: (usize, bool),
}

/// What a space is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpaceKind {
    /// A room with a door.
    Room,
    /// What leads to rooms.
    Corridor,
    /// The floor round the hall; on the ground, the hall's own floor too.
    Gallery,
    /// A staircase, between its landings.
    Stairs,
}

/// A passage between two spaces of one storey.
#[derive(Clone, Copy, Debug)]
pub struct PlanDoor {
    /// Indices of the spaces; the second is `None` when the door leads outside.
    pub spaces: (usize, Option<usize>),
    /// The part of the wall that it takes.
    pub rect: LatticeRect,
    /// Which floor it is on.
    pub storey: usize,
}

/// A flight of steps between two spaces.
#[derive(Clone, Copy, Debug)]
pub struct Stair {
    /// Indices of the lower and the upper space.
    pub spaces: [usize; 2],
    /// What the steps cover.
    pub flight: LatticeRect,
    /// Whether one goes up towards greater z.
    pub towards_z: bool,
    /// The storey of the lower space.
    pub storey: usize,
}

/// A hole through a wall.
#[derive(Clone, Copy, Debug)]
pub(super) struct WallOpening {
    /// The part of the wall that it takes.
    pub rect: LatticeRect,
    /// Which way one goes through: 0 along x, 1 along z.
    pub axis: usize,
    /// Heights above the floor.
    pub sill: i32,
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
    /// How many rooms there are.
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

    /// The doors and arches of one storey that a body needs to get through.
    pub(super) fn doors_on(&self, storey: usize) -> impl Iterator<Item = &PlanDoor> {
        self.doors.iter().filter(move |door| door.storey == storey)
    }
}
