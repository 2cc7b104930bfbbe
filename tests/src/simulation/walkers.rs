//! The walkers of a simulation, recorded as a trace.

use std::fmt::Write;

use glam::{Vec2, Vec3};
use rand::{Rng, rngs::SmallRng};
use sightline_cli::trace::Trace;

use super::building::{BuildingRoom, SimulatedBuilding};

/// The largest acceleration, in metres per second squared.
const ACCELERATION: f32 = 8.0;
/// The time between two samples, in seconds.
pub const STEP_S: f32 = 0.05;

/// How long a new walker stands still, in seconds: until its client is let in, even if one message
/// is lost.
const JOINING_S: f32 = 1.0;

/// The least distance of a jump, in metres: farther than any body gets in a step.
const JUMP_MIN_M: f32 = 1.0;

/// How a walker behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Behaviour {
    /// Stands still.
    Idle,
    /// Goes from room to room.
    Walks,
    /// Goes back and forth through one door.
    Paces,
    /// Runs straight on until it hits something.
    Runs,
}

struct Agent {
    behaviour: Behaviour,
    room: usize,
    /// Its position: x and z, in metres.
    at: Vec2,
    velocity: Vec2,
    speed: f32,
    way: Vec<Vec2>,
    rest_s: f32,
    /// The steps in which it is present.
    present: std::ops::Range<u32>,
}

/// What a walk is like.
#[derive(Clone, Copy, Debug)]
pub struct Walks {
    /// The number of agents. Those for whom no free place is found are left out.
    pub agents: usize,
    /// The number of samples.
    pub steps: u32,
    /// The top speed of all agents, in metres per second.
    pub speed_max: f32,
    /// The chance per step that an agent is put elsewhere.
    pub jump_chance: f64,
}

/// The recorded walks of agents in a building.
pub fn trace(building: &SimulatedBuilding, rng: &mut SmallRng, walks: &Walks) -> Trace {
    let Walks { agents, steps, speed_max, jump_chance } = *walks;
    assert!(speed_max > 0.0 && (0.0..=1.0).contains(&jump_chance), "{walks:?}");
    let mut all: Vec<Agent> =
        (0..agents).filter_map(|_| Agent::new(building, rng, steps, speed_max)).collect();
    let mut rows = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n".to_owned();
    for step in 0..steps {
        for (id, walker) in all.iter_mut().enumerate() {
            if !walker.present.contains(&step) {
                continue;
            }
            if jump_chance > 0.0 && rng.random_bool(jump_chance) {
                walker.jump(building, rng);
            } else {
                walker.step(building, rng);
            }
            let eye = building.world_point(walker.eye(building));
            let v = building.world_point(Vec3::new(walker.velocity.x, 0.0, walker.velocity.y));
            let t_ms = (step as f32 * STEP_S * 1e3).round();
            let yaw = (-v.x).atan2(-v.z);
            let _ = writeln!(
                rows,
                "{t_ms},{id},{:.5},{:.5},{:.5},{yaw:.4},0,{:.4},{:.4},{:.4}",
                eye.x, eye.y, eye.z, v.x, v.y, v.z
            );
        }
    }
    Trace::read(rows.as_bytes()).expect("the rows are a trace")
}

impl Agent {
    fn new(
        building: &SimulatedBuilding,
        rng: &mut SmallRng,
        steps: u32,
        speed_max: f32,
    ) -> Option<Self> {
        let room = rng.random_range(0..building.rooms.len());
        let at = building.place(room, rng)?;
        let behaviour = match rng.random_range(0..10) {
            0..2 => Behaviour::Idle,
            2..6 => Behaviour::Walks,
            6..8 => Behaviour::Paces,
            _ => Behaviour::Runs,
        };
        let from = if rng.random_bool(0.7) { 0 } else { rng.random_range(0..steps / 2) };
        let to = if rng.random_bool(0.8) { steps } else { rng.random_range(from + 1..=steps) };
        Some(Self {
            behaviour,
            room,
            at,
            velocity: Vec2::ZERO,
            speed: speed_max
                * if behaviour == Behaviour::Runs { 0.98 } else { rng.random_range(0.3..0.98) },
            way: Vec::new(),
            rest_s: JOINING_S,
            present: from..to,
        })
    }

    fn eye(&self, building: &SimulatedBuilding) -> Vec3 {
        Vec3::new(self.at.x, building.rooms[self.room].eye, self.at.y)
    }

    fn step(&mut self, building: &SimulatedBuilding, rng: &mut SmallRng) {
        self.rest_s -= STEP_S;
        if self.way.is_empty() && self.rest_s <= 0.0 && self.behaviour != Behaviour::Idle {
            self.choose_goal(building, rng);
        }
        let wanted = self.way.last().map_or(Vec2::ZERO, |goal| {
            let away = *goal - self.at;
            let left_m = away.length();
            let braking = (2.0 * ACCELERATION * left_m).sqrt();
            away.normalize_or_zero() * self.speed.min(braking).min(left_m / STEP_S)
        });
        let change = (wanted - self.velocity).clamp_length_max(ACCELERATION * STEP_S);
        self.velocity += change;
        let next = self.at + self.velocity * STEP_S;
        if building.is_free(Vec3::new(next.x, building.rooms[self.room].eye, next.y)) {
            self.at = next;
        } else {
            // It has run into something.
            self.velocity = Vec2::ZERO;
            self.way.clear();
        }
        if self.way.last().is_some_and(|goal| goal.distance(self.at) < 0.05) {
            self.way.pop();
            if self.way.is_empty() && self.behaviour == Behaviour::Walks && rng.random_bool(0.3) {
                self.rest_s = rng.random_range(0.0..2.0);
            }
        }
    }

    /// Puts it elsewhere, standing still.
    fn jump(&mut self, building: &SimulatedBuilding, rng: &mut SmallRng) {
        let room = rng.random_range(0..building.rooms.len());
        let place = building.place(room, rng).filter(|at| at.distance(self.at) >= JUMP_MIN_M);
        let Some(at) = place else { return };
        (self.room, self.at, self.velocity) = (room, at, Vec2::ZERO);
        self.way.clear();
    }

    /// Chooses the next goals. The first one to reach comes last.
    fn choose_goal(&mut self, building: &SimulatedBuilding, rng: &mut SmallRng) {
        let room: &BuildingRoom = &building.rooms[self.room];
        let door =
            (!room.doors.is_empty()).then(|| room.doors[rng.random_range(0..room.doors.len())]);
        match (self.behaviour, door) {
            (Behaviour::Runs, _) if rng.random_bool(0.5) => {
                let angle = rng.random_range(0.0..std::f32::consts::TAU);
                self.way = vec![self.at + Vec2::from_angle(angle) * 30.0];
            }
            (_, Some(door)) if self.behaviour == Behaviour::Paces || rng.random_bool(0.8) => {
                let beyond = building.place(door.to, rng).unwrap_or(door.far);
                self.way = vec![beyond, door.far, door.near];
                self.room = door.to;
            }
            _ => self.way = building.place(self.room, rng).into_iter().collect(),
        }
    }
}
