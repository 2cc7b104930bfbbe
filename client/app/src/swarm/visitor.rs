//! One simulated visitor: it walks somewhere, rests a while, and walks on.

use std::collections::VecDeque;

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_cli::trace::Track;
use sightline_client_core::{
    navigation::Navigation,
    walker::{MoveInput, Walker},
};
use sightline_world::{Spawn, World, motion::Pose};

/// The distance within which a place counts as reached, in metres.
const NEAR: f32 = 0.12;
/// A visitor that gets no nearer for this time chooses another goal, in seconds.
const STUCK_S: f32 = 2.0;
/// The preferred distance of goals, in metres.
const GOAL_DISTANCE: std::ops::Range<f32> = 4.0..40.0;

/// What moves a visitor.
pub enum Visitor {
    /// It wanders by itself.
    Wandering(Box<Wanderer>),
    /// It follows a recorded walk.
    Recorded(Track),
}

impl Visitor {
    /// The pose after `dt_s` more seconds, `elapsed_s` seconds after the start.
    pub fn step(
        &mut self,
        world: &World,
        navigation: &Navigation,
        dt_s: f32,
        elapsed_s: f64,
    ) -> Pose {
        match self {
            Self::Wandering(wanderer) => wanderer.step(world, navigation, dt_s),
            Self::Recorded(track) => track.at(elapsed_s),
        }
    }

    /// Moves the visitor to the pose that the server corrected it to.
    pub fn correct(&mut self, pose: Pose) {
        match self {
            Self::Wandering(wanderer) => {
                wanderer.walker.place(pose);
                wanderer.way.clear();
            }
            Self::Recorded(_) => {}
        }
    }
}

/// A visitor that wanders by itself.
pub struct Wanderer {
    walker: Walker,
    random: SmallRng,
    way: VecDeque<Vec3>,
    /// How long it still rests, in seconds.
    rest_s: f32,
    /// Its speed, as a share of the world's limit.
    haste: f32,
    /// The smallest distance to the next place so far, in metres, and the time since then, in
    /// seconds.
    nearest: (f32, f32),
}

impl Wanderer {
    /// A wanderer whose eye is at a place.
    pub fn new(world: &World, eye: Vec3, seed: u64) -> Self {
        let mut random = SmallRng::seed_from_u64(seed);
        let spawn = Spawn { eye, yaw: random.random_range(0.0..std::f32::consts::TAU) };
        let haste = random.random_range(0.45..0.95);
        let rest_s = random.random_range(0.0..2.0);
        let (walker, nearest) = (Walker::new(world, spawn), (f32::MAX, 0.0));
        Self { walker, random, way: VecDeque::new(), rest_s, haste, nearest }
    }

    fn step(&mut self, world: &World, navigation: &Navigation, dt_s: f32) -> Pose {
        let pose = self.walker.pose();
        let stay = MoveInput { yaw: pose.yaw, pitch: pose.pitch, ..MoveInput::default() };
        if self.rest_s > 0.0 {
            self.rest_s -= dt_s;
            return self.walker.step(&world.octree, stay, dt_s);
        }
        let Some(next) = self.next_place(pose.eye) else {
            self.choose(navigation, pose.eye);
            return self.walker.step(&world.octree, stay, dt_s);
        };
        let way = (next - pose.eye).with_y(0.0);
        self.watch_progress(way.length(), dt_s);
        let speed = world.speed_max.max(0.1);
        let wish = MoveInput {
            // Slower over the last stretch, to avoid overshooting.
            forward: self.haste.min(way.length() / (speed * dt_s.max(1e-3))),
            yaw: (-way.x).atan2(-way.z),
            ..MoveInput::default()
        };
        self.walker.step(&world.octree, wish, dt_s)
    }

    /// Removes the places that were reached, and returns the next one.
    fn next_place(&mut self, eye: Vec3) -> Option<Vec3> {
        while let Some(next) = self.way.front().copied() {
            if (next - eye).with_y(0.0).length() > NEAR {
                return Some(next);
            }
            self.way.pop_front();
            self.nearest = (f32::MAX, 0.0);
            if self.way.is_empty() && self.random.random_bool(0.7) {
                self.rest_s = self.random.random_range(0.5..4.0);
            }
        }
        None
    }

    /// Chooses another goal when the visitor gets no nearer.
    fn watch_progress(&mut self, distance: f32, dt_s: f32) {
        let (nearest, since_s) = &mut self.nearest;
        if distance < *nearest - 0.05 {
            (*nearest, *since_s) = (distance, 0.0);
            return;
        }
        *since_s += dt_s;
        if *since_s > STUCK_S {
            self.way.clear();
            self.nearest = (f32::MAX, 0.0);
        }
    }

    fn choose(&mut self, navigation: &Navigation, eye: Vec3) {
        self.nearest = (f32::MAX, 0.0);
        let goals: Vec<Vec3> = (0..8).filter_map(|_| navigation.random(&mut self.random)).collect();
        let is_near = |goal: &&Vec3| GOAL_DISTANCE.contains(&goal.distance(eye));
        let goal = goals.iter().find(is_near).or(goals.first()).copied();
        let way = goal.and_then(|goal| navigation.path(eye, goal)).filter(|way| !way.is_empty());
        match way {
            Some(way) => self.way = way.into(),
            // No way leads anywhere from here: rest, rather than search at every step.
            None => self.rest_s = 0.5,
        }
    }
}
