//! Temporal bounding volumes, and what a server expects of a client that has one.

use std::{fmt, time::Duration};

use glam::Vec3;

use super::{Agility, Pose};
use crate::geometry::{Aabb, Axes};

/// What the server expects of the client of an avatar that is in the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ReportingState {
    /// The client reports when its avatar departs from its course: some viewer may see it, or it
    /// may see another.
    #[default]
    Live,
    /// The client is silent: while its avatar is inside its TBV no viewer can see it, and it can
    /// see no other avatar.
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

/// A temporal bounding volume (TBV): a region sure to contain an avatar's eye until it expires.
///
/// It is a box along the building's own axes. The server may intersect it with what a body can
/// reach, since nobody goes through walls. (Sudarsky and Gotsman 1996, *Output-Sensitive Visibility
/// Algorithms for Dynamic Scenes*, section 3.)
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tbv {
    /// The box that contains the eye, along `axes`, in metres.
    pub within: Aabb,
    /// The building's own axes.
    pub axes: Axes,
    /// The end of the validity, on the server's clock.
    pub expiry: Duration,
    /// The notice that the client gives before its body can be outside. Zero means that the body
    /// cannot leave the region before the expiry.
    pub notice: Duration,
}

impl Tbv {
    /// Whether an eye, given in the world's axes, is inside.
    pub fn contains(&self, eye: Vec3) -> bool {
        self.within.contains(self.axes.own(eye))
    }

    /// Whether a client with this pose may stay silent until its next tick.
    ///
    /// Without a notice, the eye must be inside now and a tick later. With one, every place that
    /// the body can reach within the notice must be inside.
    pub fn holds(&self, pose: &Pose, tick: Duration, agility: &Agility) -> bool {
        let (eye, velocity) = (self.axes.own(pose.eye), self.axes.own(pose.velocity));
        if self.notice.is_zero() {
            let next = eye + velocity * tick.as_secs_f32();
            return self.within.contains(eye) && self.within.contains(next);
        }
        self.within.contains_box(&agility.eyes(eye, velocity, self.notice))
    }

    /// The TBV with its box grown by a margin on every side, in metres.
    pub fn grown(&self, metres: f32) -> Self {
        Self { within: self.within.grown(metres), ..*self }
    }
}
