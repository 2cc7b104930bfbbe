//! From half-spaces to the faces of a convex solid.

use glam::DVec3;
use sightline_world::tolerance::UNIT_F32;

use super::map::{Brush, Plane};

/// The farthest a brush reaches from the origin, in Quake units.
const REACH: f64 = 65_536.0;
/// A point this near a plane lies on it, in Quake units.
const ON_PLANE: f64 = 1.0 / 1024.0;
/// The least area of a face, in square units: a few square millimetres.
const AREA_MIN: f64 = 1.0 / 128.0;
/// Vertices nearly on a lattice are moved onto it. It has this many points per unit.
const LATTICE: f64 = 64.0;
const LATTICE_TOLERANCE: f64 = 1.0 / 256.0;

/// The faces of a brush, in Quake units: convex polygons, each with its plane. `None` when the
/// brush is unbounded or not finite.
pub(super) fn faces(brush: &Brush) -> Option<Vec<(Plane, Vec<DVec3>)>> {
    let planes = distinct(&brush.planes);
    let mut faces = Vec::with_capacity(planes.len());
    for (i, plane) in planes.iter().enumerate() {
        let others = planes.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, other)| other);
        let mut winding = others.fold(whole(plane)?, |winding, other| clipped(&winding, other));
        snap(&mut winding, &planes);
        winding.dedup();
        while winding.len() > 1 && winding.first() == winding.last() {
            winding.pop();
        }
        // A bevel plane touches the brush along an edge only.
        if area(&winding) < AREA_MIN {
            continue;
        }
        if !winding.iter().all(|p| p.abs().max_element() < REACH) {
            return None;
        }
        faces.push((*plane, winding));
    }
    Some(faces)
}

/// The planes without duplicates.
fn distinct(planes: &[Plane]) -> Vec<Plane> {
    let mut distinct: Vec<Plane> = Vec::with_capacity(planes.len());
    for plane in planes {
        if !distinct.contains(plane) {
            distinct.push(*plane);
        }
    }
    distinct
}

/// The axis to which a plane is perpendicular, where it crosses the axis, and whether it faces
/// along it.
fn axial(plane: &Plane) -> Option<(usize, f64, bool)> {
    let axis = (0..3).find(|&axis| plane.normal[axis].abs() == 1.0)?;
    let others = (0..3).filter(|&other| other != axis);
    let positive = plane.normal[axis] > 0.0;
    others.into_iter().all(|other| plane.normal[other] == 0.0).then_some((
        axis,
        plane.distance * plane.normal[axis],
        positive,
    ))
}

/// A square on a plane, larger than any map. `None` when the plane is invalid.
fn whole(plane: &Plane) -> Option<Vec<DVec3>> {
    let normal = plane.normal;
    let is_unit = (normal.length_squared() - 1.0).abs() < UNIT_F32;
    if !is_unit || !plane.distance.is_finite() {
        return None;
    }
    if let Some((axis, at, _)) = axial(plane) {
        let corner = |u: f64, v: f64| {
            let mut corner = DVec3::splat(at);
            corner[(axis + 1) % 3] = u * 2.0 * REACH;
            corner[(axis + 2) % 3] = v * 2.0 * REACH;
            corner
        };
        return Some(vec![
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ]);
    }
    let normal = normal.normalize();
    let centre = normal * plane.distance;
    let (u, v) = normal.any_orthonormal_pair();
    let (u, v) = (u * 2.0 * REACH, v * 2.0 * REACH);
    Some(vec![centre - u - v, centre + u - v, centre + u + v, centre - u + v])
}

/// The part of a convex polygon within a half-space.
fn clipped(winding: &[DVec3], plane: &Plane) -> Vec<DVec3> {
    let height = |p: DVec3| plane.normal.dot(p) - plane.distance;
    let mut kept = Vec::with_capacity(winding.len() + 1);
    for (i, &from) in winding.iter().enumerate() {
        let to = winding[(i + 1) % winding.len()];
        let (above, next) = (height(from), height(to));
        if above <= ON_PLANE {
            kept.push(from);
        }
        let crosses =
            (above < -ON_PLANE && next > ON_PLANE) || (above > ON_PLANE && next < -ON_PLANE);
        if crosses {
            kept.push(crossing(from, to, above / (above - next), plane));
        }
    }
    kept
}

/// A point between two others, exactly on the plane when the plane is axial.
fn crossing(from: DVec3, to: DVec3, share: f64, plane: &Plane) -> DVec3 {
    let mut point = from + (to - from) * share;
    if let Some((axis, at, _)) = axial(plane) {
        point[axis] = at;
    }
    point
}

/// Moves vertices that are nearly on the lattice onto it, so that those of neighbouring brushes
/// coincide. No vertex leaves an axial plane of the brush.
fn snap(winding: &mut [DVec3], planes: &[Plane]) {
    let levels: Vec<(usize, f64)> =
        planes.iter().filter_map(axial).map(|(axis, at, _)| (axis, at)).collect();
    for point in winding {
        for axis in 0..3 {
            let value = point[axis];
            let lattice = (value * LATTICE).round() / LATTICE;
            let is_exact = levels.contains(&(axis, value));
            if !is_exact && (value - lattice).abs() < LATTICE_TOLERANCE {
                point[axis] = lattice;
            }
        }
    }
}

/// The area of a convex polygon, in square units.
fn area(winding: &[DVec3]) -> f64 {
    let from = |i: usize| winding[i] - winding[0];
    let fan = (2..winding.len()).map(|i| from(i - 1).cross(from(i)));
    fan.sum::<DVec3>().length() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(normal: [f64; 3], distance: f64) -> Plane {
        Plane { normal: DVec3::from(normal), distance }
    }

    fn box_planes() -> Vec<Plane> {
        vec![
            plane([1.0, 0.0, 0.0], 8.3),
            plane([-1.0, 0.0, 0.0], 8.0),
            plane([0.0, 1.0, 0.0], 16.0),
            plane([0.0, -1.0, 0.0], 16.0),
            plane([0.0, 0.0, 1.0], 100.0),
            plane([0.0, 0.0, -1.0], -50.0),
        ]
    }

    #[test]
    fn six_axial_sides_make_a_box_with_exact_corners() {
        let faces = faces(&Brush { planes: box_planes(), sides: Vec::new(), shader: 0 }).unwrap();
        let [min, max] = [DVec3::new(-8.0, -16.0, 50.0), DVec3::new(8.3, 16.0, 100.0)];
        assert_eq!(faces.len(), 6);
        for point in faces.iter().flat_map(|(_, winding)| winding) {
            assert!((0..3).all(|a| point[a] == min[a] || point[a] == max[a]), "{point}");
        }
    }

    #[test]
    fn a_bevel_that_only_touches_leaves_a_box() {
        let mut planes = box_planes();
        let diagonal = 0.5f64.sqrt();
        planes.push(plane([diagonal, diagonal, 0.0], (8.3 + 16.0) * diagonal));
        planes.push(planes[0]);
        let faces = faces(&Brush { planes, sides: Vec::new(), shader: 0 }).unwrap();
        assert_eq!(faces.len(), 6);
    }

    #[test]
    fn a_cut_corner_makes_a_seventh_face() {
        let mut planes = box_planes();
        let diagonal = 0.5f64.sqrt();
        planes.push(plane([diagonal, diagonal, 0.0], 20.3 * diagonal));
        let faces = faces(&Brush { planes, sides: Vec::new(), shader: 0 }).unwrap();
        assert_eq!(faces.len(), 7);
        // The cut takes 4 × 4 off two of the sides: its own area is 50 × √32.
        let expected =
            2.0 * (16.3 * 32.0 - 8.0) + 50.0 * (16.3 + 32.0 + 12.3 + 28.0 + 32f64.sqrt());
        let total: f64 = faces.iter().map(|(_, w)| area(w)).sum();
        assert!((total - expected).abs() < 0.1, "{total} {expected}");
    }

    #[test]
    fn unbounded_empty_and_invalid_brushes_have_no_faces() {
        let brush = |planes| Brush { planes, sides: Vec::new(), shader: 0 };
        assert!(faces(&brush(box_planes()[..5].to_vec())).is_none());
        assert!(faces(&brush(vec![plane([f64::NAN; 3], 1.0)])).is_none());
        assert!(faces(&brush(vec![plane([0.0; 3], 1.0)])).is_none());
        let mut apart = box_planes();
        apart[0].distance = -9.0;
        assert!(faces(&brush(apart)).unwrap().is_empty());
    }
}
