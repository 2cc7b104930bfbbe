//! Where somebody can be, in terms of rooms.

use super::{RoomId, RoomIndex};
use crate::{
    geometry::Aabb,
    world::{CellId, Cells},
};

/// The rooms that a region has a part in: made when the region changes, so that asking about pairs is
/// cheap.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Place {
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

impl Place {
    /// The place of a region, which is some boxes in own axes.
    pub(super) fn new(index: &RoomIndex, cells: &Cells, boxes: &[Aabb]) -> Self {
        let mut place = Self { boxes: boxes.to_vec(), ..Self::default() };
        let mut found: Vec<CellId> = Vec::new();
        for region in boxes {
            let start = found.len();
            cells.overlapping(region, &mut found);
            place.is_bare |= index.is_bare(cells, region, &found[start..]);
            index
                .unbounded()
                .filter(|id| index.meets(*id, region))
                .for_each(|id| place.touched.push(id));
        }
        found.sort_unstable();
        found.dedup();
        let near = found.iter().flat_map(|cell| index.rooms_near(*cell)).copied();
        let mut near: Vec<RoomId> = near.chain(place.touched.iter().copied()).collect();
        near.sort_unstable();
        near.dedup();
        near.retain(|id| boxes.iter().any(|region| index.meets(*id, region)));
        place.touched = near;
        // What is in no cell is in something solid: no part of a body is seen there.
        let in_cells = |id: &RoomId, region: &Aabb| {
            let mut parts =
                found.iter().map(|cell| cells.cells[cell.0 as usize].bounds.intersection(region));
            !found.is_empty() && parts.all(|part| part.is_empty() || index.covers(*id, &part))
        };
        let is_within = |id: &RoomId| {
            boxes.iter().all(|region| index.covers(*id, region) || in_cells(id, region))
        };
        place.within = place.touched.iter().copied().filter(is_within).collect();
        place.restricting =
            place.touched.iter().copied().filter(|id| index.restricts(*id)).collect();
        let sealed = place.touched.iter().filter(|id| index.is_sealed(**id));
        place.sealed = sealed.map(|id| (*id, place.within.binary_search(id).is_ok())).collect();
        if index.names_cells() {
            place.cells = found;
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

/// The sealed rooms that a point is in. Two people are told of each other only where theirs
/// [agree](Self::agrees).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Seal([Option<RoomId>; Self::MAX]);

impl Seal {
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
