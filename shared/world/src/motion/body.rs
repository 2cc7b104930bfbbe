//! The box that stands for a body.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::geometry::{Aabb, Axes};

/// How far around a body voxels must be here before it moves, in metres.
const AROUND_M: f32 = 0.5;

/// The shape of every body in a world: a box about the eye.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// The distance from the eye to each side, in metres.
    pub half_width: f32,
    /// The distance from the eye to the top, in metres.
    pub above_eye: f32,
    /// The distance from the eye to the soles, in metres.
    pub below_eye: f32,
}

impl Body {
    /// A person: 0.4 m wide, 1.7 m high, the eye at 1.6 m.
    pub const PERSON: Self = Self { half_width: 0.2, above_eye: 0.1, below_eye: 1.6 };
    /// A Quake III player: 0.76 m wide, 1.42 m high.
    pub const QUAKE: Self = Self { half_width: 0.38, above_eye: 0.15, below_eye: 1.27 };

    /// The middle of the body whose eye is at a point: where its light is looked up.
    pub fn middle(&self, eye: Vec3) -> Vec3 {
        eye + Vec3::Y * ((self.above_eye - self.below_eye) / 2.0)
    }

    /// The highest step that the body climbs without a jump, in metres. It is 18 units in Quake
    /// maps.
    pub fn step_height(&self) -> f32 {
        if *self == Self::QUAKE { 0.46 } else { 0.35 }
    }

    /// The smallest body along own axes that contains this one, which stands along the world's.
    pub fn in_axes(&self, axes: &Axes) -> Self {
        Self { half_width: self.half_width * axes.widening(), ..*self }
    }

    /// The box that the body fills while its eye is at a point.
    pub fn around(&self, eye: Vec3) -> Aabb {
        self.around_box(&Aabb::new(eye, eye))
    }

    /// The box that the body cannot leave while its eye stays in a box.
    pub fn around_box(&self, eyes: &Aabb) -> Aabb {
        debug_assert!(
            self.half_width >= 0.0 && self.above_eye >= 0.0 && self.below_eye >= 0.0,
            "{self:?} does not contain its eye"
        );
        Aabb {
            min: eyes.min - Vec3::new(self.half_width, self.below_eye, self.half_width),
            max: eyes.max + Vec3::new(self.half_width, self.above_eye, self.half_width),
        }
    }

    /// The box in which all voxels must be here before the body moves while its eye is in a box.
    pub fn surroundings(&self, eyes: &Aabb) -> Aabb {
        self.around_box(eyes).grown(AROUND_M)
    }
}
