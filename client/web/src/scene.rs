//! The building as one sees it.

use std::{sync::Arc, time::Duration};

use serde::Serialize;
use sightline_client_core::replica::{AvatarSource, Replica, VisibleAvatar};
use sightline_renderer::{
    Camera, Frame, Renderer,
    moving::{Culling, InView, MovingRenderer},
    plan::{Plan, PlanSketch},
};
use sightline_visibility::rooms::{BuildingSight, RoomIndex};
use sightline_world::{
    World,
    motion::Pose,
    rooms::{Room, RoomId},
};

use crate::walk::Walk;

/// A view that has not changed for so long is drawn with more pixels.
const RESTS: Duration = Duration::from_millis(400);
/// The least horizontal field of view, in radians: on an upright screen the vertical one grows.
const FOV_X_MIN: f32 = 0.95;

/// The building as one sees it.
pub(crate) struct Scene {
    pub(crate) walk: Walk,
    world: Arc<World>,
    rooms: RoomIndex,
    moving: MovingRenderer,
    renderer: Renderer,
    /// The building alone.
    building: Frame,
    /// The building, and what moves in it.
    inhabited: Frame,
    /// Red, green, blue and 255 for each pixel.
    pixels: Vec<[u8; 4]>,
    /// Whether what rooms hide from the eye is drawn, too.
    with_hidden: bool,
    /// What the picture of the building shows: the camera, columns and rows, and whether with what
    /// rooms hide.
    shown: Option<(Camera, (usize, usize), bool)>,
    /// What the picture shows that moves.
    in_view: Option<InView>,
    /// The camera, and since when it has been that.
    camera: (Camera, Duration),
    seen: Vec<VisibleAvatar>,
    plan: Option<Plan>,
    sketch: Option<PlanSketch>,
}

/// A room, as a page lists it.
#[derive(Debug, Serialize)]
pub(crate) struct ListedRoom {
    title: String,
    /// The middle of its floor, in metres.
    at: [f32; 3],
}

/// Where a plan is.
#[derive(Debug, Serialize)]
pub(crate) struct PlanPlace {
    columns: usize,
    rows: usize,
    /// The world's x and z at the upper left corner, in metres.
    x: f32,
    z: f32,
    /// The length that a pixel spans, in metres.
    metres: f32,
}

impl Scene {
    pub(crate) fn new(world: Arc<World>, pose: Pose) -> Self {
        Self {
            walk: Walk::new(world.clone(), pose),
            rooms: RoomIndex::new(&world),
            moving: MovingRenderer::new(&world, Culling::default()),
            renderer: Renderer::default(),
            building: Frame::default(),
            inhabited: Frame::default(),
            pixels: Vec::new(),
            with_hidden: false,
            shown: None,
            in_view: None,
            camera: (Camera::at(&pose), Duration::ZERO),
            seen: Vec::new(),
            plan: None,
            sketch: None,
            world,
        }
    }

    /// Enters a world at a pose. Returns whether it is another one.
    pub(crate) fn enter(&mut self, world: Arc<World>, pose: Pose) -> bool {
        let is_another = !Arc::ptr_eq(&world, &self.world);
        if is_another {
            *self = Self::new(world, pose);
        } else {
            self.walk.put(pose);
        }
        is_another
    }

    /// The avatars of which at least one pixel is shown.
    pub(crate) fn seen(&self) -> &[VisibleAvatar] {
        &self.seen
    }

    /// The title of the building, and of the room that one is in, if any.
    pub(crate) fn place(&self) -> (&str, Option<&str>) {
        let room = self.rooms.room_at(self.walk.pose().eye);
        let room = room.and_then(|room| self.world.rooms.get(room));
        (&self.world.title, room.map(|room| room.title()))
    }

    pub(crate) fn rooms(&self) -> Vec<ListedRoom> {
        let listed = |(id, room): (u16, &Room)| {
            let bounds = self.rooms.bounds(RoomId(id));
            let at = bounds.centre().with_y(bounds.min.y).to_array();
            ListedRoom { title: room.title().to_owned(), at }
        };
        (0..).zip(self.world.rooms.list()).map(listed).collect()
    }

    /// Draws what rooms hide from the eye from now on, or leaves it out again. Returns false where
    /// there are no rooms.
    pub(crate) fn toggle_hidden(&mut self) -> bool {
        self.with_hidden ^= true;
        !self.rooms.is_empty()
    }

    /// The height of the soles, in metres.
    pub(crate) fn soles(&self) -> f32 {
        self.walk.pose().eye.y - self.world.body.below_eye
    }

    /// Whether the view has been the same for a while.
    pub(crate) fn rests(&self, now: Duration) -> bool {
        now.saturating_sub(self.camera.1) >= RESTS
    }

    /// Draws what one sees, if it looks otherwise than before. Returns whether it does.
    pub(crate) fn draw(
        &mut self,
        replica: Option<&mut Replica>,
        now: Duration,
        size: (usize, usize),
    ) -> bool {
        let camera = camera(&self.walk.pose(), size);
        if camera != self.camera.0 {
            self.camera = (camera, now);
        }
        let wanted = Some((camera, size, self.with_hidden));
        let is_moved = self.shown != wanted;
        if is_moved {
            let sight = || BuildingSight::of(&self.world, &self.rooms, camera.eye);
            self.renderer.building_sight = if self.with_hidden { None } else { sight() };
            self.building.resize(size.0, size.1);
            self.renderer.draw(&self.world.octree, &camera, &mut self.building);
            self.shown = wanted;
        }
        let time = replica.as_ref().map_or(now, |replica| replica.server_time(now));
        let source = replica.map(|replica| replica as &mut dyn AvatarSource);
        let mut in_view = self.moving.find(&self.building, &camera, &self.world, source, time);
        if let Some(sight) = &self.renderer.building_sight {
            in_view.leave_out_hidden(sight, &self.world);
        }
        let is_same = self.in_view.as_ref().is_some_and(|shown| shown.looks_like(&in_view));
        if is_same && !is_moved {
            return false;
        }
        self.inhabited.copy_from(&self.building);
        self.seen = in_view.draw(&mut self.inhabited, &camera, &self.world);
        self.in_view = Some(in_view);
        self.pixels.clear();
        self.pixels.extend(self.inhabited.colour.iter().map(|colour| {
            let [_, red, green, blue] = colour.to_be_bytes();
            [red, green, blue, 255]
        }));
        true
    }

    /// The picture: red, green, blue and 255 for each pixel.
    pub(crate) fn pixels(&self) -> &[[u8; 4]] {
        &self.pixels
    }

    /// Goes on making the plan of the storey that one is on. Returns whether it is finished now.
    pub(crate) fn make_plan(&mut self, rows: usize) -> bool {
        let soles = self.soles();
        if self.sketch.is_none() && !self.plan.as_ref().is_some_and(|plan| plan.serves(soles)) {
            self.sketch = Some(PlanSketch::new(&self.world, soles));
        }
        let Some(sketch) = &mut self.sketch else { return false };
        let Some(plan) = sketch.go_on(&self.world, rows) else { return false };
        (self.plan, self.sketch) = (Some(plan), None);
        true
    }

    pub(crate) fn makes_plan(&self) -> bool {
        self.sketch.is_some()
    }

    pub(crate) fn plan_place(&self) -> Option<PlanPlace> {
        let plan = self.plan.as_ref()?;
        let ([columns, rows], corner) = (plan.size(), plan.corner());
        Some(PlanPlace { columns, rows, x: corner.x, z: corner.y, metres: plan.metres() })
    }

    pub(crate) fn plan_pixels(&self) -> Vec<u8> {
        let pixels = self.plan.iter().flat_map(|plan| plan.pixels());
        let bytes = |pixel: &Option<u32>| match pixel.map(u32::to_be_bytes) {
            Some([_, red, green, blue]) => [red, green, blue, 255],
            None => [0; 4],
        };
        pixels.flat_map(bytes).collect()
    }
}

/// The camera of an eye for a picture of some columns and rows.
fn camera(pose: &Pose, (columns, rows): (usize, usize)) -> Camera {
    let upright = rows as f32 / columns.max(1) as f32;
    let least = 2.0 * ((FOV_X_MIN * 0.5).tan() * upright).atan();
    Camera { fov_y: Camera::FOV_Y.max(least), ..Camera::at(pose) }
}

#[cfg(test)]
mod tests;
