//! One's own body in the building: walking, climbing stairs, jumping, falling, flying.
//!
//! No clock and no input devices: [`Walker::step`] takes a [`MoveInput`] and a time, and gives a pose
//! that the server accepts: the eye is never faster than the world allows, never out of its
//! bounds, and the body never enters a voxel.

use glam::Vec3;
use sightline_world::{
    Spawn, World,
    geometry::{Aabb, Confines},
    motion::{Agility, Body, Pose},
    octree::Octree,
};

/// What the person at the keyboard, or a simulated visitor, wants.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct MoveInput {
    /// Along the look, from -1 (back) to 1; 1 is as fast as the world allows.
    pub forward: f32,
    /// To the right, from -1 to 1.
    pub right: f32,
    /// Upward, from -1 to 1; only when flying.
    pub up: f32,
    /// As in [`Pose::yaw`].
    pub yaw: f32,
    /// As in [`Pose::pitch`].
    pub pitch: f32,
    /// No gravity.
    pub fly: bool,
    /// Leave the ground.
    pub jump: bool,
}

/// A body that moves in a building.
#[derive(Clone, Debug)]
pub struct Walker {
    body: Body,
    /// Where the eye may be.
    confines: Confines,
    agility: Agility,
    speed_max: f32,
    /// How fast it goes along the ground, in metres a second.
    drive: Vec3,
    pose: Pose,
    /// Metres a second, upward.
    rise: f32,
    grounded: bool,
    /// How much higher it may climb before it must stand again, in metres.
    climb_left: f32,
}

/// Metres a second, each second.
const GRAVITY: f32 = 9.81;

/// At most, in metres a second: enough for half a metre.
const JUMP_SPEED: f32 = 3.2;

/// No sub-step is longer, so that no body passes through a voxel.
const SUBSTEP_S: f32 = 1.0 / 120.0;

/// A longer time is cut, since what happened in it is lost anyway.
const STEP_S_MAX: f32 = 0.25;

/// How fast a body goes off at once, in metres a second: within what the server believes that it can
/// do ([`Agility::dash`](sightline_world::motion::Agility::dash)).
const START_SPEED: f32 = 1.2;
/// The part of the acceleration that the server believes in that is used.
const PUSH_SHARE: f32 = 0.95;
/// What is left to the server's rounding: the part of the speed that is used.
const SPEED_SHARE: f32 = 0.97;

/// How far a free place is searched for when the body is stuck, in metres.
const FREE_WITHIN: f32 = 3.0;

impl Walker {
    /// A body at a spawn point. Where it does not fit there it gets out step by step: the server
    /// counts from the place that it gave.
    pub fn new(world: &World, spawn: Spawn) -> Self {
        let mut walker = Self {
            body: world.body,
            confines: world.confines().grown(-0.001),
            agility: Agility::of(&world.body, world.speed_max),
            speed_max: world.speed_max,
            drive: Vec3::ZERO,
            pose: Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() },
            rise: 0.0,
            grounded: false,
            climb_left: 0.0,
        };
        walker.pose.eye = walker.within(spawn.eye);
        walker
    }

    /// Where it is now.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Whether it stands on something.
    pub fn is_grounded(&self) -> bool {
        self.grounded
    }

    /// Puts it where the server says that it is.
    pub fn place(&mut self, pose: Pose) {
        if pose.is_finite() {
            self.pose = Pose { eye: self.within(pose.eye), ..pose };
            (self.rise, self.grounded) = (0.0, false);
        }
    }

    /// Moves for `dt_s` seconds, at most a quarter of one, and tells where it is then.
    pub fn step(&mut self, octree: &Octree, wish: MoveInput, dt_s: f32) -> Pose {
        if wish.yaw.is_finite() && wish.pitch.is_finite() {
            (self.pose.yaw, self.pose.pitch) = (wish.yaw, wish.pitch);
        }
        let dt_s = if dt_s.is_finite() { dt_s.clamp(0.0, STEP_S_MAX) } else { 0.0 };
        if dt_s > 0.0 {
            let start = self.pose.eye;
            let substeps = (dt_s / SUBSTEP_S).ceil();
            for _ in 0..substeps as u32 {
                self.substep(octree, &wish, dt_s / substeps);
            }
            self.pose.velocity = (self.pose.eye - start) / dt_s;
        }
        self.pose
    }

    fn substep(&mut self, octree: &Octree, wish: &MoveInput, dt_s: f32) {
        let reach = self.speed_max * SPEED_SHARE * dt_s;
        if self.is_solid_at(octree, self.pose.eye) {
            // The server may place a body where it does not fit; it finds its way out.
            if let Some(free) = self.free_place(octree) {
                let reach = reach.min(START_SPEED * dt_s);
                self.pose.eye += (free - self.pose.eye).clamp_length_max(reach);
            }
            return;
        }
        let velocity = if wish.fly { self.flight(wish, dt_s) } else { self.gait(wish, dt_s) };
        let way = (velocity * dt_s).clamp_length_max(reach);
        let start = self.pose.eye;
        let along_x = self.slide(octree, 0, way.x);
        let along_z = self.slide(octree, 2, way.z);
        let gone = self.pose.eye - start;
        let is_stopped = gone.length_squared() < 0.25 * way.with_y(0.0).length_squared();
        if !(along_x && along_z) && is_stopped {
            // What ran into something gains speed anew.
            self.drive = Vec3::new(gone.x, 0.0, gone.z) / dt_s;
        }
        if wish.fly {
            self.slide(octree, 1, way.y);
            self.grounded = false;
            return;
        }
        let ahead = Vec3::new(way.x, 0.0, way.z) - (self.pose.eye - start);
        if !(along_x && along_z) && way.y <= 0.0 && self.can_climb(octree, ahead) {
            let left = (reach * reach - self.pose.eye.distance_squared(start)).max(0.0).sqrt();
            let height = left.min(self.climb_left);
            self.slide(octree, 1, height);
            self.climb_left -= height;
            self.rise = 0.0;
            return;
        }
        let free = self.slide(octree, 1, way.y);
        self.grounded = !free && way.y <= 0.0;
        if !free {
            self.rise = 0.0;
        }
        if self.grounded {
            self.climb_left = self.body.step_height();
        }
    }

    /// The velocity of a flying body: along the look.
    fn flight(&mut self, wish: &MoveInput, dt_s: f32) -> Vec3 {
        self.rise = 0.0;
        let right = Vec3::new(self.pose.yaw.cos(), 0.0, -self.pose.yaw.sin());
        let wanted = self.pose.forward() * share(wish.forward)
            + right * share(wish.right)
            + Vec3::Y * share(wish.up);
        let wanted = wanted.clamp_length_max(1.0) * self.speed_max * SPEED_SHARE;
        let climb = self.agility.climb.min(self.speed_max * SPEED_SHARE);
        self.driven(wanted.with_y(0.0), dt_s) + Vec3::Y * wanted.y.clamp(-climb, climb)
    }

    /// The velocity of a walking, jumping or falling body.
    fn gait(&mut self, wish: &MoveInput, dt_s: f32) -> Vec3 {
        if wish.jump && self.grounded {
            self.rise = JUMP_SPEED.min(0.7 * self.speed_max);
            self.climb_left = 0.0;
        }
        self.rise = (self.rise - GRAVITY * dt_s).max(-self.speed_max);
        let (sin, cos) = self.pose.yaw.sin_cos();
        let (ahead, right) = (Vec3::new(-sin, 0.0, -cos), Vec3::new(cos, 0.0, -sin));
        let wanted = ahead * share(wish.forward) + right * share(wish.right);
        let wanted = wanted.clamp_length_max(1.0) * self.speed_max * SPEED_SHARE;
        self.driven(wanted, dt_s) + Vec3::Y * self.rise
    }

    /// The velocity along the ground that comes next to one that is wanted. Whoever turns keeps
    /// what speed it had in its new direction, and gains more as fast as bodies can.
    fn driven(&mut self, wanted: Vec3, dt_s: f32) -> Vec3 {
        let direction = wanted.normalize_or_zero();
        let speed = self.drive.dot(direction).max(START_SPEED);
        let faster = speed + PUSH_SHARE * self.agility.acceleration_max * dt_s;
        self.drive = direction * faster.min(wanted.length());
        self.drive
    }

    /// Moves along one axis until something is in the way; whether nothing was.
    fn slide(&mut self, octree: &Octree, axis: usize, distance: f32) -> bool {
        let start = self.pose.eye;
        let at = |distance: f32| {
            let mut eye = start;
            eye[axis] += distance;
            eye
        };
        let is_free = |eye: Vec3| self.confines.contains(eye) && !self.is_solid_at(octree, eye);
        if is_free(at(distance)) {
            self.pose.eye = at(distance);
            return true;
        }
        let (mut free, mut blocked) = (0.0, distance);
        for _ in 0..5 {
            let middle = 0.5 * (free + blocked);
            if is_free(at(middle)) {
                free = middle;
            } else {
                blocked = middle;
            }
        }
        self.pose.eye = at(free);
        false
    }

    /// Whether the body fits on a step ahead, and above where it is while it climbs.
    fn can_climb(&self, octree: &Octree, ahead: Vec3) -> bool {
        let fits = |eye: Vec3| self.confines.contains(eye) && !self.is_solid_at(octree, eye);
        let voxel = octree.voxel().max(0.01);
        let tries = (self.climb_left / voxel).ceil().clamp(0.0, 64.0) as u32;
        (1..=tries)
            .map(|i| Vec3::Y * (i as f32 * voxel).min(self.climb_left))
            .take_while(|&up| fits(self.pose.eye + up))
            .any(|up| fits(self.pose.eye + up + ahead))
    }

    fn is_solid_at(&self, octree: &Octree, eye: Vec3) -> bool {
        octree.solid_in(&self.body.around(eye))
    }

    fn within(&self, eye: Vec3) -> Vec3 {
        let eye = if eye.is_finite() { eye } else { self.confines.centre() };
        self.confines.clamp(eye)
    }

    /// The nearest place where the body fits, of a few hundred around it: one that the eye sees, if
    /// there is one, since the server believes nobody who comes through a wall.
    fn free_place(&self, octree: &Octree) -> Option<Vec3> {
        let is_free = |eye: &Vec3| self.confines.contains(*eye) && !self.is_solid_at(octree, *eye);
        let is_seen = |place: &Vec3| is_free(place) && self.sees(octree, *place);
        self.place_near(octree, is_seen).or_else(|| self.place_near(octree, is_free))
    }

    /// The nearest good place: above, aside, slanting up, below, slanting down.
    fn place_near(&self, octree: &Octree, is_good: impl Fn(&Vec3) -> bool) -> Option<Vec3> {
        let eye = self.pose.eye;
        if is_good(&eye) {
            return Some(eye);
        }
        let step = octree.voxel().max(0.05);
        let rings = (FREE_WITHIN / step).ceil().min(64.0) as i32;
        (1..=rings).find_map(|ring| {
            let distance = ring as f32 * step;
            // Up first: most bodies that do not fit stand a little too low.
            let up = Vec3::Y * distance;
            let around = (0..8).map(|i| Vec3::from_array(around_circle(i)) * distance);
            let slanted =
                |up: Vec3| around.clone().map(move |side| (side + up).normalize() * distance);
            let above = [up].into_iter().chain(around.clone()).chain(slanted(up));
            let places = above.chain([-up]).chain(slanted(-up));
            places.map(|offset| eye + offset).find(&is_good)
        })
    }

    /// Whether no voxel is between the eye and a place, but for one that the eye itself is in.
    fn sees(&self, octree: &Octree, place: Vec3) -> bool {
        let eye = self.pose.eye;
        let pieces = (eye.distance(place) / octree.voxel().max(0.01)).ceil().max(1.0);
        let at = |i: u32| eye.lerp(place, i as f32 / pieces);
        let is_solid = |i: u32| {
            let piece = Aabb::from_points([at(i), at(i + 1)]);
            octree.solid_in(&piece.grown(0.01))
        };
        let first = u32::from(is_solid(0));
        !(first..pieces as u32).any(is_solid)
    }
}

/// The i-th of eight level directions.
fn around_circle(i: i32) -> [f32; 3] {
    let (sin, cos) = (i as f32 * std::f32::consts::FRAC_PI_4).sin_cos();
    [cos, 0.0, sin]
}

/// A wish from -1 to 1; nothing when it is no number.
fn share(wish: f32) -> f32 {
    if wish.is_finite() { wish.clamp(-1.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests;
