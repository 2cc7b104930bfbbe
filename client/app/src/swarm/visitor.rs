//! One simulated visitor: it walks somewhere, as fast as people do, turns, rests a while, looks
//! about, and walks on.

use std::f32::consts::TAU;

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_cli::trace::Track;
use sightline_client_core::{
    navigation::Navigation,
    route::{Route, turned},
    walker::{MoveInput, Walker},
};
use sightline_world::{Spawn, World, motion::Pose};

use super::grounds::Grounds;

/// The preferred distance of goals, in metres.
const GOAL_DISTANCE: std::ops::Range<f32> = 4.0..40.0;
/// How many goals are tried for one at that distance. In a large building few are.
const GOALS_TRIED: usize = 64;
/// How fast people like to walk, in metres a second.
const PACE: std::ops::Range<f32> = 0.9..1.7;
/// The greatest share of the world's speed limit at which a visitor walks.
const SPEED_SHARE_MAX: f32 = 0.95;
/// How fast people turn to look about, in radians a second.
const GAZE_SPEED: f32 = 1.0;
/// How far people turn to look about, in radians.
const GAZE: f32 = 2.0;
/// The share of goals at which a visitor rests, and for how long, in seconds.
const REST_SHARE: f64 = 0.7;
const REST_S: std::ops::Range<f32> = 1.0..14.0;

/// What moves a visitor.
pub enum Visitor {
    /// It wanders by itself.
    Wandering(Box<Wanderer>),
    /// It follows a recorded walk.
    Recorded(Track),
}

impl Visitor {
    /// The pose after `dt_s` more seconds, `elapsed_s` seconds after the start.
    pub fn step(&mut self, grounds: &Grounds, dt_s: f32, elapsed_s: f64) -> Pose {
        match self {
            Self::Wandering(wanderer) => wanderer.step(&grounds.world, &grounds.navigation, dt_s),
            Self::Recorded(track) => track.at(elapsed_s),
        }
    }

    /// The visitor goes on in another building, from a pose.
    pub fn move_over(&mut self, world: &World, pose: Pose) {
        if let Self::Wandering(wanderer) = self {
            wanderer.walker = Walker::new(world, Spawn { eye: pose.eye, yaw: pose.yaw });
            wanderer.route = Route::default();
        }
    }

    /// Moves the visitor to the pose that the server corrected it to.
    pub fn correct(&mut self, pose: Pose) {
        match self {
            Self::Wandering(wanderer) => {
                wanderer.walker.place(pose);
                wanderer.route = Route::default();
            }
            Self::Recorded(_) => {}
        }
    }
}

/// A visitor that wanders by itself.
pub struct Wanderer {
    walker: Walker,
    random: SmallRng,
    route: Route,
    /// How long it still rests, in seconds.
    rest_s: f32,
    /// The heading that it looks to while it rests.
    gaze: f32,
    /// Its speed, in metres a second.
    pace: f32,
}

impl Wanderer {
    /// A wanderer whose eye is at a place.
    pub fn new(world: &World, eye: Vec3, seed: u64) -> Self {
        let mut random = SmallRng::seed_from_u64(seed);
        let spawn = Spawn { eye, yaw: random.random_range(0.0..TAU) };
        let pace = random.random_range(PACE).min(SPEED_SHARE_MAX * world.speed_max);
        let rest_s = random.random_range(0.0..2.0);
        let (walker, route) = (Walker::new(world, spawn), Route::default());
        Self { walker, random, route, rest_s, gaze: spawn.yaw, pace }
    }

    fn step(&mut self, world: &World, navigation: &Navigation, dt_s: f32) -> Pose {
        let pose = self.walker.pose();
        if self.rest_s > 0.0 {
            self.rest_s -= dt_s;
            let yaw = turned(pose.yaw, self.gaze, GAZE_SPEED * dt_s);
            let look = MoveInput { yaw, ..MoveInput::default() };
            return self.walker.step(&world.octree, look, dt_s);
        }
        let was_walking = !self.route.is_over();
        let wish = self.route.wish(&pose, self.pace, world.speed_max, dt_s);
        let wish = wish.unwrap_or_else(|| {
            if was_walking && self.random.random_bool(REST_SHARE) {
                self.rest_s = self.random.random_range(REST_S);
                self.gaze = pose.yaw + self.random.random_range(-GAZE..GAZE);
            }
            self.choose(navigation, pose.eye);
            MoveInput { yaw: pose.yaw, ..MoveInput::default() }
        });
        self.walker.step(&world.octree, wish, dt_s)
    }

    fn choose(&mut self, navigation: &Navigation, eye: Vec3) {
        let is_near = |goal: &Vec3| GOAL_DISTANCE.contains(&goal.distance(eye));
        let random = &mut self.random;
        let goal = (0..GOALS_TRIED).filter_map(|_| navigation.random(random)).find(is_near);
        let goal = goal.or_else(|| navigation.random(&mut self.random));
        let way = goal.and_then(|goal| navigation.path(eye, goal)).filter(|way| !way.is_empty());
        match way {
            Some(way) => self.route = Route::new(way),
            // No way leads anywhere from here: rest, rather than search at every step.
            None => self.rest_s = 0.5,
        }
    }
}
