//! Planes of polygons, and how they lie to the axes.

use glam::DVec3;

/// The points whose dot product with the normal is the distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// The normal, of unit length, towards the front. It is exactly an axis when the plane is axial
    /// to within the tolerance.
    pub normal: DVec3,
    /// The distance from the origin along the normal, in metres.
    pub distance: f64,
}

impl Plane {
    /// The plane of a triangle. A nearly axial plane becomes exactly axial, and a nearly upright
    /// one exactly upright.
    pub(super) fn through(triangle: &[DVec3; 3], normal: DVec3, near: f64) -> Self {
        let centre = triangle.iter().sum::<DVec3>() / 3.0;
        let [a, b, c] = *triangle;
        let size = a.max(b).max(c) - a.min(b).min(c);
        let n = normal.abs();
        let main = if n.x >= n.y && n.x >= n.z {
            0
        } else if n.y >= n.z {
            1
        } else {
            2
        };
        let mut normal = normal;
        if size[main] <= near && n[main] > 0.9 {
            normal = DVec3::AXES[main] * normal[main].signum();
        } else if n.y * size.y <= near && n.y < 0.01 {
            normal = normal.with_y(0.0).normalize_or_zero();
        }
        Self { normal, distance: normal.dot(centre) }
    }

    /// The axis to which the plane is exactly perpendicular, if any.
    pub fn axis(&self) -> Option<usize> {
        (0..3).find(|&axis| self.normal[axis].abs() == 1.0)
    }

    /// The distance of a point in front of the plane, in metres; negative behind it.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.distance
    }
}

/// How the plane of a polygon lies to the axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Facing {
    /// Perpendicular to an axis.
    Axis(usize),
    /// Upright, but perpendicular to no axis.
    Upright,
    /// Neither axial nor upright.
    Oblique,
}

impl Facing {
    pub(super) fn of(plane: &Plane) -> Self {
        match plane.axis() {
            Some(axis) => Self::Axis(axis),
            None if plane.normal.y.abs() < UPRIGHT => Self::Upright,
            None => Self::Oblique,
        }
    }
}

/// Whether a rectangle in this plane could have the edge, with sides parallel to axes or, in an
/// upright plane, level and upright. All other edges are non-axial edges (Lei and Ouhyoung 1999,
/// section 3). The paper also counts the level edges of turned walls as non-axial, but these would
/// make the carving volume of an arch in such a wall as large as the wall.
pub(super) fn is_regular(facing: Facing, along: DVec3, weld: f64) -> bool {
    let a = along.abs();
    let stray = match facing {
        Facing::Axis(0) => a.y.min(a.z),
        Facing::Axis(1) => a.x.min(a.z),
        Facing::Axis(_) => a.x.min(a.y),
        Facing::Upright => a.y.min(a.x.hypot(a.z)),
        Facing::Oblique => a.y.hypot(a.z).min(a.x.hypot(a.z)).min(a.x.hypot(a.y)),
    };
    // Corners split a slanted edge into short parts, none of which strays far.
    stray <= weld * 2.0 && (stray <= along.length() * 0.02 || along.length() <= weld * 10.0)
}

/// The normal of an upright plane rises by less than this.
const UPRIGHT: f64 = 1e-6;
