//! The shapes of rooms.

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use super::{CORNERS_MAX, EXTENT_MAX, HULL_POINTS_MAX, is_sane};
use crate::geometry::Aabb;

/// A part of a room, in metres and the world's axes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Shape {
    /// An upright prism over a polygon of the plan. Without heights it is unbounded above and
    /// below.
    Plan {
        /// The x and z coordinates of the corners, in order around a simple polygon. It need not be
        /// convex.
        corners: Vec<Vec2>,
        /// The heights of the lower and the upper end, in metres.
        heights: Option<[f32; 2]>,
    },
    /// A box.
    Box(Aabb),
    /// The convex hull of some points.
    Hull(Vec<Vec3>),
}

impl Shape {
    /// Whether the shape has volume and all its coordinates are in range.
    pub(super) fn is_sane(&self) -> bool {
        match self {
            Self::Plan { corners, heights } => {
                let [low, high] = heights.unwrap_or([0.0, 1.0]);
                let counts = (3..=CORNERS_MAX).contains(&corners.len());
                let flat = corners.iter().map(|at| Vec3::new(at.x, 0.0, at.y));
                counts
                    && low < high
                    && is_sane(&flat.collect::<Vec<_>>())
                    && is_sane(&[Vec3::new(0.0, low, high)])
            }
            Self::Box(region) => is_sane(&region.corners()) && region.min.cmplt(region.max).all(),
            Self::Hull(points) => (4..=HULL_POINTS_MAX).contains(&points.len()) && is_sane(points),
        }
    }

    /// The smallest box around the shape. A plan without heights reaches from `-EXTENT_MAX` to
    /// `EXTENT_MAX`.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Plan { corners, heights } => {
                let [low, high] = heights.unwrap_or([-EXTENT_MAX, EXTENT_MAX]);
                let flat =
                    corners.iter().flat_map(|at| [low, high].map(|y| Vec3::new(at.x, y, at.y)));
                Aabb::from_points(flat)
            }
            Self::Box(region) => *region,
            Self::Hull(points) => Aabb::from_points(points.iter().copied()),
        }
    }
}
