//! Where each visitor was in the last seconds.

use std::{
    collections::{HashMap, VecDeque},
    time::Duration,
};

use glam::Vec3;
use sightline_world::motion::{AvatarId, Pose};

use super::STEP;

/// How long the past poses of a visitor are kept.
pub const HISTORY: Duration = Duration::from_secs(3);

/// Where each visitor was in the last seconds. Times are those since all visitors were in.
#[derive(Default)]
pub struct Histories {
    visitors: HashMap<AvatarId, History>,
}

/// The past poses of one visitor, oldest first.
#[derive(Default)]
pub struct History {
    poses: VecDeque<(Duration, Pose)>,
}

impl Histories {
    /// Takes in where a visitor is now.
    pub fn push(&mut self, visitor: AvatarId, now: Duration, pose: Pose) {
        self.visitors.entry(visitor).or_default().push(now, pose);
    }

    /// The past of a visitor; `None` before its first pose.
    pub fn of(&self, visitor: AvatarId) -> Option<&History> {
        self.visitors.get(&visitor)
    }
}

impl History {
    fn push(&mut self, now: Duration, pose: Pose) {
        debug_assert!(self.poses.back().is_none_or(|(at, _)| *at <= now), "time goes forward");
        self.poses.push_back((now, pose));
        while self.poses.front().is_some_and(|(at, _)| now.saturating_sub(*at) > HISTORY) {
            self.poses.pop_front();
        }
    }

    /// The newest pose.
    pub fn newest(&self) -> Option<Pose> {
        self.poses.back().map(|(_, pose)| *pose)
    }

    /// Where the visitor was at a time, on the straight way between two poses; `None` when that is
    /// too long ago.
    pub fn at(&self, time: Duration) -> Option<Pose> {
        let after = self.poses.partition_point(|(at, _)| *at <= time);
        let (from, before) = self.poses.get(after.checked_sub(1)?)?;
        let Some((to, next)) = self.poses.get(after) else { return Some(*before) };
        let share = (time - *from).div_duration_f32(*to - *from);
        Some(before.on_the_way_to(next, share))
    }

    /// How long ago the visitor left a place, within a distance in metres. In milliseconds.
    pub fn age_ms(&self, now: Duration, place: Vec3, within_m: f32) -> f64 {
        let poses = &self.poses;
        let was_there = |(_, pose): &&(Duration, Pose)| pose.eye.distance(place) < within_m;
        match poses.iter().rev().find(was_there) {
            // It was there until the next pose was recorded.
            Some((t, _)) => {
                let until =
                    poses.iter().find(|(later, _)| later > t).map_or(now, |(later, _)| *later);
                now.saturating_sub(until).as_secs_f64() * 1e3
            }
            None if poses
                .front()
                .is_some_and(|(t, _)| now.saturating_sub(*t) + STEP >= HISTORY) =>
            {
                HISTORY.as_secs_f64() * 1e3
            }
            // The visitor was there before its first recorded pose.
            None => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn history() -> History {
        let mut history = History::default();
        for (t, x) in [(0, 1.0), (50, 2.0), (100, 2.0), (150, 3.0), (200, 4.0)] {
            history.push(ms(t), Pose { eye: Vec3::X * x, ..Pose::default() });
        }
        history
    }

    #[test]
    fn a_place_ages_from_the_moment_the_visitor_left_it() {
        let history = history();
        for (x, age) in [(4.0, 0.0), (3.0, 10.0), (2.0, 60.0), (1.0, 160.0), (9.0, 0.0)] {
            assert_eq!(history.age_ms(ms(210), Vec3::X * x, 0.07), age, "at {x}");
        }
        assert_eq!(history.age_ms(ms(3_000), Vec3::X * 9.0, 0.07), 3_000.0);
    }

    #[test]
    fn between_two_poses_the_visitor_was_on_the_straight_way() {
        let mut history = history();
        let x_at = |t: u64| history.at(ms(t)).map(|pose| pose.eye.x);
        assert_eq!([0, 25, 80, 190, 900].map(x_at), [1.0, 1.5, 2.0, 3.8, 4.0].map(Some));
        history.push(ms(4_000), Pose::default());
        assert_eq!(history.at(ms(3_999)), None, "the history does not reach back to it");
    }
}
