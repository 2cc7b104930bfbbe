//! The sealed rooms at a point.

use sightline_world::rooms::RoomId;

/// The sealed rooms that a point is in. Two avatars are told about each other only if their sealed
/// rooms [agree](Self::agrees).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct SealedRooms([Option<RoomId>; Self::MAX]);

impl SealedRooms {
    /// The most sealed rooms that are remembered. A point in this many or more agrees with none.
    pub const MAX: usize = 4;

    /// Collects sealed rooms, which come in ascending order.
    pub(super) fn of(rooms: impl Iterator<Item = RoomId>) -> Self {
        let mut sealed = Self::default();
        for (at, room) in rooms.enumerate().take(Self::MAX) {
            debug_assert!(at == 0 || sealed.0[at - 1] < Some(room), "rooms ascend");
            sealed.0[at] = Some(room);
        }
        sealed
    }

    /// Whether both points are in the same sealed rooms. Wrongly denied only to points in
    /// [`MAX`](Self::MAX) or more sealed rooms.
    pub fn agrees(&self, other: &Self) -> bool {
        self == other && self.0[Self::MAX - 1].is_none()
    }

    /// Whether the point is in no sealed room.
    pub fn is_open(&self) -> bool {
        self.0[0].is_none()
    }

    /// The sealed rooms, ascending.
    pub fn rooms(&self) -> impl Iterator<Item = RoomId> {
        self.0.into_iter().flatten()
    }
}
