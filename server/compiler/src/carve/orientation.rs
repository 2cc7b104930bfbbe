//! The orientation of a building: the angle about the vertical by which most of its walls are
//! turned.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::{DVec3, Vec3};
use sightline_world::tolerance::WELD_M;

/// Bins of wall directions over a quarter turn: half a degree each.
const BINS: usize = 180;
/// A triangle is part of a wall when its unit normal rises by no more than this.
const UPRIGHT: f64 = 1e-3;
/// The angle about the vertical by which the walls with the most area are turned, in radians, from
/// 0 to a quarter turn. In [`Axes::turned`](sightline_world::geometry::Axes::turned) by this angle,
/// these walls are axial. Exactly 0 when they are axial already.
///
/// The direction with the most wall area wins, to half a degree, modulo quarter turns. The angle is
/// then the weighted mean of the walls near it. The weight of a wall is its area times the square
/// of its length, because long walls tell a direction better.
pub fn dominant_orientation(opaque: &[[Vec3; 3]]) -> f64 {
    let walls: Vec<Wall> = opaque.iter().filter_map(Wall::of).collect();
    let mut bins = vec![0.0; BINS];
    for wall in &walls {
        bins[((wall.turn / FRAC_PI_2 * BINS as f64) as usize).min(BINS - 1)] += wall.area;
    }
    // Two neighbouring bins count together: a direction may lie on their border.
    let pair = |bin: &usize| bins[*bin] + bins[(*bin + 1) % BINS];
    let Some(first) = (0..BINS).max_by(|a, b| pair(a).total_cmp(&pair(b)).then(b.cmp(a))) else {
        return 0.0;
    };
    let width = FRAC_PI_2 / BINS as f64;
    let mut turn = (first + 1) as f64 * width;
    for window in [width * 1.5, width / 4.0, width / 32.0, width / 256.0] {
        turn += mean_offset(&walls, turn, window);
    }
    let turn = turn.rem_euclid(FRAC_PI_2);
    let reach = opaque.as_flattened().iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
    let stray = turn.min(FRAC_PI_2 - turn) * f64::from(reach);
    if stray < WELD_M { 0.0 } else { turn }
}

/// An upright triangle.
struct Wall {
    /// The direction of its normal, modulo a quarter turn.
    turn: f64,
    area: f64,
    weight: f64,
}

impl Wall {
    fn of(corners: &[Vec3; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        let doubled = (b - a).cross(c - a);
        let area = doubled.length() * 0.5;
        let normal = doubled.try_normalize()?;
        if normal.y.abs() > UPRIGHT {
            return None;
        }
        let level = |edge: DVec3| edge.x * edge.x + edge.z * edge.z;
        let length_squared = level(b - a).max(level(c - b)).max(level(a - c));
        let turn = normal.z.atan2(normal.x).rem_euclid(FRAC_PI_2);
        Some(Self { turn, area, weight: area * length_squared })
    }
}

/// The offset from an angle to the weighted mean of the walls within a window about it.
fn mean_offset(walls: &[Wall], around: f64, window: f64) -> f64 {
    let offset = |wall: &Wall| (wall.turn - around + FRAC_PI_4).rem_euclid(FRAC_PI_2) - FRAC_PI_4;
    let near =
        walls.iter().map(|wall| (offset(wall), wall.weight)).filter(|(o, _)| o.abs() <= window);
    let (sum, weight) = near.fold((0.0, 0.0), |(s, w), (o, weight)| (s + o * weight, w + weight));
    if weight > 0.0 { sum / weight } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};
    use proptest::prelude::*;
    use sightline_world::geometry::Axes;

    use super::*;

    /// The upright faces of a box, two triangles each.
    fn walls(size: Vec3, turn: f32, at: Vec3) -> Vec<[Vec3; 3]> {
        let corner = |x: f32, y: f32, z: f32| {
            // Turning about y by a negative angle takes x towards z.
            at + Quat::from_rotation_y(-turn) * (size * Vec3::new(x, y, z))
        };
        [[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 1.0], [1.0, 1.0, 0.0, 1.0], [0.0, 1.0, 0.0, 0.0]]
            .into_iter()
            .flat_map(|[x0, z0, x1, z1]| {
                let [a, b] = [corner(x0, 0.0, z0), corner(x1, 0.0, z1)];
                let [c, d] = [corner(x1, 1.0, z1), corner(x0, 1.0, z0)];
                [[a, b, c], [a, c, d]]
            })
            .collect()
    }

    #[test]
    fn an_axial_building_is_not_turned_at_all() {
        let mut all = walls(Vec3::new(20.0, 3.0, 12.0), 0.0, Vec3::new(3.3, 0.0, -70.1));
        all.extend(walls(Vec3::new(1.0, 1.0, 2.0), 0.7, Vec3::ZERO));
        assert_eq!(dominant_orientation(&all), 0.0);
        assert_eq!(dominant_orientation(&[]), 0.0);
    }

    proptest! {
        /// The majority of walls wins, and in its axes these walls are flat to single precision.
        #[test]
        fn most_walls_become_axial(degrees in 0.0..90.0f32, other in 0.0..90.0f32) {
            let turn = degrees.to_radians();
            let house = walls(Vec3::new(40.0, 3.0, 25.0), turn, Vec3::new(-20.0, 0.0, 31.0));
            let mut all = house.clone();
            all.extend(walls(Vec3::new(9.0, 3.0, 7.0), other.to_radians(), Vec3::ONE));
            let found = dominant_orientation(&all);
            prop_assert!((0.0..FRAC_PI_2).contains(&found));
            // When the two houses are nearly parallel, the mean may lie between them.
            let apart = (f64::from(degrees - other) + 45.0).rem_euclid(90.0) - 45.0;
            prop_assume!(apart.abs() > 0.6 || apart == 0.0);
            for triangle in house {
                let axes = Axes::turned(found);
                let own = triangle.map(|p| axes.own_exact(p.as_dvec3()));
                let spread = |axis: usize| {
                    let along = own.map(|p| p[axis]);
                    along.into_iter().fold(f64::MIN, f64::max) - along.into_iter().fold(f64::MAX, f64::min)
                };
                prop_assert!(spread(0).min(spread(2)) < 3e-5, "{} {}", spread(0), spread(2));
                let back = own.map(|p| axes.world(p.as_vec3()));
                prop_assert!(back.iter().zip(&triangle).all(|(a, b)| a.distance(*b) < 1e-5));
            }
        }
    }
}
