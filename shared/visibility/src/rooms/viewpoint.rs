//! Boxes of eyes and their fields of view.

use glam::DVec3;
use sightline_world::geometry::{Aabb, Axes, Frustum};

use crate::HalfSpace;

/// A box of eyes and their field of view, in own axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    /// The box of eyes, which may be a point.
    pub eyes: Aabb,
    /// The normals of the sides of the field of view, which point out of it. Empty if eyes look all
    /// round.
    outwards: Vec<DVec3>,
}

impl Viewpoint {
    /// Eyes that look all round.
    pub fn all_round(eyes: Aabb) -> Self {
        Self { eyes, outwards: Vec::new() }
    }

    /// Eyes that see what is in a field of view. The field is given in the world's axes.
    pub fn looking(eyes: Aabb, field: &Frustum, axes: &Axes) -> Self {
        Self { eyes, outwards: field.outwards().iter().map(|side| axes.own_exact(*side)).collect() }
    }

    /// Half-spaces that hold the fields of view of all eyes.
    pub fn field(&self) -> impl Iterator<Item = HalfSpace> + '_ {
        self.outwards.iter().map(|normal| {
            let most = self.eyes.corners().into_iter().map(|eye| normal.dot(eye.as_dvec3()));
            HalfSpace { normal: *normal, distance: most.fold(f64::NEG_INFINITY, f64::max) }
        })
    }
}
