//! Axis-aligned boxes in vector registers.

use glam::Vec3A;
use sightline_world::geometry::Aabb;

/// An axis-aligned box in vector registers, in metres and own axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct SimdBox {
    pub low: Vec3A,
    pub high: Vec3A,
}

impl SimdBox {
    pub(super) fn new(region: &Aabb) -> Self {
        Self { low: region.min.into(), high: region.max.into() }
    }

    pub(super) fn union(&self, other: &Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    pub(super) fn holds(&self, other: &Self) -> bool {
        (self.low.cmple(other.low) & self.high.cmpge(other.high)).all()
    }
}
