//! Where another avatar is, by the courses that arrived.

use std::{collections::VecDeque, f32::consts::TAU, time::Duration};

use glam::Vec3;
use sightline_world::{
    geometry::Aabb,
    motion::{COURSE_MAX, FREE_FALL, Pose, turn_between},
};

/// Avatars are shown as they were this many ticks before the newest tick that can have arrived.
/// That is the promise of freshness, and a course that is not late arrives just when an avatar must
/// begin to join it.
const DELAY_TICKS: f64 = 2.0;
/// An avatar leaves a course this number of ticks before the next one begins, and is shown on the
/// straight way to that beginning.
const JOIN_TICKS: f64 = DELAY_TICKS;
/// A course that arrives too late is joined within this time.
pub const BLEND: Duration = Duration::from_millis(150);
/// A difference that is larger is not blended: the avatar was put elsewhere. In metres.
const BLEND_MAX_M: f32 = 2.0;
/// The number of courses that are kept of an avatar.
const COURSES_MAX: usize = 6;
/// The estimate of the server's clock follows messages that are later than estimated within this
/// time.
const CLOCK_SLACK_S: f64 = 25.0;
/// A smaller change of the estimate does not begin a correction anew, in seconds.
const CLOCK_TRIFLE_S: f64 = 1e-3;
/// A larger correction of the clock is made at once, in seconds.
const CLOCK_STEP_S: f64 = 0.5;

/// The estimate of when the server's ticks are on the client's clock.
#[derive(Clone, Debug)]
pub struct Clock {
    interval_s: f64,
    /// The newest tick of which a message arrived.
    newest: u32,
    /// When tick 0 was, as the fastest messages have it, in seconds.
    origin_s: Option<f64>,
    /// When the last message arrived, in seconds.
    heard_s: f64,
    /// What is shown does not leap when the estimate changes.
    correction: Option<ClockCorrection>,
}

/// By how much what is shown still lags behind the estimate of the clock. That shrinks evenly to
/// nothing. All are in seconds of the client's clock.
#[derive(Clone, Copy, Debug)]
struct ClockCorrection {
    from_s: f64,
    until_s: f64,
    behind_s: f64,
}

impl ClockCorrection {
    fn left_s(&self, now_s: f64) -> f64 {
        let left = (self.until_s - now_s) / (self.until_s - self.from_s);
        self.behind_s * left.clamp(0.0, 1.0)
    }
}

impl Clock {
    /// An estimate for a server with this time from tick to tick.
    pub fn new(interval: Duration) -> Self {
        let interval_s = interval.as_secs_f64();
        Self { interval_s, newest: 0, origin_s: None, heard_s: 0.0, correction: None }
    }

    /// Takes in that a message of a tick arrived. The fastest messages count within 150 ms, later
    /// ones slowly.
    pub fn synchronise(&mut self, tick: u32, now: Duration) {
        self.newest = self.newest.max(tick);
        let now_s = now.as_secs_f64();
        let origin = now_s - f64::from(tick) * self.interval_s;
        let share = ((now_s - self.heard_s) / CLOCK_SLACK_S).clamp(0.0, 0.1);
        self.heard_s = now_s;
        let Some(known) = self.origin_s.replace(origin) else { return };
        let estimate = if origin > known { known + (origin - known) * share } else { origin };
        self.origin_s = Some(estimate);
        self.correct(now_s, known - estimate);
    }

    /// Lets what is shown follow a change of the estimate, by which it would be ahead at once.
    fn correct(&mut self, now_s: f64, ahead_s: f64) {
        let before = self.correction.filter(|correction| now_s < correction.until_s);
        let behind_s = ahead_s + before.map_or(0.0, |correction| correction.left_s(now_s));
        let until_s = match before {
            Some(before) if ahead_s.abs() < CLOCK_TRIFLE_S => before.until_s,
            _ => now_s + BLEND.as_secs_f64(),
        };
        let is_small = behind_s.abs() <= CLOCK_STEP_S && behind_s != 0.0;
        self.correction = is_small.then_some(ClockCorrection { from_s: now_s, until_s, behind_s });
    }

    /// The moment that is shown now, in ticks.
    pub fn shown_tick(&self, now: Duration) -> f64 {
        let left_s = |correction: ClockCorrection| correction.left_s(now.as_secs_f64());
        let behind_s = self.correction.map_or(0.0, left_s);
        self.arrived_tick(now) - behind_s / self.interval_s - DELAY_TICKS
    }

    /// The newest tick that can have arrived now, and the part of the next one that has passed.
    pub fn arrived_tick(&self, now: Duration) -> f64 {
        let Some(origin) = self.origin_s else { return f64::from(self.newest) + DELAY_TICKS };
        (now.as_secs_f64() - origin) / self.interval_s
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

/// A course as the server told it.
#[derive(Clone, Copy, Debug)]
struct Course {
    /// The tick of the pose.
    tick: u32,
    pose: Pose,
}

impl Course {
    /// The pose at a moment, in ticks. Before the course begins it is that at its beginning.
    fn at(&self, tick: f64, interval: Duration) -> Pose {
        let ticks = (tick - f64::from(self.tick)).max(0.0);
        self.pose.straight_on(interval.mul_f64(ticks.min(1e6)))
    }
}

impl Course {
    /// The moment in ticks at which a falling body is highest, if it rises at first.
    fn top(&self, interval: Duration) -> Option<f64> {
        let rise_s = f64::from(self.pose.velocity.y / FREE_FALL);
        let rises = self.pose.falls && rise_s > 0.0;
        rises.then(|| f64::from(self.tick) + rise_s / interval.as_secs_f64())
    }
}

/// How far an avatar is shown off its newest course, because that arrived late. The difference
/// shrinks evenly to nothing.
#[derive(Clone, Copy, Debug)]
struct Blend {
    /// The moments at which it begins and ends, in ticks.
    from: f64,
    until: f64,
    off: Vec3,
    turn: f32,
    pitch: f32,
}

impl Blend {
    /// The part of the difference that is left at a moment, from 0 to 1.
    fn left(&self, tick: f64) -> f32 {
        (((self.until - tick) / (self.until - self.from)) as f32).clamp(0.0, 1.0)
    }
}

/// The newest courses of an avatar, and the motion along them.
///
/// An avatar follows a course until two ticks before the next one begins, and joins that in this
/// time. The client was on course at its last tick before that of the departure. A course that
/// arrives later is joined within 150 ms.
#[derive(Clone, Debug)]
pub struct Timeline {
    interval: Duration,
    /// In ascending order of tick; never empty.
    courses: VecDeque<Course>,
    blend: Option<Blend>,
    /// When the newest course arrived.
    heard_at: Duration,
}

impl Timeline {
    /// A timeline with one course, which arrived now, for a server with this time from tick to
    /// tick.
    pub fn new(interval: Duration, tick: u32, pose: Pose, now: Duration) -> Self {
        let courses = VecDeque::from([Course { tick, pose }]);
        Self { interval, courses, blend: None, heard_at: now }
    }

    /// Adds a course that arrived now, while a moment in ticks is shown. It is newer than all
    /// courses before.
    pub fn push(&mut self, tick: u32, pose: Pose, now: Duration, shown_tick: f64) {
        self.heard_at = now;
        let shown = self.at(shown_tick);
        let newest = self.last().tick;
        if tick <= newest {
            self.courses.pop_back();
        }
        self.courses.push_back(Course { tick: tick.max(newest), pose });
        while self.courses.len() > COURSES_MAX {
            self.courses.pop_front();
        }
        debug_assert!(self.courses.iter().is_sorted_by(|a, b| a.tick < b.tick), "{self:?}");
        self.blend = None;
        let joined = self.at(shown_tick);
        let off = shown.eye - joined.eye;
        let turn = turn_between(joined.yaw, shown.yaw);
        let pitch = shown.pitch - joined.pitch;
        let differs = off != Vec3::ZERO || turn != 0.0 || pitch != 0.0;
        if differs && off.length() <= BLEND_MAX_M {
            let until = shown_tick + BLEND.div_duration_f64(self.interval);
            self.blend = Some(Blend { from: shown_tick, until, off, turn, pitch });
        }
    }

    /// The newest course as it is at its beginning, and when it arrived.
    pub fn newest(&self) -> (Pose, Duration) {
        (self.last().pose, self.heard_at)
    }

    /// The tick at which the newest course begins.
    pub fn newest_tick(&self) -> u32 {
        self.last().tick
    }

    /// The pose at a moment, in ticks.
    pub fn at(&self, tick: f64) -> Pose {
        let pose = self.unblended(tick);
        let Some(blend) = &self.blend else { return pose };
        let left = blend.left(tick);
        Pose {
            eye: pose.eye + blend.off * left,
            yaw: (pose.yaw + blend.turn * left).rem_euclid(TAU),
            pitch: pose.pitch + blend.pitch * left,
            ..pose
        }
    }

    fn unblended(&self, tick: f64) -> Pose {
        let after = self.courses.partition_point(|course| f64::from(course.tick) <= tick);
        let before = after.checked_sub(1).and_then(|index| self.courses.get(index));
        match (before, self.courses.get(after)) {
            (Some(before), Some(next)) => {
                let begin = (f64::from(next.tick) - JOIN_TICKS).max(f64::from(before.tick));
                if tick <= begin {
                    return before.at(tick, self.interval);
                }
                let share = (tick - begin) / (f64::from(next.tick) - begin);
                between(&before.at(begin, self.interval), &next.pose, share as f32)
            }
            (Some(before), None) => before.at(tick, self.interval),
            (None, Some(next)) => next.pose,
            (None, None) => Pose::default(),
        }
    }

    /// A box that holds the eye from one moment to another, in ticks, as long as no course is
    /// added.
    pub fn eyes(&self, [from, until]: [f64; 2]) -> Aabb {
        // The eye moves in straight lines. It turns where courses begin or end, and where it has
        // joined one.
        let begins = self.courses.iter().map(|course| f64::from(course.tick));
        let turns = begins.clone().chain(begins.map(|tick| tick - JOIN_TICKS));
        let blend = self.blend.iter().flat_map(|blend| [blend.from, blend.until]);
        let end = f64::from(self.last().tick) + COURSE_MAX.div_duration_f64(self.interval);
        let tops = self.courses.iter().filter_map(|course| course.top(self.interval));
        let turns =
            turns.chain(blend).chain(tops).chain([end]).filter(|at| (from..until).contains(at));
        let ticks = turns.chain([from, until.max(from)]);
        // While a blend goes on, the top of a jump may be elsewhere.
        let shift = self.blend.map_or(0.0, |blend| blend.off.y.abs());
        let falls = self.courses.iter().any(|course| course.pose.falls);
        let points = Aabb::from_points(ticks.map(|tick| self.at(tick).eye));
        if falls { points.grown(shift) } else { points }
    }

    fn last(&self) -> Course {
        self.courses.back().copied().unwrap_or(Course { tick: 0, pose: Pose::default() })
    }
}

/// The pose at a share of the way from one pose to another.
fn between(a: &Pose, b: &Pose, share: f32) -> Pose {
    Pose {
        eye: a.eye.lerp(b.eye, share),
        yaw: (a.yaw + turn_between(a.yaw, b.yaw) * share).rem_euclid(TAU),
        pitch: a.pitch + (b.pitch - a.pitch) * share,
        velocity: a.velocity.lerp(b.velocity, share),
        yaw_rate: b.yaw_rate,
        falls: b.falls,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: Duration = Duration::from_millis(50);

    fn pose(x: f32, speed: f32) -> Pose {
        Pose { eye: Vec3::X * x, velocity: Vec3::X * speed, ..Pose::default() }
    }

    fn x_at(timeline: &Timeline, tick: f64) -> f32 {
        timeline.at(tick).eye.x
    }

    #[test]
    fn an_avatar_follows_its_course_and_joins_the_next_one_within_two_ticks() {
        let mut timeline = Timeline::new(TICK, 10, pose(1.0, 1.0), TICK);
        timeline.push(20, pose(1.6, 0.0), TICK, 10.0);
        let expected = [(3.0, 1.0), (10.0, 1.0), (12.0, 1.1), (18.0, 1.4), (19.0, 1.5)];
        for (tick, x) in expected.into_iter().chain([(20.0, 1.6), (99.0, 1.6)]) {
            assert!((x_at(&timeline, tick) - x).abs() < 1e-5, "tick {tick}");
        }
    }

    #[test]
    fn a_late_course_is_joined_within_150_ms_and_without_a_jump() {
        let mut timeline = Timeline::new(TICK, 10, pose(1.0, 1.0), TICK);
        timeline.push(20, Pose { yaw: 6.0, ..pose(1.5, -1.0) }, TICK, 22.0);
        assert!((x_at(&timeline, 22.0) - 1.6).abs() < 1e-5, "where it was shown");
        let mut before = timeline.at(22.0);
        for step in 1..=30 {
            let pose = timeline.at(22.0 + f64::from(step) * 0.1);
            assert!(pose.eye.distance(before.eye) < 0.02);
            assert!(turn_between(before.yaw, pose.yaw).abs() < 0.02);
            before = pose;
        }
        assert!((x_at(&timeline, 25.0) - 1.25).abs() < 1e-5, "on the new course");
        let mut timeline = Timeline::new(TICK, 10, pose(1.0, 0.0), TICK);
        timeline.push(20, pose(50.0, 0.0), TICK, 22.0);
        assert_eq!(x_at(&timeline, 22.0), 50.0, "it was put elsewhere");
    }

    #[test]
    fn a_timeline_keeps_few_courses_in_order() {
        let mut timeline = Timeline::new(TICK, 0, pose(0.0, 1.0), TICK);
        for tick in [1, 5, 5, 3, 9, 20, 40, 41, 42, 43] {
            timeline.push(tick, pose(tick as f32, 1.0), TICK, 0.0);
            assert!(timeline.courses.len() <= COURSES_MAX);
            assert!(timeline.courses.iter().is_sorted_by(|a, b| a.tick < b.tick));
            assert_eq!(timeline.newest().0.eye.x, tick as f32);
        }
    }

    #[test]
    fn the_eye_stays_in_its_predicted_box() {
        let mut timeline = Timeline::new(TICK, 3, pose(7.0, 1.0), TICK);
        for (tick, x) in [(5, 6.0), (6, 5.0), (9, 4.0), (30, 3.0), (31, 2.0)] {
            let falls = tick % 2 == 0;
            let velocity = Vec3::new(2.0 - x, x, 0.0);
            let course = Pose { velocity, falls, ..pose(x, 0.0) };
            timeline.push(tick, course, TICK, f64::from(tick) + 0.3);
            for from in 0..80 {
                let from = f64::from(from) * 0.5;
                for length in [0, 3, 20, 200, 2_000] {
                    let until = from + f64::from(length) * 0.1;
                    let eyes = timeline.eyes([from, until]).grown(1e-4);
                    let times = (0..=length).map(|step| from + f64::from(step) * 0.1);
                    times.for_each(|at| assert!(eyes.contains(timeline.at(at).eye), "{at}"));
                }
            }
        }
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
