//! Light from a polygon, in closed form (Lambert 1760).

use arrayvec::ArrayVec;
use glam::Vec3;

/// The light at a point from a polygon of radiance 1, in front of the surface with this unit
/// normal. Corners are relative to the point, and those of a triangle or a quadrilateral. Divided
/// by π it is the form factor. It is negative when the corners go the other way around.
pub(super) fn irradiance_of_polygon(corners: &[Vec3], normal: Vec3) -> f32 {
    let above = clipped(corners, normal);
    let count = above.len();
    let sum: f32 = (0..count)
        .map(|i| {
            let (from, to) = (above[i], above[(i + 1) % count]);
            let across = from.cross(to);
            let length = across.length();
            // The angle, which is exact also when it is small.
            let angle = length.atan2(from.dot(to));
            if length > 0.0 { angle * across.dot(normal) / length } else { 0.0 }
        })
        .sum();
    0.5 * sum
}

/// The part of a polygon in front of a plane through the origin.
fn clipped(corners: &[Vec3], normal: Vec3) -> ArrayVec<Vec3, 5> {
    let mut above = ArrayVec::new();
    for (i, &to) in corners.iter().enumerate() {
        let from = corners[(i + corners.len() - 1) % corners.len()];
        let (low, high) = (normal.dot(from), normal.dot(to));
        if (low < 0.0) != (high < 0.0) {
            above.push(from + (to - from) * (low / (low - high)));
        }
        if high >= 0.0 {
            above.push(to);
        }
    }
    above
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;

    fn factor(corners: &[Vec3], normal: Vec3) -> f32 {
        (irradiance_of_polygon(corners, normal) / PI).abs()
    }

    #[test]
    fn a_rectangle_over_a_point_has_its_known_form_factor() {
        // A rectangle of a × b, one corner straight above the point, at height c (Howell's B-3).
        for [a, b, c] in [[1.0, 1.0, 1.0], [2.0, 0.5, 0.7], [0.1, 0.2, 3.0]] {
            let corners = [[0.0, 0.0], [a, 0.0], [a, b], [0.0, b]].map(|[x, y]| Vec3::new(x, y, c));
            let (x, y) = (a / c, b / c);
            let known = (x / (1.0 + x * x).sqrt() * (y / (1.0 + x * x).sqrt()).atan()
                + y / (1.0 + y * y).sqrt() * (x / (1.0 + y * y).sqrt()).atan())
                / (2.0 * PI);
            let found = factor(&corners, Vec3::Z);
            assert!((found - known).abs() < 1.0e-5, "{a} {b} {c}: {found}, not {known}");
        }
    }

    #[test]
    fn a_disc_over_a_point_has_its_known_form_factor() {
        let (radius, height, parts) = (0.8f32, 1.3f32, 720);
        let rim = |i: usize| {
            let (sine, cosine) = (i as f32 / parts as f32 * 2.0 * PI).sin_cos();
            Vec3::new(radius * cosine, radius * sine, height)
        };
        let middle = Vec3::Z * height;
        let found: f32 = (0..parts).map(|i| factor(&[middle, rim(i), rim(i + 1)], Vec3::Z)).sum();
        let known = radius * radius / (radius * radius + height * height);
        assert!((found - known).abs() < 1.0e-4, "{found}, not {known}");
    }

    #[test]
    fn what_is_below_the_horizon_gives_no_light() {
        let wall = |low: f32| {
            [[-1.0, low], [1.0, low], [1.0, 1.0], [-1.0, 1.0]].map(|[x, z]| Vec3::new(x, 2.0, z))
        };
        let (whole, above) = (factor(&wall(-3.0), Vec3::Z), factor(&wall(0.0), Vec3::Z));
        assert!((whole - above).abs() < 1.0e-6 && above > 0.0, "{whole} {above}");
        assert_eq!(factor(&wall(-3.0), -Vec3::Y), 0.0);
    }
}
