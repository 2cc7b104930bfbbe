//! The own body in the building: walking, climbing stairs, jumping, falling and flying.
//!
//! [`Walker::step`] takes a [`MoveInput`] and a time, and returns a pose that the server accepts:
//! the eye is never faster than the world allows and never leaves its bounds, and the body never
//! enters a voxel. There is no clock and no input device.

use glam::Vec3;
use sightline_world::{
    Spawn, World,
    geometry::{Aabb, Confines},
    motion::{Agility, Body, Pose},
    octree::Octree,
    tolerance::INWARD_M,
};

/// How a person at the keyboard, or a simulated visitor, wants to move.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct MoveInput {
    /// Speed in the direction of view, from -1 (backwards) to 1, as a share of the world's speed
    /// limit.
    pub forward: f32,
    /// Speed to the right, from -1 to 1.
    pub right: f32,
    /// Speed upward, from -1 to 1. It counts only when flying.
    pub up: f32,
    /// The heading, as in [`Pose::yaw`].
    pub yaw: f32,
    /// The elevation of the view, as in [`Pose::pitch`].
    pub pitch: f32,
    /// Whether the body flies, without gravity.
    pub fly: bool,
    /// Whether the body jumps if it stands.
    pub jump: bool,
}

/// A body that moves in a building.
#[derive(Clone, Debug)]
pub struct Walker {
    body: Body,
    /// The region that the eye does not leave.
    confines: Confines,
    agility: Agility,
    /// The speed limit, in metres a second.
    speed_max: f32,
    /// The velocity along the ground, in metres a second.
    drive: Vec3,
    pose: Pose,
    /// The velocity upward, in metres a second.
    rise: f32,
    grounded: bool,
    /// How much higher the body may climb before it must stand again, in metres.
    climb_left: f32,
}

/// In metres a second squared.
const GRAVITY: f32 = 9.81;

/// The speed at which a jump begins, in metres a second: enough for half a metre.
const JUMP_SPEED: f32 = 3.2;

/// The longest sub-step, in seconds. No body passes through a voxel within it.
const SUBSTEP_S: f32 = 1.0 / 120.0;

/// The longest step, in seconds. A longer one is cut, because input during it is lost anyway.
const STEP_S_MAX: f32 = 0.25;

/// The speed that a body has at once, in metres a second. It is below what the server accepts
/// ([`Agility::dash`](sightline_world::motion::Agility::dash)).
const START_SPEED: f32 = 1.2;
/// The share used of the acceleration that the server accepts.
const PUSH_SHARE: f32 = 0.95;
/// The share used of the speed limit. The rest covers the rounding of poses on the wire.
const SPEED_SHARE: f32 = 0.97;

const _: () = assert!(PUSH_SHARE < 1.0 && SPEED_SHARE < 1.0, "the server checks the limits");

/// A body that is blocked within this distance counts as touching what is there, in metres. It
/// spares bodies that stand or walk most of the tests against voxels.
const TOUCHING_M: f32 = 1e-3;

/// How far a stuck body searches for a free place, in metres.
const FREE_WITHIN: f32 = 3.0;

impl Walker {
    /// A body at a spawn point. Where the body does not fit, [`Walker::step`] moves it out slowly,
    /// because the server measures its way from the spawn point.
    pub fn new(world: &World, spawn: Spawn) -> Self {
        let mut walker = Self {
            body: world.body,
            confines: world.confines().grown(-INWARD_M),
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

    /// The pose of the body.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Whether the body stands on something.
    pub fn is_grounded(&self) -> bool {
        self.grounded
    }

    /// Puts the body where the server says that it is. A pose that is not finite is ignored.
    pub fn place(&mut self, pose: Pose) {
        if pose.is_finite() {
            self.pose = Pose { eye: self.within(pose.eye), ..pose };
            (self.rise, self.grounded) = (0.0, false);
        }
    }

    /// Moves the body for `dt_s` seconds, at most a quarter of a second. Returns its pose then.
    pub fn step(&mut self, octree: &Octree, input: MoveInput, dt_s: f32) -> Pose {
        if input.yaw.is_finite() && input.pitch.is_finite() {
            (self.pose.yaw, self.pose.pitch) = (input.yaw, input.pitch);
        }
        let dt_s = if dt_s.is_finite() { dt_s.clamp(0.0, STEP_S_MAX) } else { 0.0 };
        if dt_s > 0.0 {
            let start = self.pose.eye;
            let substeps = (dt_s / SUBSTEP_S).ceil();
            for _ in 0..substeps as u32 {
                self.substep(octree, &input, dt_s / substeps);
            }
            self.pose.velocity = (self.pose.eye - start) / dt_s;
            let limit = self.speed_max * (1.0 + f32::EPSILON);
            debug_assert!(self.pose.velocity.length() <= limit, "{}", self.pose.velocity);
        }
        debug_assert!(self.pose.is_finite(), "{:?}", self.pose);
        self.pose
    }

    /// Moves the body for at most [`SUBSTEP_S`].
    fn substep(&mut self, octree: &Octree, input: &MoveInput, dt_s: f32) {
        let reach = self.speed_max * SPEED_SHARE * dt_s;
        if self.is_solid_at(octree, self.pose.eye) {
            // The server may have put the body where it does not fit. It finds its way out.
            if let Some(free) = self.free_place(octree) {
                let reach = reach.min(START_SPEED * dt_s);
                self.pose.eye += (free - self.pose.eye).clamp_length_max(reach);
            }
            return;
        }
        let velocity = if input.fly { self.flight(input, dt_s) } else { self.gait(input, dt_s) };
        let way = (velocity * dt_s).clamp_length_max(reach);
        let start = self.pose.eye;
        let along_x = self.slide(octree, 0, way.x);
        let along_z = self.slide(octree, 2, way.z);
        let gone = self.pose.eye - start;
        let is_stopped = gone.length_squared() < 0.25 * way.with_y(0.0).length_squared();
        if !(along_x && along_z) && is_stopped {
            // A body that ran into something accelerates anew.
            self.drive = Vec3::new(gone.x, 0.0, gone.z) / dt_s;
        }
        if input.fly {
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

    /// The velocity of a flying body, in metres a second: forward is the direction of view.
    fn flight(&mut self, input: &MoveInput, dt_s: f32) -> Vec3 {
        self.rise = 0.0;
        let right = Vec3::new(self.pose.yaw.cos(), 0.0, -self.pose.yaw.sin());
        let wanted = self.pose.forward() * share(input.forward)
            + right * share(input.right)
            + Vec3::Y * share(input.up);
        let wanted = wanted.clamp_length_max(1.0) * self.speed_max * SPEED_SHARE;
        let climb = self.agility.climb.min(self.speed_max * SPEED_SHARE);
        self.driven(wanted.with_y(0.0), dt_s) + Vec3::Y * wanted.y.clamp(-climb, climb)
    }

    /// The velocity of a walking, jumping or falling body, in metres a second.
    fn gait(&mut self, input: &MoveInput, dt_s: f32) -> Vec3 {
        if input.jump && self.grounded {
            self.rise = JUMP_SPEED.min(0.7 * self.speed_max);
            self.climb_left = 0.0;
        }
        self.rise = (self.rise - GRAVITY * dt_s).max(-self.speed_max);
        let (sin, cos) = self.pose.yaw.sin_cos();
        let (ahead, right) = (Vec3::new(-sin, 0.0, -cos), Vec3::new(cos, 0.0, -sin));
        let wanted = ahead * share(input.forward) + right * share(input.right);
        let wanted = wanted.clamp_length_max(1.0) * self.speed_max * SPEED_SHARE;
        self.driven(wanted, dt_s) + Vec3::Y * self.rise
    }

    /// The velocity along the ground after a sub-step towards a wanted one, in metres a second. A
    /// body that turns keeps the component of its velocity in the new direction and accelerates as
    /// bodies can.
    fn driven(&mut self, wanted: Vec3, dt_s: f32) -> Vec3 {
        let direction = wanted.normalize_or_zero();
        let speed = self.drive.dot(direction).max(START_SPEED);
        let faster = speed + PUSH_SHARE * self.agility.acceleration_max * dt_s;
        self.drive = direction * faster.min(wanted.length());
        self.drive
    }

    /// Moves the body along one axis until something is in the way. Returns whether nothing was.
    fn slide(&mut self, octree: &Octree, axis: usize, distance: f32) -> bool {
        if distance == 0.0 {
            return true;
        }
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
        if distance.abs() < TOUCHING_M {
            return false;
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

    /// Whether the body fits on a step ahead, and can rise to it.
    fn can_climb(&self, octree: &Octree, ahead: Vec3) -> bool {
        let fits = |eye: Vec3| self.confines.contains(eye) && !self.is_solid_at(octree, eye);
        let voxel = octree.voxel().max(0.01);
        let tries = (self.climb_left / voxel).ceil().clamp(0.0, 64.0) as u32;
        (1..=tries)
            .map(|i| Vec3::Y * (i as f32 * voxel).min(self.climb_left))
            .take_while(|&up| fits(self.pose.eye + up))
            .any(|up| fits(self.pose.eye + up + ahead))
    }

    /// Whether the body does not fit at an eye.
    fn is_solid_at(&self, octree: &Octree, eye: Vec3) -> bool {
        octree.solid_in(&self.body.around(eye))
    }

    /// The nearest eye within the confines; their centre for an eye that is not finite.
    fn within(&self, eye: Vec3) -> Vec3 {
        let eye = if eye.is_finite() { eye } else { self.confines.centre() };
        self.confines.clamp(eye)
    }

    /// The nearest place where the body fits, of a few hundred around it. Places that the eye sees
    /// come first, because the server rejects a way through a wall.
    fn free_place(&self, octree: &Octree) -> Option<Vec3> {
        let is_free = |eye: &Vec3| self.confines.contains(*eye) && !self.is_solid_at(octree, *eye);
        let is_seen = |place: &Vec3| is_free(place) && self.sees(octree, *place);
        self.place_near(octree, is_seen).or_else(|| self.place_near(octree, is_free))
    }

    /// The nearest good place around the eye: above, aside, slanting up, below or slanting down.
    fn place_near(&self, octree: &Octree, is_good: impl Fn(&Vec3) -> bool) -> Option<Vec3> {
        let eye = self.pose.eye;
        if is_good(&eye) {
            return Some(eye);
        }
        let step = octree.voxel().max(0.05);
        let rings = (FREE_WITHIN / step).ceil().min(64.0) as i32;
        (1..=rings).find_map(|ring| {
            let distance = ring as f32 * step;
            // Above comes first: most bodies that do not fit stand slightly too low.
            let up = Vec3::Y * distance;
            let around = (0..8).map(|i| Vec3::from_array(around_circle(i)) * distance);
            let slanted =
                |up: Vec3| around.clone().map(move |side| (side + up).normalize() * distance);
            let above = [up].into_iter().chain(around.clone()).chain(slanted(up));
            let places = above.chain([-up]).chain(slanted(-up));
            places.map(|offset| eye + offset).find(&is_good)
        })
    }

    /// Whether no voxel is between the eye and a place, except one that contains the eye.
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

/// The i-th of eight horizontal directions.
fn around_circle(i: i32) -> [f32; 3] {
    let (sin, cos) = (i as f32 * std::f32::consts::FRAC_PI_4).sin_cos();
    [cos, 0.0, sin]
}

/// An input clamped to -1 and 1; zero when it is not finite.
fn share(input: f32) -> f32 {
    if input.is_finite() { input.clamp(-1.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests;
