//! Boxes, frustums and a building's own axes.

mod axes;
mod confines;

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

pub use axes::Axes;
pub use confines::Confines;

/// A closed axis-aligned box, in metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// The corner with the least coordinates.
    pub min: Vec3,
    /// The corner with the greatest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// The box that contains no point: the identity of [`Aabb::union`].
    pub const EMPTY: Self =
        Self { min: Vec3::splat(f32::INFINITY), max: Vec3::splat(f32::NEG_INFINITY) };

    /// The box between two opposite corners. `min` has the lesser coordinate on each axis.
    pub const fn new(min: Vec3, max: Vec3) -> Self {
        Self { min, max }
    }

    /// The smallest box around some points; [`Aabb::EMPTY`] around none.
    pub fn from_points(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self { min: b.min.min(p), max: b.max.max(p) })
    }

    /// The cube of half-width `radius` around a point.
    pub fn around(centre: Vec3, radius: f32) -> Self {
        Self { min: centre - radius, max: centre + radius }
    }

    /// Whether the box contains no point.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// The smallest box around both boxes.
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The intersection of both boxes; empty when they are apart.
    pub fn intersection(&self, other: &Self) -> Self {
        Self { min: self.min.max(other.min), max: self.max.min(other.max) }
    }

    /// Whether the boxes share a point; touching counts.
    pub fn intersects(&self, other: &Self) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    /// Whether the point is inside or on the boundary.
    pub fn contains(&self, point: Vec3) -> bool {
        self.min.cmple(point).all() && point.cmple(self.max).all()
    }

    /// Whether the other box lies wholly inside this one.
    pub fn contains_box(&self, other: &Self) -> bool {
        self.min.cmple(other.min).all() && other.max.cmple(self.max).all()
    }

    /// The box grown by `margin` metres on every side.
    pub fn grown(&self, margin: f32) -> Self {
        Self { min: self.min - margin, max: self.max + margin }
    }

    /// The width along each axis, in metres.
    pub fn size(&self) -> Vec3 {
        self.max - self.min
    }

    /// The eight corners.
    pub fn corners(&self) -> [Vec3; 8] {
        std::array::from_fn(|i| {
            let pick = |axis: usize| [self.min[axis], self.max[axis]][i >> axis & 1];
            Vec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// The centre.
    pub fn centre(&self) -> Vec3 {
        (self.min + self.max) * 0.5
    }
}

/// The directions that a camera sees: a pyramid without an apex position, so that it applies to
/// every eye in a box.
#[derive(Clone, Debug, PartialEq)]
pub struct Frustum {
    /// The outward unit normals of the pyramid's sides.
    outwards: [DVec3; 4],
    count: usize,
}

impl Frustum {
    /// The frustum of a camera with the yaw and pitch of a [`Pose`](crate::motion::Pose). Its
    /// picture spans the angle `across` horizontally and `upright` vertically, in radians. An angle
    /// of π or more, or NaN, bounds nothing.
    pub fn new(yaw: f32, pitch: f32, across: f32, upright: f32) -> Self {
        let (sin_yaw, cos_yaw) = f64::from(yaw).sin_cos();
        let (sin_pitch, cos_pitch) = f64::from(pitch).sin_cos();
        let forward = DVec3::new(-sin_yaw * cos_pitch, sin_pitch, -cos_yaw * cos_pitch);
        let right = DVec3::new(cos_yaw, 0.0, -sin_yaw);
        let up = right.cross(forward);
        let mut frustum = Self { outwards: [DVec3::ZERO; 4], count: 0 };
        for (side, angle) in [(right, across), (up, upright)] {
            let (sine, cosine) = (f64::from(angle.max(0.0)) * 0.5).sin_cos();
            if forward.is_finite() && angle < std::f32::consts::PI {
                for side in [side, -side] {
                    frustum.outwards[frustum.count] = side * cosine - forward * sine;
                    frustum.count += 1;
                }
            }
        }
        debug_assert!(frustum.outwards().iter().all(|normal| normal.is_normalized()));
        frustum
    }

    /// The outward unit normals of the pyramid's sides, at most four. A direction is inside when
    /// its dot product with none of them is positive.
    pub fn outwards(&self) -> &[DVec3] {
        &self.outwards[..self.count]
    }

    /// Whether a direction of any length is inside or on the boundary.
    pub fn contains(&self, direction: Vec3) -> bool {
        self.outwards().iter().all(|outwards| outwards.dot(direction.as_dvec3()) <= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Pose;

    #[test]
    fn a_frustum_contains_directions_within_its_angles() {
        for i in 0..100 {
            let (yaw, pitch) = (i as f32 * 0.7, (i as f32 * 0.37).sin() * 1.4);
            let forward = Pose { yaw, pitch, ..Pose::default() }.forward();
            let right = Vec3::new(yaw.cos(), 0.0, -yaw.sin());
            let up = right.cross(forward);
            let frustum = Frustum::new(yaw, pitch, 1.6, 0.8);
            let check = |across: f32, upright: f32, expected: bool| {
                let direction = forward + right * across.tan() + up * upright.tan();
                assert_eq!(frustum.contains(direction * 3.0), expected, "{across}, {upright}");
                assert!(!frustum.contains(direction * -3.0));
            };
            for (across, upright) in [(0.79, 0.39), (-0.79, 0.39), (0.79, -0.39), (-0.79, -0.39)] {
                check(across, upright, true);
                check(across * 1.03, upright, false);
                check(across, upright * 1.06, false);
            }
        }
    }

    #[test]
    fn an_angle_too_wide_for_a_pyramid_bounds_nothing() {
        for wide in [3.2, 6.0, f32::INFINITY, f32::NAN] {
            assert_eq!(Frustum::new(1.0, 0.1, wide, wide).outwards(), []);
            assert_eq!(Frustum::new(1.0, 0.1, wide, 0.8).outwards().len(), 2);
        }
        assert_eq!(Frustum::new(f32::NAN, 0.1, 1.0, 1.0).outwards(), []);
    }
}
