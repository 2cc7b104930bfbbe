//! Planes of polygons, and how they lie to the axes.

use glam::DVec3;

/// Points whose product with the normal is the distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Of unit length, towards the front. Of what is axial to within the tolerance, it is exactly
    /// an axis.
    pub normal: DVec3,
    /// From the origin along the normal, in metres.
    pub distance: f64,
}

impl Plane {
    /// The plane of a triangle; across an axis, or upright, exactly, when it is nearly so.
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

    /// The axis that it is exactly across, if any.
    pub fn axis(&self) -> Option<usize> {
        (0..3).find(|&axis| self.normal[axis].abs() == 1.0)
    }

    /// How far before the plane a point is, in metres; negative behind.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.distance
    }
}

/// How a polygon's plane lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Facing {
    /// Across an axis.
    Axis(usize),
    /// Upright, but across no axis.
    Upright,
    Oblique,
}

impl Facing {
    pub fn of(plane: &Plane) -> Self {
        match plane.axis() {
            Some(axis) => Self::Axis(axis),
            None if plane.normal.y.abs() < UPRIGHT => Self::Upright,
            None => Self::Oblique,
        }
    }
}

/// Whether an edge is such as a rectangle in this plane could have whose sides are parallel to
/// axes or, upright, to the floor and to the vertical. All others are what the paper calls
/// non-axial edges; it counts the level edges of turned walls with them, but these would make the
/// carving volume of an arch in such a wall as large as the wall.
pub(super) fn is_regular(facing: Facing, along: DVec3, weld: f64) -> bool {
    let a = along.abs();
    let stray = match facing {
        Facing::Axis(0) => a.y.min(a.z),
        Facing::Axis(1) => a.x.min(a.z),
        Facing::Axis(_) => a.x.min(a.y),
        Facing::Upright => a.y.min(a.x.hypot(a.z)),
        Facing::Oblique => a.y.hypot(a.z).min(a.x.hypot(a.z)).min(a.x.hypot(a.y)),
    };
    // Of the short parts into which corners split a slanted edge, none strays far.
    stray <= weld * 2.0 && (stray <= along.length() * 0.02 || along.length() <= weld * 10.0)
}

/// The normal of what stands upright rises by less than this.
const UPRIGHT: f64 = 1e-6;
