//! Which movers may be visible from a moving camera, by visibility sets (Menon and Rossignac 1999).

use sightline_visibility::rooms::{
    RoomIndex,
    sets::{ViewpointTolerance, VisibilitySets},
};
use sightline_world::{Mover, World, motion::Pose};

/// Viewpoints that differ by no more share a visibility set.
const TOLERANCE: ViewpointTolerance = ViewpointTolerance { eye_m: 0.5, look: 0.15 };
/// A camera that moved farther since the frame before was put elsewhere, in metres.
const LEAP_M: f32 = 4.0;

/// The visibility sets of a camera's viewpoints, and of the ways between them, from frame to frame.
pub struct MoverVisibility {
    sets: VisibilitySets,
    before: Option<Pose>,
}

impl MoverVisibility {
    /// Visibility sets for pictures of this width and height in pixels. `upright` is the vertical
    /// field of view in radians.
    pub fn new((width, height): (usize, usize), upright: f32) -> Self {
        let shape = width as f32 / height.max(1) as f32;
        let across = 2.0 * ((upright * 0.5).tan() * shape).atan();
        Self { sets: VisibilitySets::new(TOLERANCE, [across, upright]), before: None }
    }

    /// The movers that may be visible from a viewpoint, or from anywhere on the way to it from the
    /// viewpoint before.
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

    /// How many visibility sets were made so far.
    pub fn sets_made(&self) -> u64 {
        self.sets.made()
    }
}
