//! Where another avatar is between the poses that arrived.

use std::{
    collections::VecDeque,
    f32::consts::{PI, TAU},
    time::Duration,
};

use sightline_world::{geometry::Aabb, motion::Pose};

/// Avatars are shown as they were this many ticks before the newest tick that can have arrived, so
/// that there is mostly a later pose to move towards.
const DELAY_TICKS: f64 = 1.5;
/// Without a later pose, an avatar goes on in a straight line for this many ticks.
const EXTRAPOLATION_TICKS: f32 = 3.0;
/// The number of poses that are kept of an avatar.
const SAMPLES_MAX: usize = 6;
/// The estimate of the server's clock follows a message that is later than estimated by one part in
/// this many.
const CLOCK_SLACK: f64 = 512.0;

/// The estimate of when the server's ticks are on the client's clock.
#[derive(Clone, Debug)]
pub struct Clock {
    interval_s: f64,
    /// The newest tick of which a message arrived.
    newest: u32,
    /// When tick 0 was, as the fastest messages have it, in seconds.
    origin_s: Option<f64>,
}

impl Clock {
    /// An estimate for a server with this time from tick to tick.
    pub fn new(interval: Duration) -> Self {
        Self { interval_s: interval.as_secs_f64(), newest: 0, origin_s: None }
    }

    /// Takes in that a message of a tick arrived. The fastest messages count at once, later ones
    /// slowly.
    pub fn synchronise(&mut self, tick: u32, now: Duration) {
        self.newest = self.newest.max(tick);
        let origin = now.as_secs_f64() - f64::from(tick) * self.interval_s;
        self.origin_s = Some(match self.origin_s {
            Some(known) if origin > known => known + (origin - known) / CLOCK_SLACK,
            _ => origin,
        });
    }

    /// The newest tick of which a message arrived.
    pub fn newest_tick(&self) -> u32 {
        self.newest
    }

    /// The moment that is shown now, in ticks.
    pub fn shown_tick(&self, now: Duration) -> f64 {
        let Some(origin) = self.origin_s else { return f64::from(self.newest) };
        (now.as_secs_f64() - origin) / self.interval_s - DELAY_TICKS
    }

    /// The moment in ticks that has a time of [`Clock::shown_time_s`]; the newest tick as long as
    /// no time is known.
    pub fn tick_at(&self, shown: Duration) -> f64 {
        let ticks = self.origin_s.map(|_| shown.as_secs_f64() / self.interval_s);
        ticks.unwrap_or(f64::from(self.newest))
    }

    /// The moment that is shown now, in seconds of the server's clock; `None` before the first
    /// message.
    pub fn shown_time_s(&self, now: Duration) -> Option<f64> {
        self.origin_s.map(|_| self.shown_tick(now) * self.interval_s)
    }
}

/// The newest poses of an avatar, and the motion between them.
#[derive(Clone, Debug)]
pub struct Timeline {
    /// Ticks and poses in ascending order; never empty.
    samples: VecDeque<(u32, Pose)>,
    /// When the newest pose arrived.
    heard_at: Duration,
}

impl Timeline {
    /// A timeline with one pose, which arrived now.
    pub fn new(tick: u32, pose: Pose, now: Duration) -> Self {
        Self { samples: VecDeque::from([(tick, pose)]), heard_at: now }
    }

    /// Adds a pose that arrived now. It is newer than all poses before.
    pub fn push(&mut self, tick: u32, pose: Pose, now: Duration) {
        self.heard_at = now;
        let (newest, before) = self.last();
        if tick <= newest {
            self.samples.pop_back();
        } else if tick - newest > 2 {
            // The avatar stood still, or a message was lost. It moves within this tick, not slowly
            // since the pose before.
            self.samples.push_back((tick - 1, before));
        }
        self.samples.push_back((tick.max(newest), pose));
        while self.samples.len() > SAMPLES_MAX {
            self.samples.pop_front();
        }
        debug_assert!(self.samples.iter().is_sorted_by(|a, b| a.0 < b.0), "{:?}", self.samples);
    }

    /// The newest pose, and when it arrived.
    pub fn newest(&self) -> (Pose, Duration) {
        (self.last().1, self.heard_at)
    }

    /// The pose at a moment, in ticks.
    pub fn at(&self, tick: f64, interval: Duration) -> Pose {
        let after = self.samples.partition_point(|(t, _)| f64::from(*t) <= tick);
        let before = after.checked_sub(1).and_then(|i| self.samples.get(i));
        match (before, self.samples.get(after)) {
            (Some((t, a)), Some((u, b))) => {
                let share = (tick - f64::from(*t)) / f64::from(u - t);
                between(a, b, share as f32)
            }
            (Some((t, a)), None) => {
                let ahead = ((tick - f64::from(*t)) as f32).min(EXTRAPOLATION_TICKS);
                Pose { eye: a.eye + a.velocity * (ahead * interval.as_secs_f32()), ..*a }
            }
            (None, Some((_, b))) => *b,
            (None, None) => Pose::default(),
        }
    }

    /// A box that holds the eye from one moment to another, in ticks, as long as no pose is added.
    pub fn eyes(&self, [from, until]: [f64; 2], interval: Duration) -> Aabb {
        // The eye moves in straight lines, and turns at samples and where it stops.
        let (newest, _) = self.last();
        let end = f64::from(newest) + f64::from(EXTRAPOLATION_TICKS);
        let turns = self.samples.iter().map(|(at, _)| f64::from(*at)).chain([end]);
        let turns = turns.filter(|at| (from..until).contains(at));
        let ticks = turns.chain([from, until.max(from)]);
        Aabb::from_points(ticks.map(|tick| self.at(tick, interval).eye))
    }

    fn last(&self) -> (u32, Pose) {
        self.samples.back().copied().unwrap_or_default()
    }
}

/// The pose at a share of the way from one pose to another.
fn between(a: &Pose, b: &Pose, share: f32) -> Pose {
    // Yaw turns the shorter way round.
    let turn = (b.yaw - a.yaw + PI).rem_euclid(TAU) - PI;
    Pose {
        eye: a.eye.lerp(b.eye, share),
        yaw: (a.yaw + turn * share).rem_euclid(TAU),
        pitch: a.pitch + (b.pitch - a.pitch) * share,
        velocity: a.velocity.lerp(b.velocity, share),
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    const TICK: Duration = Duration::from_millis(50);

    fn pose(x: f32) -> Pose {
        Pose { eye: Vec3::X * x, velocity: Vec3::X, ..Pose::default() }
    }

    fn x_at(timeline: &Timeline, tick: f64) -> f32 {
        timeline.at(tick, TICK).eye.x
    }

    #[test]
    fn an_avatar_moves_between_its_poses_and_a_little_beyond() {
        let mut timeline = Timeline::new(10, pose(1.0), TICK);
        timeline.push(12, pose(2.0), TICK);
        for (tick, x) in [(3.0, 1.0), (10.0, 1.0), (11.0, 1.5), (12.0, 2.0), (13.0, 2.05)] {
            assert!((x_at(&timeline, tick) - x).abs() < 1e-5, "tick {tick}");
        }
        assert!((x_at(&timeline, 100.0) - 2.15).abs() < 1e-5, "three ticks and no more");
    }

    #[test]
    fn after_standing_still_an_avatar_does_not_slide() {
        let mut timeline = Timeline::new(10, pose(1.0), TICK);
        timeline.push(100, pose(2.0), TICK);
        assert_eq!(x_at(&timeline, 99.0), 1.0);
        assert_eq!(x_at(&timeline, 99.5), 1.5);
    }

    #[test]
    fn a_timeline_keeps_few_poses_in_order() {
        let mut timeline = Timeline::new(0, pose(0.0), TICK);
        for tick in [1, 5, 5, 3, 9, 20, 40, 41, 42, 43] {
            timeline.push(tick, pose(tick as f32), TICK);
            assert!(timeline.samples.len() <= SAMPLES_MAX);
            assert!(timeline.samples.iter().is_sorted_by(|a, b| a.0 < b.0));
            assert_eq!(timeline.newest().0.eye.x, tick as f32);
        }
    }

    #[test]
    fn the_eye_stays_in_its_predicted_box() {
        let mut timeline = Timeline::new(3, pose(7.0), TICK);
        for (tick, x) in [(5, 1.0), (6, -2.0), (9, 4.0), (30, 3.0), (31, 2.0)] {
            timeline.push(tick, pose(x), TICK);
            for from in 0..80 {
                let from = f64::from(from) * 0.5;
                for length in [0, 3, 20, 200] {
                    let until = from + f64::from(length) * 0.1;
                    let eyes = timeline.eyes([from, until], TICK).grown(1e-5);
                    let times = (0..=length).map(|step| from + f64::from(step) * 0.1);
                    times.for_each(|at| assert!(eyes.contains(timeline.at(at, TICK).eye), "{at}"));
                }
            }
        }
        assert!(timeline.eyes([30.9, 99.0], TICK).size().x < 0.3, "and not much more");
    }

    #[test]
    fn yaw_turns_the_shorter_way() {
        let a = Pose { yaw: 0.1, ..Pose::default() };
        let b = Pose { yaw: TAU - 0.1, ..Pose::default() };
        let middle = between(&a, &b, 0.5).yaw;
        assert!(!(1e-5..TAU - 1e-5).contains(&middle), "{middle}");
    }

    #[test]
    fn the_clock_follows_the_fastest_messages() {
        let mut clock = Clock::new(TICK);
        assert_eq!(clock.shown_tick(TICK), 0.0);
        assert_eq!(clock.shown_time_s(TICK), None);
        for tick in 100..200u32 {
            let jitter = Duration::from_millis(u64::from(tick % 7) * 10);
            clock.synchronise(tick, TICK * tick + Duration::from_millis(500) + jitter);
        }
        let now = TICK * 199 + Duration::from_millis(500);
        assert!((clock.shown_tick(now) - (199.0 - DELAY_TICKS)).abs() < 0.1);
        let shown_s = clock.shown_time_s(now).expect("heard of");
        assert!((shown_s - (199.0 - DELAY_TICKS) * TICK.as_secs_f64()).abs() < 0.1);
    }
}
