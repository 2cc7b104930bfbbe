//! Where the own avatar was set to be in the last moments.

use std::{collections::VecDeque, time::Duration};

use sightline_world::motion::Pose;

/// The own avatar is not moved on by itself for longer than this.
const MOVE_ON_MAX: Duration = Duration::from_millis(50);
/// How many poses are kept.
const KEPT: usize = 16;

/// The poses of the own avatar as the caller set them last.
///
/// A timer fires late on a busy machine, and by then the avatar is elsewhere. A client reports
/// where it was at its tick, so that it seems to be off its course no more often than it is.
#[derive(Clone, Debug, Default)]
pub(crate) struct OwnMotion {
    /// The last poses and their times, oldest first: at most [`KEPT`].
    set: VecDeque<(Duration, Pose)>,
}

impl OwnMotion {
    /// Takes in a pose at a time.
    pub(crate) fn set(&mut self, now: Duration, pose: Pose) {
        if self.set.len() == KEPT {
            self.set.pop_front();
        }
        self.set.push_back((now, pose));
    }

    /// Forgets all: the avatar is elsewhere.
    pub(crate) fn clear(&mut self) {
        self.set.clear();
    }

    /// The pose at a time: between those that were set before and after it, or straight on from the
    /// last one for a short while. `None` when none was set before.
    pub(crate) fn at(&self, time: Duration) -> Option<Pose> {
        let after = self.set.partition_point(|(set, _)| *set <= time);
        let (from, before) = self.set.get(after.checked_sub(1)?)?;
        let Some((to, next)) = self.set.get(after) else {
            return Some(before.straight_on(time.saturating_sub(*from).min(MOVE_ON_MAX)));
        };
        let part = (time - *from).div_duration_f32(*to - *from);
        Some(before.on_the_way_to(next, part))
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn the_avatar_is_where_it_was_at_a_time_and_goes_straight_on_for_a_short_while() {
        let mut motion = OwnMotion::default();
        assert_eq!(motion.at(ms(10)), None);
        let pose = |x: f32, yaw: f32| Pose {
            eye: Vec3::X * x,
            yaw,
            velocity: Vec3::X * 2.0,
            ..Pose::default()
        };
        motion.set(ms(100), pose(1.0, 0.0));
        motion.set(ms(200), pose(2.0, 1.0));
        let at = |time| motion.at(ms(time)).map(|pose| (pose.eye.x, pose.yaw));
        assert_eq!((at(99), at(100)), (None, Some((1.0, 0.0))));
        assert!(at(150).is_some_and(|(x, yaw)| (x - 1.5).abs() < 1e-5 && (yaw - 0.5).abs() < 1e-5));
        let ahead = [200, 220, 250, 900].map(|time| at(time).map(|(x, _)| (x * 100.0).round()));
        assert_eq!(ahead, [200.0, 204.0, 210.0, 210.0].map(Some));
        motion.clear();
        assert_eq!(motion.at(ms(200)), None);
    }

    #[test]
    fn no_more_is_kept_than_may_be() {
        let mut motion = OwnMotion::default();
        (0..1_000).for_each(|i| motion.set(ms(i), Pose::default()));
        assert_eq!(motion.set.len(), KEPT);
    }
}
