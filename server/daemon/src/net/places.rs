//! Where visitors begin, and room for a body near a place.

use glam::Vec3;
use sightline_protocol::fingerprint::KeyFingerprint;
use sightline_world::{World, tolerance::WIRE_POSE_M};

use super::{
    client::{FormerPlace, Visit},
    offers::WorldOffer,
    state::ServerState,
};

/// How far a body may be moved to where it has room, in metres. The voxels of a quick compilation
/// are up to that thick.
const MOVED_M: f32 = 0.6;
/// The distance between places that are tried, in metres.
const STEP_M: f32 = 0.1;

/// Where a visitor enters a world: where it was before, or else where it asks for, if it is free to
/// choose. `None` for a spawn point.
pub async fn place_in(
    state: &ServerState,
    visit: &Visit,
    offer: &WorldOffer,
    asked: Option<Vec3>,
) -> Option<Vec3> {
    let world = offer.world.world();
    if let Some(former) = visit.former() {
        let place = former.going_on(asked);
        return if former.world == offer.number { Some(place) } else { room_near(world, place) };
    }
    if state.config.free_entry && asked.is_some() {
        return asked;
    }
    if let Some(eye) = last_place(state, visit.key, &world.title).await {
        return room_near(world, FormerPlace::last(eye).going_on(asked));
    }
    let is_spawn =
        |asked: &Vec3| world.spawns.iter().any(|spawn| spawn.eye.distance(*asked) <= WIRE_POSE_M);
    asked.filter(is_spawn)
}

/// Where a visitor was before this server was started, or at another station, whichever was later.
async fn last_place(state: &ServerState, key: KeyFingerprint, title: &str) -> Option<Vec3> {
    let (people, own_title) = (state.people.clone(), title.to_owned());
    let here = tokio::task::spawn_blocking(move || people.last_place(key, &own_title)).await;
    let here = here.ok().flatten();
    let there = match &state.places {
        Some(places) => places.last(key, title).await,
        None => None,
    };
    match (here, there) {
        (Some((_, noted_s)), Some(there)) if there.at_s > noted_s => Some(there.eye),
        (Some((eye, _)), _) => Some(eye),
        (None, there) => there.map(|there| there.eye),
    }
}

/// The place nearest to another one at which a body has room; `None` when there is none near by.
fn room_near(world: &World, eye: Vec3) -> Option<Vec3> {
    let steps = (MOVED_M / STEP_M) as i32;
    let axis = || (-steps..=steps).map(|step| step as f32 * STEP_M);
    let mut moves: Vec<Vec3> = axis()
        .flat_map(|x| axis().flat_map(move |y| axis().map(move |z| Vec3::new(x, y, z))))
        .filter(|by| by.length() <= MOVED_M)
        .collect();
    moves.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let confines = world.confines();
    let has_room = |eye: &Vec3| {
        confines.contains(*eye)
            && world.cells.at(*eye).is_some()
            && !world.octree.solid_in(&world.body.around(*eye))
    };
    moves.into_iter().map(|by| eye + by).find(has_room)
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor;

    use super::*;

    #[test]
    fn a_body_in_the_floor_is_lifted_and_one_deep_below_has_no_room() {
        let world = voxel_floor::world(&[]);
        let free = world.spawns[0].eye;
        assert_eq!(room_near(&world, free), Some(free));
        let floor = free.y - world.body.below_eye;
        let sunk = Vec3::new(free.x, floor + world.body.below_eye - 0.25, free.z);
        let lifted = room_near(&world, sunk).expect("there is room above");
        assert!(lifted.y > sunk.y && lifted.distance(sunk) <= MOVED_M, "{lifted}");
        assert_eq!(room_near(&world, Vec3::splat(1.0e6)), None, "outside");
    }
}
