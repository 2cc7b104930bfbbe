use glam::{Quat, Vec3};
use proptest::prelude::*;
use rand::{Rng, SeedableRng, rngs::SmallRng};

use super::*;

const DOOR: Aabb = Aabb::new(Vec3::ZERO, Vec3::new(1.0, 2.0, 0.1));

fn seconds(seconds: f64) -> Duration {
    Duration::from_secs_f64(seconds)
}

/// The box around a moving box's corners, sampled at many times.
fn sampled(trajectory: &Trajectory, bounds: &Aabb, from: f64, until: f64, count: u32) -> Aabb {
    let times = (0..=count).map(|i| from + (until - from) * f64::from(i) / f64::from(count));
    let places = times.flat_map(|time_s| {
        let at = trajectory.at(seconds(time_s));
        bounds.corners().map(|corner| at.transform_point3(corner.as_dvec3()).as_vec3())
    });
    Aabb::from_points(places)
}

fn vector(rng: &mut SmallRng, reach: f32) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|_| rng.random_range(-reach..reach)))
}

fn turn(rng: &mut SmallRng) -> Quat {
    let axis = vector(rng, 1.0).try_normalize().unwrap_or(Vec3::Y);
    Quat::from_axis_angle(axis, rng.random_range(-3.1..3.1))
}

fn track<V>(
    rng: &mut SmallRng,
    length_s: f32,
    value: impl Fn(&mut SmallRng) -> V,
) -> KeyframeTrack<V> {
    let mut times: Vec<f32> =
        (0..rng.random_range(1..6)).map(|_| rng.random_range(0.0..length_s)).collect();
    times.sort_by(f32::total_cmp);
    // Samples would miss the extremes of faster changes.
    times.dedup_by(|later, before| *later - *before < 0.05);
    let keys = times.into_iter().map(|time_s| (time_s, value(rng))).collect();
    KeyframeTrack { keys, steps: rng.random_bool(0.25) }
}

fn some_trajectory(rng: &mut SmallRng, joints: usize) -> Trajectory {
    let length_s = rng.random_range(0.5..8.0);
    let joint = |rng: &mut SmallRng| {
        let place = vector(rng, 5.0).as_dvec3();
        let mut joint =
            Joint::still(DAffine3::from_rotation_translation(turn(rng).as_dquat(), place));
        if rng.random_bool(0.7) {
            joint.rotation = track(rng, length_s, turn);
        }
        if rng.random_bool(0.5) {
            joint.translation = track(rng, length_s, |rng| vector(rng, 4.0));
        }
        if rng.random_bool(0.2) {
            joint.scale = track(rng, length_s, |rng| vector(rng, 0.5) + 1.0);
        }
        joint
    };
    let playback = [Playback::Loop, Playback::Once, Playback::Triggered][rng.random_range(0..3)];
    let joints = (0..joints).map(|_| joint(rng)).collect();
    Trajectory::new(joints, length_s, playback).expect("sound")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn no_moving_box_leaves_its_swept_box(
        seed: u64, joints in 0usize..4, from in 0f64..20.0, lasting in 0f64..10.0,
    ) {
        let rng = &mut SmallRng::seed_from_u64(seed);
        let trajectory = some_trajectory(rng, joints);
        let corner = vector(rng, 2.0);
        let bounds = Aabb::new(corner, corner + vector(rng, 1.0).abs());
        for lasting in [lasting, lasting * 0.01, 0.0] {
            let swept = trajectory.swept(&bounds, seconds(from), seconds(from + lasting));
            let sampled = sampled(&trajectory, &bounds, from, from + lasting, 400);
            prop_assert!(swept.contains_box(&sampled), "{swept:?} does not hold {sampled:?}");
            prop_assert!(trajectory.everywhere(&bounds).contains_box(&sampled));
        }
    }

    #[test]
    fn swept_boxes_are_tight_where_one_value_changes_and_nearly_so_elsewhere(
        seed: u64, joints in 1usize..3, from in 0f64..8.0, lasting in 0.01f64..3.0,
    ) {
        let rng = &mut SmallRng::seed_from_u64(seed);
        let mut trajectory = some_trajectory(rng, joints);
        let bounds = Aabb::around(Vec3::ZERO, 0.5);
        // Samples miss jumps.
        for joint in &mut trajectory.joints {
            joint.rotation.steps = false;
            joint.translation.steps = false;
            joint.scale.steps = false;
        }
        let swept = |t: &Trajectory| t.swept(&bounds, seconds(from), seconds(from + lasting));
        let sampled = |t: &Trajectory| sampled(t, &bounds, from, from + lasting, 1_000);
        let excess = |t: &Trajectory| {
            (swept(t).size() - sampled(t).size()).max_element() / (sampled(t).size().max_element())
        };
        // The box around a rotated box is never tight, and each joint adds to that.
        let excess_max = [0.4, 2.0][joints - 1];
        prop_assert!(excess(&trajectory) < excess_max, "{}", excess(&trajectory));
        let joint = &mut trajectory.joints[0];
        joint.translation = KeyframeTrack::constant(Vec3::ONE);
        joint.scale = KeyframeTrack::constant(Vec3::ONE);
        trajectory.joints.truncate(1);
        prop_assert!(excess(&trajectory) < 1e-2, "{}", excess(&trajectory));
    }
}

fn hinged(keys: Vec<(f32, f32)>, playback: Playback) -> Trajectory {
    let length_s = keys.last().expect("some").0;
    let place = DAffine3::from_translation(DVec3::new(10.0, 0.0, 5.0));
    let keys = keys.into_iter().map(|(at, angle)| (at, Quat::from_rotation_y(angle)));
    let joint = Joint { rotation: KeyframeTrack::linear(keys.collect()), ..Joint::still(place) };
    Trajectory::new(vec![joint], length_s, playback).expect("sound")
}

/// The poses at both ends tell nothing about the arc: the door's edge is farthest out halfway.
#[test]
fn a_door_on_a_hinge_sweeps_its_arc() {
    let half_turn = hinged(vec![(0.0, 0.0), (1.0, 3.0)], Playback::Once);
    let swept = half_turn.swept(&DOOR, Duration::ZERO, seconds(1.0));
    // Turned left, the door opens towards -z. Halfway its diagonal points along -z.
    assert!((swept.min.z - (5.0 - 1.01f32.sqrt())).abs() < 1e-3, "{swept:?}");
    let [start, end] = [0.0, 1.0].map(|at| half_turn.swept(&DOOR, seconds(at), seconds(at)));
    assert!(start.union(&end).min.z > 4.7);
}

#[test]
fn playbacks_differ_after_the_end_of_the_trajectory() {
    let keys = vec![(0.0, 0.0), (2.0, 1.0)];
    let edge = |playback, at| {
        let motion = hinged(keys.clone(), playback);
        motion.at(seconds(at)).transform_vector3(DVec3::X).z
    };
    let expected = |angle: f64| -angle.sin();
    for (playback, at, angle) in [
        (Playback::Loop, 1.0, 0.5),
        (Playback::Loop, 3.0, 0.5),
        (Playback::Loop, 200.5, 0.25),
        (Playback::Once, 1.0, 0.5),
        (Playback::Once, 3.0, 1.0),
        (Playback::Triggered, 1e9, 1.0),
    ] {
        assert!((edge(playback, at) - expected(angle)).abs() < 1e-6, "{playback:?} at {at}");
    }
}

#[test]
fn a_swept_box_contains_both_ends_of_a_jump() {
    let mut joint = Joint::still(DAffine3::IDENTITY);
    joint.translation = KeyframeTrack::steps(vec![(0.0, Vec3::ZERO), (1.0, Vec3::X * 9.0)]);
    let lift = Trajectory::new(vec![joint], 2.0, Playback::Loop).expect("sound");
    let right = |from, until| lift.swept(&DOOR, seconds(from), seconds(until)).max.x;
    assert!(right(0.0, 0.99) < 1.1);
    assert!(right(0.0, 1.0) > 9.9);
    assert!(right(1.5, 1.9) > 9.9);
    assert!(lift.swept(&DOOR, seconds(1.5), seconds(1.9)).min.x > 8.9);
    assert!(lift.swept(&DOOR, seconds(1.5), seconds(2.1)).min.x < 0.1);
}

#[test]
fn invalid_trajectories_are_refused() {
    let check = |change: &dyn Fn(&mut Joint, &mut f32), expected| {
        let mut joint = Joint::still(DAffine3::IDENTITY);
        let mut length_s = 1.0;
        change(&mut joint, &mut length_s);
        assert_eq!(Trajectory::new(vec![joint], length_s, Playback::Loop), Err(expected));
    };
    use TrajectoryError::*;
    check(&|_, length_s| *length_s = f32::NAN, Length);
    check(&|_, length_s| *length_s = 0.0, Length);
    check(&|_, length_s| *length_s = 1e9, Length);
    check(&|joint, _| joint.scale.keys.clear(), Times);
    check(&|joint, _| joint.scale.keys[0].0 = f32::NAN, Times);
    check(&|joint, _| joint.scale.keys[0].0 = 1.5, Times);
    check(&|joint, _| joint.scale.keys.push((0.0, Vec3::ONE)), Times);
    check(&|joint, _| joint.scale.keys[0].1.x = f32::INFINITY, Value);
    check(&|joint, _| joint.rotation.keys[0].1 = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), Value);
    check(&|joint, _| joint.frame.translation.y = f64::NAN, Value);
    let many = (0..=KEYS_MAX).map(|i| (i as f32 / 5_000.0, Vec3::ONE)).collect::<Vec<_>>();
    check(&|joint, _| joint.scale.keys = many.clone(), TooMany);
    let joints = vec![Joint::still(DAffine3::IDENTITY); JOINTS_MAX + 1];
    assert_eq!(Trajectory::new(joints, 1.0, Playback::Once), Err(TooMany));
}
