//! Pedestrians who walk from room to room in a generated building.

use std::collections::VecDeque;

use glam::{Vec2, Vec3, Vec3Swizzles};
use rand::{Rng, rngs::SmallRng};
use rayon::prelude::*;
use sightline_demo_building::{LatticeRect, Plan, PlanDoor, SpaceKind, UNITS_PER_METRE};
use sightline_world::{World, geometry::Aabb, motion::Pose};

/// The largest acceleration, in metres per second squared.
const ACCELERATION: f32 = 3.0;
/// The slowest and the fastest walking speed, in metres per second.
const SPEEDS: [f32; 2] = [1.0, 1.5];
/// The speed where they turn, in metres per second.
const TURN_SPEED: f32 = 0.3;
/// The distance of goals and doors from walls, in metres.
const CLEARANCE_M: f32 = 0.45;
/// The number of goals tried before one is taken whose way is not clear.
const TRIES: usize = 8;
/// The chance of staying at a goal.
const STAYS: f64 = 0.5;
/// The longest stay, in seconds.
const STAY_S: f32 = 10.0;
/// The height of an eye above the floor, in metres.
const EYE_M: f32 = 1.6;

/// The floors of a building, and the doors between them.
#[derive(Debug)]
pub struct Floors {
    spaces: Vec<Floor>,
}

/// An area to walk in without passing a door.
#[derive(Clone, Debug)]
struct Floor {
    min: Vec2,
    max: Vec2,
    eye: f32,
    doors: Vec<Passage>,
}

/// A way out: a place in front of the door, one behind it, and the floor that it leads to.
#[derive(Clone, Copy, Debug)]
struct Passage {
    near: Vec2,
    far: Vec2,
    to: usize,
}

impl Floors {
    /// The rooms and corridors of a plan, on all storeys, without stairs.
    pub fn new(plan: &Plan) -> Self {
        let floors = plan.spaces.iter().map(|space| {
            let height = plan.floor(space.storey) as f32 / UNITS_PER_METRE as f32;
            let [min, max] = ends(&space.rect);
            Floor { min, max, eye: height + EYE_M, doors: Vec::new() }
        });
        let mut spaces: Vec<Floor> = floors.collect();
        let open =
            |space: usize| matches!(plan.spaces[space].kind, SpaceKind::Room | SpaceKind::Corridor);
        for door in &plan.doors {
            if let PlanDoor { spaces: (a, Some(b)), .. } = *door
                && open(a)
                && open(b)
            {
                let there = passage(door, &spaces[a], b);
                spaces[a].doors.push(there);
                spaces[b].doors.push(Passage { near: there.far, far: there.near, to: a });
            }
        }
        Self { spaces }
    }

    /// The floors to start on: each has a door.
    fn starts(&self) -> Vec<usize> {
        let leads = |floor: &usize| !self.spaces[*floor].doors.is_empty();
        (0..self.spaces.len()).filter(leads).collect()
    }
}

fn ends(rect: &LatticeRect) -> [Vec2; 2] {
    let metres = |[x, z]: [i32; 2]| Vec2::new(x as f32, z as f32) / UNITS_PER_METRE as f32;
    [metres(rect.min), metres(rect.max)]
}

fn passage(door: &PlanDoor, from: &Floor, to: usize) -> Passage {
    let [min, max] = ends(&door.rect);
    let (middle, size) = ((min + max) * 0.5, max - min);
    let through = if size.x < size.y { Vec2::X } else { Vec2::Y };
    let out = through * (middle - (from.min + from.max) * 0.5).dot(through).signum();
    let away = out * (size.min_element() * 0.5 + CLEARANCE_M);
    Passage { near: middle - away, far: middle + away, to }
}

/// One pedestrian.
#[derive(Clone, Debug)]
pub struct Pedestrian {
    /// The position of its eye.
    pub eye: Vec3,
    /// In metres per second.
    pub velocity: Vec3,
    floor: usize,
    way: VecDeque<Vec2>,
    speed: f32,
    stays_s: f32,
    rng: SmallRng,
}

impl Pedestrian {
    /// The pose that its client would report.
    pub fn pose(&self) -> Pose {
        let yaw = if self.velocity == Vec3::ZERO {
            0.0
        } else {
            (-self.velocity.x).atan2(-self.velocity.z)
        };
        Pose { eye: self.eye, yaw, velocity: self.velocity, ..Pose::default() }
    }
}

/// All pedestrians, and the floors that they walk on.
#[derive(Debug)]
pub struct Pedestrians {
    floors: Floors,
    /// The pedestrians: first those in the building, then one in each closed room.
    pub walkers: Vec<Pedestrian>,
}

impl Pedestrians {
    /// A number of pedestrians on the floors of a building, and one more in each closed room.
    pub fn new(
        mut floors: Floors,
        walkers: usize,
        closed: &[Aabb],
        rng: &mut impl FnMut() -> SmallRng,
    ) -> Self {
        let starts = floors.starts();
        assert!(!starts.is_empty(), "the building has a door");
        let mut homes: Vec<usize> = (0..walkers).map(|i| starts[i % starts.len()]).collect();
        for room in closed {
            homes.push(floors.spaces.len());
            let (min, max, eye) = (room.min.xz(), room.max.xz(), room.min.y + EYE_M);
            floors.spaces.push(Floor { min, max, eye, doors: Vec::new() });
        }
        let walkers = homes.into_iter().map(|floor| {
            let (mut rng, of) = (rng(), &floors.spaces[floor]);
            let at = within(of, &mut rng);
            let speed = rng.random_range(SPEEDS[0]..SPEEDS[1]);
            let eye = Vec3::new(at.x, of.eye, at.y);
            let (velocity, way, stays_s) = (Vec3::ZERO, VecDeque::new(), 0.0);
            Pedestrian { eye, velocity, floor, way, speed, stays_s, rng }
        });
        let walkers = walkers.collect();
        Self { floors, walkers }
    }

    /// Moves all pedestrians by a time, in seconds.
    pub fn step(&mut self, world: &World, time_s: f32) {
        let floors = &self.floors;
        self.walkers.par_iter_mut().for_each(|walker| step(walker, floors, world, time_s));
    }
}

fn step(walker: &mut Pedestrian, floors: &Floors, world: &World, time_s: f32) {
    walker.stays_s -= time_s;
    if walker.way.is_empty() && walker.stays_s <= 0.0 {
        choose(walker, floors, world);
    }
    let at = walker.eye.xz();
    let wanted = walker.way.front().map_or(Vec2::ZERO, |goal| {
        let away = goal - at;
        let left_m = away.length();
        let turning = (TURN_SPEED * TURN_SPEED + 2.0 * ACCELERATION * left_m).sqrt();
        away.normalize_or_zero() * walker.speed.min(turning).min(left_m / time_s)
    });
    let velocity = walker.velocity.xz();
    let velocity = velocity + (wanted - velocity).clamp_length_max(ACCELERATION * time_s);
    let at = at + velocity * time_s;
    walker.velocity = Vec3::new(velocity.x, 0.0, velocity.y);
    walker.eye = Vec3::new(at.x, walker.eye.y, at.y);
    if walker.way.front().is_some_and(|goal| goal.distance(at) < 0.05) {
        walker.way.pop_front();
        if walker.way.is_empty() && walker.rng.random_bool(STAYS) {
            walker.stays_s = walker.rng.random_range(0.0..STAY_S);
        }
    }
}

/// Chooses another place on the same floor, or through a door.
fn choose(walker: &mut Pedestrian, floors: &Floors, world: &World) {
    let floor = &floors.spaces[walker.floor];
    let rng = &mut walker.rng;
    let mut to = walker.floor;
    let mut from = walker.eye.xz();
    if !floor.doors.is_empty() && rng.random_bool(0.7) {
        let door = floor.doors[rng.random_range(0..floor.doors.len())];
        walker.way.extend([door.near, door.far]);
        (to, from) = (door.to, door.far);
    }
    let beyond = &floors.spaces[to];
    let goals = (0..TRIES).map(|_| within(beyond, rng));
    let clear = |goal: &Vec2| is_clear(world, beyond.eye, from, *goal);
    let mut last = from;
    let found = goals.inspect(|goal| last = *goal).find(clear);
    walker.way.push_back(found.unwrap_or(last));
    walker.floor = to;
}

fn within(floor: &Floor, rng: &mut SmallRng) -> Vec2 {
    let margin = Vec2::splat(CLEARANCE_M).min((floor.max - floor.min) * 0.4);
    let (min, max) = (floor.min + margin, floor.max - margin);
    min + (max - min) * Vec2::new(rng.random(), rng.random())
}

/// Whether a straight way is free of cupboards and columns, as far as cells tell.
fn is_clear(world: &World, height: f32, from: Vec2, to: Vec2) -> bool {
    let parts = (from.distance(to) / 0.3).ceil().max(1.0);
    (0..=parts as u32).all(|part| {
        let at = from.lerp(to, part as f32 / parts);
        world.cells.at(Vec3::new(at.x, height, at.y)).is_some()
    })
}
