//! Boxes in double precision.

use glam::DVec3;
use sightline_world::{geometry::Aabb, tolerance::ON_PLANE_F64_M};

use crate::HalfSpace;

/// An axis-aligned box in double precision, in metres and own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DAabb {
    /// The corner with the least coordinates.
    pub min: DVec3,
    /// The corner with the greatest coordinates.
    pub max: DVec3,
}

impl DAabb {
    /// A box, grown by a margin in metres on every side.
    pub fn around(region: &Aabb, margin: f64) -> Self {
        Self { min: region.min.as_dvec3() - margin, max: region.max.as_dvec3() + margin }
    }

    pub(super) fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub(super) fn contains(&self, other: &Self) -> bool {
        self.min.cmple(other.min).all() && other.max.cmple(self.max).all()
    }

    /// The corners. Bit `axis` of a corner's number says whether it is the upper one along the
    /// axis.
    pub(super) fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |axis: usize| [self.min[axis], self.max[axis]][i >> axis & 1];
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// The squared distance between the nearest points of two boxes.
    pub(super) fn distance_squared(&self, other: &Self) -> f64 {
        (other.min - self.max).max(self.min - other.max).max(DVec3::ZERO).length_squared()
    }

    /// Shrinks the box to the smallest one that holds its part in a half-space. False if there is
    /// no such part.
    pub(super) fn keep(&mut self, half: &HalfSpace) -> bool {
        debug_assert!(self.min.cmple(self.max).all(), "only boxes with points are cut");
        let nearest = (half.normal * self.min).min(half.normal * self.max);
        let slack = half.distance + ON_PLANE_F64_M - nearest.element_sum();
        if slack < 0.0 {
            return false;
        }
        for axis in 0..3 {
            let n = half.normal[axis];
            if n > 1e-12 {
                self.max[axis] = self.max[axis].min(self.min[axis] + slack / n);
            } else if n < -1e-12 {
                self.min[axis] = self.min[axis].max(self.max[axis] + slack / n);
            }
        }
        true
    }

    /// Whether some of the box is in a half-space.
    pub(super) fn meets(&self, half: &HalfSpace) -> bool {
        let nearest = (half.normal * self.min).min(half.normal * self.max);
        nearest.element_sum() <= half.distance + ON_PLANE_F64_M
    }
}
