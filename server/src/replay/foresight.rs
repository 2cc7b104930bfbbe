//! What a viewer could come to see within the horizon, by samples: the oracle that looks ahead.
//!
//! The engine decides at a tick, by reports that were made a one-way delay and up to a tick before,
//! for as long as its word stands: until that of the next tick has arrived. Within that time eye and body
//! can be at more places than they are. Those sampled are where the walkers of the trace are at the
//! beginning, at present and at the end of it, and places that a straight walk from the first leads to
//! without meeting an opaque triangle: to both sides of the line between the two, and in some
//! directions of chance, as far as the body can get.
//!
//! Samples find too little, never too much: what is held for each pair found is an upper bound of what an exact
//! oracle would say.

use std::time::Duration;

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_shared::motion::Body;

use crate::sight::Sight;

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
    /// How far it can get from the first place, in metres.
    pub(super) way_m: f32,
}

/// Whether one walker's eye could come to see the other's body.
pub(super) fn foresees(
    sight: &Sight,
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
fn places(sight: &Sight, body: &Body, walk: &Walk, other: Vec3, rng: &mut SmallRng) -> Vec<Vec3> {
    let across = (other - walk.first).cross(Vec3::Y).normalize_or(Vec3::X);
    let chances = (0..CHANCES).map(|_| {
        let angle = rng.random_range(0.0..std::f32::consts::TAU);
        Vec3::new(angle.cos(), 0.0, angle.sin())
    });
    let mut found = vec![walk.now, walk.first, walk.last];
    let directions: Vec<Vec3> = chances.chain([across, -across]).collect();
    found.extend(directions.into_iter().map(|direction| walked(sight, body, walk, direction)));
    found
}

/// As far as a straight walk leads without the body's sticking into a wall, or nearly.
fn walked(sight: &Sight, body: &Body, walk: &Walk, direction: Vec3) -> Vec3 {
    let wall_m = sight.distance(walk.first, direction).unwrap_or(f32::INFINITY);
    let free_m = walk.way_m.min((wall_m - body.half_width).max(0.0));
    let is_free = |at: &Vec3| {
        [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z]
            .into_iter()
            .all(|side| sight.distance(*at, side).is_none_or(|wall_m| wall_m >= body.half_width))
    };
    let parts = [1.0, 0.75, 0.5, 0.25].map(|part| walk.first + direction * free_m * part);
    parts.into_iter().find(is_free).unwrap_or(walk.first)
}

#[cfg(test)]
mod tests {
    use sightline_shared::world::Mesh;

    use super::*;

    /// An endless wall along x at z = 0 that ends at x = 0.
    fn wall() -> Sight {
        let positions = [(-90.0, -9.0), (0.0, -9.0), (0.0, 9.0), (-90.0, 9.0)];
        let positions = positions.map(|(x, y)| Vec3::new(x, y, 0.0)).to_vec();
        Sight::new(&Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] })
    }

    fn standing(x: f32, z: f32, way_m: f32) -> Walk {
        let eye = Vec3::new(x, 1.6, z);
        Walk { first: eye, now: eye, last: eye, way_m }
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
    fn nobody_steps_through_a_wall() {
        check(standing(-30.0, -0.5, 9.0), standing(-30.0, 0.5, 9.0), false);
    }
}
