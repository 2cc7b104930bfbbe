//! Where somebody can be, in terms of rooms.

use super::RoomIndex;
use sightline_world::{CellId, Cells, geometry::Aabb, rooms::RoomId};

/// The rooms that a region has a part in: made when the region changes, so that asking about pairs is
/// cheap.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct RoomOverlap {
    /// In own axes.
    pub(super) boxes: Vec<Aabb>,
    /// The rooms that some of it may be in, ascending.
    pub(super) touched: Vec<RoomId>,
    /// Those of them that all of it is in, ascending.
    pub(super) within: Vec<RoomId>,
    /// Of what it touches, the rooms that are sealed, and whether all of it is in.
    pub(super) sealed: Vec<(RoomId, bool)>,
    /// Of what it touches, the rooms that say what may be seen.
    pub(super) restricting: Vec<RoomId>,
    /// Some of it may be in no room that says what may be seen.
    pub(super) is_bare: bool,
    /// The cells that it overlaps, ascending; only where sets name cells.
    pub(super) cells: Vec<CellId>,
}

impl RoomOverlap {
    /// The place of a region, which is some boxes in own axes.
    pub(super) fn new(index: &RoomIndex, cells: &Cells, boxes: &[Aabb]) -> Self {
        let mut found: Vec<CellId> = Vec::new();
        let mut is_bare = false;
        for region in boxes {
            let start = found.len();
            cells.overlapping(region, &mut found);
            is_bare |= index.is_bare(cells, region, &found[start..]);
        }
        found.sort_unstable();
        found.dedup();
        let parts = parts(cells, boxes, &found);
        Self::of_parts(index, boxes, &found, [boxes, &parts], is_bare)
    }

    /// The place of what some cells, ascending, have of some boxes.
    pub(super) fn within_cells(
        index: &RoomIndex,
        cells: &Cells,
        boxes: &[Aabb],
        found: &[CellId],
    ) -> Self {
        let is_bare =
            boxes.is_empty() || boxes.iter().any(|region| index.is_bare(cells, region, found));
        let parts = parts(cells, boxes, found);
        Self::of_parts(index, boxes, found, [&parts, &parts], is_bare)
    }

    fn of_parts(
        index: &RoomIndex,
        boxes: &[Aabb],
        found: &[CellId],
        [touching, inside]: [&[Aabb]; 2],
        is_bare: bool,
    ) -> Self {
        let mut place = Self { boxes: boxes.to_vec(), is_bare, ..Self::default() };
        let near = found.iter().flat_map(|cell| index.rooms_near(*cell)).copied();
        place.touched = near.chain(index.unbounded()).collect();
        place.touched.sort_unstable();
        place.touched.dedup();
        place.touched.retain(|id| touching.iter().any(|part| index.meets(*id, part)));
        let holds = |id: &RoomId, all: &[Aabb]| {
            !all.is_empty() && all.iter().all(|part| index.covers(*id, part))
        };
        // What is in no cell is in something solid: no part of a body is seen there.
        let is_within = |id: &RoomId| holds(id, touching) || holds(id, inside);
        place.within = place.touched.iter().copied().filter(is_within).collect();
        place.restricting =
            place.touched.iter().copied().filter(|id| index.restricts(*id)).collect();
        let sealed = place.touched.iter().filter(|id| index.is_sealed(**id));
        place.sealed = sealed.map(|id| (*id, place.within.binary_search(id).is_ok())).collect();
        if index.names_cells() {
            place.cells = found.to_vec();
        }
        place
    }

    /// The rooms that some of it may be in, ascending.
    pub fn touched(&self) -> &[RoomId] {
        &self.touched
    }

    /// Those of them that all of it is in, ascending.
    pub fn within(&self) -> &[RoomId] {
        &self.within
    }

    /// Whether some of it may be in no room that says what may be seen: cells decide what is seen from it.
    pub fn is_bare(&self) -> bool {
        self.is_bare
    }

    /// Whether somebody in the one and somebody in the other may be in the same sealed rooms.
    pub(super) fn may_share_seals(&self, other: &Self) -> bool {
        if self.sealed.is_empty() && other.sealed.is_empty() {
            return true;
        }
        let lone = |a: &Self, b: &Self| {
            a.sealed
                .iter()
                .any(|(id, within)| *within && b.sealed.iter().all(|(room, _)| room != id))
        };
        !lone(self, other) && !lone(other, self)
    }
}

/// What some cells have of some boxes.
fn parts(cells: &Cells, boxes: &[Aabb], found: &[CellId]) -> Vec<Aabb> {
    let bounds = found.iter().map(|cell| &cells.cells[cell.0 as usize].bounds);
    let parts = bounds.flat_map(|bounds| boxes.iter().map(|region| region.intersection(bounds)));
    parts.filter(|part| !part.is_empty()).collect()
}

/// The sealed rooms that a point is in. Two people are told of each other only where theirs
/// [agree](Self::agrees).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct SealedRooms([Option<RoomId>; Self::MAX]);

impl SealedRooms {
    /// Who is in more sealed rooms at once agrees with nobody.
    pub const MAX: usize = 4;

    /// Of some rooms, ascending.
    pub(super) fn of(rooms: impl Iterator<Item = RoomId>) -> Self {
        let mut seal = Self::default();
        for (at, room) in rooms.enumerate().take(Self::MAX) {
            seal.0[at] = Some(room);
        }
        seal
    }

    /// Whether neither is in a sealed room that the other is not in.
    pub fn agrees(&self, other: &Self) -> bool {
        self == other && self.0[Self::MAX - 1].is_none()
    }

    /// Whether it is in no sealed room.
    pub fn is_open(&self) -> bool {
        self.0[0].is_none()
    }

    /// The sealed rooms.
    pub fn rooms(&self) -> impl Iterator<Item = RoomId> {
        self.0.into_iter().flatten()
    }
}
