//! What drawing costs, and how good the pictures are: for `sightline-client bench` and for tests.
//!
//! * [`Views`]: where from. [`measure`]: what a frame costs from there in each way to draw it, among them [`Rays`] through
//!   the world's opaque triangles, one after the other again and again, so that what else the machine does hits all alike.
//! * [`Comparison`]: the renderer's modes against each other. [`Difference`]: how two pictures of one view differ. [`Depths`]: how far a picture's depths are from where rays
//!   end.
//! * [`Shimmer`]: how much more a picture changes along a slow path than what it shows.
//! * [`fuzzy()`]: what it saves to leave out what is hidden from a box of eyes.
//! * [`moving()`]: what avatars and movers cost in each way to cull them.
//!
//! Clocks are read here, and nowhere in the renderer.

mod compare;
mod depths;
mod difference;
mod fuzzy;
mod measure;
mod moving;
mod rays;
mod shimmer;

use sightline_world::World;

pub use compare::{Comparison, View};
pub use depths::{Depths, Fault};
pub use difference::{Difference, channels, differs};
pub use fuzzy::{FRAME_S, FuzzyError, FuzzyRun, fuzzy};
pub use measure::{Contender, Counts, Options, Row, Run, Spread, Timing, measure};
pub use moving::{Crowd, Kind, MovingCost, MovingError, MovingRow, MovingRun, moving};
pub use rays::{Rays, Tree};
pub use shimmer::Shimmer;

use crate::path::Path;
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
    pub fn new(world: &World, path: &Path, frames: usize) -> Self {
        let spawn = |spawn: &sightline_world::Spawn| {
            Camera::at(&Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() })
        };
        Self {
            spawns: world.spawns.iter().map(spawn).collect(),
            path: path.frames(frames).map(|(_, pose)| Camera::at(&pose)).collect(),
        }
    }
}
