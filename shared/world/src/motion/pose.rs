//! Who and where an avatar is.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::turn_between;

/// The acceleration of a body in free fall, in metres per second squared: that of a player of a
/// Quake map, 800 map units. No body falls faster. A body that falls otherwise, such as a person at
/// 9.81 m/s², never counts as falling freely, and reports more often.
pub const FREE_FALL: f32 = 20.32;

/// The number of an avatar: a participant as seen by others and as a viewer.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Default,
)]
pub struct AvatarId(pub u32);

/// The place and direction of view of an avatar's eye, and how both change.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Pose {
    /// The eye's position, in metres.
    pub eye: Vec3,
    /// The turn about the vertical, in radians. Zero faces -z; positive turns left.
    pub yaw: f32,
    /// The angle above the horizon, in radians.
    pub pitch: f32,
    /// The eye's velocity, in metres per second.
    pub velocity: Vec3,
    /// How fast the yaw grows, in radians per second.
    pub yaw_rate: f32,
    /// Whether the body falls freely, so that its velocity downwards grows by [`FREE_FALL`].
    pub falls: bool,
}

impl Pose {
    /// The direction of view, of unit length.
    pub fn forward(&self) -> Vec3 {
        let (sin_yaw, cos_yaw) = self.yaw.sin_cos();
        let (sin_pitch, cos_pitch) = self.pitch.sin_cos();
        Vec3::new(-sin_yaw * cos_pitch, sin_pitch, -cos_yaw * cos_pitch)
    }

    /// The pose at a part of the straight way to another, from 0 to 1, with the rates of this one.
    pub fn on_the_way_to(&self, other: &Self, part: f32) -> Self {
        Self {
            eye: self.eye + (other.eye - self.eye) * part,
            yaw: self.yaw + turn_between(self.yaw, other.yaw) * part,
            pitch: self.pitch + (other.pitch - self.pitch) * part,
            ..*self
        }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.eye.is_finite()
            && self.yaw.is_finite()
            && self.pitch.is_finite()
            && self.velocity.is_finite()
            && self.yaw_rate.is_finite()
    }
}

/// A pose at which avatars can begin. The pitch is zero.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spawn {
    /// The eye's position, in metres.
    pub eye: Vec3,
    /// The yaw, as in [`Pose::yaw`].
    pub yaw: f32,
}
