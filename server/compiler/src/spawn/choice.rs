//! Which places become spawn points, and where visitors look first.

use glam::Vec3;
use rayon::prelude::*;
use sightline_world::Spawn;

use super::{
    floors::{Floors, Place},
    rating::{self, DIRECTIONS, Sight, Surroundings},
};

/// The most spawn points.
const SPAWNS_MAX: usize = 12;
/// A spawn point for each of these parts of the area, in square metres.
const PART_M2: f32 = 12.0;
/// Spawn points are at least this far apart, in metres, so that bodies do not overlap.
const APART_M: f32 = 0.8;
/// The most areas that are rated, the largest first.
const AREAS_MAX: usize = 200;
/// The most places of an area that are looked at.
const SAMPLES_MAX: usize = 600;
/// The floor within this distance of a place tells whether it slopes, in metres.
const NEAR_M: f32 = 0.5;
/// The floor is level within this distance of a good place, in metres.
const LEVEL_M: f32 = 0.75;
/// Views count up to this distance, in metres.
const VIEW_MAX_M: f32 = 25.0;
/// A view of nothing counts as this far, in metres.
const VIEW_OF_NOTHING_M: f32 = 3.0;
/// Nothing is nearer than this in the direction of sight, in metres, where that can be had.
const NOSE_M: f32 = 1.5;
/// An area without any view out counts for this much.
const SEALED: f32 = 0.6;
/// An area counts for this much for each other that is below all of it: attics are above rooms.
const UPPER: f32 = 0.7;
/// An area with nothing in it counts for this much.
const BARE: f32 = 0.5;
/// An area counts in full where rays meet this number of different triangles.
const FURNISHED: f32 = 10.0;

/// A place that was looked at.
#[derive(Clone, Copy)]
struct Candidate<'a> {
    place: &'a Place,
    merit: f32,
    around: Surroundings,
    /// How many other places are below.
    below: usize,
}

/// The spawn points of a building: scattered over its best area, the best one first. Empty when
/// nobody can stand anywhere.
pub(super) fn choose(floors: &Floors, sight: &Sight) -> Vec<Spawn> {
    let mut areas: Vec<Vec<&Place>> = vec![Vec::new(); floors.area_count()];
    for place in &floors.places {
        areas[place.area as usize].push(place);
    }
    areas.sort_by_key(|places| std::cmp::Reverse(places.len()));
    areas.truncate(AREAS_MAX);
    let rated: Vec<(f32, Vec<Candidate<'_>>)> =
        areas.par_iter().map(|places| rate(floors, sight, places)).collect();
    // Of equal ones the first, which is the larger.
    let best = rated.into_iter().zip(&areas).fold(None, |best, (rated, places)| match &best {
        Some(((score, _), _)) if *score >= rated.0 => best,
        _ => Some((rated, places)),
    });
    let Some(((_, candidates), places)) = best else { return Vec::new() };
    scatter(floors, sight, candidates, places.len() as f32 * floors.place_m2())
}

/// How good an area is, and the places of it that were looked at. Merit counts for more than size:
/// the outside of a sky is larger than any room.
fn rate<'a>(floors: &Floors, sight: &Sight, places: &[&'a Place]) -> (f32, Vec<Candidate<'a>>) {
    let step = places.len().div_ceil(SAMPLES_MAX).max(1);
    let look = |place: &&'a Place| {
        let around = sight.surroundings(floors.eye(place));
        let column = floors.column_of(place);
        let below = column.iter().filter(|other| other.sole < place.sole).count();
        let level = floors.level_share(place, NEAR_M);
        let merit = rating::merit(&around, place.headroom, level, below > 0);
        Candidate { place, merit, around, below }
    };
    let candidates: Vec<Candidate<'a>> = places.iter().step_by(step).map(look).collect();
    let mean = |what: &dyn Fn(&Candidate<'_>) -> f32| {
        candidates.iter().map(what).sum::<f32>() / candidates.len().max(1) as f32
    };
    let merit = mean(&|candidate| candidate.merit);
    let sealed = if candidates.iter().any(|c| c.around.sees_out) { 1.0 } else { SEALED };
    let upper = UPPER.powf(mean(&|c| c.below as f32));
    let contents = mean(&|c| c.around.triangles as f32) / FURNISHED;
    let furnished = BARE + (1.0 - BARE) * contents.min(1.0);
    let size = places.len() as f32 * floors.place_m2();
    (merit * merit * sealed * upper * furnished * size, candidates)
}

/// Scatters spawn points over the good places of an area.
fn scatter(
    floors: &Floors,
    sight: &Sight,
    mut candidates: Vec<Candidate<'_>>,
    area_m2: f32,
) -> Vec<Spawn> {
    let most = candidates.iter().map(|c| c.merit).fold(0.0, f32::max);
    candidates.retain(|candidate| candidate.merit >= 0.8 * most);
    let mut views: Vec<(f32, Spawn)> = candidates
        .par_iter()
        .map(|candidate| {
            let eye = floors.eye(candidate.place);
            let (openness, yaw) = view(sight, eye);
            // Rather in the middle of a floor than on a step, a bench or at a wall.
            let level = floors.level_share(candidate.place, LEVEL_M);
            (openness * level.powi(4), Spawn { eye, yaw })
        })
        .collect();
    let count = ((area_m2 / PART_M2) as usize).clamp(1, SPAWNS_MAX);
    let part = (area_m2 / count as f32).sqrt();
    let mut chosen: Vec<Spawn> = Vec::new();
    while chosen.len() < count {
        let gap = |spawn: &Spawn| {
            chosen.iter().map(|other| other.eye.distance(spawn.eye)).fold(f32::INFINITY, f32::min)
        };
        views.retain(|(_, spawn)| gap(spawn) >= APART_M);
        let worth = |(openness, spawn): &(f32, Spawn)| openness * (gap(spawn) / part).min(1.0);
        let best = views.iter().max_by(|a, b| worth(a).total_cmp(&worth(b)));
        let Some((_, best)) = best else { break };
        let best = *best;
        chosen.push(best);
    }
    chosen
}

/// How open the view from an eye is, in metres, and the heading of the longest view.
fn view(sight: &Sight, eye: Vec3) -> (f32, f32) {
    let far: [f32; DIRECTIONS] = std::array::from_fn(|index| {
        let distance = sight.distance(eye, rating::direction(index));
        distance.map_or(VIEW_OF_NOTHING_M, |far| far.min(VIEW_MAX_M))
    });
    let mean = far.iter().sum::<f32>() / DIRECTIONS as f32;
    // A view through a slit is no view: what is beside it counts too.
    let wide = |index: usize| {
        let at = |offset: usize| far[(index + DIRECTIONS + offset - 2) % DIRECTIONS];
        let nose = sight.room_ahead(eye, rating::direction(index));
        let is_free = if nose >= NOSE_M { 1.0 } else { nose / NOSE_M * 0.2 };
        let around = [at(0), at(1), at(3), at(4)];
        is_free * (at(2) + around.iter().map(|far| far.min(at(2))).sum::<f32>() * 0.5)
    };
    let widths: Vec<f32> = (0..DIRECTIONS).map(wide).collect();
    let best = (0..DIRECTIONS).fold(0, |best, i| if widths[i] > widths[best] { i } else { best });
    (mean, rating::yaw(best))
}
