//! Planes along which space is split, and coordinates within them.

use glam::{DVec2, DVec3};

/// A plane to split along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SplitPlane {
    /// The points where one coordinate has a value.
    Axial {
        /// The coordinate: 0, 1 or 2.
        axis: usize,
        /// The value, in metres.
        at: f32,
    },
    /// The points where `normal · point = distance`.
    Plane {
        /// The normal, of unit length.
        normal: DVec3,
        /// The distance from the origin, in metres.
        distance: f64,
    },
}

impl SplitPlane {
    /// The distance of a point from the plane, in metres; negative on the lesser side.
    pub(crate) fn height(&self, point: DVec3) -> f64 {
        match *self {
            Self::Axial { axis, at } => point[axis] - f64::from(at),
            Self::Plane { normal, distance } => normal.dot(point) - distance,
        }
    }

    /// The normal towards the greater side, of unit length.
    pub(crate) fn normal(&self) -> DVec3 {
        match *self {
            Self::Axial { axis, .. } => DVec3::AXES[axis],
            Self::Plane { normal, .. } => normal,
        }
    }

    /// The coordinates of a point within the plane: the two other axes of an axial plane, or along
    /// the horizontal and up in a vertical one.
    pub(crate) fn flat(&self, point: DVec3) -> DVec2 {
        match *self {
            Self::Axial { axis, .. } => in_plane(point, axis),
            Self::Plane { normal, .. } => {
                DVec2::new(normal.z * point.x - normal.x * point.z, point.y)
            }
        }
    }

    /// The point of the plane at these coordinates.
    pub(crate) fn upright(&self, point: DVec2) -> DVec3 {
        match *self {
            Self::Axial { axis, at } => {
                let (u, v) = other_axes(axis);
                let mut place = DVec3::splat(f64::from(at));
                (place[u], place[v]) = (point.x, point.y);
                place
            }
            Self::Plane { normal: n, distance } => {
                DVec3::new(n.z * point.x, point.y, -n.x * point.x) + n * distance
            }
        }
    }
}

/// The two other coordinates of a point, in ascending order of axis.
pub(crate) fn in_plane(point: DVec3, axis: usize) -> DVec2 {
    let (u, v) = other_axes(axis);
    DVec2::new(point[u], point[v])
}

/// The two other axes, in ascending order.
pub(crate) fn other_axes(axis: usize) -> (usize, usize) {
    match axis {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    }
}
