//! What bodies can do of their own power.

use std::time::Duration;

use glam::{Vec2, Vec3};

use super::{Body, FREE_FALL};
use crate::geometry::Aabb;

/// The terminal speed of falling bodies in Quake maps, in metres per second.
const FALL_MAX: f32 = 45.0;

/// What a body can do of its own power. It bounds how far the body moves in a given time.
///
/// An eye that moves at `v` is in a region that depends on `v` after a time `t`. An obstacle takes
/// away the component of `v` towards it. So a body without effort stays in the ball whose diameter
/// is the path `v t` (Thales). A body can change its velocity by [`dash`](Self::dash) at once, and
/// accelerates by [`acceleration_max`](Self::acceleration_max) afterwards. Stairs lift and lower
/// it, and it falls. The speed limit bounds the whole motion, or the body's own speed if that is
/// higher.
///
/// A faster motion is an *impulse*, such as a rocket's push or a jump pad. The host announces it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agility {
    /// The greatest speed that a body reaches by its own power, in metres per second.
    pub speed_max: f32,
    /// The greatest instant change of the velocity along the ground, in metres per second.
    pub dash: f32,
    /// The acceleration along the ground on top of the dash, in metres per second squared.
    pub acceleration_max: f32,
    /// The greatest instant change of the eye's height, in metres: a step of a stair, or a crouch.
    pub step: f32,
    /// The speed at which stairs and jumps lift the eye, in metres per second.
    pub climb: f32,
    /// The greatest speed of a falling body, in metres per second.
    pub fall_max: f32,
}

impl Agility {
    /// The agility of a kind of body.
    ///
    /// A Quake III player runs at 8.1 m/s and accelerates at ten times that speed per second, for
    /// one frame of the game. It jumps at 6.9 m/s, climbs steps of 0.46 m and crouches by 0.4 m.
    pub fn of(body: &Body, speed_max: f32) -> Self {
        if *body == Body::QUAKE {
            Self {
                speed_max,
                dash: 4.0,
                acceleration_max: 40.0,
                step: 0.46,
                climb: 3.0,
                fall_max: FALL_MAX.max(speed_max),
            }
        } else {
            Self {
                speed_max,
                dash: 1.4,
                acceleration_max: 6.0,
                step: 0.35,
                climb: 2.0,
                fall_max: speed_max,
            }
        }
    }

    /// Whether every limit is a number of at least zero. Otherwise regions would be too small.
    fn is_valid(&self) -> bool {
        let Self { speed_max, dash, acceleration_max, step, climb, fall_max } = *self;
        [speed_max, dash, acceleration_max, step, climb, fall_max]
            .into_iter()
            .all(|limit| limit >= 0.0)
    }

    /// The part of a velocity that a body can keep up of its own power.
    pub fn sustained(&self, velocity: Vec3) -> Vec3 {
        let aside = velocity.with_y(velocity.y.max(0.0)).clamp_length_max(self.speed_max);
        let fall = velocity.y.clamp(-self.fall_max.max(self.speed_max), 0.0);
        aside + Vec3::Y * fall
    }

    /// A box that contains the eye from now until `time` has passed. The eye is at `eye` now, and
    /// moves at `velocity`. Any axes will do if y is up.
    pub fn eyes(&self, eye: Vec3, velocity: Vec3, time: Duration) -> Aabb {
        debug_assert!(self.is_valid(), "{self:?} bounds no motion");
        let t = time.as_secs_f32();
        let along = Vec2::new(velocity.x, velocity.z) * (0.5 * t);
        let aside = along.length() + self.dash * t + 0.5 * self.acceleration_max * t * t;
        let up = velocity.y.max(0.0) * t + self.step + self.climb * t;
        let down = (-velocity.y).max(0.0) * t + self.step + 0.5 * FREE_FALL * t * t;
        let able = Aabb {
            min: eye + Vec3::new(along.x - aside, -down, along.y - aside),
            max: eye + Vec3::new(along.x + aside, up, along.y + aside),
        };
        able.intersection(&Aabb::around(eye, self.way(velocity, time)))
    }

    /// The greatest distance that an eye moving at `velocity` covers in `time`, in metres. An eye
    /// that is faster than the limit, because of a fall or a push, may keep its speed.
    pub fn way(&self, velocity: Vec3, time: Duration) -> f32 {
        let t = time.as_secs_f32();
        let falls = if self.fall_max > self.speed_max { 0.5 * FREE_FALL * t * t } else { 0.0 };
        velocity.length().max(self.speed_max) * t + falls
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PERSON: Agility = Agility {
        speed_max: 4.0,
        dash: 1.4,
        acceleration_max: 6.0,
        step: 0.35,
        climb: 2.0,
        fall_max: 4.0,
    };

    #[test]
    fn a_walker_moves_farther_ahead_than_back() {
        let time = Duration::from_millis(100);
        let eyes = PERSON.eyes(Vec3::ZERO, Vec3::X * 2.0, time);
        // A path of 0.2 m, 0.14 m by the dash, 0.03 m by acceleration; then stairs.
        assert!((eyes.max.x - 0.37).abs() < 1e-5, "{eyes:?}");
        assert!((eyes.min.x + 0.17).abs() < 1e-5 && (eyes.max.z - 0.27).abs() < 1e-5, "{eyes:?}");
        assert!(
            (eyes.max.y - 0.4).abs() < 1e-5 && (eyes.min.y + 0.4).abs() < 1e-5,
            "the speed limit: {eyes:?}"
        );
    }

    proptest! {
        /// Bodies run, turn, stop at walls and run again, all within the limits.
        #[test]
        fn no_eye_leaves_its_box(
            turns in proptest::collection::vec((-3.2..3.2f32, 0.0..1.0f32, 0.0..1.0f32), 40),
            heading in -3.2..3.2f32,
            speed in 0.0..4.0f32,
        ) {
            let step_s = 0.01;
            let start = Vec3::new(heading.cos(), 0.0, heading.sin()) * speed;
            let (mut eye, mut velocity) = (Vec3::ZERO, start);
            for (i, (turn, push, wall)) in turns.into_iter().enumerate() {
                let towards = Vec3::new(turn.cos(), 0.0, turn.sin());
                if wall < 0.1 {
                    velocity -= towards * velocity.dot(towards).max(0.0);
                }
                velocity += towards * push * PERSON.acceleration_max * step_s;
                velocity = velocity.clamp_length_max(PERSON.speed_max);
                eye += velocity * step_s;
                let time = Duration::from_secs_f32(step_s * (i + 1) as f32);
                let eyes = PERSON.eyes(Vec3::ZERO, start, time).grown(1e-4);
                prop_assert!(eyes.contains(eye), "{} {:?} {:?}", eye, eyes, time);
            }
        }
    }
}
