//! Where newcomers begin: at the spawn points in turn, and beside them once each has been used, so
//! that they do not all stand in one spot.

use std::f32::consts::PI;

use glam::Vec3;
use sightline_world::{Spawn, World, geometry::Aabb};

/// The number of places around a spawn point, itself included.
const PLACES: usize = 16;
/// About the distance between two places, in metres.
const SPACING_M: f32 = 0.9;
/// The way to a place is tested in steps of this length, in metres: less than a body is wide.
const STEP_M: f32 = 0.2;
/// The angle from one place to the next, in radians: the golden angle, which spreads them evenly.
const TURN: f32 = PI * 0.763_932;

/// Where the newcomer with this number begins, counted from zero; `None` in a world without spawn
/// points.
pub(crate) fn place(world: &World, number: usize) -> Option<Spawn> {
    let count = world.spawns.len();
    let spawn = *world.spawns.get(number % count.max(1))?;
    let eyes: Vec<Vec3> = (0..PLACES)
        .map(|i| beside(spawn.eye, i))
        .filter(|eye| is_open(world, spawn.eye, *eye))
        .collect();
    let eye = eyes.get(number / count % eyes.len().max(1)).copied().unwrap_or(spawn.eye);
    Some(Spawn { eye, ..spawn })
}

/// The i-th place around a spawn point. The first one is the spawn point itself.
fn beside(eye: Vec3, i: usize) -> Vec3 {
    let (sin, cos) = (i as f32 * TURN).sin_cos();
    eye + Vec3::new(cos, 0.0, sin) * SPACING_M * (i as f32).sqrt()
}

/// Whether a body has room, and a floor below it, at a place and on the straight way there.
fn is_open(world: &World, from: Vec3, to: Vec3) -> bool {
    let steps = (from.distance(to) / STEP_M).ceil() as u32;
    (1..=steps).all(|i| {
        let eye = from.lerp(to, i as f32 / steps as f32);
        let body = world.body.around(eye);
        let depth = world.body.step_height();
        let below =
            Aabb { min: body.min.with_y(body.min.y - depth), max: body.max.with_y(body.min.y) };
        world.confines().contains(eye)
            && world.cells.at(eye).is_some()
            && !world.octree.solid_in(&body)
            && world.octree.solid_in(&below)
    })
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor::{self, SPAWN};

    use super::*;

    #[test]
    fn newcomers_spread_over_the_floor_and_stay_on_this_side_of_walls() {
        // A wall of 12 cm stands 1 m east of the spawn point.
        let wall = ([24, 0, 0], [25, 32, 64], 0);
        let world = voxel_floor::world(&[wall]);
        let eyes: Vec<Vec3> = (0..8).map(|i| place(&world, i).unwrap().eye).collect();
        assert_eq!(eyes[0], SPAWN.eye);
        for (i, eye) in eyes.iter().enumerate() {
            assert!(!world.octree.solid_in(&world.body.around(*eye)), "{eye}");
            assert!(eye.x < 3.0 && eye.distance(SPAWN.eye) < 4.0, "{eye}");
            assert!(eyes[..i].iter().all(|other| other.distance(*eye) > 0.6), "{eyes:?}");
        }
    }

    #[test]
    fn spawn_points_come_in_turn_before_places_beside_them() {
        let mut world = voxel_floor::world(&[]);
        let other = Spawn { eye: SPAWN.eye + Vec3::X * 4.0, yaw: 1.0 };
        world.spawns.push(other);
        let places: Vec<Spawn> = (0..4).map(|i| place(&world, i).unwrap()).collect();
        assert_eq!(places[..2], [SPAWN, other]);
        assert_eq!([places[2].yaw, places[3].yaw], [SPAWN.yaw, other.yaw]);
        assert!(places[3].eye.distance(other.eye) > 0.8 && places[3].eye.distance(other.eye) < 1.0);
    }

    #[test]
    fn without_a_floor_around_it_a_spawn_point_is_used_again() {
        let pillar = ([15, 0, 31], [17, 40, 33], 0);
        let mut world = voxel_floor::world(&[pillar]);
        world.spawns[0].eye = Vec3::new(2.0, 6.7, 4.0);
        assert_eq!(place(&world, 5).unwrap().eye, world.spawns[0].eye);
        world.spawns.clear();
        assert_eq!(place(&world, 0), None);
    }
}
