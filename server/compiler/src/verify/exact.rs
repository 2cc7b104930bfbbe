//! Whether a line is free, in double precision. This decides before a pair is called a miss.
//!
//! Rays through triangles are in single precision. A line may slip by rounding through the seam of
//! two brushes, or begin so near a wall that it seems to begin behind it. Then rays see what nobody
//! can see. So a miss must also be free here:
//!
//! * No brush, ten micrometres larger, holds more than a tenth of a millimetre of the line. The
//!   growth closes the seams between brushes whose planes were rounded apart. The tenth of a
//!   millimetre lets a line touch an edge. A true sight line that this denies squeezes through a
//!   gap of twenty micrometres, or grazes a wall along its length; its neighbours are tested.
//! * The line crosses no triangle, and neither end is within a tenth of a millimetre of one. So
//!   near a triangle, rounding decides on which side the line begins.

use glam::DVec3;
use sightline_world::tolerance::{BRUSH_CORNER_M, BRUSH_GROWTH_M, EYE_CLEARANCE_M, GRAZE_M};
use sightline_world::{Mesh, Origin, Solid, geometry::Aabb};

/// Whether nothing lies between two points, and nothing at either end.
pub(super) fn is_free(mesh: &Mesh, origin: Option<&Origin>, from: DVec3, to: DVec3) -> bool {
    let around = Aabb::from_points([from.as_vec3(), to.as_vec3()]).grown(BRUSH_CORNER_M);
    let is_held = |origin: &Origin| {
        let near = origin.solids.iter().filter(|solid| solid.bounds.intersects(&around));
        near.into_iter().any(|solid| length_inside(origin, solid, from, to) > GRAZE_M)
    };
    if origin.is_some_and(is_held) {
        return false;
    }
    mesh.triangles.iter().all(|triangle| {
        let corners = triangle.map(|corner| mesh.positions[corner as usize]);
        if !Aabb::from_points(corners).intersects(&around) {
            return true;
        }
        let corners = corners.map(|corner| corner.as_dvec3());
        let is_near = |point| distance(corners, point) < EYE_CLEARANCE_M;
        !(crosses(corners, from, to) || is_near(from) || is_near(to))
    })
}

/// The length of a line inside a brush that is [`BRUSH_GROWTH_M`] larger, in metres.
fn length_inside(origin: &Origin, solid: &Solid, from: DVec3, to: DVec3) -> f64 {
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for side in origin.sides(solid) {
        let (begin, end) = (side.height(from) - BRUSH_GROWTH_M, side.height(to) - BRUSH_GROWTH_M);
        match (begin > 0.0, end > 0.0) {
            (true, true) => return 0.0,
            (true, false) => enter = enter.max(begin / (begin - end)),
            (false, true) => leave = leave.min(begin / (begin - end)),
            (false, false) => {}
        }
    }
    (leave - enter).max(0.0) * from.distance(to)
}

/// Whether a line meets a triangle, its edges included.
fn crosses([a, b, c]: [DVec3; 3], from: DVec3, to: DVec3) -> bool {
    let along = to - from;
    let normal = (b - a).cross(c - a);
    let slope = along.dot(normal);
    if slope == 0.0 {
        return false;
    }
    let share = (a - from).dot(normal) / slope;
    if !(0.0..=1.0).contains(&share) {
        return false;
    }
    // The line passes all edges on the same side, whichever way the triangle faces.
    let side = |p: DVec3, q: DVec3| along.dot((p - from).cross(q - from));
    let sides = [side(a, b), side(b, c), side(c, a)];
    sides.iter().all(|&s| s >= 0.0) || sides.iter().all(|&s| s <= 0.0)
}

/// The distance of a point from a triangle, in metres.
fn distance([a, b, c]: [DVec3; 3], point: DVec3) -> f64 {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let height = (point - a).dot(normal);
    let foot = point - normal * height;
    let is_over =
        [(a, b), (b, c), (c, a)].iter().all(|&(p, q)| (q - p).cross(foot - p).dot(normal) >= 0.0);
    if is_over && normal != DVec3::ZERO {
        return height.abs();
    }
    let edges = [(a, b), (b, c), (c, a)].map(|(p, q)| {
        let along = q - p;
        let share = (point - p).dot(along) / along.length_squared().max(f64::MIN_POSITIVE);
        point.distance(p + along * share.clamp(0.0, 1.0))
    });
    edges.into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sightline_world::OriginPlane;

    use super::*;

    fn triangle() -> Mesh {
        Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]] }
    }

    fn v(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }

    #[test]
    fn a_triangle_blocks_what_crosses_it_and_what_ends_at_it() {
        let check = |from, to, free| {
            assert_eq!(is_free(&triangle(), None, from, to), free, "{from} {to}");
            assert_eq!(is_free(&triangle(), None, to, from), free, "{to} {from}");
        };
        check(v(0.2, 0.2, 1.0), v(0.3, 0.3, -1.0), false);
        check(v(0.8, 0.8, 1.0), v(0.8, 0.8, -1.0), true);
        check(v(0.2, 0.2, 1.0), v(0.2, 0.2, 2e-4), true);
        check(v(0.2, 0.2, 1.0), v(0.2, 0.2, 5e-5), false);
        check(v(-5e-5, 0.5, 0.0), v(-1.0, 0.5, 0.0), false);
        check(v(-2e-4, 0.5, 0.0), v(-1.0, 0.5, 0.0), true);
        // Along the diagonal edge, exactly.
        check(v(0.5, 0.5, 1.0), v(0.5, 0.5, -1.0), false);
    }

    #[test]
    fn a_brush_blocks_what_runs_inside_it_and_seams_are_closed() {
        let plane = |normal, distance| OriginPlane { normal, distance };
        // Two slabs side by side, five micrometres apart.
        let planes = vec![
            plane(Vec3::X, 1.0),
            plane(Vec3::NEG_X, 0.0),
            plane(Vec3::X, 2.0),
            plane(Vec3::NEG_X, -1.000_005),
            plane(Vec3::Y, 1.0),
            plane(Vec3::NEG_Y, 0.0),
        ];
        let bounds = Aabb::new(Vec3::new(0.0, 0.0, -9.0), Vec3::new(2.0, 1.0, 9.0));
        let solid = |sides| Solid { bounds, sides };
        let solids = vec![solid(vec![0, 1, 4, 5]), solid(vec![2, 3, 4, 5])];
        let origin = Origin { planes, solids, tree: None };
        let check = |from, to, free| {
            assert_eq!(is_free(&Mesh::default(), Some(&origin), from, to), free, "{from} {to}");
        };
        check(v(0.5, -1.0, 0.0), v(0.5, 2.0, 0.0), false);
        check(v(1.000_002, -1.0, 0.0), v(1.000_002, 2.0, 0.0), false);
        check(v(-0.5, -1.0, 0.0), v(-0.5, 2.0, 0.0), true);
        // Over the edge, touching it.
        check(v(-1.0, 0.0, 0.0), v(1.0, 2.0 - 1e-6, 0.0), true);
        check(v(-1.0, 0.0, 0.0), v(1.0, 1.9, 0.0), false);
    }
}
