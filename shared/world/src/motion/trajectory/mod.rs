//! Trajectories: the place of a mover at any time, and a box that it does not leave between two
//! times.

mod sweep;
#[cfg(test)]
mod tests;
mod track;

use std::time::Duration;

use glam::{DAffine3, DVec3};
use thiserror::Error;

pub use track::{Interpolate, KeyframeTrack};

use crate::geometry::Aabb;

/// The greatest number of joints of a trajectory.
pub const JOINTS_MAX: usize = 16;
/// The greatest number of keys in all tracks of a trajectory together: they take 192 KiB at most.
pub const KEYS_MAX: usize = 4_096;
/// The greatest length of a trajectory, in seconds: a day.
pub const LENGTH_S_MAX: f32 = 86_400.0;
/// The greatest coordinate of a joint or key, in metres, and the greatest scale.
const VALUE_MAX: f64 = 1e6;

/// The motion of a mover: its place at every time.
///
/// The mover hangs on a chain of joints, as nodes of a scene do. The first joint is fixed to the
/// world. Rotations follow the shorter arc at constant speed.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    joints: Vec<Joint>,
    length_s: f32,
    playback: Playback,
}

/// When a mover plays its trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Playback {
    /// From the start of the server's clock, over and over.
    Loop,
    /// Once, from the start of the server's clock. The mover stays where the trajectory ends.
    Once,
    /// Once after each trigger. Between triggers the mover rests where the trajectory begins.
    Triggered,
}

/// A moving node. Whatever hangs on it is scaled, rotated and translated, in this order, and then
/// placed in the frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// The joint's place relative to the joint above; the first joint's, relative to the world.
    pub frame: DAffine3,
    /// The translation, in metres.
    pub translation: KeyframeTrack<glam::Vec3>,
    /// The rotation, as unit quaternions.
    pub rotation: KeyframeTrack<glam::Quat>,
    /// The scale along each axis.
    pub scale: KeyframeTrack<glam::Vec3>,
}

/// Why a trajectory is invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum TrajectoryError {
    /// It has more than [`KEYS_MAX`] keys or [`JOINTS_MAX`] joints.
    #[error("a trajectory has more than {KEYS_MAX} keys or {JOINTS_MAX} joints")]
    TooMany,
    /// A track has no key, or the times of its keys do not ascend within the length.
    #[error("the key times of a trajectory do not ascend, or lie beyond its end")]
    Times,
    /// The length is negative, too long or not finite; or a loop takes no time.
    #[error("the length of a trajectory is not between 0 and {LENGTH_S_MAX} s")]
    Length,
    /// A value is not finite, is too great, or is not a rotation.
    #[error("a trajectory has a value that is out of range or is not a rotation")]
    Value,
}

impl Joint {
    /// A joint that does not move, at a place relative to the joint above.
    pub fn still(frame: DAffine3) -> Self {
        Self {
            frame,
            translation: KeyframeTrack::constant(glam::Vec3::ZERO),
            rotation: KeyframeTrack::constant(glam::Quat::IDENTITY),
            scale: KeyframeTrack::constant(glam::Vec3::ONE),
        }
    }

    fn at(&self, time_s: f64) -> DAffine3 {
        let local = DAffine3::from_scale_rotation_translation(
            self.scale.at(time_s),
            self.rotation.at(time_s),
            self.translation.at(time_s),
        );
        self.frame * local
    }

    fn check(&self, length_s: f32) -> Result<usize, TrajectoryError> {
        let frame = self.frame.to_cols_array();
        if !frame.iter().all(|value| value.abs() <= VALUE_MAX) {
            return Err(TrajectoryError::Value);
        }
        Ok(self.translation.check(length_s)?
            + self.rotation.check(length_s)?
            + self.scale.check(length_s)?)
    }
}

impl Trajectory {
    /// A trajectory of a given length, in seconds. Every key lies within the length.
    ///
    /// # Errors
    ///
    /// When a value, a time, the length or the number of keys or joints is out of range.
    pub fn new(
        joints: Vec<Joint>,
        length_s: f32,
        playback: Playback,
    ) -> Result<Self, TrajectoryError> {
        if joints.len() > JOINTS_MAX {
            return Err(TrajectoryError::TooMany);
        }
        let takes_time = playback != Playback::Loop || length_s > 0.0;
        if !(0.0..=LENGTH_S_MAX).contains(&length_s) || !takes_time {
            return Err(TrajectoryError::Length);
        }
        let mut keys = 0;
        for joint in &joints {
            keys += joint.check(length_s)?;
        }
        if keys > KEYS_MAX {
            Err(TrajectoryError::TooMany)
        } else {
            Ok(Self { joints, length_s, playback })
        }
    }

    /// The joints, the one fixed to the world first.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// The length, in seconds.
    pub fn length_s(&self) -> f32 {
        self.length_s
    }

    /// When the mover plays the trajectory.
    pub fn playback(&self) -> Playback {
        self.playback
    }

    /// The transform from the mover's own coordinates to the world's. The start is that of the
    /// server's clock, or the trigger.
    pub fn at(&self, since_start: Duration) -> DAffine3 {
        self.at_local(self.local_s(since_start.as_secs_f64()))
    }

    /// A box that contains a moving box between two times after the start. `bounds` is given in the
    /// mover's own coordinates. The result covers the arcs between keys. It is as tight as a box
    /// can be if only one of rotation, translation and scale changes.
    pub fn swept(&self, bounds: &Aabb, from: Duration, until: Duration) -> Aabb {
        if bounds.is_empty() {
            return Aabb::EMPTY;
        }
        let (from, until) = (from.as_secs_f64(), until.as_secs_f64().max(from.as_secs_f64()));
        let length = f64::from(self.length_s);
        if self.playback == Playback::Loop && until - from >= length {
            return sweep::between(self, bounds, 0.0, length);
        }
        let (first, last) = (self.local_s(from), self.local_s(until));
        if first <= last {
            return sweep::between(self, bounds, first, last);
        }
        let to_the_end = sweep::between(self, bounds, first, length);
        to_the_end.union(&sweep::between(self, bounds, 0.0, last))
    }

    /// A box that a moving box never leaves, whenever the trajectory is triggered. `bounds` is
    /// given in the mover's own coordinates.
    pub fn everywhere(&self, bounds: &Aabb) -> Aabb {
        let whole = Duration::from_secs_f32(self.length_s) + Duration::from_millis(1);
        self.swept(bounds, Duration::ZERO, whole)
    }

    /// The time within the trajectory, in seconds.
    fn local_s(&self, since_start_s: f64) -> f64 {
        let length = f64::from(self.length_s);
        match self.playback {
            Playback::Loop => since_start_s % length,
            Playback::Once | Playback::Triggered => since_start_s.min(length),
        }
    }

    fn at_local(&self, time_s: f64) -> DAffine3 {
        self.joints.iter().fold(DAffine3::IDENTITY, |above, joint| above * joint.at(time_s))
    }
}

/// An axis-aligned box in double precision.
#[derive(Clone, Copy, Debug)]
struct ExactBounds {
    min: DVec3,
    max: DVec3,
}
