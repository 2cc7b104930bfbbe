//! How far an eye can have moved, by what its body can do.

use std::time::Duration;

use glam::Vec3;
use sightline_world::{geometry::Aabb, motion::Pose, tolerance::WIRE_POSE_M};

use crate::building::Building;

/// How much of a margin a walking avatar has aside and behind, as a part of an even one.
const ASIDE: f32 = 0.25;
/// For how many ticks a walking avatar is expected to go on as it does.
const AHEAD_TICKS: f32 = 12.0;

/// Bounds of where an eye can be until a moment, whatever walls are in between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MotionBound {
    /// The last accepted eye position, in own axes.
    pub(crate) from: Vec3,
    /// The box that the eye stays in, in own axes.
    pub(crate) eyes: Aabb,
    /// No way on foot is longer, in metres.
    pub(crate) way_m: f32,
}

impl MotionBound {
    /// The bounds for a time after the last accepted report was made. A velocity that is not
    /// believed may be any velocity up to the top speed.
    pub(crate) fn new(building: &Building, pose: &Pose, is_believed: bool, time: Duration) -> Self {
        let axes = building.axes();
        let mut agility = building.agility;
        if !is_believed {
            agility.dash = agility.speed_max;
        }
        let (from, velocity) = (axes.own(pose.eye), axes.own(pose.velocity));
        Self {
            from,
            eyes: agility.eyes(from, velocity, time).grown(WIRE_POSE_M),
            way_m: building.agility.way(velocity, time) + WIRE_POSE_M,
        }
    }

    /// The bounds, `by` times as large about the last eye position.
    pub(crate) fn scaled(self, by: f32) -> Self {
        if by == 1.0 {
            return self;
        }
        Self { eyes: scaled(&self.eyes, self.from, by), way_m: self.way_m * by, ..self }
    }
}

/// A box that is `by` times as large about a point.
pub(crate) fn scaled(region: &Aabb, about: Vec3, by: f32) -> Aabb {
    Aabb::new(about + (region.min - about) * by, about + (region.max - about) * by)
}

/// A box with a margin for an eye that moves by `step` each tick. Most of the margin is ahead.
pub(crate) fn with_margin_ahead(eyes: &Aabb, step: Vec3, margin_m: f32) -> Aabb {
    let ahead_m = (step.length() * AHEAD_TICKS).min(2.0 * (1.0 - ASIDE) * margin_m);
    let shift = step.normalize_or_zero() * ahead_m;
    let ahead = Aabb::new(eyes.min + shift, eyes.max + shift);
    eyes.union(&ahead).grown(margin_m - 0.5 * ahead_m)
}
