//! Which viewpoint boxes an eye needs, now and soon.

use glam::{IVec3, Vec3};
use sightline_world::geometry::Aabb;

/// The edge of a viewpoint box, in metres.
const EDGE_M: f32 = 0.5;
/// How far ahead boxes are prepared, in seconds.
const AHEAD_S: f32 = 1.0;
/// The number of places along the way ahead that are looked at.
const STEPS: usize = 8;

/// The viewpoint boxes that an eye needs within a second if its velocity stays, in metres a second.
/// The box that the eye is in comes first.
pub fn boxes_ahead(eye: Vec3, velocity: Vec3) -> Vec<Aabb> {
    let mut places: Vec<IVec3> = Vec::new();
    for step in 0..=STEPS {
        let at = eye + velocity * (AHEAD_S * step as f32 / STEPS as f32);
        let place = (at / EDGE_M).floor().as_ivec3();
        if !places.contains(&place) {
            places.push(place);
        }
    }
    debug_assert!((1..=STEPS + 1).contains(&places.len()), "{} boxes", places.len());
    let bounds = |place: IVec3| {
        let min = place.as_vec3() * EDGE_M;
        Aabb::new(min, min + EDGE_M)
    };
    places.into_iter().map(bounds).collect()
}
