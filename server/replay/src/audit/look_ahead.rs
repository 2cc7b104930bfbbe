//! What a viewer could come to see within its horizon, by sampling.
//!
//! At a tick the engine decides by reports that were made a one-way delay and up to a tick before,
//! and its decision stands until that of the next tick has arrived. Within that time an eye or a
//! body can be at more places than its present one. The samples are the avatar's places in the
//! trace at the beginning, now and at the end of that time, and places around the first one: to
//! both sides of the line between the pair, level and as high as the body can rise, and in some
//! random directions. Each of the latter lies as far away as the body can get ([`Agility`]) on a
//! straight line that meets no opaque triangle.
//!
//! Sampling finds too little, never too much. So the number of held pairs for each pair found is an
//! upper bound of what an exact oracle would say.

use std::time::Duration;

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_oracle::Oracle;
use sightline_world::motion::{Agility, Body};

/// Sampled points on each axis of a body's box.
const SAMPLES: u32 = 2;
/// How many of the directions are random.
const RANDOM_DIRECTIONS: usize = 2;
/// The sampled parts of a straight way, the longest first.
const WAY_PARTS: [f32; 4] = [1.0, 0.75, 0.5, 0.25];

/// Where an avatar's eye is and can be in the time for which a decision stands.
#[derive(Clone, Copy, Debug)]
pub(super) struct HorizonMotion {
    /// When the last report was made that the engine can know.
    pub(super) first: Vec3,
    /// At present.
    pub(super) now: Vec3,
    /// When what the next tick tells has arrived.
    pub(super) last: Vec3,
    /// Where it can be in all that time, by its velocity at `first`.
    pub(super) reachable: Reachable,
}

/// Where a body's eye can be some time after it was at a place: within a level circle, and as far
/// up as the body can rise.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reachable {
    centre: Vec3,
    radius_m: f32,
    rise_m: f32,
}

impl Reachable {
    /// The circle is inscribed in the box of [`Agility::eyes`], so all of it is in that box.
    pub(super) fn new(agility: &Agility, eye: Vec3, velocity: Vec3, time: Duration) -> Self {
        let eyes = agility.eyes(eye, velocity, time);
        let centre = eye + velocity.with_y(0.0) * (0.5 * time.as_secs_f32());
        let radius_m = (eyes.max - centre).min(centre - eyes.min).with_y(f32::INFINITY);
        let (radius_m, rise_m) = (radius_m.min_element().max(0.0), eyes.max.y - eye.y);
        debug_assert!(radius_m.is_finite() && rise_m >= 0.0, "{radius_m} m, {rise_m} m up");
        Self { centre, radius_m, rise_m }
    }
}

/// Whether some sampled place of a viewer's eye sees the avatar's body at some sampled place. The
/// random directions depend on the time and on both places, so that a run can be repeated.
pub(super) fn can_come_into_sight(
    oracle: &Oracle,
    body: &Body,
    at: Duration,
    viewer: &HorizonMotion,
    avatar: &HorizonMotion,
) -> bool {
    let seed = at.as_nanos() as u64 ^ u64::from(viewer.now.x.to_bits()) << 32;
    let mut rng = SmallRng::seed_from_u64(seed ^ u64::from(avatar.now.z.to_bits()));
    let eyes = places(oracle, body, viewer, avatar.now, &mut rng);
    let others = places(oracle, body, avatar, viewer.now, &mut rng);
    // The likeliest pairs come first: both at the edge of what they reach.
    let pairs = (0..eyes.len() + others.len())
        .rev()
        .flat_map(|sum| (0..eyes.len()).map(move |i| (i, sum.wrapping_sub(i))));
    pairs.filter_map(|(i, k)| Some((eyes[i], others.get(k)?))).any(|(eye, other)| {
        let region = body.around(*other);
        oracle.between(eye, region.centre()) || oracle.of_box(eye, &region, SAMPLES)
    })
}

/// Sampled places of an avatar's eye. Those likeliest to bring something into sight come last.
fn places(
    oracle: &Oracle,
    body: &Body,
    motion: &HorizonMotion,
    other: Vec3,
    rng: &mut SmallRng,
) -> Vec<Vec3> {
    let across = (other - motion.first).cross(Vec3::Y).normalize_or(Vec3::X);
    let random_directions = (0..RANDOM_DIRECTIONS).map(|_| {
        let angle = rng.random_range(0.0..std::f32::consts::TAU);
        Vec3::new(angle.cos(), 0.0, angle.sin())
    });
    let mut found = vec![motion.now, motion.first, motion.last];
    let Reachable { centre, radius_m, rise_m } = motion.reachable;
    let rise = Vec3::Y * rise_m;
    let sides = [across, -across];
    let level = random_directions.chain(sides).map(|side| centre + side * radius_m);
    let goals: Vec<Vec3> =
        sides.map(|side| centre + side * radius_m + rise).into_iter().chain(level).collect();
    found.extend(goals.into_iter().map(|goal| towards(oracle, body, motion.first, goal)));
    found
}

/// The farthest sampled place on the straight way to a goal at which the body is not in a wall, by
/// four level rays.
fn towards(oracle: &Oracle, body: &Body, first: Vec3, goal: Vec3) -> Vec3 {
    let way = goal - first;
    let Some(direction) = way.try_normalize() else { return first };
    let wall_m = oracle.distance(first, direction).unwrap_or(f32::INFINITY);
    let free_m = way.length().min((wall_m - body.half_width).max(0.0));
    let is_free = |at: &Vec3| {
        [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z]
            .into_iter()
            .all(|side| oracle.distance(*at, side).is_none_or(|wall_m| wall_m >= body.half_width))
    };
    let places = WAY_PARTS.map(|part| first + direction * free_m * part);
    places.into_iter().find(is_free).unwrap_or(first)
}

#[cfg(test)]
mod tests {
    use sightline_world::Mesh;

    use super::*;

    /// A long wall along x at z = 0 that ends at x = 0.
    fn wall() -> Oracle {
        let positions = [(-90.0, -9.0), (0.0, -9.0), (0.0, 9.0), (-90.0, 9.0)];
        let positions = positions.map(|(x, y)| Vec3::new(x, y, 0.0)).to_vec();
        Oracle::new(&Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] })
    }

    fn standing(x: f32, z: f32, radius_m: f32) -> HorizonMotion {
        let eye = Vec3::new(x, 1.6, z);
        let reachable = Reachable { centre: eye, radius_m, rise_m: 0.0 };
        HorizonMotion { first: eye, now: eye, last: eye, reachable }
    }

    fn check(viewer: HorizonMotion, avatar: HorizonMotion, expected: bool) {
        for k in 0..20 {
            let at = Duration::from_millis(k);
            assert_eq!(
                can_come_into_sight(&wall(), &Body::PERSON, at, &viewer, &avatar),
                expected,
                "{k}"
            );
        }
    }

    #[test]
    fn an_avatar_that_can_step_out_from_behind_a_wall_can_come_into_sight() {
        check(standing(-1.0, -2.0, 0.1), standing(-1.0, 2.0, 0.1), false);
        check(standing(-1.0, -2.0, 2.0), standing(-1.0, 2.0, 2.0), true);
        check(standing(-30.0, -2.0, 2.0), standing(-30.0, 2.0, 2.0), false);
        let comes = HorizonMotion { last: Vec3::new(0.5, 1.6, 2.0), ..standing(-1.0, 2.0, 0.0) };
        check(standing(0.5, -2.0, 0.0), comes, true);
    }

    #[test]
    fn a_moving_avatar_reaches_farther_ahead_than_back_and_stays_in_its_region() {
        let agility = Agility::of(&Body::PERSON, 3.0);
        let time = Duration::from_millis(200);
        for velocity in [Vec3::ZERO, Vec3::X, Vec3::new(-1.0, 0.5, 2.5), Vec3::Z * 9.0] {
            let eyes = agility.eyes(Vec3::ZERO, velocity, time).grown(1e-4);
            let reachable = Reachable::new(&agility, Vec3::ZERO, velocity, time);
            for angle in (0..64).map(|i| i as f32 * 0.1) {
                let side = Vec3::new(angle.cos(), 0.0, angle.sin()) * reachable.radius_m;
                assert!(
                    eyes.contains(reachable.centre + side)
                        && eyes.contains(Vec3::Y * reachable.rise_m)
                );
            }
            assert!(reachable.centre.dot(velocity) >= 0.0);
            let has_room = reachable.radius_m > 0.2 || velocity.length() > agility.speed_max;
            assert!(has_room, "{velocity}: {reachable:?}");
        }
    }

    #[test]
    fn no_avatar_steps_through_a_wall() {
        check(standing(-30.0, -0.5, 9.0), standing(-30.0, 0.5, 9.0), false);
    }
}
