//! What a viewer could come to see within the horizon, by samples: the oracle that looks ahead.
//!
//! The engine decides at a tick, by reports that were made a one-way delay and up to a tick before,
//! for as long as its word stands: until that of the next tick has arrived. Within that time eye and body
//! can be at more places than they are. Those sampled are where the walkers of the trace are at the
//! beginning, at present and at the end of it, and places that a straight way from the first leads to
//! without meeting an opaque triangle: to both sides of the line between the two, level and as high as
//! the body can rise, and in some directions of chance. What the body can do in the time, by the velocity that
//! it had at first, bounds them all ([`Agility`]).
//!
//! Samples find too little, never too much: what is held for each pair found is an upper bound of what an exact
//! oracle would say.

use std::time::Duration;

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_world::motion::{Agility, Body};

use sightline_oracle::Oracle;

/// Points looked for on each axis of a body's box.
const SAMPLES: u32 = 2;
/// Directions of chance.
const CHANCES: usize = 2;

/// Where one walker is in the time that a decision is for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    /// When the last report was made that the engine can know.
    pub(super) first: Vec3,
    /// At present.
    pub(super) now: Vec3,
    /// When the word of the next tick stands.
    pub(super) last: Vec3,
    /// Where it can be in all that time, as it moved at first.
    pub(super) able: Able,
}

/// Where a body can be some time after it was at a place: level, in a ball; and so far up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Able {
    centre: Vec3,
    radius_m: f32,
    up_m: f32,
}

impl Able {
    /// By its velocity and what bodies can do. The box of [`Agility::eyes`] is the one around it.
    pub(super) fn new(agility: &Agility, eye: Vec3, velocity: Vec3, time: Duration) -> Self {
        let eyes = agility.eyes(eye, velocity, time);
        let centre = eye + velocity.with_y(0.0) * (0.5 * time.as_secs_f32());
        let radius_m = (eyes.max - centre).min(centre - eyes.min).with_y(f32::INFINITY);
        let (radius_m, up_m) = (radius_m.min_element().max(0.0), eyes.max.y - eye.y);
        Self { centre, radius_m, up_m }
    }
}

/// Whether one walker's eye could come to see the other's body.
pub(super) fn foresees(
    sight: &Oracle,
    body: &Body,
    at: Duration,
    viewer: &Walk,
    avatar: &Walk,
) -> bool {
    let seed = at.as_nanos() as u64 ^ u64::from(viewer.now.x.to_bits()) << 32;
    let mut rng = SmallRng::seed_from_u64(seed ^ u64::from(avatar.now.z.to_bits()));
    let eyes = places(sight, body, viewer, avatar.now, &mut rng);
    let others = places(sight, body, avatar, viewer.now, &mut rng);
    // The likeliest come first: both at the edge of what they reach.
    let pairs = (0..eyes.len() + others.len())
        .rev()
        .flat_map(|sum| (0..eyes.len()).map(move |i| (i, sum.wrapping_sub(i))));
    pairs.filter_map(|(i, k)| Some((eyes[i], others.get(k)?))).any(|(eye, other)| {
        let region = body.around(*other);
        sight.between(eye, region.centre()) || sight.of_box(eye, &region, SAMPLES)
    })
}

/// Places that a walker can be at, the likeliest to change what is in sight last.
fn places(sight: &Oracle, body: &Body, walk: &Walk, other: Vec3, rng: &mut SmallRng) -> Vec<Vec3> {
    let across = (other - walk.first).cross(Vec3::Y).normalize_or(Vec3::X);
    let chances = (0..CHANCES).map(|_| {
        let angle = rng.random_range(0.0..std::f32::consts::TAU);
        Vec3::new(angle.cos(), 0.0, angle.sin())
    });
    let mut found = vec![walk.now, walk.first, walk.last];
    let Able { centre, radius_m, up_m } = walk.able;
    let rise = Vec3::Y * up_m;
    let sides = [across, -across];
    let level = chances.chain(sides).map(|side| centre + side * radius_m);
    let goals: Vec<Vec3> =
        sides.map(|side| centre + side * radius_m + rise).into_iter().chain(level).collect();
    found.extend(goals.into_iter().map(|goal| walked(sight, body, walk.first, goal)));
    found
}

/// As far as a straight way leads without the body's sticking into a wall, or nearly.
fn walked(sight: &Oracle, body: &Body, first: Vec3, goal: Vec3) -> Vec3 {
    let way = goal - first;
    let Some(direction) = way.try_normalize() else { return first };
    let wall_m = sight.distance(first, direction).unwrap_or(f32::INFINITY);
    let free_m = way.length().min((wall_m - body.half_width).max(0.0));
    let is_free = |at: &Vec3| {
        [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z]
            .into_iter()
            .all(|side| sight.distance(*at, side).is_none_or(|wall_m| wall_m >= body.half_width))
    };
    let parts = [1.0, 0.75, 0.5, 0.25].map(|part| first + direction * free_m * part);
    parts.into_iter().find(is_free).unwrap_or(first)
}

#[cfg(test)]
mod tests {
    use sightline_world::Mesh;

    use super::*;

    /// An endless wall along x at z = 0 that ends at x = 0.
    fn wall() -> Oracle {
        let positions = [(-90.0, -9.0), (0.0, -9.0), (0.0, 9.0), (-90.0, 9.0)];
        let positions = positions.map(|(x, y)| Vec3::new(x, y, 0.0)).to_vec();
        Oracle::new(&Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] })
    }

    fn standing(x: f32, z: f32, radius_m: f32) -> Walk {
        let eye = Vec3::new(x, 1.6, z);
        let able = Able { centre: eye, radius_m, up_m: 0.0 };
        Walk { first: eye, now: eye, last: eye, able }
    }

    fn check(viewer: Walk, avatar: Walk, expected: bool) {
        for k in 0..20 {
            let at = Duration::from_millis(k);
            assert_eq!(foresees(&wall(), &Body::PERSON, at, &viewer, &avatar), expected, "{k}");
        }
    }

    #[test]
    fn who_can_step_out_from_behind_a_wall_is_foreseen() {
        check(standing(-1.0, -2.0, 0.1), standing(-1.0, 2.0, 0.1), false);
        check(standing(-1.0, -2.0, 2.0), standing(-1.0, 2.0, 2.0), true);
        check(standing(-30.0, -2.0, 2.0), standing(-30.0, 2.0, 2.0), false);
        let comes = Walk { last: Vec3::new(0.5, 1.6, 2.0), ..standing(-1.0, 2.0, 0.0) };
        check(standing(0.5, -2.0, 0.0), comes, true);
    }

    #[test]
    fn whoever_moves_gets_further_ahead_than_back_and_never_beyond_what_is_told_of_regions() {
        let agility = Agility::of(&Body::PERSON, 3.0);
        let time = Duration::from_millis(200);
        for velocity in [Vec3::ZERO, Vec3::X, Vec3::new(-1.0, 0.5, 2.5), Vec3::Z * 9.0] {
            let eyes = agility.eyes(Vec3::ZERO, velocity, time).grown(1e-4);
            let able = Able::new(&agility, Vec3::ZERO, velocity, time);
            for angle in (0..64).map(|i| i as f32 * 0.1) {
                let side = Vec3::new(angle.cos(), 0.0, angle.sin()) * able.radius_m;
                assert!(eyes.contains(able.centre + side) && eyes.contains(Vec3::Y * able.up_m));
            }
            assert!(able.centre.dot(velocity) >= 0.0);
            let has_room = able.radius_m > 0.2 || velocity.length() > agility.speed_max;
            assert!(has_room, "{velocity}: {able:?}");
        }
    }

    #[test]
    fn nobody_steps_through_a_wall() {
        check(standing(-30.0, -0.5, 9.0), standing(-30.0, 0.5, 9.0), false);
    }
}
