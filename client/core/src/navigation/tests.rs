use rand::SeedableRng;

use super::*;
use sightline_fixtures::voxel_floor::world;

use crate::walker::{MoveInput, Walker};

/// Walks a path with a real body. Returns where the body ends.
fn walk(world: &World, way: &[Vec3], from: Vec3) -> Vec3 {
    let spawn = sightline_world::Spawn { eye: from, yaw: 0.0 };
    let mut walker = Walker::new(world, spawn);
    for place in way {
        for _ in 0..600 {
            let to = *place - walker.pose().eye;
            if to.with_y(0.0).length() < 0.08 {
                break;
            }
            let input =
                MoveInput { forward: 0.5, yaw: (-to.x).atan2(-to.z), ..MoveInput::default() };
            walker.step(&world.octree, input, 1.0 / 60.0);
        }
    }
    walker.pose().eye
}

const WEST: Vec3 = Vec3::new(1.0, 1.725, 4.0);
const EAST: Vec3 = Vec3::new(7.0, 1.725, 4.0);

#[test]
fn a_path_leads_round_a_wall_and_a_body_can_walk_it() {
    // A wall across the middle, with a gap of 1 m at one end; voxels are 0.125 m.
    let world = world(&[([31, 1, 8], [33, 30, 64], 0)]);
    let navigation = Navigation::new(&world);
    assert!(navigation.len() > 100);
    let way = navigation.path(WEST, EAST).unwrap();
    assert!(way.iter().any(|place| place.z < 1.0), "through the gap: {way:?}");
    assert!(walk(&world, &way, WEST).distance(EAST) < 0.4);
}

#[test]
fn a_coarse_grid_leads_round_a_wall_and_not_through_it() {
    let spacing_m = SPACINGS[1] * world(&[]).body.half_width;
    let navigation = |wall: [u32; 3]| {
        let world = world(&[([31, 1, 8], wall, 0)]);
        let mut navigation = Navigation::grid(&world, spacing_m, PLACES_MAX);
        navigation.connected = navigation.largest_component();
        navigation.path(WEST, EAST).map(|way| walk(&world, &way, WEST))
    };
    let end = navigation([33, 30, 64]).unwrap();
    assert!(end.distance(EAST) < 0.6, "ended at {end}");
    let world = world(&[([31, 1, 0], [32, 30, 64], 0)]);
    assert_eq!(
        Navigation::grid(&world, spacing_m, PLACES_MAX).path(WEST, EAST),
        None,
        "thin walls"
    );
}

#[test]
fn a_closed_wall_has_no_path_and_stairs_have_one() {
    let closed = world(&[([31, 1, 0], [33, 30, 64], 0)]);
    assert_eq!(Navigation::new(&closed).path(WEST, EAST), None);
    // Five steps of 0.25 m up to a platform 1.25 m high.
    let mut boxes = vec![([40, 1, 0], [64, 11, 64], 0)];
    boxes.extend((0..4).map(|i| ([32 + 2 * i, 1, 24], [34 + 2 * i, 3 + 2 * i, 40], 0)));
    let stairs = world(&boxes);
    let navigation = Navigation::new(&stairs);
    let top = EAST + Vec3::Y * 1.25;
    let way = navigation.path(WEST, top).unwrap();
    let end = walk(&stairs, &way, WEST);
    assert!(end.distance(top) < 0.4, "ended at {end}");
    assert!(navigation.path(top, WEST).is_some());
}

#[test]
fn no_goal_is_a_place_without_a_way_back() {
    // A pit 2 m deep: everything around it is 2 m higher.
    let world = world(&[
        ([0, 1, 0], [24, 17, 64], 0),
        ([40, 1, 0], [64, 17, 64], 0),
        ([24, 1, 0], [40, 17, 24], 0),
        ([24, 1, 40], [40, 17, 64], 0),
    ]);
    let world = World {
        spawns: vec![sightline_world::Spawn { eye: WEST + Vec3::Y * 2.0, yaw: 0.0 }],
        ..world
    };
    let navigation = Navigation::new(&world);
    let mut random = SmallRng::seed_from_u64(1);
    for _ in 0..1_000 {
        let eye = navigation.random(&mut random).unwrap();
        assert!(eye.y > 3.0, "{eye}");
    }
}

#[test]
fn a_world_without_a_floor_has_no_places() {
    let world =
        World { octree: sightline_world::octree::Octree::empty(Vec3::ZERO, 1.0, 1), ..world(&[]) };
    let navigation = Navigation::new(&world);
    assert!(navigation.is_empty());
    assert_eq!(navigation.random(&mut SmallRng::seed_from_u64(1)), None);
    assert_eq!(navigation.path(WEST, EAST), None);
}
