//! Who may see whom by rooms.

use sightline_world::{geometry::Aabb, rooms::RoomId, tolerance::ROOM_BOUNDARY_M};

use super::{
    index::{NamedMembers, RoomIndex, VisibilityRule},
    overlap::RoomOverlap,
};

/// What somebody in one room may see of somebody in another, by rooms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoomVerdict {
    /// Whatever cells show.
    Always,
    /// Nothing.
    Never,
    /// What windows show, or what cells and objects in the room's set show.
    Windows,
}

impl RoomIndex {
    /// Whether rooms let an eye in one region see some of a body in another. The answer is no only
    /// if it is no for every place in the two regions. A smaller region never gets a yes where a
    /// larger one gets a no.
    pub fn may_see(&self, eyes: &RoomOverlap, body: &RoomOverlap) -> bool {
        if !eyes.may_share_sealed_rooms(body) || self.is_behind_opaque_rooms(eyes, body) {
            return false;
        }
        eyes.is_bare || eyes.restricting.iter().any(|id| self.shows(*id, eyes, body))
    }

    /// What somebody may see of somebody else, when each of them is entirely in the given room and
    /// in no other.
    pub fn verdict(&self, from: RoomId, to: RoomId) -> RoomVerdict {
        let room = self.room(from);
        let is_sealed = from != to && (room.is_sealed || self.room(to).is_sealed);
        let named = room.rule.named();
        let is_shown = match &room.rule {
            VisibilityRule::Only(named) => named.rooms.contains(to.0.into()),
            VisibilityRule::AllBut(named) => !named.rooms.contains(to.0.into()),
        };
        let names_places = !named.cells.is_empty() || !named.objects.is_empty();
        if is_sealed || self.is_behind(&room.bounds, &self.room(to).bounds) {
            RoomVerdict::Never
        } else if is_shown || !room.restricts {
            RoomVerdict::Always
        } else if room.through_windows.contains(to.0.into()) || names_places {
            RoomVerdict::Windows
        } else {
            RoomVerdict::Never
        }
    }

    /// Whether opaque rooms hide all of a body from all eyes.
    fn is_behind_opaque_rooms(&self, eyes: &RoomOverlap, body: &RoomOverlap) -> bool {
        let is_behind = |from: &Aabb| body.boxes.iter().all(|body| self.is_behind(from, body));
        !self.opaque.is_empty()
            && !eyes.boxes.is_empty()
            && !body.boxes.is_empty()
            && eyes.boxes.iter().all(is_behind)
    }

    /// Whether one opaque room hides all of a box from all eyes in another.
    fn is_behind(&self, eyes: &Aabb, body: &Aabb) -> bool {
        let mut opaque = self.opaque.iter().filter_map(|id| self.room(*id).opaque.as_ref());
        !eyes.is_empty() && !body.is_empty() && opaque.any(|room| room.hides(eyes, body))
    }

    /// Whether a room shows some of a body by its set or through its windows, to somebody inside.
    fn shows(&self, id: RoomId, eyes: &RoomOverlap, body: &RoomOverlap) -> bool {
        let room = self.room(id);
        if self.shows_by_set(id, body) {
            return true;
        }
        if room.windows.is_empty() {
            return false;
        }
        // No window shows a body that is entirely in a room into which no window leads.
        if body.within.iter().any(|id| !room.through_windows.contains(id.0.into())) {
            return false;
        }
        let inside = |from: &Aabb| from.intersection(&room.bounds.grown(ROOM_BOUNDARY_M));
        let shows_from = |from: &Aabb| body.boxes.iter().any(|body| room.windows.show(from, body));
        eyes.boxes.iter().map(inside).filter(|from| !from.is_empty()).any(|from| shows_from(&from))
    }

    /// Whether a room's set may show some of a body.
    pub(super) fn shows_by_set(&self, id: RoomId, body: &RoomOverlap) -> bool {
        match &self.room(id).rule {
            VisibilityRule::Only(named) => {
                body.touched.iter().any(|room| named.rooms.contains(room.0.into()))
                    || body.cells.iter().any(|cell| named.cells.contains(cell.0))
                    || body
                        .boxes
                        .iter()
                        .any(|body| self.objects_of(named).any(|at| at.intersects(body)))
            }
            VisibilityRule::AllBut(named) => {
                let is_in_cells = !body.cells.is_empty()
                    && body.cells.iter().all(|cell| named.cells.contains(cell.0));
                let is_in_object =
                    |body: &Aabb| self.objects_of(named).any(|at| at.contains_box(body));
                let is_in_objects =
                    || !body.boxes.is_empty() && body.boxes.iter().all(is_in_object);
                let is_in_rooms =
                    body.within.iter().any(|room| named.rooms.contains(room.0.into()));
                !is_in_rooms && !is_in_cells && !is_in_objects()
            }
        }
    }

    /// The boxes of the objects in a set.
    fn objects_of<'a>(&'a self, named: &'a NamedMembers) -> impl Iterator<Item = &'a Aabb> {
        named.objects.iter().filter_map(|at| self.objects.get(*at as usize))
    }
}
