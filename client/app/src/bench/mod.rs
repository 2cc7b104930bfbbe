//! The cost of drawing and the quality of pictures: for `sightline-client bench` and for tests.
//!
//! * [`Views`]: where frames are drawn from. [`measure`]: the cost of a frame by each method, among
//!   them rays ([`RayCaster`]) through the world's opaque triangles. The methods take turns, so
//!   that the load of other programs affects all of them alike.
//! * [`ModeComparison`]: the renderer's modes compared with each other. [`PictureDifference`]: how
//!   two pictures of one view differ. [`DepthAgreement`]: how a picture's depths agree with rays.
//! * [`Shimmer`]: how much more the pixels change along a slow path than the scene does.
//! * [`fuzzy()`]: what is saved by leaving out nodes that are hidden from a box of eyes.
//! * [`moving()`]: the cost of avatars and movers with each way of culling.
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

use sightline_renderer::Camera;
use sightline_world::motion::Pose;

use crate::camera_path::CameraPath;

/// The cameras that frames are drawn with.
#[derive(Clone, Debug, Default)]
pub struct Views {
    /// At the world's spawn points.
    pub spawns: Vec<Camera>,
    /// Along a path.
    pub path: Vec<Camera>,
}

impl Views {
    /// All spawn points of a world, and some frames of a path.
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
