//! Keyframe tracks: one value over time.

use glam::{DQuat, DVec3, Quat, Vec3};

use super::{KEYS_MAX, TrajectoryError, VALUE_MAX};
use crate::tolerance::UNIT_F32;

/// A value given at key times and interpolated in between.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyframeTrack<V> {
    /// The times, in seconds and ascending, and the values. There is at least one key. The value is
    /// constant before the first key and after the last.
    pub keys: Vec<(f32, V)>,
    /// Whether the value jumps at each key and is constant in between.
    pub steps: bool,
}

/// A type of value that a track can have.
pub trait Interpolate: Copy {
    /// The same value in double precision, for computations.
    type Exact: Copy;

    /// The value in double precision.
    fn exact(self) -> Self::Exact;

    /// The value at a fraction of the way from one value to another. The fraction is from 0 to 1.
    fn between(a: Self::Exact, b: Self::Exact, part: f64) -> Self::Exact;

    /// Whether the value is finite and within range; a rotation must have unit length.
    fn is_sane(self) -> bool;
}

impl Interpolate for Vec3 {
    type Exact = DVec3;

    fn exact(self) -> DVec3 {
        self.as_dvec3()
    }

    fn between(a: DVec3, b: DVec3, part: f64) -> DVec3 {
        a + (b - a) * part
    }

    fn is_sane(self) -> bool {
        self.as_dvec3().abs().cmple(DVec3::splat(VALUE_MAX)).all()
    }
}

impl Interpolate for Quat {
    type Exact = DQuat;

    fn exact(self) -> DQuat {
        self.as_dquat().normalize()
    }

    fn between(a: DQuat, b: DQuat, part: f64) -> DQuat {
        let (axis, angle) = arc(a, b);
        DQuat::from_axis_angle(axis, angle * part) * a
    }

    fn is_sane(self) -> bool {
        // Files round rotations, so glam's own check would be too strict.
        (self.length_squared() - 1.0).abs() < UNIT_F32 as f32
    }
}

/// The axis and the angle that turn one rotation into another along the shorter arc.
pub(super) fn arc(a: DQuat, b: DQuat) -> (DVec3, f64) {
    let b = if a.dot(b) < 0.0 { -b } else { b };
    let turn = b * a.conjugate();
    let axis = turn.xyz();
    let sine = axis.length();
    if sine < 1e-12 {
        return (DVec3::X, 0.0);
    }
    (axis / sine, 2.0 * sine.atan2(turn.w))
}

impl<V: Interpolate> KeyframeTrack<V> {
    /// A constant value.
    pub fn constant(value: V) -> Self {
        Self { keys: vec![(0.0, value)], steps: true }
    }

    /// A value that is linear between keys.
    pub fn linear(keys: Vec<(f32, V)>) -> Self {
        Self { keys, steps: false }
    }

    /// A value that jumps at each key.
    pub fn steps(keys: Vec<(f32, V)>) -> Self {
        Self { keys, steps: true }
    }

    /// The value at a time.
    pub(super) fn at(&self, time_s: f64) -> V::Exact {
        let segment = self.segment(time_s);
        V::between(segment.from, segment.to, segment.part(time_s))
    }

    /// The segment that a time falls in: from a key to the next.
    pub(super) fn segment(&self, time_s: f64) -> TrackSegment<V> {
        debug_assert!(!self.keys.is_empty(), "a checked track has a key");
        let next = self.keys.partition_point(|&(key_s, _)| f64::from(key_s) <= time_s);
        let (start_s, from) = self.keys[next.saturating_sub(1)];
        let (end_s, to) = match self.keys.get(next) {
            Some(&(end_s, to)) if next > 0 && !self.steps => (end_s, to),
            _ => (start_s, from),
        };
        let [start_s, end_s] = [start_s, end_s].map(f64::from);
        TrackSegment { start_s, end_s, from: from.exact(), to: to.exact() }
    }

    /// The times of the keys strictly between two times.
    pub(super) fn times_between(&self, from_s: f64, until_s: f64) -> impl Iterator<Item = f64> {
        let first = self.keys.partition_point(|&(key_s, _)| f64::from(key_s) <= from_s);
        let keys = self.keys[first..].iter().map(|&(key_s, _)| f64::from(key_s));
        keys.take_while(move |&key_s| key_s < until_s)
    }

    /// The number of keys, if all of them are valid.
    pub(super) fn check(&self, length_s: f32) -> Result<usize, TrajectoryError> {
        if self.keys.len() > KEYS_MAX {
            return Err(TrajectoryError::TooMany);
        }
        let within = |&(key_s, _): &(f32, V)| (0.0..=length_s).contains(&key_s);
        let ascend = self.keys.windows(2).all(|pair| pair[0].0 < pair[1].0);
        if self.keys.is_empty() || !ascend || !self.keys.iter().all(within) {
            return Err(TrajectoryError::Times);
        }
        if !self.keys.iter().all(|(_, value)| value.is_sane()) {
            return Err(TrajectoryError::Value);
        }
        Ok(self.keys.len())
    }
}

/// A part of a track on which the value is linear.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrackSegment<V: Interpolate> {
    start_s: f64,
    end_s: f64,
    pub(super) from: V::Exact,
    pub(super) to: V::Exact,
}

impl<V: Interpolate> TrackSegment<V> {
    /// The fraction of the segment that has passed at a time, from 0 to 1.
    pub(super) fn part(&self, time_s: f64) -> f64 {
        if self.end_s > self.start_s {
            ((time_s - self.start_s) / (self.end_s - self.start_s)).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }

    pub(super) fn at(&self, time_s: f64) -> V::Exact {
        V::between(self.from, self.to, self.part(time_s))
    }

    /// Whether the value can change.
    pub(super) fn moves(&self) -> bool {
        self.end_s > self.start_s
    }
}
