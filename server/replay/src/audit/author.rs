//! What the building's author rules out: an avatar that rooms hide is no miss.

use std::sync::Arc;

use glam::Vec3;
use sightline_visibility::rooms::{RoomIndex, SealedRooms};
use sightline_world::{World, geometry::Aabb};

use super::pairs::Participant;

/// The author's rooms, where they rule anything out.
pub(super) struct AuthorRules {
    world: Arc<World>,
    rooms: RoomIndex,
}

impl AuthorRules {
    /// `None` when every pair may see each other.
    pub(super) fn new(world: &Arc<World>) -> Option<Self> {
        let rooms = RoomIndex::new(world);
        rooms.can_rule_out().then(|| Self { world: Arc::clone(world), rooms })
    }

    /// The sealed rooms that an eye is in.
    pub(super) fn sealed_rooms_at(&self, eye: Vec3) -> SealedRooms {
        self.rooms.sealed_rooms_at(eye)
    }

    /// Whether a viewer may see another participant, whose body is a box. For sealed rooms the
    /// server goes by what it has heard, so both participants must have been there for a while.
    pub(super) fn allows(
        &self,
        viewer: &Participant<'_>,
        other: &Participant<'_>,
        body: &Aabb,
    ) -> bool {
        let cells = &self.world.cells;
        let overlap = |region: &Aabb| self.rooms.overlap(cells, &[cells.axes.own_box(region)]);
        let eye = overlap(&Aabb::around(viewer.pose.eye, 0.0));
        let mut sealed = viewer.sealed_rooms.iter().chain(&other.sealed_rooms);
        sealed.all(|rooms| rooms.agrees(&viewer.sealed_rooms[0]))
            && self.rooms.may_see(&eye, &overlap(body))
    }
}
