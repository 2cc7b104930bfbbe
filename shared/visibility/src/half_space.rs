//! Half-spaces: what the modules of this crate describe convex regions with.

use glam::{DVec3, Vec3};
use sightline_world::geometry::Aabb;

/// All points on one side of a plane, the plane included: those with `normal · p <= distance`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfSpace {
    /// The plane's normal, of unit length. It points out of the half-space.
    pub normal: DVec3,
    /// The distance of the plane from the origin along the normal, in metres.
    pub distance: f64,
}

/// Where a box lies relative to a region of space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Containment {
    /// No point of the box is in the region.
    Outside,
    /// Some points of the box may be in the region.
    Partial,
    /// Every point of the box is in the region.
    Inside,
}

impl HalfSpace {
    /// How far a point is outside, in metres; negative inside.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.distance
    }

    /// Whether a point is inside, or outside by no more than `tolerance`, in metres.
    pub fn holds(&self, point: Vec3, tolerance: f64) -> bool {
        self.normal.dot(point.as_dvec3()) <= self.distance + tolerance
    }

    /// Where a box lies relative to the half-space.
    pub fn containment(&self, region: &Aabb) -> Containment {
        let ahead = self.normal.dot(region.centre().as_dvec3()) - self.distance;
        let reach = self.normal.abs().dot(region.size().as_dvec3() * 0.5);
        if ahead > reach {
            Containment::Outside
        } else if ahead <= -reach {
            Containment::Inside
        } else {
            Containment::Partial
        }
    }

    /// The half-space with its plane moved outwards by a distance in metres.
    pub fn moved(&self, by: f64) -> Self {
        Self { distance: self.distance + by, ..*self }
    }

    /// One of the six half-spaces that bound a box. Numbers from 0 to 2 give the lower faces, along
    /// x, y and z, and those from 3 to 5 the upper faces.
    pub(crate) fn of_box(region: &Aabb, number: usize) -> Self {
        assert!(number < 6, "a box has six faces");
        let axis = number % 3;
        let normal = DVec3::AXES[axis];
        if number < 3 {
            Self { normal: -normal, distance: -f64::from(region.min[axis]) }
        } else {
            Self { normal, distance: f64::from(region.max[axis]) }
        }
    }
}
