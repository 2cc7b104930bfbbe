//! From opaque triangles to the planes that they lie in.

use std::collections::HashMap;

use glam::{DVec2, DVec3};
use sightline_world::tolerance::AXIAL_PLANE_M;

use super::{
    plane::OccluderPlane,
    rectangle::{PlaneTriangle, anticlockwise},
};
use crate::split_plane::{SplitPlane, in_plane};

/// An opaque triangle, in the building's own axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OccluderTriangle {
    /// The corners, in metres.
    pub corners: [DVec3; 3],
    /// Whether space is split along it only when nothing else is left to split along.
    pub is_last: bool,
}

/// Groups opaque triangles, in the building's own axes, by plane. Axial planes come first, by axis
/// and then ascending; other vertical planes follow.
///
/// First, corners next to an axial plane are moved onto it, by at most [`AXIAL_PLANE_M`]. So walls
/// that meet in the model but for rounding leave no gap.
pub(crate) fn planes(opaque: &[OccluderTriangle]) -> Vec<OccluderPlane> {
    let levels = [0, 1, 2].map(|axis| {
        let planes = planes_along(axis, opaque);
        planes.iter().map(|plane| -plane.cut.height(DVec3::ZERO)).collect::<Vec<f64>>()
    });
    let snapped = |mut corner: DVec3| {
        for (axis, levels) in levels.iter().enumerate() {
            let above = levels.partition_point(|&level| level < corner[axis]);
            let near = levels[above.saturating_sub(1)..].iter().take(2);
            let away = |level: &&f64| (**level - corner[axis]).abs();
            if let Some(&level) = near.min_by(|a, b| away(a).total_cmp(&away(b)))
                && (level - corner[axis]).abs() <= AXIAL_PLANE_M
            {
                corner[axis] = level;
            }
        }
        corner
    };
    let snapped = |&OccluderTriangle { corners, is_last }: &OccluderTriangle| OccluderTriangle {
        corners: corners.map(snapped),
        is_last,
    };
    let opaque: Vec<OccluderTriangle> = opaque.iter().map(snapped).collect();
    let opaque = &opaque;
    let mut planes: Vec<_> = (0..3).flat_map(|axis| planes_along(axis, opaque)).collect();
    planes.extend(slanted(opaque));
    planes
}

/// Whether three coordinates differ by rounding only.
fn agree(along: [f64; 3]) -> bool {
    let low = along.into_iter().fold(f64::INFINITY, f64::min);
    along.into_iter().all(|c| c - low <= AXIAL_PLANE_M)
}

/// The planes perpendicular to one axis.
fn planes_along(axis: usize, opaque: &[OccluderTriangle]) -> Vec<OccluderPlane> {
    let mut axial: Vec<(f64, (PlaneTriangle, bool))> = opaque
        .iter()
        .filter(|opaque| agree(opaque.corners.map(|c| c[axis])))
        .filter_map(|OccluderTriangle { corners, is_last }| {
            let low = corners.iter().fold(f64::INFINITY, |low, c| low.min(c[axis]));
            Some((low, (anticlockwise(corners.map(|c| in_plane(c, axis)))?, *is_last)))
        })
        .collect();
    // The sort is stable: triangles of one plane keep the order of the model.
    axial.sort_by(|a, b| a.0.total_cmp(&b.0));
    axial
        .chunk_by(|a, b| b.0 - a.0 <= AXIAL_PLANE_M)
        .flat_map(|near| split_wide(near))
        .map(|near| {
            let triangles = near.iter().map(|&(_, triangle)| triangle);
            OccluderPlane::new(SplitPlane::Axial { axis, at: near[0].0 as f32 }, triangles)
        })
        .collect()
}

/// The other vertical planes, in the order of the model.
fn slanted(opaque: &[OccluderTriangle]) -> Vec<OccluderPlane> {
    /// The steps of distance (metres) and direction (radians) by which similar planes are found.
    const STEP: [f64; 2] = [1.0, 0.01];
    let mut found: Vec<(SplitPlane, Vec<(PlaneTriangle, bool)>)> = Vec::new();
    let mut alike: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
    for OccluderTriangle { corners, is_last } in opaque {
        let Some(cut) = vertical(corners) else { continue };
        let normal = cut.normal();
        let key = [-cut.height(DVec3::ZERO), normal.x.atan2(normal.z)];
        let key = [0, 1].map(|i| (key[i] / STEP[i]).floor() as i64);
        let near = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [key[0] + i, key[1] + j]));
        let fits = |&&index: &&usize| {
            let (other, _): &(SplitPlane, _) = &found[index];
            corners.iter().all(|&corner| other.height(corner).abs() <= AXIAL_PLANE_M)
        };
        let known = near.filter_map(|key| alike.get(&key)).flatten().find(fits).copied();
        let index = known.unwrap_or_else(|| {
            alike.entry(key).or_default().push(found.len());
            found.push((cut, Vec::new()));
            found.len() - 1
        });
        let (cut, triangles) = &mut found[index];
        let triangle = anticlockwise(corners.map(|corner| cut.flat(corner)));
        triangles.extend(triangle.map(|triangle| (triangle, *is_last)));
    }
    found
        .into_iter()
        .map(|(cut, triangles)| OccluderPlane::new(cut, triangles.into_iter()))
        .collect()
}

/// The vertical plane of a triangle. None when the plane is axial or not vertical, or the triangle
/// has no area.
fn vertical(corners: &[DVec3; 3]) -> Option<SplitPlane> {
    let [a, b, c] = *corners;
    if (0..3).any(|axis| agree(corners.map(|corner| corner[axis]))) {
        return None;
    }
    // The longest edge gives the direction with the least error.
    let edges = [b - a, c - b, a - c].map(|edge| DVec2::new(edge.x, edge.z));
    let along = edges.into_iter().max_by(|a, b| a.length().total_cmp(&b.length()))?;
    let across = DVec3::new(-along.y, 0.0, along.x).try_normalize()?;
    let across = if across.x < 0.0 { -across } else { across };
    let distance = across.dot((a + b + c) / 3.0);
    let cut = SplitPlane::Plane { normal: across, distance };
    corners.iter().all(|&corner| cut.height(corner).abs() <= AXIAL_PLANE_M).then_some(cut)
}

/// Splits a chain of planes, each within the tolerance of the next, where it is wider than the
/// tolerance.
fn split_wide<T>(mut near: &[(f64, T)]) -> Vec<&[(f64, T)]> {
    let mut parts = Vec::new();
    while let Some(first) = near.first() {
        let end = near.partition_point(|(at, _)| at - first.0 <= AXIAL_PLANE_M);
        let (part, rest) = near.split_at(end);
        parts.push(part);
        near = rest;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_within_the_tolerance_are_one_and_others_are_not() {
        let flat = |y: f64, tilt: f64| {
            let corners =
                [DVec3::new(0.0, y, 0.0), DVec3::new(1.0, y + tilt, 0.0), DVec3::new(0.0, y, 1.0)];
            OccluderTriangle { corners, is_last: false }
        };
        let near = planes(&[flat(1.0, 0.0), flat(1.00002, 0.0), flat(1.0, 0.00002)]);
        assert_eq!(near.len(), 1);
        assert_eq!(near[0].cut, SplitPlane::Axial { axis: 1, at: 1.0 });
        assert_eq!(near[0].triangles.len(), 3);
        assert_eq!(planes(&[flat(1.0, 0.0), flat(1.001, 0.0), flat(1.0, 0.001)]).len(), 2);
    }
}
