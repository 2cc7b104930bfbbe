//! Directions and places that are spread evenly, without random numbers.

use std::f32::consts::TAU;

use glam::Vec3;

const GOLDEN: f32 = 0.618_034;

/// The `i`th of `count` places in the unit square: even in the first number, a golden-ratio
/// sequence in the second.
pub(super) fn spread(i: usize, count: usize) -> [f32; 2] {
    [(i as f32 + 0.5) / count as f32, (i as f32 * GOLDEN).fract()]
}

/// Directions over a surface, as dense as light from there counts, about the z axis. Patterns
/// differ by `turn`, from 0 to 1.
pub(super) fn cosine_direction(i: usize, count: usize, turn: f32) -> Vec3 {
    let [share, angle] = spread(i, count);
    let (sine, cosine) = ((angle + turn) * TAU).sin_cos();
    let radius = share.sqrt();
    Vec3::new(cosine * radius, sine * radius, (1.0 - share).sqrt())
}

/// A direction about the z axis, turned to be about a normal.
pub(super) fn about(normal: Vec3, direction: Vec3) -> Vec3 {
    let (u, v) = normal.any_orthonormal_pair();
    u * direction.x + v * direction.y + normal * direction.z
}
