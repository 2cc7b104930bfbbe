//! Where an avatar was last known to be, and how far its eye can have moved since.

use std::time::Duration;

use glam::Vec3;
use sightline_world::{
    geometry::Aabb,
    motion::{Pose, Tolerance},
    tolerance::{WIRE_BOUNDARY_M, WIRE_POSE_M},
};

use super::ReachStart;
use crate::{building::Building, claims::WalkState};

/// How much of a margin a walking avatar has aside and behind, as a part of an even one.
const ASIDE: f32 = 0.25;
/// For how many ticks a walking avatar is expected to go on as it does.
const AHEAD_TICKS: f32 = 12.0;
/// For how many ticks the margin of a fast avatar suffices.
const LASTING_TICKS: f32 = 6.0;
/// The largest such margin, in metres.
const LASTING_MAX_M: f32 = 4.0;

/// What the engine knows of how an avatar moves.
///
/// It is where the avatar was at the last moment of which its client's word is known. That is the
/// last report, or a later point of the course for which silence speaks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    /// The pose at that moment.
    pub(crate) pose: Pose,
    /// The eye of that pose, in own axes.
    pub(crate) from: Vec3,
    /// How long ago that moment is at most.
    pub(crate) age: Duration,
    /// By how much the avatar may have been elsewhere then.
    pub(crate) tolerance: Tolerance,
    pub(crate) walk: WalkState,
    /// The client's round trip.
    pub(crate) round_trip: Duration,
    /// Whether the avatar moves as its claims say.
    pub(crate) is_believed: bool,
}

impl Motion {
    pub(crate) fn start<'a>(&self, building: &'a Building) -> ReachStart<'a> {
        let rounded = Aabb::around(self.from, WIRE_BOUNDARY_M);
        ReachStart {
            cells: building.cells(),
            adjacency: &building.adjacency,
            clearance: building.clearance_of(self.walk),
            from: self.from,
            space: building.walkways.space_around(self.walk, &rounded),
        }
    }
}

/// Bounds of where an eye can be until a moment, whatever walls are in between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MotionBound {
    /// Where the eye was last known to be, in own axes.
    pub(crate) from: Vec3,
    /// The box that the eye stays in, in own axes.
    pub(crate) eyes: Aabb,
    /// No way on foot is longer, in metres.
    pub(crate) way_m: f32,
}

impl MotionBound {
    /// The bounds for a time after the eye was last known to be somewhere. A velocity that is not
    /// believed may be any velocity up to the top speed.
    pub(crate) fn new(
        building: &Building,
        motion: &Motion,
        is_believed: bool,
        time: Duration,
    ) -> Self {
        let axes = building.axes();
        let mut agility = building.agility;
        if !is_believed {
            agility.dash = agility.speed_max;
        }
        let (from, velocity) = (motion.from, axes.own(motion.pose.velocity));
        let unsure_m = WIRE_POSE_M + motion.tolerance.growth_m(time);
        Self {
            from,
            eyes: agility.eyes(from, velocity, time).grown(unsure_m),
            way_m: building.agility.way(velocity, time) + unsure_m,
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

/// The margin of a region for an eye that moves by `step` each tick: enough for some ticks.
pub(crate) fn lasting_margin_m(step: Vec3, least_m: f32) -> f32 {
    (step.length() * LASTING_TICKS).min(LASTING_MAX_M).max(least_m)
}

/// A box with a margin for an eye that moves by `step` each tick. Most of the margin is ahead.
pub(crate) fn with_margin_ahead(eyes: &Aabb, step: Vec3, margin_m: f32) -> Aabb {
    let ahead_m = (step.length() * AHEAD_TICKS).min(2.0 * (1.0 - ASIDE) * margin_m);
    let shift = step.normalize_or_zero() * ahead_m;
    let ahead = Aabb::new(eyes.min + shift, eyes.max + shift);
    eyes.union(&ahead).grown(margin_m - 0.5 * ahead_m)
}
