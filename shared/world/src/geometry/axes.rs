//! A building's own axes, along which most walls run.

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::Aabb;

/// The axes along which the walls of a building run: the world's, turned about the vertical.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Axes {
    /// The turn from the world's x axis towards its z axis, in radians.
    turn: f64,
    sine: f64,
    cosine: f64,
}

impl Default for Axes {
    fn default() -> Self {
        Self::WORLD
    }
}

impl Axes {
    /// The world's axes.
    pub const WORLD: Self = Self { turn: 0.0, sine: 0.0, cosine: 1.0 };

    /// The world's axes turned about the vertical, from x towards z, in radians.
    pub fn turned(turn: f64) -> Self {
        debug_assert!(turn.is_finite(), "axes turned by {turn}");
        let (sine, cosine) = if turn == 0.0 { (0.0, 1.0) } else { turn.sin_cos() };
        Self { turn, sine, cosine }
    }

    /// The turn from the world's x axis towards its z axis, in radians.
    pub fn turn(&self) -> f64 {
        self.turn
    }

    /// Transforms a point from the world's axes to these.
    pub fn own(&self, point: Vec3) -> Vec3 {
        if self.turn == 0.0 { point } else { self.own_exact(point.as_dvec3()).as_vec3() }
    }

    /// Transforms a point from the world's axes to these, in double precision.
    pub fn own_exact(&self, point: DVec3) -> DVec3 {
        let (s, c) = (self.sine, self.cosine);
        DVec3::new(c * point.x + s * point.z, point.y, c * point.z - s * point.x)
    }

    /// Transforms a point from these axes to the world's.
    pub fn world(&self, point: Vec3) -> Vec3 {
        if self.turn == 0.0 {
            return point;
        }
        let (p, s, c) = (point.as_dvec3(), self.sine, self.cosine);
        DVec3::new(c * p.x - s * p.z, p.y, s * p.x + c * p.z).as_vec3()
    }

    /// The smallest box along these axes around a box along the world's.
    pub fn own_box(&self, region: &Aabb) -> Aabb {
        self.mapped(region, |corner| self.own(corner))
    }

    /// The smallest box along the world's axes around a box along these.
    pub fn world_box(&self, region: &Aabb) -> Aabb {
        self.mapped(region, |corner| self.world(corner))
    }

    /// The width of the smallest square along these axes around a unit square along the world's.
    pub fn widening(&self) -> f32 {
        (self.sine.abs() + self.cosine.abs()) as f32
    }

    fn mapped(&self, region: &Aabb, map: impl Fn(Vec3) -> Vec3) -> Aabb {
        if self.turn == 0.0 || region.is_empty() {
            return *region;
        }
        Aabb::from_points(region.corners().map(map))
    }
}
