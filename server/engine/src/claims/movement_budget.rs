//! What a client may claim: the server integrates time itself.

use std::time::Duration;

use glam::Vec3;
use sightline_world::{
    geometry::Confines,
    motion::{Pose, Tbv},
    tolerance::{BUDGET_ROUNDING_M, WALK_SPARE_M},
};

/// A claim may exceed the speed limit by so much.
const TOLERANCE: f64 = 1.01;
/// What a client did not use of its speed for so long it may still use: reports that were held up
/// and arrive together are all accepted.
const BUNCHING: Duration = Duration::from_millis(250);
/// Silence longer than this earns no more way.
const SILENCE_MAX: Duration = Duration::from_secs(5);

/// What is accepted from clients.
#[derive(Clone, Copy, Debug)]
pub struct ClaimLimits {
    /// No eye leaves it.
    pub confines: Confines,
    /// In metres a second.
    pub speed_max: f32,
    /// Downwards, in metres a second: no less than `speed_max`.
    pub fall_max: f32,
    /// As in [`Config`](crate::Config).
    pub refusals_max: u32,
    /// As in [`Config`](crate::Config).
    pub refusal_window: Duration,
}

/// How far one client can be believed.
#[derive(Clone, Debug)]
pub struct MovementBudget {
    sequence: Option<u32>,
    accepted: Duration,
    unused_m: f64,
    /// What is left of a speed that the server itself gave it, in metres a second.
    given: f32,
    refusals: u32,
    first_refusal: Duration,
    last_refusal: Duration,
    corrected: Option<Duration>,
}

/// What becomes of a claim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClaimVerdict {
    /// It enters the world.
    Accepted,
    /// It is older than one that was taken in before.
    Old,
    /// It is false. `correct` is unset when a correction is still on its way.
    Refused {
        /// Tell the client where it is.
        correct: bool,
    },
    /// It is false once more than can be borne.
    Expelled,
}

impl MovementBudget {
    /// A client that has just been put in its place.
    pub fn new(now: Duration) -> Self {
        Self {
            sequence: None,
            accepted: now,
            unused_m: BUDGET_ROUNDING_M,
            given: 0.0,
            refusals: 0,
            first_refusal: now,
            last_refusal: now,
            corrected: None,
        }
    }

    /// The client was put somewhere else by the server itself, or pushed: it moves at a velocity now.
    pub fn relocate(&mut self, now: Duration, velocity: Vec3) {
        let given = velocity.length();
        *self = Self { sequence: self.sequence, given, ..Self::new(now) };
    }

    /// The part of a velocity that its client can have, given what was accepted last.
    pub fn plausible(&self, velocity: Vec3, limits: &ClaimLimits) -> Vec3 {
        let speed_max = limits.speed_max.max(self.given);
        let aside = velocity.with_y(velocity.y.max(0.0)).clamp_length_max(speed_max);
        let fall = velocity.y.clamp(-limits.fall_max.max(speed_max), 0.0);
        aside + Vec3::Y * fall
    }

    /// Judges a claim against the last accepted place, for a hidden client its TBV, and the walls: `lead`
    /// says how long the way is at least that leads from the one place to the other, if there is one
    /// that is no longer than this, in metres.
    pub fn judge(
        &mut self,
        now: Duration,
        (sequence, claim): (u32, &Pose),
        (at, tbv): (Vec3, Option<&Tbv>),
        round_trip: Duration,
        limits: &ClaimLimits,
        lead: impl FnOnce(f64) -> Option<f64>,
    ) -> ClaimVerdict {
        if self.sequence.is_some_and(|newest| sequence <= newest) {
            return ClaimVerdict::Old;
        }
        self.sequence = Some(sequence);
        let elapsed = now.saturating_sub(self.accepted);
        let allowed_m = self.allowed_m(elapsed.min(SILENCE_MAX), limits);
        let straight_m = way_m(at, claim.eye, limits);
        let is_believable = claim.is_finite()
            && limits.confines.contains(claim.eye)
            && straight_m <= allowed_m
            && tbv.is_none_or(|tbv| within(tbv, claim.eye, now, limits));
        // Who was silent for long may have gone to and fro.
        let led = is_believable.then(|| lead(self.allowed_m(elapsed, limits) + WALK_SPARE_M));
        let Some(led_m) = led.flatten() else {
            return self.refuse(now, round_trip, limits);
        };
        let unused_m = (allowed_m - straight_m.max(led_m)).max(0.0);
        let bunched_m = f64::from(limits.speed_max) * BUNCHING.as_secs_f64();
        self.unused_m = unused_m.min(bunched_m.max(BUDGET_ROUNDING_M));
        self.accepted = now;
        self.refusals = 0;
        self.given = self.given.min(claim.velocity.length());
        ClaimVerdict::Accepted
    }

    /// How far the client can have come so long after its last accepted claim.
    fn allowed_m(&self, elapsed: Duration, limits: &ClaimLimits) -> f64 {
        let speed = f64::from(limits.speed_max.max(self.given));
        self.unused_m + speed * TOLERANCE * elapsed.as_secs_f64()
    }

    /// Counts refusals in a row. Those that were on their way when the first correction left
    /// expel nobody, and call for no further correction.
    fn refuse(
        &mut self,
        now: Duration,
        round_trip: Duration,
        limits: &ClaimLimits,
    ) -> ClaimVerdict {
        if self.refusals == 0 || now.saturating_sub(self.last_refusal) > limits.refusal_window {
            self.refusals = 0;
            self.first_refusal = now;
        }
        self.refusals += 1;
        self.last_refusal = now;
        let heard = now.saturating_sub(self.first_refusal) >= 2 * round_trip;
        if self.refusals >= limits.refusals_max && heard {
            return ClaimVerdict::Expelled;
        }
        let correct = self.corrected.is_none_or(|at| now.saturating_sub(at) >= round_trip);
        if correct {
            self.corrected = Some(now);
        }
        ClaimVerdict::Refused { correct }
    }
}

/// How far it is from one place to another, where falls count for less: in metres.
fn way_m(from: Vec3, to: Vec3, limits: &ClaimLimits) -> f64 {
    let mut way = to.as_dvec3() - from.as_dvec3();
    if way.y < 0.0 {
        way.y *= f64::from(limits.speed_max / limits.fall_max.max(limits.speed_max));
    }
    way.length()
}

/// Whether an eye can be somewhere by what its TBV says; one that has expired goes on growing.
fn within(tbv: &Tbv, eye: Vec3, now: Duration, limits: &ClaimLimits) -> bool {
    let beyond = now.saturating_sub(tbv.expiry).as_secs_f64() * f64::from(limits.speed_max);
    let margin_m = (beyond * TOLERANCE + BUDGET_ROUNDING_M) as f32;
    tbv.grown(margin_m).contains(eye)
}

#[cfg(test)]
mod tests {
    use sightline_world::geometry::{Aabb, Axes};

    use super::*;

    const LIMITS: ClaimLimits = ClaimLimits {
        confines: Confines {
            axes: Axes::WORLD,
            bounds: Aabb::new(Vec3::splat(-1_000.0), Vec3::splat(1_000.0)),
        },
        speed_max: 2.0,
        fall_max: 2.0,
        refusals_max: 20,
        refusal_window: Duration::from_secs(5),
    };
    const RTT: Duration = Duration::from_millis(100);

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn at(x: f32) -> Pose {
        Pose { eye: Vec3::new(x, 0.0, 0.0), ..Pose::default() }
    }

    /// Feeds (milliseconds, place) claims and says which were accepted.
    fn accepted(claims: &[(u64, f32)]) -> Vec<bool> {
        let mut ledger = MovementBudget::new(ms(0));
        let mut place = Vec3::ZERO;
        let mut judge = |(i, &(t, x)): (usize, &(u64, f32))| {
            let verdict = ledger.judge(
                ms(t),
                (i as u32, &at(x)),
                (place, None),
                Duration::ZERO,
                &LIMITS,
                |_| Some(0.0),
            );
            if verdict == ClaimVerdict::Accepted {
                place = at(x).eye;
            }
            verdict == ClaimVerdict::Accepted
        };
        claims.iter().enumerate().map(&mut judge).collect()
    }

    #[test]
    fn way_is_earned_by_time_alone() {
        assert_eq!(accepted(&[(50, 0.1), (100, 0.2), (1_100, 2.2)]), [true; 3]);
        assert_eq!(accepted(&[(50, 0.2), (100, 0.2)]), [false, true]);
        assert_eq!(accepted(&[(500, 50.0)]), [false]);
        // Held up for 200 ms and then all at once.
        let bunch = [(300, 0.4), (300, 0.5), (300, 0.6), (301, 0.6), (350, 0.72), (350, 0.9)];
        assert_eq!(accepted(&bunch), [true, true, true, true, true, false]);
        // What was saved long ago is gone.
        assert_eq!(accepted(&[(10_000, 0.0), (10_050, 1.0)]), [true, false]);
    }

    #[test]
    fn over_a_long_time_nobody_gains_more_than_one_in_a_hundred() {
        for step in [1, 7, 50, 333] {
            let mut ledger = MovementBudget::new(ms(0));
            let (mut x, mut t) = (0.0_f32, 0);
            for i in 0..2_000 {
                t += step;
                let hop = 2.0 * step as f32 / 1_000.0 * if i % 3 == 0 { 2.0 } else { 1.015 };
                let place = at(x).eye;
                let claim = at(x + hop);
                let verdict =
                    ledger.judge(ms(t), (i, &claim), (place, None), RTT, &LIMITS, |_| Some(0.0));
                if verdict == ClaimVerdict::Accepted {
                    x += hop;
                }
            }
            let limit = 2.0 * t as f32 / 1_000.0;
            assert!(x <= limit * 1.0101 + 0.021, "step {step}: {x} of {limit}");
            assert!(x > limit * 0.3, "step {step}: {x} of {limit}");
        }
    }

    #[test]
    fn what_is_no_place_is_refused() {
        for eye in [
            Vec3::new(f32::NAN, 0.0, 0.0),
            Vec3::new(0.0, f32::INFINITY, 0.0),
            Vec3::new(0.0, 0.0, 1_001.0),
        ] {
            let mut ledger = MovementBudget::new(ms(0));
            let claim = Pose { eye, ..Pose::default() };
            let verdict =
                ledger
                    .judge(ms(4_000), (0, &claim), (Vec3::ZERO, None), RTT, &LIMITS, |_| Some(0.0));
            assert_eq!(verdict, ClaimVerdict::Refused { correct: true }, "{eye}");
        }
    }

    #[test]
    fn old_reports_are_ignored_even_after_a_refusal() {
        let mut ledger = MovementBudget::new(ms(0));
        let mut judge = |t, sequence, x| {
            ledger.judge(ms(t), (sequence, &at(x)), (Vec3::ZERO, None), RTT, &LIMITS, |_| Some(0.0))
        };
        assert_eq!(judge(50, 5, 0.0), ClaimVerdict::Accepted);
        assert_eq!(judge(60, 5, 0.0), ClaimVerdict::Old);
        assert_eq!(judge(70, 4, 0.0), ClaimVerdict::Old);
        assert_eq!(judge(80, 9, 99.0), ClaimVerdict::Refused { correct: true });
        assert_eq!(judge(90, 8, 0.0), ClaimVerdict::Old);
        assert_eq!(judge(100, 10, 0.0), ClaimVerdict::Accepted);
    }

    #[test]
    fn a_hidden_client_must_be_where_its_tbv_says() {
        let region = |centre, size_m, expiry| Tbv {
            within: Aabb::around(centre, size_m),
            axes: Axes::WORLD,
            expiry,
            notice: Duration::ZERO,
        };
        let tbv = region(Vec3::ZERO, 2.0, ms(1_000));
        for (t, x, verdict) in [
            (900, 1.7, ClaimVerdict::Accepted),
            (1_000, 2.0, ClaimVerdict::Accepted),
            (1_500, 2.9, ClaimVerdict::Accepted),
            (1_500, 3.3, ClaimVerdict::Refused { correct: true }),
        ] {
            let mut ledger = MovementBudget::new(ms(0));
            let got =
                ledger.judge(ms(t), (0, &at(x)), (Vec3::ZERO, Some(&tbv)), RTT, &LIMITS, |_| {
                    Some(0.0)
                });
            assert_eq!(got, verdict, "{t} ms, {x} m");
        }
        // Way saved up does not lead out of the region.
        let mut ledger = MovementBudget::new(ms(0));
        let start = Vec3::new(-1.0, 0.0, 0.0);
        let small = region(start, 0.2, ms(3_100));
        let got =
            ledger.judge(ms(3_050), (0, &at(0.0)), (start, Some(&small)), RTT, &LIMITS, |_| {
                Some(0.0)
            });
        assert_eq!(got, ClaimVerdict::Refused { correct: true });
    }

    #[test]
    fn who_was_pushed_coasts_and_who_falls_falls() {
        let limits = ClaimLimits { fall_max: 20.0, ..LIMITS };
        let pose = |x: f32, y: f32, velocity: f32| Pose {
            eye: Vec3::new(x, y, 0.0),
            velocity: Vec3::X * velocity,
            ..Pose::default()
        };
        let mut ledger = MovementBudget::new(ms(0));
        ledger.relocate(ms(0), Vec3::X * 10.0);
        let mut judge = |t, sequence, claim: Pose, at: Pose| {
            let verdict =
                ledger
                    .judge(ms(t), (sequence, &claim), (at.eye, None), RTT, &limits, |_| Some(0.0));
            verdict == ClaimVerdict::Accepted
        };
        assert!(judge(100, 1, pose(1.0, 0.0, 8.0), pose(0.0, 0.0, 10.0)));
        assert!(!judge(200, 2, pose(2.3, 0.0, 8.0), pose(1.0, 0.0, 8.0)), "it was 8 m/s by now");
        assert!(judge(300, 3, pose(2.0, -4.0, 1.0), pose(1.0, 0.0, 8.0)), "down at 20 m/s");
        assert!(
            !judge(400, 4, pose(2.8, -4.0, 8.0), pose(2.0, -4.0, 1.0)),
            "what was lost is lost"
        );
        let claimed = Vec3::new(9.0, -50.0, 0.0);
        assert_eq!(ledger.plausible(claimed, &limits), Vec3::new(2.0, -20.0, 0.0));
    }

    #[test]
    fn a_way_round_a_wall_is_used_up_like_a_straight_one() {
        let mut ledger = MovementBudget::new(ms(0));
        let mut round = |t, sequence, way_m: f64| {
            let lead = |most_m: f64| (way_m <= most_m).then_some(way_m);
            ledger.judge(ms(t), (sequence, &at(0.01)), (Vec3::ZERO, None), RTT, &LIMITS, lead)
        };
        assert_eq!(round(500, 1, 0.9), ClaimVerdict::Accepted);
        assert_eq!(round(550, 2, 0.9), ClaimVerdict::Refused { correct: true });
        assert_eq!(round(550, 3, 0.2), ClaimVerdict::Accepted);
        assert_eq!(round(1_000, 4, 0.9), ClaimVerdict::Accepted);
        // Longer than any straight way can be believed: it may have gone to and fro.
        assert_eq!(round(9_000, 5, 16.0), ClaimVerdict::Accepted);
        assert_eq!(round(9_050, 6, 0.2), ClaimVerdict::Refused { correct: true });
    }

    #[test]
    fn who_persists_is_expelled_and_who_stumbles_is_not() {
        let run = |every_ms: u64, round_trip: Duration, good: u64| {
            let mut ledger = MovementBudget::new(ms(0));
            (1..200_u64).position(|i| {
                let x = if good > 0 && i % good == 0 { 0.0 } else { 500.0 };
                let claim = at(x);
                ledger.judge(
                    ms(i * every_ms),
                    (i as u32, &claim),
                    (Vec3::ZERO, None),
                    round_trip,
                    &LIMITS,
                    |_| Some(0.0),
                ) == ClaimVerdict::Expelled
            })
        };
        assert_eq!(run(50, RTT, 0), Some(19));
        assert_eq!(run(50, ms(1_000), 0), Some(40), "the correction must have been heard");
        assert_eq!(run(50, RTT, 10), None);
        assert_eq!(run(6_000, RTT, 0), None);
    }

    #[test]
    fn one_correction_a_round_trip() {
        let mut ledger = MovementBudget::new(ms(0));
        let corrected: Vec<bool> = (1..10_u32)
            .map(|i| {
                let claim = at(500.0);
                let now = ms(u64::from(i) * 25);
                let verdict =
                    ledger.judge(now, (i, &claim), (Vec3::ZERO, None), RTT, &LIMITS, |_| Some(0.0));
                verdict == ClaimVerdict::Refused { correct: true }
            })
            .collect();
        assert_eq!(corrected, [true, false, false, false, true, false, false, false, true]);
    }
}
