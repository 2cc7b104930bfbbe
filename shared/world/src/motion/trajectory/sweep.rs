//! The box around everything that a moving box passes through.
//!
//! Time is cut at every key, so that every value is linear on each piece. Where several values
//! change at once, pieces are cut finer. On a piece the box is carried through the joints, the last
//! one first. An arc is bounded by its own extremes; everything else by interval arithmetic. Each
//! step gives a box around its input, so the result is never too small.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DMat3, DQuat, DVec3, Quat, Vec3};

use super::{
    ExactBounds, Joint, Trajectory,
    track::{TrackSegment, arc},
};
use crate::{
    geometry::Aabb,
    tolerance::{SWEPT_M, SWEPT_SHARE},
};

/// The greatest rotation on a piece where other values change too, in radians.
const TURN_MAX: f64 = PI / 16.0;
/// The greatest number of parts that a piece is cut into.
const PARTS_MAX: f64 = 16.0;

/// The swept box from one time within a trajectory to another, both included.
pub(super) fn between(trajectory: &Trajectory, bounds: &Aabb, from_s: f64, until_s: f64) -> Aabb {
    let bounds = ExactBounds { min: bounds.min.as_dvec3(), max: bounds.max.as_dvec3() };
    let mut times = vec![from_s, until_s];
    for Joint { translation, rotation, scale, .. } in trajectory.joints() {
        times.extend(translation.times_between(from_s, until_s));
        times.extend(rotation.times_between(from_s, until_s));
        times.extend(scale.times_between(from_s, until_s));
    }
    times.sort_by(f64::total_cmp);
    times.dedup();
    // A value that jumps at the very end has jumped.
    let mut whole = swept_piece(trajectory, bounds, until_s, until_s);
    for pair in times.windows(2) {
        let parts = parts(trajectory, pair[0], pair[1]);
        let at = |i: f64| pair[0] + (pair[1] - pair[0]) * (i / parts);
        let mut i = 0.0;
        while i < parts {
            whole = whole.union(&swept_piece(trajectory, bounds, at(i), at(i + 1.0)));
            i += 1.0;
        }
    }
    whole.rounded()
}

/// The number of parts to cut a piece without keys into.
fn parts(trajectory: &Trajectory, from_s: f64, until_s: f64) -> f64 {
    let (mut turn, mut moving) = (0.0f64, 0);
    for joint in trajectory.joints() {
        let rotation = joint.rotation.segment(from_s);
        let (_, angle) = arc(rotation.from, rotation.to);
        let angle = angle * (rotation.part(until_s) - rotation.part(from_s));
        turn += angle;
        moving += usize::from(angle > 0.0);
        moving += usize::from(joint.translation.segment(from_s).moves());
        moving += usize::from(joint.scale.segment(from_s).moves());
    }
    if moving > 1 { (turn / TURN_MAX).ceil().clamp(1.0, PARTS_MAX) } else { 1.0 }
}

/// The swept box on a piece without keys.
fn swept_piece(
    trajectory: &Trajectory,
    bounds: ExactBounds,
    from_s: f64,
    until_s: f64,
) -> ExactBounds {
    trajectory.joints().iter().rev().fold(bounds, |bounds, joint| {
        let scaled = scaled(&bounds, &joint.scale.segment(from_s), from_s, until_s);
        let frame = &joint.frame;
        let turned = scaled.turned(&joint.rotation.segment(from_s), frame, from_s, until_s);
        let translation = joint.translation.segment(from_s);
        let [a, b] = [from_s, until_s].map(|at| frame.transform_point3(translation.at(at)));
        ExactBounds { min: turned.min + a.min(b), max: turned.max + a.max(b) }
    })
}

fn scaled(
    bounds: &ExactBounds,
    scale: &TrackSegment<Vec3>,
    from_s: f64,
    until_s: f64,
) -> ExactBounds {
    let (a, b) = (scale.at(from_s), scale.at(until_s));
    let ends = [bounds.min * a, bounds.min * b, bounds.max * a, bounds.max * b];
    ExactBounds::around(ends)
}

impl ExactBounds {
    fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        let empty = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };
        points.into_iter().fold(empty, |b, p| Self { min: b.min.min(p), max: b.max.max(p) })
    }

    fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    fn corners(&self) -> impl Iterator<Item = DVec3> + '_ {
        (0..8).map(|i| {
            let pick =
                |axis: usize| if i >> axis & 1 == 0 { self.min[axis] } else { self.max[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// Around the arcs of all corners, seen as a frame has them but for its place. What is inside
    /// of the box stays between them.
    fn turned(
        &self,
        rotation: &TrackSegment<Quat>,
        frame: &DAffine3,
        from_s: f64,
        until_s: f64,
    ) -> Self {
        let (axis, angle) = arc(rotation.from, rotation.to);
        let start: DQuat = rotation.at(from_s);
        let angle = angle * (rotation.part(until_s) - rotation.part(from_s));
        let start = DMat3::from_quat(start);
        let arcs = self.corners().map(|corner| {
            let corner = start * corner;
            let middle = axis * axis.dot(corner);
            let parts = [middle, corner - middle, axis.cross(corner)];
            around_arc(parts.map(|part| frame.matrix3 * part), angle)
        });
        arcs.reduce(|a, b| a.union(&b)).expect("eight corners")
    }

    /// The box in single precision, rounded outwards.
    fn rounded(&self) -> Aabb {
        let reach = self.min.abs().max(self.max.abs());
        let margin = DVec3::splat(SWEPT_M) + reach * SWEPT_SHARE;
        let rounded = Aabb::new((self.min - margin).as_vec3(), (self.max + margin).as_vec3());
        debug_assert!(
            rounded.min.as_dvec3().cmple(self.min).all()
                && rounded.max.as_dvec3().cmpge(self.max).all(),
            "rounding must not shrink {self:?}"
        );
        rounded
    }
}

/// The box around `middle + out cos φ + aside sin φ` for all φ from 0 to an angle of at most π.
fn around_arc([middle, out, aside]: [DVec3; 3], angle: f64) -> ExactBounds {
    let (sine, cosine) = angle.sin_cos();
    let mut bounds = ExactBounds::around([middle + out, middle + out * cosine + aside * sine]);
    if angle == 0.0 {
        return bounds;
    }
    for i in 0..3 {
        let radius = out[i].hypot(aside[i]);
        let highest = aside[i].atan2(out[i]).rem_euclid(TAU);
        if highest <= angle {
            bounds.max[i] = bounds.max[i].max(middle[i] + radius);
        }
        if (highest + PI).rem_euclid(TAU) <= angle {
            bounds.min[i] = bounds.min[i].min(middle[i] - radius);
        }
    }
    bounds
}
