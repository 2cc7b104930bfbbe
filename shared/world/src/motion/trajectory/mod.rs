//! Known motions: where a mover is at a time, and a box that it does not leave between two times.

mod sweep;
#[cfg(test)]
mod tests;
mod track;

use std::time::Duration;

use glam::{DAffine3, DVec3};
use thiserror::Error;

pub use track::{Interpolate, KeyframeTrack};

use crate::geometry::Aabb;

/// A trajectory has no more joints.
pub const JOINTS_MAX: usize = 16;
/// All tracks of a trajectory together have no more keys: 192 KiB of them at most.
pub const KEYS_MAX: usize = 4_096;
/// No trajectory takes longer, in seconds: a day.
pub const LENGTH_S_MAX: f32 = 86_400.0;
/// No part of one is further from where it is counted from, in metres, and nothing is scaled by more.
const VALUE_MAX: f64 = 1e6;

/// How a mover moves: where it is at every time.
///
/// It hangs on a chain of joints, as nodes of a scene do, the first at the world. Rotations go
/// along arcs at constant speed, the shorter way round.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    joints: Vec<Joint>,
    length_s: f32,
    playback: Playback,
}

/// When a mover moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Playback {
    /// From the beginning of the server's clock, again and again.
    Loop,
    /// From the beginning of the server's clock, once; it stays where it ends.
    Once,
    /// Once whenever somebody or something sets it off; it rests where it begins.
    Triggered,
}

/// A node that moves: what hangs on it is first scaled, then turned, then moved, then put into the
/// frame, which is that of the joint above.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Where the joint is, as the joint above has it, or the world if it is the first.
    pub frame: DAffine3,
    /// In metres.
    pub translation: KeyframeTrack<glam::Vec3>,
    /// Unit quaternions.
    pub rotation: KeyframeTrack<glam::Quat>,
    /// Factors.
    pub scale: KeyframeTrack<glam::Vec3>,
}

/// Why something is no trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum TrajectoryError {
    /// See [`KEYS_MAX`], [`JOINTS_MAX`].
    #[error("a motion has more than {KEYS_MAX} keys or {JOINTS_MAX} joints")]
    TooMany,
    /// It has no key, or the times do not ascend within its length.
    #[error("the times of a motion do not ascend, or are beyond its end")]
    Times,
    /// The length is not finite, negative, or too long; or a loop takes no time.
    #[error("the length of a motion is not between 0 and {LENGTH_S_MAX} s")]
    Length,
    /// A value is not finite, far too great, or no rotation.
    #[error("a motion leads nowhere")]
    Value,
}

impl Joint {
    /// A joint that does not move.
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
    /// A motion of a length in seconds, which no key is beyond.
    ///
    /// # Errors
    ///
    /// When something is not finite, too long, too much, or out of order.
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

    /// The joints, from the world on.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// How long it takes, in seconds.
    pub fn length_s(&self) -> f32 {
        self.length_s
    }

    /// When it moves.
    pub fn playback(&self) -> Playback {
        self.playback
    }

    /// From a mover's own coordinates to the world's, a time after the start: that of the server's
    /// clock, or what set it off.
    pub fn at(&self, since_start: Duration) -> DAffine3 {
        self.at_local(self.local_s(since_start.as_secs_f64()))
    }

    /// A box sure to hold, from one time after the start to another, what a box in a mover's own
    /// coordinates holds. It takes in the arcs between keys, and is as tight as a box can be around
    /// boxes where just one thing moves.
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

    /// A box that what moves never leaves, whenever it is set off.
    pub fn everywhere(&self, bounds: &Aabb) -> Aabb {
        let whole = Duration::from_secs_f32(self.length_s) + Duration::from_millis(1);
        self.swept(bounds, Duration::ZERO, whole)
    }

    /// Time within the motion.
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

/// A box in double precision, as [`Aabb`].
#[derive(Clone, Copy, Debug)]
struct ExactBounds {
    min: DVec3,
    max: DVec3,
}
