//! The camera: where the eye is and what it looks at.

use glam::Vec3;
use sightline_world::motion::Pose;

/// A pinhole camera without roll.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The position of the eye, in metres.
    pub eye: Vec3,
    /// The heading, as in [`Pose::yaw`].
    pub yaw: f32,
    /// The elevation, as in [`Pose::pitch`].
    pub pitch: f32,
    /// The vertical field of view, in radians.
    pub fov_y: f32,
}

impl Camera {
    /// The default vertical field of view: 65 degrees, in radians.
    pub const FOV_Y: f32 = 65.0 * std::f32::consts::PI / 180.0;

    /// The view from a pose, with the default field of view.
    pub fn at(pose: &Pose) -> Self {
        Self { eye: pose.eye, yaw: pose.yaw, pitch: pose.pitch, fov_y: Self::FOV_Y }
    }

    /// The focal length in pixels for a picture of `height` rows: how many pixels a length of one
    /// metre spans at a distance of one metre.
    pub fn focal(&self, height: usize) -> f32 {
        height as f32 * 0.5 / (self.fov_y * 0.5).clamp(0.01, 1.5).tan()
    }

    /// The view from one point towards another, with the default field of view.
    pub fn looking_at(eye: Vec3, target: Vec3) -> Self {
        let along = target - eye;
        let level = along.x.hypot(along.z);
        let yaw = if level > 0.0 { (-along.x).atan2(-along.z) } else { 0.0 };
        Self { eye, yaw, pitch: along.y.atan2(level), fov_y: Self::FOV_Y }
    }
}
