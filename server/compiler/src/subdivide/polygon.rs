//! The polygons of gates and portals, as the world has them.

use glam::{DVec2, DVec3};
use sightline_world::tolerance::{CLOSED_M, ON_PLANE_F32_M};
use sightline_world::{Polygon, geometry::Aabb};

use crate::split_plane::SplitPlane;

/// A convex polygon as the world has it: a rectangle where it is one. None when it is so narrow
/// that it counts as closed.
pub(super) fn polygon(cut: &SplitPlane, corners: &[DVec3]) -> Option<Polygon> {
    if corners.len() < 3 || width(corners) < CLOSED_M {
        return None;
    }
    let bounds = Aabb::from_points(corners.iter().map(|corner| corner.as_vec3()));
    if let SplitPlane::Axial { axis, .. } = *cut {
        let flat: Vec<DVec2> = corners.iter().map(|&corner| cut.flat(corner)).collect();
        let on_side = |&corner: &DVec2| {
            let (min, max) = (cut.flat(bounds.min.as_dvec3()), cut.flat(bounds.max.as_dvec3()));
            let is_near = |at: f64, side: f64| (at - side).abs() < ON_PLANE_F32_M;
            (0..2).all(|i| is_near(corner[i], min[i]) || is_near(corner[i], max[i]))
        };
        if flat.iter().all(on_side) {
            return Some(Polygon::Rectangle { axis: axis as u8, bounds });
        }
    }
    let corners = corners.iter().map(|corner| corner.as_vec3()).collect();
    Some(Polygon::Other { normal: cut.normal(), corners })
}

/// The width of a convex polygon: the least distance between two parallel lines around it, one of
/// them along an edge, in metres.
fn width(corners: &[DVec3]) -> f64 {
    let across = |i: usize| {
        let (from, to) = (corners[i], corners[(i + 1) % corners.len()]);
        let along = (to - from).try_normalize()?;
        let away = |&corner: &DVec3| (corner - from).reject_from_normalized(along).length();
        corners.iter().map(away).max_by(f64::total_cmp)
    };
    (0..corners.len()).filter_map(across).min_by(f64::total_cmp).unwrap_or(0.0)
}
