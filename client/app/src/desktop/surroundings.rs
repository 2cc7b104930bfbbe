//! The building that is walked in, and what drawing it needs.

use std::sync::Arc;

use glam::Vec3;
use sightline_client_core::arriving::ArrivingWorld;
use sightline_renderer::{
    moving::{Culling, MovingRenderer},
    node_visibility::VisibilityPrefetcher,
    rooms::RoomWireframes,
};
use sightline_visibility::rooms::{BuildingSight, RoomIndex};
use sightline_world::World;

use super::plans::Plans;

/// The building that is walked in, and what drawing it needs.
pub(super) struct Surroundings {
    pub(super) building: ArrivingWorld,
    pub(super) rooms: RoomIndex,
    pub(super) moving: MovingRenderer,
    pub(super) plans: Plans,
    /// Finds hidden nodes, if the options ask for it.
    pub(super) ahead: Option<VisibilityPrefetcher>,
    /// Made when first needed.
    wires: Option<RoomWireframes>,
}

impl Surroundings {
    /// The surroundings in a building. `fuzzy` finds hidden nodes ahead of the eye.
    pub(super) fn new(building: ArrivingWorld, fuzzy: bool) -> Self {
        let world = building.complete().filter(|_| fuzzy);
        let ahead = world.and_then(|world| {
            let ahead = VisibilityPrefetcher::new(&world.octree);
            ahead.inspect_err(|error| tracing::warn!(%error, "hidden nodes are not left out")).ok()
        });
        let rooms = RoomIndex::new(building.world());
        let moving = MovingRenderer::new(building.world(), Culling::default());
        Self { building, rooms, moving, plans: Plans::default(), ahead, wires: None }
    }

    /// The building. While pieces of it are missing, it has no voxels.
    pub(super) fn world(&self) -> &Arc<World> {
        self.building.world()
    }

    /// The rooms as wire frames.
    pub(super) fn wires(&mut self) -> &RoomWireframes {
        let world = self.building.world();
        self.wires.get_or_insert_with(|| RoomWireframes::new(world))
    }

    /// What rooms show to an eye, unless they show everything.
    pub(super) fn sight(&self, eye: Vec3) -> Option<BuildingSight> {
        BuildingSight::of(self.world(), &self.rooms, eye)
    }

    /// Whether the author has declared any room.
    pub(super) fn has_rooms(&self) -> bool {
        !self.world().rooms.list().is_empty()
    }

    /// The name of the building, and of the room around an eye.
    pub(super) fn place_name(&self, eye: Vec3) -> String {
        let room = self.rooms.room_at(eye).and_then(|room| self.world().rooms.get(room));
        let room = room.map(|room| format!(", {}", room.title())).unwrap_or_default();
        format!("{}{room}", self.world().title)
    }
}
