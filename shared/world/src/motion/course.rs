//! Courses: where an avatar will be if it goes on as it last said.
//!
//! A client says where its avatar is, how it moves and how it turns. From that everybody computes
//! the same course: straight on, turning evenly, and on a parabola in free fall. The client speaks
//! again when its avatar *departs* from the course by more than a tolerance. Its silence means that
//! the avatar is on course.
//! (Sudarsky and Gotsman 1996, section 3.2, sweep a volume along a known trajectory.)

use std::{
    f32::consts::{PI, TAU},
    time::Duration,
};

use glam::Vec3;

use super::{Agility, FREE_FALL, Pose};

/// No course is followed for longer. It exceeds the keep-alive and the time that a report takes.
pub const COURSE_MAX: Duration = Duration::from_secs(6);
/// A viewer can hardly tell that an avatar is shown off its true place by its distance over this.
/// In a picture that is 1,280 pixels wide with an angle of 90 degrees the avatar is then off by ten
/// pixels at most.
pub const ACUITY_DISTANCES: f32 = 64.0;
/// A client that stays on course reports after this time.
pub const KEEP_ALIVE: Duration = Duration::from_secs(4);
/// An avatar that stands still may be off its course by this part of the tolerance.
const STANDING_PART: f32 = 0.3;
/// From this speed on an avatar may be off its course by the whole tolerance, in metres per second.
/// Walkers depart seldom and stay near corners for long, so a smaller tolerance suits them.
const RUNNING: f32 = 3.0;

impl Pose {
    /// Where an avatar with this pose is after a time, if it stays on course.
    #[must_use]
    pub fn on_course(&self, elapsed: Duration, agility: &Agility) -> Self {
        let sustained = agility.sustained(self.velocity);
        let later = Self { velocity: sustained, ..*self }.straight_on(elapsed);
        Self { velocity: later.velocity + (self.velocity - sustained), ..later }
    }

    /// Where an avatar with this pose is after a time, if it keeps its velocity, or falls.
    #[must_use]
    pub fn straight_on(&self, elapsed: Duration) -> Self {
        let seconds = elapsed.min(COURSE_MAX).as_secs_f32();
        let faster = Vec3::NEG_Y * if self.falls { FREE_FALL * seconds } else { 0.0 };
        // A host may name any finite rate.
        let turn = (self.yaw_rate * seconds).clamp(f32::MIN, f32::MAX);
        Self {
            eye: self.eye + (self.velocity + 0.5 * faster) * seconds,
            yaw: (self.yaw + turn).rem_euclid(TAU),
            velocity: self.velocity + faster,
            ..*self
        }
    }
}

/// The part of a velocity along the ground.
///
/// This is no closure: Rust 1.95 lets a closure change an argument that its caller reads again.
fn level(velocity: Vec3) -> Vec3 {
    velocity.with_y(0.0)
}

/// The shorter turn from one yaw to another, in radians: from -π to π.
pub fn turn_between(from: f32, to: f32) -> f32 {
    (to - from + PI).rem_euclid(TAU) - PI
}

/// What a live client may leave unsaid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// By how much the eye of a running avatar may be off its course along the ground, in metres;
    /// half as much in height. Zero means that the client reports at every tick.
    pub metres: f32,
    /// By how much yaw and pitch may be off, in radians.
    pub radians: f32,
    /// The time ahead for which the server computes regions from the course.
    pub ahead: Duration,
}

impl Tolerance {
    /// No tolerance: the client reports at every tick.
    pub const NONE: Self = Self { metres: 0.0, radians: 0.0, ahead: Duration::ZERO };

    /// Whether the client must report at every tick.
    pub fn is_none(&self) -> bool {
        self.metres <= 0.0
    }

    /// Whether wherever this tolerance allows an avatar to be is allowed by another one, too. How
    /// far it may be turned does not count, since no region depends on that.
    pub fn is_within(&self, other: &Self) -> bool {
        self.is_none() || self.metres <= other.metres && self.ahead >= other.ahead
    }

    /// The tolerance of an avatar that should be on this course. One that stands still hardly
    /// departs, so a small tolerance costs it no reports and keeps its regions small.
    #[must_use]
    pub fn along(&self, course: &Pose) -> Self {
        // Server and client must agree, and only in free fall does the speed change on the way.
        if course.falls {
            return *self;
        }
        let part = STANDING_PART + (1.0 - STANDING_PART) * course.velocity.length() / RUNNING;
        Self { metres: self.metres * part.min(1.0), ..*self }
    }

    /// A tolerance that allows all that this one or another one does.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        if self.is_none() || other.is_none() {
            return if self.is_none() { *other } else { *self };
        }
        Self {
            metres: self.metres.max(other.metres),
            radians: self.radians.max(other.radians),
            ahead: self.ahead.min(other.ahead),
        }
    }

    /// Whether an avatar is on its course: it is where it should be, and what its body can do from
    /// there is within what the server allows for.
    ///
    /// The second condition is about velocity. Regions are bounded by
    /// [`Agility::eyes`], whose sides differ by a part that is linear in time. So if the
    /// region from the true pose is within the region from the course, grown by
    /// [`Tolerance::growth_m`], now and after `ahead`, it is so at all times.
    ///
    /// How the avatar is turned is [another question](Tolerance::holds_turn).
    pub fn holds(&self, course: &Pose, pose: &Pose, agility: &Agility) -> bool {
        if self.is_none() {
            return false;
        }
        let here = self.along(course);
        let off = pose.eye - course.eye;
        off.with_y(0.0).length() <= here.metres
            && off.y.abs() <= 0.5 * here.metres
            && here.excess_m(course, pose, agility) <= here.growth_m(here.ahead)
    }

    /// Whether an avatar is turned as its course says.
    pub fn holds_turn(&self, course: &Pose, pose: &Pose) -> bool {
        let turned = turn_between(course.yaw, pose.yaw);
        turned.abs() <= self.radians && (pose.pitch - course.pitch).abs() <= self.radians
    }

    /// By how much a region from the course must grow on each side so that it contains what a body
    /// can do that is on course within this tolerance, for a time after it was. The tolerance is
    /// that [along](Tolerance::along) the course.
    pub fn growth_m(&self, time: Duration) -> f32 {
        if self.is_none() {
            return 0.0;
        }
        let part = time.as_secs_f32() / self.ahead.as_secs_f32().max(1e-3);
        // Beyond `ahead` a difference goes on to grow as it may have grown before.
        self.metres * (2.0 * part - 1.0).max(1.0)
    }

    /// By how much the region from a pose may stick out of the region from the course after
    /// `ahead`, in metres.
    fn excess_m(&self, course: &Pose, pose: &Pose, agility: &Agility) -> f32 {
        let seconds = self.ahead.as_secs_f32();
        let off = pose.eye - course.eye;
        let [v, c] = [pose.velocity, course.velocity].map(|velocity| agility.sustained(velocity));
        // Along the ground both regions are within circles about the middle of the way.
        let centres = level(off + (v - c) * (0.5 * seconds)).length();
        let aside = centres + 0.5 * seconds * (level(v).length() - level(c).length());
        let up = off.y + seconds * (v.y.max(0.0) - c.y.max(0.0));
        let down = -off.y + seconds * ((-v.y).max(0.0) - (-c.y).max(0.0));
        let [speed_v, speed_c] = [v, c].map(|velocity| velocity.length().max(agility.speed_max));
        let way = off.length() + seconds * (speed_v - speed_c);
        aside.max(up).max(down).max(way)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::motion::Body;

    fn agility() -> Agility {
        Agility::of(&Body::PERSON, 4.0)
    }

    fn tolerance(metres: f32) -> Tolerance {
        Tolerance { metres, radians: 0.1, ahead: Duration::from_millis(200) }
    }

    fn walking(x: f32, speed: f32) -> Pose {
        Pose { eye: Vec3::X * x, velocity: Vec3::X * speed, ..Pose::default() }
    }

    #[test]
    fn a_course_stays_finite_at_any_rate_of_turning() {
        for yaw_rate in [f32::MAX, f32::MIN, 1e38] {
            let later = Pose { yaw: 6.0, yaw_rate, ..Pose::default() }.straight_on(COURSE_MAX);
            assert!(later.is_finite(), "{later:?}");
        }
    }

    #[test]
    fn a_course_is_straight_and_turns_evenly() {
        let pose = Pose { yaw: 6.0, yaw_rate: 1.0, ..walking(1.0, 2.0) };
        let later = pose.on_course(Duration::from_millis(500), &agility());
        assert_eq!(later.eye, Vec3::X * 2.0);
        assert!((later.yaw - (6.5 - TAU)).abs() < 1e-5, "{}", later.yaw);
        let jump = Pose { velocity: Vec3::Y * 5.0, falls: true, ..Pose::default() };
        let later = jump.on_course(Duration::from_millis(500), &agility());
        let sustained = 4.0;
        assert!((later.eye.y - (0.5 * sustained - 0.125 * FREE_FALL)).abs() < 1e-5);
        assert!((later.velocity.y - (5.0 - 0.5 * FREE_FALL)).abs() < 1e-5);
        let fast = walking(0.0, 50.0).on_course(Duration::from_secs(1), &agility());
        assert_eq!(fast.eye, Vec3::X * 4.0, "nobody sustains more than the top speed");
    }

    #[test]
    fn a_walker_departs_by_place_by_direction_and_by_starting_but_not_by_stopping() {
        let (tolerance, agility) = (tolerance(0.05), agility());
        let holds = |course: Pose, pose: Pose| tolerance.holds(&course, &pose, &agility);
        assert!(holds(walking(0.0, 3.0), walking(0.04, 3.0)));
        assert!(!holds(walking(0.0, 3.0), walking(0.06, 3.0)));
        assert!(!holds(walking(0.0, 1.2), walking(0.04, 1.2)), "who walks may depart by less");
        assert!(holds(walking(0.0, 1.2), walking(0.0, 0.0)), "what it can do is less");
        assert!(!holds(walking(0.0, 0.0), walking(0.0, 1.2)));
        let turned = |by: f32| Pose { yaw: TAU - by, ..Pose::default() };
        assert!(!tolerance.holds_turn(&walking(0.0, 0.0), &turned(0.11)));
        assert!(tolerance.holds_turn(&walking(0.0, 0.0), &turned(0.09)));
        assert!(!Tolerance::NONE.holds(&walking(0.0, 0.0), &walking(0.0, 0.0), &agility));
    }

    #[test]
    fn who_stands_may_depart_by_less_and_who_falls_by_as_much_as_who_runs() {
        let metres = |course: Pose| tolerance(0.1).along(&course).metres;
        assert!((metres(walking(0.0, 0.0)) - 0.03).abs() < 1e-6);
        assert!((metres(walking(0.0, 1.5)) - 0.065).abs() < 1e-6);
        assert_eq!([3.0, 3.9].map(|speed| metres(walking(0.0, speed))), [0.1; 2]);
        assert_eq!(metres(Pose { falls: true, ..Pose::default() }), 0.1);
    }

    fn vector(most: f32) -> impl Strategy<Value = Vec3> {
        proptest::array::uniform3(-most..most).prop_map(Vec3::from)
    }

    proptest! {
        /// What a body on course can do stays within the grown region of the course, in any axes.
        #[test]
        fn the_grown_region_contains_what_a_body_on_course_can_do(
            course in vector(6.0),
            change in vector(0.5),
            off in vector(0.5),
            metres in 0.02..0.3f32,
            time_ms in 0u64..1_000,
            turn in 0.0..1.6f32,
            is_quake in any::<bool>(),
        ) {
            let agility = if is_quake { Agility::of(&Body::QUAKE, 8.1) } else { agility() };
            let tolerance = tolerance(metres);
            let course = Pose { velocity: course, ..Pose::default() };
            let off = off * metres;
            let pose = Pose { eye: off, velocity: course.velocity + change, ..course };
            prop_assume!(tolerance.holds(&course, &pose, &agility));
            let time = Duration::from_millis(time_ms);
            let turned = |v: Vec3| glam::Quat::from_rotation_y(turn) * v;
            let eyes = |pose: &Pose| {
                agility.eyes(turned(pose.eye), turned(agility.sustained(pose.velocity)), time)
            };
            let grown = eyes(&course).grown(tolerance.along(&course).growth_m(time) + 1e-4);
            prop_assert!(grown.contains_box(&eyes(&pose)), "{:?} {:?}", grown, eyes(&pose));
        }
    }
}
