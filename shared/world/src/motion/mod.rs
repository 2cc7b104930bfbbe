//! Where a body is, what it can do in a given time, and the regions sure to contain it.

mod agility;
pub mod trajectory;

use std::{fmt, time::Duration};

use glam::Vec3;
use serde::{Deserialize, Serialize};

pub use agility::Agility;

use crate::geometry::{Aabb, Axes};

/// One participant, as seen by the others and as seeing.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Default,
)]
pub struct AvatarId(pub u32);

/// Where an avatar's eye is and how it looks and moves.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Pose {
    /// The eye, in metres.
    pub eye: Vec3,
    /// Turn about the vertical, in radians: 0 looks along -z, positive turns left.
    pub yaw: f32,
    /// Look up (positive) or down, in radians.
    pub pitch: f32,
    /// Metres a second.
    pub velocity: Vec3,
}

impl Pose {
    /// The unit vector along which the avatar looks.
    pub fn forward(&self) -> Vec3 {
        let (sin_yaw, cos_yaw) = self.yaw.sin_cos();
        let (sin_pitch, cos_pitch) = self.pitch.sin_cos();
        Vec3::new(-sin_yaw * cos_pitch, sin_pitch, -cos_yaw * cos_pitch)
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.eye.is_finite()
            && self.yaw.is_finite()
            && self.pitch.is_finite()
            && self.velocity.is_finite()
    }
}

/// The shape of every body in a world: a box about the eye.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// From the eye to each side, in metres.
    pub half_width: f32,
    /// From the eye to the top, in metres.
    pub above_eye: f32,
    /// From the eye to the soles, in metres.
    pub below_eye: f32,
}

impl Body {
    /// A person: 0.4 m wide, 1.7 m high, the eye at 1.6 m.
    pub const PERSON: Self = Self { half_width: 0.2, above_eye: 0.1, below_eye: 1.6 };
    /// A Quake III player: 0.76 m wide, 1.42 m high.
    pub const QUAKE: Self = Self { half_width: 0.38, above_eye: 0.15, below_eye: 1.27 };

    /// How high a step it climbs without a jump, in metres: in Quake maps 18 units.
    pub fn step_height(&self) -> f32 {
        if *self == Self::QUAKE { 0.46 } else { 0.35 }
    }

    /// The smallest body in own axes around this one, which stands in the world's.
    pub fn in_axes(&self, axes: &Axes) -> Self {
        Self { half_width: self.half_width * axes.widening(), ..*self }
    }

    /// The box that the body fills when its eye is at a point.
    pub fn around(&self, eye: Vec3) -> Aabb {
        self.around_box(&Aabb::new(eye, eye))
    }

    /// The box that the body cannot leave while its eye stays in a box.
    pub fn around_box(&self, eyes: &Aabb) -> Aabb {
        Aabb {
            min: eyes.min - Vec3::new(self.half_width, self.below_eye, self.half_width),
            max: eyes.max + Vec3::new(self.half_width, self.above_eye, self.half_width),
        }
    }
}

/// What the server expects of the client of an avatar that is in the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ReportingState {
    /// The client reports at every tick: some viewer may see its avatar, or it may see somebody.
    #[default]
    Live,
    /// The client is silent: while its avatar is inside its TBV nobody can see it and it can see nobody.
    Quiet,
    /// The client owes one report: its TBV expired or was revealed.
    Asked,
}

impl fmt::Display for ReportingState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Live => "live",
            Self::Quiet => "quiet",
            Self::Asked => "asked",
        })
    }
}

/// A region sure to contain an avatar's eye until it expires: a box along the building's own axes. What
/// the server makes of it may be smaller, since nobody goes through walls.
/// (Sudarsky and Gotsman, *Output-Sensitive Visibility Algorithms for Dynamic Scenes*, section 3.)
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tbv {
    /// Where the eye is, along `axes`.
    pub within: Aabb,
    /// Those of the building.
    pub axes: Axes,
    /// The end of the validity, on the server's clock.
    pub expiry: Duration,
    /// Unless zero, the body could get out before that: it stays by the word of its client, which says so as soon
    /// as the body could be outside within so long.
    pub notice: Duration,
}

impl Tbv {
    /// Whether an eye at this place of the world is inside.
    pub fn contains(&self, eye: Vec3) -> bool {
        self.within.contains(self.axes.own(eye))
    }

    /// Whether a client in there need not say anything until its next tick: its body, which moves as it says,
    /// is still inside by then, and as much longer as its notice takes.
    pub fn holds(&self, pose: &Pose, tick: Duration, agility: &Agility) -> bool {
        let (eye, velocity) = (self.axes.own(pose.eye), self.axes.own(pose.velocity));
        if self.notice.is_zero() {
            let next = eye + velocity * tick.as_secs_f32();
            return self.within.contains(eye) && self.within.contains(next);
        }
        self.within.contains_box(&agility.eyes(eye, velocity, self.notice))
    }

    /// The same region and so many metres more on each side.
    pub fn grown(&self, metres: f32) -> Self {
        Self { within: self.within.grown(metres), ..*self }
    }
}
