//! What drawing costs, and how good the pictures are: for `sightline-client bench` and for tests.
//!
//! * [`Views`]: where from. [`measure`]: what a frame costs from there in each way to draw it, among them [`RayCaster`] through
//!   the world's opaque triangles, one after the other again and again, so that what else the machine does hits all alike.
//! * [`ModeComparison`]: the renderer's modes against each other. [`PictureDifference`]: how two pictures of one view differ. [`DepthAgreement`]: how far a picture's depths are from where rays
//!   end.
//! * [`Shimmer`]: how much more a picture changes along a slow path than what it shows.
//! * [`fuzzy()`]: what it saves to leave out what is hidden from a box of eyes.
//! * [`moving()`]: what avatars and movers cost in each way to cull them.
//!
//! Clocks are read here, and nowhere in the renderer.

mod compare;
mod depth_agreement;
mod difference;
mod fuzzy;
mod measure;
mod moving;
mod rays;
mod shimmer;

use sightline_world::World;

pub use compare::{ModeComparison, ViewComparison};
pub use depth_agreement::{DepthAgreement, DepthFault};
pub use difference::{PictureDifference, channels, differs};
pub use fuzzy::{FRAME_S, FuzzyError, FuzzyRun, fuzzy};
pub use measure::{
    BenchOptions, BenchRun, DrawMethod, FrameCounts, MethodRow, Spread, Timing, measure,
};
pub use moving::{
    MovingCost, MovingError, MovingKind, MovingRow, MovingRun, SimulatedPeople, moving,
};
pub use rays::{BvhKind, RayCaster};
pub use shimmer::Shimmer;

use crate::camera_path::CameraPath;
use sightline_renderer::Camera;
use sightline_world::motion::Pose;

/// Where frames are drawn from.
#[derive(Clone, Debug, Default)]
pub struct Views {
    /// The world's spawn points.
    pub spawns: Vec<Camera>,
    /// Along a path.
    pub path: Vec<Camera>,
}

impl Views {
    /// All spawn points of a world, and so many frames of a path.
    pub fn new(world: &World, path: &CameraPath, frames: usize) -> Self {
        let spawn = |spawn: &sightline_world::Spawn| {
            Camera::at(&Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() })
        };
        Self {
            spawns: world.spawns.iter().map(spawn).collect(),
            path: path.frames(frames).map(|(_, pose)| Camera::at(&pose)).collect(),
        }
    }
}
