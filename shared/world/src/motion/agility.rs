use std::time::Duration;

use glam::{Vec2, Vec3};

use super::Body;
use crate::geometry::Aabb;

/// In metres a second squared.
const GRAVITY: f32 = 20.0;
/// In metres a second, where bodies fall as the game lets them.
const FALL_MAX: f32 = 45.0;

/// What a body can do of its own power: how far it can be from where it was, some time later.
///
/// An eye that moves at `v` is, `t` later, in a region that depends on `v`. Whatever a body runs
/// into takes away the part of `v` that is towards it, so that without any effort it is somewhere
/// in the ball that has the way `v t` as its diameter (Thales). It may turn aside at once by
/// [`dash`](Self::dash), and then gains speed by [`acceleration_max`](Self::acceleration_max).
/// Stairs lift and lower it, and it falls. In no case does it get further than its speed limit, or
/// the speed that it has, takes it.
///
/// What goes beyond is an *impulse*: a rocket's push, a jump pad. It is for the host to announce.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agility {
    /// No body gets faster by its own power, in metres a second.
    pub speed_max: f32,
    /// How much its velocity along the ground may change within no time, in metres a second.
    pub dash: f32,
    /// How fast its velocity along the ground changes beyond that, in metres a second squared.
    pub acceleration_max: f32,
    /// How far its eye may rise or sink within no time, in metres: a step of a stair, a crouch.
    pub step: f32,
    /// How fast stairs and jumps lift it, in metres a second.
    pub climb: f32,
    /// No body falls faster, in metres a second.
    pub fall_max: f32,
}

impl Agility {
    /// What a kind of body can do.
    ///
    /// A Quake III player accelerates at ten times its running speed of 8.1 m/s for as long as a
    /// frame of the game lasts, jumps off at 6.9 m/s, climbs steps of 0.46 m and crouches by 0.4 m.
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

    /// A box that holds the eye from now on until some time later, when it is at a place now and
    /// moves at a velocity: in whatever axes these are given, provided that y is up.
    pub fn eyes(&self, eye: Vec3, velocity: Vec3, time: Duration) -> Aabb {
        let t = time.as_secs_f32();
        let along = Vec2::new(velocity.x, velocity.z) * (0.5 * t);
        let aside = along.length() + self.dash * t + 0.5 * self.acceleration_max * t * t;
        let up = velocity.y.max(0.0) * t + self.step + self.climb * t;
        let down = (-velocity.y).max(0.0) * t + self.step + 0.5 * GRAVITY * t * t;
        let able = Aabb {
            min: eye + Vec3::new(along.x - aside, -down, along.y - aside),
            max: eye + Vec3::new(along.x + aside, up, along.y + aside),
        };
        able.intersection(&Aabb::around(eye, self.way(velocity, time)))
    }

    /// How far an eye that moves at a velocity can get in some time, in metres. One that is faster
    /// than the limit, by a fall or a push, may stay so.
    pub fn way(&self, velocity: Vec3, time: Duration) -> f32 {
        let t = time.as_secs_f32();
        let falls = if self.fall_max > self.speed_max { 0.5 * GRAVITY * t * t } else { 0.0 };
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
    fn a_walker_gets_ahead_more_than_back() {
        let time = Duration::from_millis(100);
        let eyes = PERSON.eyes(Vec3::ZERO, Vec3::X * 2.0, time);
        // 0.2 m of way, 0.14 m aside at once, 0.03 m by acceleration; stairs.
        assert!((eyes.max.x - 0.37).abs() < 1e-5, "{eyes:?}");
        assert!((eyes.min.x + 0.17).abs() < 1e-5 && (eyes.max.z - 0.27).abs() < 1e-5, "{eyes:?}");
        assert!(
            (eyes.max.y - 0.4).abs() < 1e-5 && (eyes.min.y + 0.4).abs() < 1e-5,
            "the speed limit: {eyes:?}"
        );
    }

    proptest! {
        /// Whoever runs, turns, stops at walls and runs again as the limits allow is inside.
        #[test]
        fn nobody_gets_out(
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
