use proptest::prelude::*;
use sightline_fixtures::voxel_floor::{SPAWN, world};
use sightline_world::octree::Material;

use super::*;

/// The yaw of a view along +x.
const EAST: f32 = -std::f32::consts::FRAC_PI_2;

fn go_east(world: &World, input: MoveInput, seconds: f32) -> Walker {
    let mut walker = Walker::new(world, SPAWN);
    for _ in 0..(seconds * 60.0) as u32 {
        walker.step(&world.octree, MoveInput { yaw: EAST, ..input }, 1.0 / 60.0);
    }
    walker
}

const WALK: MoveInput =
    MoveInput { forward: 1.0, right: 0.0, up: 0.0, yaw: 0.0, pitch: 0.0, fly: false, jump: false };

#[test]
fn walls_and_glass_stop_the_body() {
    for flags in [0, Material::GLASS] {
        let world = world(&[([32, 0, 0], [33, 64, 64], flags)]);
        for input in [WALK, MoveInput { fly: true, ..WALK }, MoveInput { jump: true, ..WALK }] {
            let eye = go_east(&world, input, 3.0).pose().eye;
            assert!(eye.x > 3.7 && eye.x <= 3.8, "{eye} with {input:?}");
        }
    }
}

#[test]
fn the_body_slides_along_a_wall() {
    let world = world(&[([32, 0, 0], [33, 64, 64], 0)]);
    let mut walker = Walker::new(&world, SPAWN);
    let input = MoveInput { right: 1.0, yaw: EAST, ..WALK };
    for _ in 0..60 {
        walker.step(&world.octree, input, 1.0 / 60.0);
    }
    let eye = walker.pose().eye;
    assert!(eye.x > 3.7 && eye.z > 6.0, "{eye}");
}

#[test]
fn stairs_are_climbed_and_walls_are_not() {
    let step = |i: u32, height: u32| ([28 + 4 * i, 0, 0], [64, 1 + height * (i + 1), 64], 0);
    let stairs = world(&[step(0, 2), step(1, 2), step(2, 2), step(3, 2)]);
    let eye = go_east(&stairs, WALK, 2.0).pose().eye;
    assert!((eye.y - 2.725).abs() < 0.02, "{eye}");
    let back = MoveInput { forward: -1.0, ..WALK };
    let mut walker = go_east(&stairs, WALK, 2.0);
    for _ in 0..180 {
        walker.step(&stairs.octree, MoveInput { yaw: EAST, ..back }, 1.0 / 60.0);
    }
    assert!((walker.pose().eye.y - 1.725).abs() < 0.02, "{}", walker.pose().eye);
    let high = world(&[step(0, 4)]);
    assert!(go_east(&high, WALK, 2.0).pose().eye.x < 3.4);
    let low_ceiling = world(&[step(0, 2), ([20, 15, 0], [64, 16, 64], 0)]);
    assert!(go_east(&low_ceiling, WALK, 2.0).pose().eye.x < 3.4);
}

#[test]
fn a_body_without_support_falls_and_lands() {
    let world = world(&[]);
    let mut walker = Walker::new(&world, Spawn { eye: Vec3::new(4.0, 7.0, 4.0), yaw: 0.0 });
    let after_half_a_second =
        (0..30).map(|_| walker.step(&world.octree, MoveInput::default(), 1.0 / 60.0)).last();
    let eye = after_half_a_second.expect("30 steps").eye;
    assert!((eye.y - (7.0 - 0.5 * GRAVITY * 0.25)).abs() < 0.1, "{eye}");
    for _ in 0..120 {
        walker.step(&world.octree, MoveInput::default(), 1.0 / 60.0);
    }
    assert!(walker.is_grounded() && (walker.pose().eye.y - 1.725).abs() < 0.01);
    let highest = (0..60)
        .map(|i| {
            walker.step(
                &world.octree,
                MoveInput { jump: i == 0, ..MoveInput::default() },
                1.0 / 60.0,
            )
        })
        .map(|pose| pose.eye.y)
        .fold(0.0, f32::max);
    assert!(highest > 2.0 && highest < 2.5, "{highest}");
    assert!((walker.pose().eye.y - 1.725).abs() < 0.01);
}

#[test]
fn a_stuck_body_gets_free_no_faster_than_it_walks() {
    let world = world(&[([10, 0, 25], [22, 6, 39], 0)]);
    let spawn = Spawn { eye: Vec3::new(2.0, 1.8, 4.0), yaw: 0.0 };
    let mut walker = Walker::new(&world, spawn);
    let is_free = |walker: &Walker| !world.octree.solid_in(&world.body.around(walker.pose().eye));
    for _ in 0..2 {
        // The server measures the way of the body from where it put it.
        assert_eq!(walker.pose().eye, spawn.eye);
        assert!(!is_free(&walker));
        for _ in 0..90 {
            let before = walker.pose().eye;
            let stuck = !is_free(&walker);
            let way = walker.step(&world.octree, MoveInput::default(), 1.0 / 60.0).eye - before;
            assert!(!stuck || way.length() <= START_SPEED / 60.0 + 1e-3, "{way}");
        }
        assert!(is_free(&walker) && walker.is_grounded());
        walker.place(Pose { eye: spawn.eye, ..Pose::default() });
    }
}

fn input() -> impl Strategy<Value = MoveInput> {
    let number = prop_oneof![8 => -1.5f32..1.5, 1 => Just(f32::NAN)];
    (prop::array::uniform5(number), any::<bool>(), 0..4u8).prop_map(|(numbers, fly, jump)| {
        let [forward, right, up, yaw, pitch] = numbers;
        MoveInput { forward, right, up, yaw: yaw * 3.0, pitch, fly, jump: jump == 0 }
    })
}

proptest! {
    #[test]
    fn no_input_breaks_the_limits(
        inputs in prop::collection::vec((input(), 0.001f32..0.3), 1..60),
        start in prop::array::uniform3(0.0f32..8.0),
    ) {
        let world = world(&[
            ([20, 0, 20], [24, 20, 40], 0),
            ([40, 0, 10], [44, 3, 60], 0),
            ([44, 0, 10], [48, 5, 60], Material::GLASS),
        ]);
        let mut walker = Walker::new(&world, Spawn { eye: Vec3::from(start), yaw: 0.0 });
        let is_stuck = |eye: Vec3| world.octree.solid_in(&world.body.around(eye));
        for (input, dt_s) in inputs {
            let before = walker.pose().eye;
            let pose = walker.step(&world.octree, input, dt_s);
            let reach = world.speed_max * dt_s.min(STEP_S_MAX);
            prop_assert!(pose.is_finite());
            prop_assert!(before.distance(pose.eye) <= reach, "{before} to {} in {dt_s} s", pose.eye);
            prop_assert!(world.bounds().contains(pose.eye));
            prop_assert!(is_stuck(before) || !is_stuck(pose.eye));
        }
    }
}
