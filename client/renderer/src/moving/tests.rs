use glam::{DAffine3, DVec3, Vec3};
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_fixtures::voxel_floor::world;
use sightline_world::{
    Mesh, Mover,
    motion::{
        Pose,
        trajectory::{Joint, KeyframeTrack, Playback, Trajectory},
    },
    octree::Octree,
};

use super::*;

const SIZE: [usize; 2] = [160, 120];

/// A tent that goes back and forth, rests, or goes away for good.
fn mover(random: &mut SmallRng) -> Mover {
    let mut within = |low: f32, high: f32| random.random_range(low..high);
    let at = Vec3::new(within(1.0, 31.0), within(0.5, 4.0), within(1.0, 31.0));
    let mut point = |at: Vec3, size: f32| {
        at + Vec3::new(within(-size, size), within(-size, size), within(-size, size))
    };
    let positions: Vec<Vec3> = (0..4).map(|_| point(Vec3::ZERO, 0.6)).collect();
    let (there, back) = (point(at, 4.0), point(at, 0.1));
    let triangles = vec![[0, 1, 2], [0, 2, 3], [1, 2, 3]];
    let mut joint = Joint::still(DAffine3::from_translation(DVec3::ZERO));
    let length_s = within(1.0, 8.0);
    let keys = vec![(0.0, at), (length_s * 0.5, there), (length_s, back)];
    joint.translation = KeyframeTrack::linear(keys);
    let course = match random.random_range(0..4) {
        0 => Playback::Once,
        1 => Playback::Triggered,
        _ => Playback::Loop,
    };
    let trajectory = Trajectory::new(vec![joint], length_s, course).unwrap();
    let colours = (0..3).map(|i| [200, 40 * i, random.random()]).collect();
    Mover::new("tent".into(), Mesh { positions, triangles }, colours, trajectory).unwrap()
}

/// A picture with walls at all distances in it.
fn building(random: &mut SmallRng) -> Frame {
    let mut frame = Frame::new(SIZE[0], SIZE[1]);
    frame.depth.fill(random.random_range(3.0..12.0));
    for _ in 0..random.random_range(0..6) {
        let [left, right] = [0, 1].map(|_| random.random_range(0..SIZE[0]));
        let [top, bottom] = [0, 1].map(|_| random.random_range(0..SIZE[1]));
        let depth =
            if random.random_bool(0.2) { f32::INFINITY } else { random.random_range(0.5..20.0) };
        for y in top.min(bottom)..=top.max(bottom) {
            frame.depth[y * SIZE[0] + left.min(right)..=y * SIZE[0] + left.max(right)].fill(depth);
        }
    }
    frame
}

/// A person who walks on for a while, until there is an update.
#[derive(Clone)]
struct Person {
    name: String,
    start: Duration,
    pose: Pose,
}

impl Person {
    const GOES_ON_S: f32 = 0.2;

    fn eye(&self, time_s: f32) -> Vec3 {
        self.pose.eye + self.pose.velocity * time_s.clamp(0.0, Self::GOES_ON_S)
    }

    fn pose(&self, now: Duration) -> Pose {
        Pose { eye: self.eye(now.saturating_sub(self.start).as_secs_f32()), ..self.pose }
    }
}

/// People who walk as bodies can, are put elsewhere, vanish, and appear again.
#[derive(Clone, Default)]
struct Crowd {
    people: BTreeMap<AvatarId, Person>,
    updates: BTreeMap<AvatarId, Update>,
}

impl Crowd {
    fn step(&mut self, now: Duration, random: &mut SmallRng) {
        let at = |random: &mut SmallRng, low: f32, high: f32| {
            let mut within = |low: f32, high: f32| random.random_range(low..high);
            Vec3::new(within(low, high), 0.1 * within(low, high), within(low, high))
        };
        for id in (0..40).map(AvatarId) {
            match random.random_range(0..200) {
                0 => drop(self.people.remove(&id)),
                1..4 => {
                    let letters = random.random_range(0..30);
                    let pose = Pose { eye: at(random, 1.0, 31.0), ..Pose::default() };
                    let name = "x".repeat(letters);
                    self.people.insert(id, Person { name, start: now, pose });
                    self.updates.insert(id, Update::Appeared);
                }
                4..60 => {
                    let Some(person) = self.people.get_mut(&id) else { continue };
                    let eye = person.pose(now).eye;
                    let velocity = at(random, -1.5, 1.5);
                    person.pose = Pose { eye, velocity, ..person.pose };
                    person.start = now;
                    self.updates.entry(id).or_insert(Update::Moved);
                }
                _ => {}
            }
        }
    }
}

impl AvatarSource for Crowd {
    fn updates(&mut self) -> Vec<(AvatarId, Update)> {
        std::mem::take(&mut self.updates).into_iter().collect()
    }

    fn path(&self, avatar: AvatarId, now: Duration, until: Duration) -> Option<(Pose, Aabb)> {
        let person = self.people.get(&avatar)?;
        let pose = person.pose(now);
        Some((pose, Aabb::from_points([pose.eye, person.pose(until).eye])))
    }

    fn shown(&self, avatar: AvatarId, now: Duration) -> Option<ShownAvatar> {
        let person = self.people.get(&avatar)?;
        let colour = [avatar.0 as u8, 200, 90];
        Some(ShownAvatar { id: avatar, name: person.name.clone(), colour, pose: person.pose(now) })
    }
}

/// A world of 32 m.
fn stage(random: &mut SmallRng) -> World {
    let movers = (0..60).map(|_| mover(random)).collect();
    World { movers, octree: Octree::empty(Vec3::ZERO, 0.5, 6), ..world(&[]) }
}

#[test]
fn all_ways_of_culling_draw_the_same_pixels() {
    let (mut saved, mut plain_placed, mut drawn, mut met) = (0, 0, 0, 0);
    let mut refuted = 0;
    for seed in 0..40 {
        let random = &mut SmallRng::seed_from_u64(seed);
        let world = stage(random);
        let mut ways = Culling::ALL.map(|culling| MovingRenderer::new(&world, culling));
        let mut crowds = [0, 1, 2].map(|_| Crowd::default());
        let mut now = Duration::ZERO;
        let mut camera = Camera::looking_at(Vec3::new(16.0, 2.0, 16.0), Vec3::ZERO);
        for _ in 0..60 {
            // Now and then time leaps, forwards or backwards.
            now = match random.random_range(0..40) {
                0 => now / 2,
                1 => now + Duration::from_secs(20),
                _ => now + Duration::from_millis(random.random_range(1..60)),
            };
            camera.yaw += random.random_range(-0.1..0.1);
            camera.eye += Vec3::new(random.random_range(-0.2..0.2), 0.0, 0.1);
            let seed = random.random();
            crowds.iter_mut().for_each(|crowd| crowd.step(now, &mut SmallRng::seed_from_u64(seed)));
            let empty = building(random);
            let pictures = [0, 1, 2].map(|way: usize| {
                let mut frame = empty.clone();
                let told = Some(&mut crowds[way] as &mut dyn AvatarSource);
                let seen = ways[way].draw(&mut frame, &camera, &world, told, now);
                (frame, seen)
            });
            assert!(pictures[0] == pictures[1], "by the pyramid, seed {seed} at {now:?}");
            assert!(pictures[0] == pictures[2], "by volumes, seed {seed} at {now:?}");
            plain_placed += ways[1].counters().placed;
            saved += ways[1].counters().placed.saturating_sub(ways[2].counters().placed);
            refuted += ways[2].counters().refuted;
            drawn += usize::from(pictures[0].0 != empty);
            met += pictures[0].1.len();
        }
    }
    assert!(drawn > 1_000 && met > 1_000, "{drawn} pictures show anything, {met} people");
    assert!(2 * saved > plain_placed, "{saved} of {plain_placed} were left alone");
    assert!(refuted > 100, "{refuted} volumes did not hold");
}

#[test]
fn hidden_avatars_are_left_alone() {
    let mut crowd = Crowd::default();
    let world = world(&[]);
    for id in (0..100).map(AvatarId) {
        let eye = Vec3::new(4.0, 1.7, 1.0 + id.0 as f32 * 0.01);
        let pose = Pose { eye, velocity: Vec3::X * 0.1, ..Pose::default() };
        crowd.people.insert(id, Person { name: "Ada".into(), start: Duration::ZERO, pose });
        crowd.updates.insert(id, Update::Appeared);
    }
    let mut moving = MovingRenderer::new(&world, Culling::Temporal);
    let camera = Camera::looking_at(Vec3::new(4.0, 1.7, 7.0), Vec3::new(4.0, 1.7, 0.0));
    let mut picture = |depth: f32, ms: u64, updates: Option<u32>| {
        let mut frame = Frame::new(SIZE[0], SIZE[1]);
        frame.depth.fill(depth);
        crowd.updates.extend(updates.map(|id| (AvatarId(id), Update::Moved)));
        let told = Some(&mut crowd as &mut dyn AvatarSource);
        let seen = moving.draw(&mut frame, &camera, &world, told, Duration::from_millis(ms));
        (seen.len(), moving.counters())
    };
    assert_eq!(picture(1.0, 0, None).1.placed, 200, "each, and its volume");
    let (_, counters) = picture(1.0, 20, Some(7));
    assert_eq!((counters.placed, counters.refuted, counters.drawn), (0, 0, 0), "{counters:?}");
    assert!(counters.tested <= 110, "nodes, and wide volumes once: {counters:?}");
    let (seen, counters) = picture(f32::INFINITY, 40, None);
    assert!(seen > 0 && counters.drawn == 100 && counters.revealed == 100, "{seen} {counters:?}");
}

#[test]
fn a_moment_looks_like_another_until_something_in_view_moves() {
    let world = world(&[]);
    let mut crowd = Crowd::default();
    let person = |x: f32| {
        let pose = Pose { eye: Vec3::new(x, 1.7, 2.0), ..Pose::default() };
        Person { name: "Ada".into(), start: Duration::ZERO, pose }
    };
    for (id, x) in [(1, 4.0), (2, -30.0)] {
        crowd.people.insert(AvatarId(id), person(x));
        crowd.updates.insert(AvatarId(id), Update::Appeared);
    }
    let mut moving = MovingRenderer::new(&world, Culling::Temporal);
    let camera = Camera::looking_at(Vec3::new(4.0, 1.7, 7.0), Vec3::new(4.0, 1.7, 0.0));
    let empty = Frame::new(SIZE[0], SIZE[1]);
    let mut at = |crowd: &mut Crowd, ms: u64| {
        moving.find(&empty, &camera, &world, Some(crowd), Duration::from_millis(ms))
    };
    let first = at(&mut crowd, 0);
    assert!(first.looks_like(&at(&mut crowd, 20)));
    crowd.people.insert(AvatarId(2), person(-31.0));
    crowd.updates.insert(AvatarId(2), Update::Moved);
    assert!(first.looks_like(&at(&mut crowd, 40)), "beside the picture");
    crowd.people.insert(AvatarId(1), person(4.1));
    crowd.updates.insert(AvatarId(1), Update::Moved);
    assert!(!first.looks_like(&at(&mut crowd, 60)));
}

#[test]
fn empty_worlds_and_frames_are_drawn_without_harm() {
    let random = &mut SmallRng::seed_from_u64(1);
    let mut world = World { octree: Octree::empty(Vec3::ZERO, 1.0, 2), ..world(&[]) };
    let camera = Camera::looking_at(Vec3::ONE, Vec3::ZERO);
    let draw = |moving: &mut MovingRenderer, size: usize, world: &World, now: Duration| {
        moving.draw(&mut Frame::new(size, 9), &camera, world, None, now)
    };
    draw(&mut MovingRenderer::new(&world, Culling::Temporal), 4, &world, Duration::MAX);
    world.movers = vec![mover(random), mover(random)];
    let mut moving = MovingRenderer::new(&world, Culling::Temporal);
    draw(&mut moving, 0, &world, Duration::ZERO);
    world.movers.truncate(1);
    draw(&mut moving, 9, &world, Duration::MAX);
}
