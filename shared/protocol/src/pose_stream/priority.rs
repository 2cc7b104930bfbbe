//! Which courses go first where one datagram does not hold all.
//!
//! Each course that waits gathers priority at each tick: by how large the avatar is on the viewer's
//! screen, how fast it is, and how far off it is shown by now. Those near by come before all
//! others, and those that have waited for long come before these.

use std::{cmp::Ordering, time::Duration};

use glam::Vec3;
use sightline_world::motion::AvatarId;

use super::courses::Course;
use crate::quantise::{SPEED_UNITS, WirePose};

/// Avatars within this distance of their viewer come first, in metres.
pub const NEAR_M: f32 = 10.0;
/// The encoder finds the near ones anew only every few ticks. Two people come closer in that time by
/// no more than this, in metres.
const NEAR_SLACK_M: f32 = 2.0;
/// A course that has waited for this long comes before all that have not.
pub const OVERDUE: Duration = Duration::from_millis(1_500);
/// How far a turn by a radian moves the side of a body, in metres.
const TURN_M: f32 = 0.25;
/// Even an avatar that is shown where it is gathers priority as if it were so far off, in metres.
const ERROR_MIN_M: f32 = 0.02;

/// A course that waits to be sent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waiting {
    pub(super) avatar: AvatarId,
    pub(super) course: Course,
    /// The course that was sent last. It is kept here too, because in a crowd a look at what was
    /// sent costs more than all else.
    pub(super) sent: Option<Course>,
    /// The tick since which the viewer is shown something else.
    pub(super) since: u32,
    /// What it has gathered.
    pub(super) priority: f32,
    /// What it gathers in a tick, and whether its avatar is near. In a crowd that is found anew
    /// only every few ticks; the tick at which it was found last is `None` before.
    pub(super) weight: f32,
    pub(super) is_near: bool,
    pub(super) weighed: Option<u32>,
}

impl Waiting {
    /// A course that waits since its own tick.
    pub(super) fn new(avatar: AvatarId, course: Course, sent: Option<Course>) -> Self {
        let (priority, weight, is_near, weighed) = (0.0, 0.0, false, None);
        Self { avatar, course, sent, since: course.tick, priority, weight, is_near, weighed }
    }
}

/// In which turn a course goes, the first first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Turn {
    /// It has waited for long.
    Overdue,
    /// Its avatar is near.
    Near,
    /// Others.
    Far,
    /// It may go again with a datagram that is sent anyway.
    Along,
}

impl Turn {
    /// That of a course that must go, and has waited for this long.
    pub(super) fn of_new(waited: Duration, is_near: bool) -> Self {
        match () {
            () if waited >= OVERDUE => Self::Overdue,
            () if is_near => Self::Near,
            () => Self::Far,
        }
    }
}

/// The order of a course among all that are due.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rank {
    pub(super) turn: Turn,
    pub(super) priority: f32,
}

impl Rank {
    /// The higher priority is first.
    pub(super) fn compare(&self, other: &Self) -> Ordering {
        self.turn.cmp(&other.turn).then(other.priority.total_cmp(&self.priority))
    }
}

/// What a viewer whose eye is at a place makes of a course: the priority that it gathers in a tick,
/// and whether the avatar is near. `shown` is where the viewer is shown the avatar; without it, the
/// error is what the avatar goes in the time that it waits.
pub(super) fn weigh(
    from: Vec3,
    shown: Option<&WirePose>,
    pose: &WirePose,
    [waited, interval]: [Duration; 2],
) -> (f32, bool) {
    let eye = Vec3::from(pose.position);
    let away_m = from.distance(eye);
    let speed = Vec3::from_array(pose.velocity.map(f32::from)).length() / SPEED_UNITS;
    let error_m = match shown {
        Some(shown) => {
            let turned = pose.yaw.wrapping_sub(shown.yaw).cast_signed();
            let turned = f32::from(turned).abs() / 65_536.0 * std::f32::consts::TAU;
            eye.distance(shown.position.into()) + TURN_M * turned
        }
        None => speed * waited.as_secs_f32(),
    };
    let size = 1.0 / away_m.max(1.0);
    let weight = (error_m.max(ERROR_MIN_M) + speed * interval.as_secs_f32()) * size;
    (weight, away_m <= NEAR_M + NEAR_SLACK_M)
}
