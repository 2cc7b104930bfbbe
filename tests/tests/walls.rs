//! Walls of a real building: honest bodies are never accused of going through one, and cheats never
//! get through.

use std::{
    f32::consts::TAU,
    ops::ControlFlow,
    sync::{Arc, OnceLock},
    time::Duration,
};

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use rayon::prelude::*;
use sightline_client_core::{
    navigation::Navigation,
    walker::{MoveInput, Walker},
};
use sightline_compiler::{CompileOptions, LightMethod, compile, import::glb};
use sightline_engine::{Config, Engine, Input, Policy};
use sightline_oracle::Oracle;
use sightline_protocol::quantise::WirePose;
use sightline_tests::simulation::SimulatedBuilding;
use sightline_world::{
    Spawn, World,
    geometry::Aabb,
    motion::{AvatarId, Pose, Report},
};

const TICK: Duration = Duration::from_millis(50);

fn building() -> Arc<World> {
    static WORLD: OnceLock<Arc<World>> = OnceLock::new();
    Arc::clone(WORLD.get_or_init(|| office(20, 4)))
}

fn office(rooms: usize, seed: u64) -> Arc<World> {
    let model =
        glb::read_slice(&sightline_demo_building::glb(rooms, seed), None, "office").unwrap();
    let options = CompileOptions {
        voxel: Some(0.05),
        cell: Some(3.0),
        light: LightMethod::None,
        ..CompileOptions::default()
    };
    let go_on = |_, _| ControlFlow::Continue(());
    Arc::new(compile(&model, &options, &go_on).unwrap().0)
}

/// An engine with one avatar, under a policy that keeps everybody live.
fn engine_with_avatar(world: &Arc<World>, place: Vec3) -> Engine {
    let config = Config { policy: Policy::Pvs, ..Config::default() };
    let mut engine = Engine::new(Arc::clone(world), config);
    let (avatar, name) = (AvatarId(0), "Ada".to_owned());
    let join = Input::Join { avatar, name, colour: [0; 3], place: Some(place) };
    engine.handle(Duration::ZERO, join);
    engine
}

/// Sends a report with the rounding of the wire.
fn report(engine: &mut Engine, [now, made]: [Duration; 2], pose: &Pose) {
    let report = Report { made, orders: 0, pose: Pose::from(WirePose::from(pose)) };
    engine.handle(now, Input::Report { avatar: AvatarId(0), report });
}

fn wish(random: &mut SmallRng) -> MoveInput {
    MoveInput {
        forward: random.random_range(0.3..=1.0),
        right: random.random_range(-0.5..=0.5),
        up: random.random_range(-1.0..=1.0),
        yaw: random.random_range(0.0..TAU),
        pitch: 0.0,
        fly: random.random_bool(0.3),
        jump: random.random_bool(0.3),
    }
}

/// A walk of half a minute with jumps and flights. Its reports are sometimes held up, for up to
/// three seconds, and then come together. None may be refused. Returns the greatest distance from
/// the start, in metres.
fn walk(world: &Arc<World>, eye: Vec3, random: &mut SmallRng, name: &str) -> f32 {
    /// From this tick on the engine knows how long reports take that are not held up.
    const KNOWN_AFTER: u32 = 20;
    let mut walker = Walker::new(world, Spawn { eye, yaw: 0.0 });
    let mut engine = engine_with_avatar(world, eye);
    let (mut intent, mut held_for, mut far_m) = (wish(random), 0, 0.0_f32);
    let mut held = Vec::new();
    for tick in 1..600_u32 {
        if random.random_bool(0.05) {
            intent = wish(random);
        }
        let pose = walker.step(&world.octree, intent, TICK.as_secs_f32());
        far_m = far_m.max(pose.eye.distance(eye));
        held.push((TICK * tick, pose));
        held_for = if held_for == 0 && tick > KNOWN_AFTER && random.random_bool(0.02) {
            random.random_range(1..60)
        } else {
            held_for - i32::from(held_for > 0)
        };
        if held_for > 0 {
            continue;
        }
        for (made, pose) in held.drain(..) {
            report(&mut engine, [TICK * tick, made], &pose);
            assert_eq!(engine.stats().refusals, 0, "{name}, from {eye}, tick {tick}: {pose:?}");
        }
    }
    far_m
}

#[test]
fn bodies_that_walk_jump_and_fly_are_never_accused_of_going_through_walls() {
    let world = building();
    let navigation = Navigation::new(&world);
    for seed in 0..12 {
        let random = &mut SmallRng::seed_from_u64(seed);
        let eye = navigation.random(random).unwrap();
        walk(&world, eye, random, &format!("seed {seed}"));
    }
}

/// Offices, and houses with windows, holes and furniture. Half of the houses are turned.
#[test]
fn nobody_is_accused_in_random_buildings() {
    let offices = [6, 9].map(|rooms| office(rooms, 100 + rooms as u64));
    // Buildings with voxels that tell which gates a body fits through.
    let houses =
        (0..24).filter(|seed| seed / 2 % 2 == 0).map(|seed| SimulatedBuilding::new(seed).world);
    let mut far_m = Vec::new();
    for (number, world) in offices.into_iter().chain(houses).enumerate() {
        let navigation = Navigation::new(&world);
        let random = &mut SmallRng::seed_from_u64(number as u64);
        for turn in 0..2 {
            let eye = navigation.random(random).expect("there is a floor");
            far_m.push(walk(&world, eye, random, &format!("building {number}, walk {turn}")));
        }
    }
    far_m.sort_by(f32::total_cmp);
    let median_m = far_m[far_m.len() / 2];
    assert!(median_m > 2.0, "the median walk is too short: {median_m} m");
}

/// The host put them there: with elbows in walls and furniture, or in a window.
#[test]
fn nobody_is_accused_who_was_put_where_its_body_does_not_fit() {
    let mut far_m = Vec::new();
    for seed in (0..24).filter(|seed| seed / 2 % 2 == 0) {
        let world = SimulatedBuilding::new(seed).world;
        let (navigation, sight) = (Navigation::new(&world), Oracle::new(&world.mesh));
        let random = &mut SmallRng::seed_from_u64(seed);
        for turn in 0..20 {
            let free = navigation.random(random).expect("there is a floor");
            let mut part = || random.random_range(-0.7..0.7);
            let eye = free + Vec3::new(part(), part(), part());
            // The side of a thin wall is undefined inside its voxels.
            let is_open =
                sight.between(free, eye) && !world.octree.solid_in(&Aabb::around(eye, 0.05));
            if is_open && world.octree.solid_in(&world.body.around(eye)) {
                far_m.push(walk(&world, eye, random, &format!("building {seed}, walk {turn}")));
            }
        }
    }
    assert!(far_m.len() > 12, "only {} walks", far_m.len());
    assert!(far_m.iter().all(|far_m| *far_m > 0.3), "somebody is stuck: {far_m:?}");
}

/// Two places on either side of a wall, with a long way between them.
struct ThinWall {
    near: Vec3,
    far: Vec3,
}

fn walls(world: &World, count: usize) -> Vec<ThinWall> {
    let (navigation, sight) = (Navigation::new(world), Oracle::new(&world.mesh));
    let random = &mut SmallRng::seed_from_u64(7);
    let mut candidate = || {
        let near = navigation.random(random).unwrap();
        let angle = random.random_range(0.0..TAU);
        let along = Vec3::new(angle.cos(), 0.0, angle.sin());
        ThinWall { near, far: near + along * random.random_range(0.5..1.5) }
    };
    let is_thin = |&ThinWall { near, far }: &ThinWall| {
        let is_free = !world.octree.solid_in(&world.body.around(far));
        let is_parted = || !sight.between(near, far) && !sight.between(far, near);
        let is_far = || way_m(&navigation, near, far).is_some_and(|way_m| way_m > 8.0);
        is_free && is_parted() && is_far()
    };
    let mut found = Vec::new();
    for _ in 0..400 {
        // All cores look at a batch, whose order stays.
        let batch: Vec<ThinWall> = (0..500).map(|_| candidate()).collect();
        found.par_extend(batch.into_par_iter().filter(is_thin));
        if found.len() >= count {
            break;
        }
    }
    found.truncate(count);
    found
}

fn way_m(navigation: &Navigation, from: Vec3, to: Vec3) -> Option<f32> {
    let way = navigation.path(from, to)?;
    let places: Vec<Vec3> = [from].into_iter().chain(way).chain([to]).collect();
    Some(places.windows(2).map(|pair| pair[0].distance(pair[1])).sum())
}

/// Whether a claim to be on the other side, half a second later, is accepted.
fn jumps_through(world: &Arc<World>, wall: &ThinWall) -> bool {
    let mut engine = engine_with_avatar(world, wall.near);
    let pose = Pose { eye: wall.far, ..Pose::default() };
    let claim = |i: u32| {
        report(&mut engine, [Duration::from_millis(500) + TICK * i; 2], &pose);
        engine.stats().walls == u64::from(i) && engine.pose(AvatarId(0)).unwrap().eye == wall.near
    };
    !(1..=3).all(claim)
}

/// Whether small claims, one after another, lead to the other side.
fn creeps_through(world: &Arc<World>, ThinWall { near, far }: &ThinWall) -> bool {
    let mut engine = engine_with_avatar(world, *near);
    let (mut eye, mut tick) = (*near, 0);
    for step in 1..=100 {
        tick += 2 + step % 3;
        // A client that persists is dropped.
        let Some(pose) = engine.pose(AvatarId(0)) else { break };
        eye = pose.eye;
        // Steps of one to ten centimetres.
        let along = (far - eye).normalize_or_zero() * (0.01 * (1 + step % 10) as f32);
        report(&mut engine, [TICK * tick; 2], &Pose { eye: eye + along, ..Pose::default() });
    }
    eye.distance(*far) < 0.2
}

#[test]
fn cheats_do_not_get_through_walls() {
    let world = building();
    let walls = walls(&world, 30);
    assert_eq!(walls.len(), 30);
    let jumped = walls.par_iter().filter(|wall| jumps_through(&world, wall)).count();
    let crept = walls.par_iter().filter(|wall| creeps_through(&world, wall)).count();
    assert_eq!((jumped, crept), (0, 0), "avatars that jumped and crept through walls");
}
