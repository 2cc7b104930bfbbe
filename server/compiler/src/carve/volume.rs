//! The carving volume, and the split of triangles by it: ComputeAoutB (Lei and Ouhyoung 1999,
//! section 4.2.1).

use glam::DVec3;

use super::{classes::is_irregular, polygons::Polygons};

/// The corners of a triangle.
pub(super) type Triangle = [DVec3; 3];

/// A carving volume: the box of the non-axial edges of a unit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Volume {
    pub min: DVec3,
    pub max: DVec3,
    /// A point this near a side lies on it, in metres.
    pub near: f64,
}

impl Volume {
    pub(super) fn of(polygons: &Polygons, unit: &[u32]) -> Self {
        let near = polygons.tolerance.plane;
        let empty = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY, near };
        unit.iter()
            .flat_map(|&polygon| polygons.borders_of(polygon))
            .filter(|border| is_irregular(polygons, border))
            .flat_map(|border| polygons.segment(border))
            .fold(empty, |v, p| Self { min: v.min.min(p), max: v.max.max(p), near })
    }

    /// Whether a segment meets the volume, boundary and tolerance included.
    pub(super) fn meets(&self, [from, to]: [DVec3; 2]) -> bool {
        let along = to - from;
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        for axis in 0..3 {
            let (low, high) = (self.min[axis] - self.near, self.max[axis] + self.near);
            if along[axis].abs() < 1e-12 {
                if from[axis] < low || from[axis] > high {
                    return false;
                }
                continue;
            }
            let (a, b) = ((low - from[axis]) / along[axis], (high - from[axis]) / along[axis]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter <= leave
    }

    /// Adds the parts of a triangle outside the volume, and the part inside or on its boundary.
    pub(super) fn split(
        &self,
        triangle: &Triangle,
        outside: &mut Vec<Triangle>,
        inside: &mut Vec<Triangle>,
    ) {
        let mut left = triangle.to_vec();
        for axis in 0..3 {
            for (at, sign) in [(self.min[axis], 1.0), (self.max[axis], -1.0)] {
                let height = |p: &DVec3| (p[axis] - at) * sign;
                if left.iter().all(|p| height(p) >= -self.near) {
                    continue;
                }
                if left.iter().all(|p| height(p) <= self.near) {
                    fan(&left, outside);
                    return;
                }
                let (within, beyond) = cut(&left, height);
                fan(&beyond, outside);
                left = within;
            }
        }
        fan(&left, inside);
    }
}

/// The parts of a convex polygon where a height is positive, and where it is negative.
fn cut(polygon: &[DVec3], height: impl Fn(&DVec3) -> f64) -> (Vec<DVec3>, Vec<DVec3>) {
    let (mut above, mut below) = (Vec::new(), Vec::new());
    for (i, &from) in polygon.iter().enumerate() {
        let to = polygon[(i + 1) % polygon.len()];
        let (a, b) = (height(&from), height(&to));
        if a >= 0.0 {
            above.push(from);
        }
        if a <= 0.0 {
            below.push(from);
        }
        if a * b < 0.0 {
            let crossing = from.lerp(to, a / (a - b));
            above.push(crossing);
            below.push(crossing);
        }
    }
    (above, below)
}

/// Adds the triangles of a convex polygon.
fn fan(polygon: &[DVec3], triangles: &mut Vec<Triangle>) {
    for i in 2..polygon.len() {
        triangles.push([polygon[0], polygon[i - 1], polygon[i]]);
    }
}

/// The area of triangles, in square metres.
pub(super) fn area(triangles: &[Triangle]) -> f64 {
    triangles.iter().map(|[a, b, c]| (b - a).cross(c - a).length() * 0.5).sum()
}
