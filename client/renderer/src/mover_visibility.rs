//! Which movers may be visible from a camera on its way, by visibility sets.

use sightline_visibility::rooms::{
    RoomIndex,
    sets::{ViewpointTolerance, VisibilitySets},
};
use sightline_world::{Mover, World, motion::Pose};

/// Viewpoints that are so near to each other share a visibility set.
const TOLERANCE: ViewpointTolerance = ViewpointTolerance { eye_m: 0.5, look: 0.15 };
/// A camera that is so far from where it was in the frame before was put there, in metres.
const LEAP_M: f32 = 4.0;

/// The visibility sets of the viewpoints of a camera's frames, and of the ways between them.
pub struct MoverVisibility {
    sets: VisibilitySets,
    before: Option<Pose>,
}

impl MoverVisibility {
    /// For pictures of this size, whose lowest and highest lines of sight are this angle apart, in radians.
    pub fn new((width, height): (usize, usize), upright: f32) -> Self {
        let shape = width as f32 / height.max(1) as f32;
        let across = 2.0 * ((upright * 0.5).tan() * shape).atan();
        Self { sets: VisibilitySets::new(TOLERANCE, [across, upright]), before: None }
    }

    /// The movers that may be visible from a viewpoint and from anywhere on the way to it from the one before.
    pub fn movers<'a>(
        &mut self,
        world: &'a World,
        rooms: &RoomIndex,
        pose: &Pose,
    ) -> Vec<&'a Mover> {
        if world.movers.is_empty() {
            return Vec::new();
        }
        let is_near = |before: &Pose| before.eye.distance(pose.eye) <= LEAP_M;
        let set = match self.before.replace(*pose).filter(is_near) {
            Some(before) => self.sets.between(world, rooms, &before, pose),
            None => self.sets.at(world, rooms, pose).clone(),
        };
        set.movers.iter().filter_map(|at| world.movers.get(at as usize)).collect()
    }

    /// How many sets were made so far.
    pub fn sets_made(&self) -> u64 {
        self.sets.made()
    }
}
