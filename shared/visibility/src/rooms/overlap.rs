//! The rooms that a region overlaps.

use sightline_world::{CellId, geometry::Aabb, rooms::RoomId};

/// The rooms that a region overlaps. It is found once when the region changes, so that questions
/// about pairs of regions are cheap.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct RoomOverlap {
    /// The boxes of the region, in own axes.
    pub(super) boxes: Vec<Aabb>,
    /// The rooms that some of the region may be in, ascending.
    pub(super) touched: Vec<RoomId>,
    /// The rooms that all of the region is in, ascending.
    pub(super) within: Vec<RoomId>,
    /// The sealed rooms among `touched`, and whether all of the region is in them.
    pub(super) sealed: Vec<(RoomId, bool)>,
    /// The rooms among `touched` that restrict what is seen from them.
    pub(super) restricting: Vec<RoomId>,
    /// Whether some of the region may be in no restricting room.
    pub(super) is_bare: bool,
    /// The cells that the region overlaps, ascending. Empty unless some room's set names cells.
    pub(super) cells: Vec<CellId>,
}

impl RoomOverlap {
    /// The overlap of any region with a world without rooms.
    pub(super) fn without_rooms() -> Self {
        Self { is_bare: true, ..Self::default() }
    }

    /// The rooms that some of the region may be in, ascending.
    pub fn touched(&self) -> &[RoomId] {
        &self.touched
    }

    /// The rooms that all of the region is in, ascending.
    pub fn within(&self) -> &[RoomId] {
        &self.within
    }

    /// Whether some of the region may be in no room that restricts what is seen from it. What is
    /// seen from there is up to cells alone.
    pub fn is_bare(&self) -> bool {
        self.is_bare
    }

    /// Whether some place in one region and some place in another may be in the same sealed rooms.
    pub(super) fn may_share_sealed_rooms(&self, other: &Self) -> bool {
        if self.sealed.is_empty() && other.sealed.is_empty() {
            return true;
        }
        let is_alone = |a: &Self, b: &Self| {
            a.sealed
                .iter()
                .any(|(id, within)| *within && b.sealed.iter().all(|(room, _)| room != id))
        };
        !is_alone(self, other) && !is_alone(other, self)
    }
}
