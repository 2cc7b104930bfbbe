//! How far a client can have moved: the server integrates time itself.

use std::time::Duration;

use glam::Vec3;
use sightline_world::{
    geometry::Confines,
    motion::{Pose, Tbv},
    tolerance::{BUDGET_ROUNDING_M, WALK_SPARE_M},
};

use crate::sphere::Sphere;

/// The factor by which a claim may exceed the speed limit.
const SPEED_TOLERANCE: f64 = 1.01;
/// A client may still use what it left unused of its speed for so long and one round trip more. So
/// reports that were held up and arrive together are all accepted, and so is the next report in
/// time after one that was lost and sent again.
const BUNCHING: Duration = Duration::from_millis(250);
/// No longer round trip counts for that.
const BUNCHING_ROUND_TRIP_MAX: Duration = Duration::from_millis(400);
/// A claim that comes late leaves as much of the client's speed unused as the claims that are still
/// on their way need: for as long as it is late, and no longer than this. The link or the server
/// itself may have held them up.
const LATENESS_MAX: Duration = Duration::from_secs(5);
/// A live client off its course has moved for no longer than this without a word, lateness apart.
const OFF_COURSE_MAX: Duration = Duration::from_secs(1);
/// A push is believed in full for so long, ...
const PUSH_WHOLE: Duration = Duration::from_secs(3);
/// ... and less and less until then.
const PUSH_MAX: Duration = Duration::from_secs(5);
/// Silence longer than this earns no more straight distance.
const SILENCE_MAX: Duration = Duration::from_secs(5);

/// What is accepted from clients.
#[derive(Clone, Copy, Debug)]
pub struct ClaimLimits {
    /// The bounds of the world: no eye leaves them.
    pub confines: Confines,
    /// The top speed, in metres a second.
    pub speed_max: f32,
    /// The top speed downwards, in metres a second: no less than `speed_max`.
    pub fall_max: f32,
    /// See [`Config::refusals_max`](crate::Config::refusals_max).
    pub refusals_max: u32,
    /// See [`Config::refusal_window`](crate::Config::refusal_window).
    pub refusal_window: Duration,
}

/// A client's word of where its avatar is, and what the server knows to hold it against.
#[derive(Clone, Copy, Debug)]
pub struct Claim<'a> {
    /// When the client made it, on its own clock: later than all claims before.
    pub made: Duration,
    /// The pose that is claimed.
    pub pose: &'a Pose,
    /// The eye position that was accepted last.
    pub from: Vec3,
    /// Where the silence of a live client has put its avatar; `None` where it means nothing.
    pub course: Option<Vec3>,
    /// The TBV of a hidden client.
    pub tbv: Option<&'a Tbv>,
    /// The ball that bounds the avatar as well, if its TBV is a sphere.
    pub(crate) sphere: Option<Sphere>,
    /// The client's measured round trip.
    pub round_trip: Duration,
    /// By how much the claim came later than the fastest of the client's last ones.
    pub late: Duration,
}

impl<'a> Claim<'a> {
    /// The claim of a live client.
    pub fn new(made: Duration, pose: &'a Pose, from: Vec3, round_trip: Duration) -> Self {
        let (course, tbv, sphere, late) = (None, None, None, Duration::ZERO);
        Self { made, pose, from, course, tbv, sphere, round_trip, late }
    }
}

/// How far one client can be believed.
#[derive(Clone, Debug)]
pub struct MovementBudget {
    /// When the last claim was made.
    made: Option<Duration>,
    accepted: Duration,
    unused_m: f64,
    /// The part that is left of a speed that the server itself gave, in metres a second.
    given: f32,
    /// What the server gave, and when.
    push: (f32, Duration),
    refusals: u32,
    first_refusal: Duration,
    last_refusal: Duration,
    corrected: Option<Duration>,
}

/// What becomes of a claim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClaimVerdict {
    /// The claim enters the world.
    Accepted,
    /// The claim is older than one that was taken in before.
    Old,
    /// The claim is false.
    Refused {
        /// Whether to tell the client where it is: no correction is on its way yet.
        correct: bool,
    },
    /// The claim is false, and the client has made too many false ones.
    Expelled,
}

impl MovementBudget {
    /// The budget of a client whose avatar has just been placed.
    pub fn new(now: Duration) -> Self {
        Self {
            made: None,
            accepted: now,
            unused_m: BUDGET_ROUNDING_M,
            given: 0.0,
            push: (0.0, now),
            refusals: 0,
            first_refusal: now,
            last_refusal: now,
            corrected: None,
        }
    }

    /// Starts anew after the server itself placed the avatar elsewhere or pushed it. It moves at
    /// this velocity now.
    pub fn relocate(&mut self, now: Duration, velocity: Vec3) {
        let given = velocity.length();
        *self = Self { made: self.made, given, push: (given, now), ..Self::new(now) };
    }

    /// The part of a velocity that the avatar can have, by what was accepted last.
    pub fn plausible(&self, velocity: Vec3, limits: &ClaimLimits) -> Vec3 {
        let speed_max = limits.speed_max.max(self.given);
        let aside = velocity.with_y(velocity.y.max(0.0)).clamp_length_max(speed_max);
        let fall = velocity.y.clamp(-limits.fall_max.max(speed_max), 0.0);
        aside + Vec3::Y * fall
    }

    /// Judges a claim by the last accepted place, by the TBV of a hidden client, and by the walls.
    ///
    /// `find_way` gives a lower bound of the length of the way to the claimed place, in metres, if
    /// there is a way that is no longer than its argument.
    pub fn judge(
        &mut self,
        now: Duration,
        claim: &Claim<'_>,
        limits: &ClaimLimits,
        find_way: impl FnOnce(f64) -> Option<f64>,
    ) -> ClaimVerdict {
        debug_assert!(claim.from.is_finite(), "only finite places are accepted");
        if self.made.is_some_and(|newest| claim.made <= newest) {
            return ClaimVerdict::Old;
        }
        self.made = Some(claim.made);
        let elapsed = now.saturating_sub(self.accepted);
        self.given = self.given.min(self.push_left(now));
        let allowed_m = self.allowed_m(elapsed.min(SILENCE_MAX), limits);
        let straight_m = straight_m(claim.from, claim.pose.eye, limits);
        let is_believable = claim.pose.is_finite()
            && limits.confines.contains(claim.pose.eye)
            && straight_m <= allowed_m
            && self.is_near_course(claim, elapsed, limits)
            && is_in_tbv(claim, now, limits);
        // A client that was silent for long may have gone to and fro.
        let way = is_believable.then(|| find_way(self.allowed_m(elapsed, limits) + WALK_SPARE_M));
        let Some(way_m) = way.flatten() else {
            return self.refuse(now, claim.round_trip, limits);
        };
        let unused_m = (allowed_m - straight_m.max(way_m)).max(0.0);
        let late = claim.late.min(LATENESS_MAX);
        let bunching = BUNCHING + claim.round_trip.min(BUNCHING_ROUND_TRIP_MAX) + late;
        let bunched_m = f64::from(limits.speed_max) * bunching.as_secs_f64();
        self.unused_m = unused_m.min(bunched_m.max(BUDGET_ROUNDING_M));
        debug_assert!(self.unused_m >= 0.0, "no client owes distance");
        self.accepted = now;
        self.refusals = 0;
        self.given = self.given.min(claim.pose.velocity.length());
        ClaimVerdict::Accepted
    }

    /// The part that is left of a push, whatever speed the client claims: a body that flies comes
    /// down, and one that slides comes to rest.
    fn push_left(&self, now: Duration) -> f32 {
        let (push, at) = self.push;
        let left = (PUSH_MAX.as_secs_f32() - now.saturating_sub(at).as_secs_f32())
            / (PUSH_MAX - PUSH_WHOLE).as_secs_f32();
        push * left.clamp(0.0, 1.0)
    }

    /// Whether a live client is where its silence has put it, or could get since it last had to
    /// speak. Silence alone earns it no leap.
    fn is_near_course(&self, claim: &Claim<'_>, elapsed: Duration, limits: &ClaimLimits) -> bool {
        let Some(course) = claim.course else { return true };
        let unsaid = elapsed.min(OFF_COURSE_MAX + claim.late.min(LATENESS_MAX));
        straight_m(course, claim.pose.eye, limits) <= self.allowed_m(unsaid, limits)
    }

    /// The distance that the client can have moved in a time after its last accepted claim.
    fn allowed_m(&self, elapsed: Duration, limits: &ClaimLimits) -> f64 {
        let speed = f64::from(limits.speed_max.max(self.given));
        self.unused_m + speed * SPEED_TOLERANCE * elapsed.as_secs_f64()
    }

    /// Counts refusals in a row. Refusals that were on their way when the first correction left
    /// expel nobody, and need no further correction.
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

/// The straight distance between two places, in metres. Falls count for less.
fn straight_m(from: Vec3, to: Vec3, limits: &ClaimLimits) -> f64 {
    let mut way = to.as_dvec3() - from.as_dvec3();
    if way.y < 0.0 {
        way.y *= f64::from(limits.speed_max / limits.fall_max.max(limits.speed_max));
    }
    way.length()
}

/// Whether the claimed eye is in the client's TBV, if it has one. An expired TBV goes on growing at
/// top speed.
fn is_in_tbv(claim: &Claim<'_>, now: Duration, limits: &ClaimLimits) -> bool {
    let Some(tbv) = claim.tbv else { return true };
    let beyond = now.saturating_sub(tbv.expiry).as_secs_f64() * f64::from(limits.speed_max);
    let margin_m = (beyond * SPEED_TOLERANCE + BUDGET_ROUNDING_M) as f32;
    let own = || tbv.axes.own(claim.pose.eye);
    tbv.grown(margin_m).contains(claim.pose.eye)
        && claim.sphere.is_none_or(|sphere| sphere.contains(own(), margin_m))
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

    /// When a claim is made, by its number.
    fn order(number: impl TryInto<u64>) -> Duration {
        ms(number.try_into().unwrap_or(0) + 1)
    }

    fn at(x: f32) -> Pose {
        Pose { eye: Vec3::new(x, 0.0, 0.0), ..Pose::default() }
    }

    /// Judges a claim where no wall is in the way.
    fn judge_freely(budget: &mut MovementBudget, now: Duration, claim: &Claim<'_>) -> ClaimVerdict {
        budget.judge(now, claim, &LIMITS, |_| Some(0.0))
    }

    /// Which of these claims, as (milliseconds, x in metres), are accepted.
    fn accepted(claims: &[(u64, f32)]) -> Vec<bool> {
        let mut budget = MovementBudget::new(ms(0));
        let mut place = Vec3::ZERO;
        let mut judge = |(i, &(t, x)): (usize, &(u64, f32))| {
            let verdict = judge_freely(
                &mut budget,
                ms(t),
                &Claim::new(order(i), &at(x), place, Duration::ZERO),
            );
            if verdict == ClaimVerdict::Accepted {
                place = at(x).eye;
            }
            verdict == ClaimVerdict::Accepted
        };
        claims.iter().enumerate().map(&mut judge).collect()
    }

    #[test]
    fn distance_is_earned_by_time_alone() {
        assert_eq!(accepted(&[(50, 0.1), (100, 0.2), (1_100, 2.2)]), [true; 3]);
        assert_eq!(accepted(&[(50, 0.2), (100, 0.2)]), [false, true]);
        assert_eq!(accepted(&[(500, 50.0)]), [false]);
        // Reports held up for 200 ms arrive all at once.
        let bunch = [(300, 0.4), (300, 0.5), (300, 0.6), (301, 0.6), (350, 0.72), (350, 0.9)];
        assert_eq!(accepted(&bunch), [true, true, true, true, true, false]);
        // Unused distance is lost after a while.
        assert_eq!(accepted(&[(10_000, 0.0), (10_050, 1.0)]), [true, false]);
    }

    #[test]
    fn the_report_after_one_that_was_sent_again_is_accepted() {
        let mut budget = MovementBudget::new(ms(0));
        let round_trip = ms(300);
        // One report a second, at top speed. The second one is lost, and comes again.
        for (i, (t, x)) in [(1_150, 2.0), (2_475, 4.0), (3_150, 6.0)].into_iter().enumerate() {
            let claim = at(x);
            let claim = Claim::new(order(i), &claim, at(x - 2.0).eye, round_trip);
            assert_eq!(judge_freely(&mut budget, ms(t), &claim), ClaimVerdict::Accepted, "{t}");
        }
    }

    #[test]
    fn a_report_that_is_held_up_for_longer_leaves_too_little_for_the_next_one() {
        let mut budget = MovementBudget::new(ms(0));
        // At top speed from the third second on. The report at 4 s comes 0.9 s late, and the next
        // in time.
        let claims = [(3_050, 0.0), (4_950, 2.0), (6_050, 6.0)];
        for (i, (t, x)) in claims.into_iter().enumerate() {
            let claim = at(x);
            let from = at(if i < 2 { 0.0 } else { 2.0 }).eye;
            let verdict =
                judge_freely(&mut budget, ms(t), &Claim::new(order(i), &claim, from, RTT));
            assert_eq!(verdict == ClaimVerdict::Accepted, i < 2, "{t}: {verdict:?}");
        }
    }

    #[test]
    fn claims_that_were_held_up_together_are_accepted_by_their_own_times() {
        let run = |tells_late: bool| {
            let mut budget = MovementBudget::new(ms(0));
            let claims = (1..=60_u64).map(|i| {
                // The server reads for the first time after three seconds of walking at top speed.
                let (made, now) = (ms(50 * i), ms(3_010));
                let (claim, from) = (at(0.1 * i as f32), at(0.1 * (i - 1) as f32).eye);
                let late = if tells_late { now - made } else { Duration::ZERO };
                let claim = Claim { late, ..Claim::new(made, &claim, from, Duration::ZERO) };
                judge_freely(&mut budget, now, &claim) == ClaimVerdict::Accepted
            });
            claims.filter(|is_accepted| *is_accepted).count()
        };
        assert_eq!(run(true), 60);
        assert!(run(false) < 60);
    }

    #[test]
    fn over_a_long_time_nobody_gains_more_than_one_per_cent() {
        for step in [1, 7, 50, 333] {
            let mut budget = MovementBudget::new(ms(0));
            let (mut x, mut t) = (0.0_f32, 0);
            for i in 0..2_000 {
                t += step;
                let hop = 2.0 * step as f32 / 1_000.0 * if i % 3 == 0 { 2.0 } else { 1.015 };
                let place = at(x).eye;
                let claim = at(x + hop);
                let verdict =
                    judge_freely(&mut budget, ms(t), &Claim::new(order(i), &claim, place, RTT));
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
    fn claims_that_are_not_finite_or_out_of_bounds_are_refused() {
        for eye in [
            Vec3::new(f32::NAN, 0.0, 0.0),
            Vec3::new(0.0, f32::INFINITY, 0.0),
            Vec3::new(0.0, 0.0, 1_001.0),
        ] {
            let mut budget = MovementBudget::new(ms(0));
            let claim = Pose { eye, ..Pose::default() };
            let verdict = judge_freely(
                &mut budget,
                ms(4_000),
                &Claim::new(order(0), &claim, Vec3::ZERO, RTT),
            );
            assert_eq!(verdict, ClaimVerdict::Refused { correct: true }, "{eye}");
        }
    }

    #[test]
    fn old_reports_are_ignored_even_after_a_refusal() {
        let mut budget = MovementBudget::new(ms(0));
        let mut judge = |t, sequence, x| {
            judge_freely(&mut budget, ms(t), &Claim::new(order(sequence), &at(x), Vec3::ZERO, RTT))
        };
        assert_eq!(judge(50, 5, 0.0), ClaimVerdict::Accepted);
        assert_eq!(judge(60, 5, 0.0), ClaimVerdict::Old);
        assert_eq!(judge(70, 4, 0.0), ClaimVerdict::Old);
        assert_eq!(judge(80, 9, 99.0), ClaimVerdict::Refused { correct: true });
        assert_eq!(judge(90, 8, 0.0), ClaimVerdict::Old);
        assert_eq!(judge(100, 10, 0.0), ClaimVerdict::Accepted);
    }

    #[test]
    fn a_hidden_client_must_be_inside_its_tbv() {
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
            let mut budget = MovementBudget::new(ms(0));
            let got = judge_freely(
                &mut budget,
                ms(t),
                &Claim { tbv: Some(&tbv), ..Claim::new(order(0), &at(x), Vec3::ZERO, RTT) },
            );
            assert_eq!(got, verdict, "{t} ms, {x} m");
        }
        // Unused distance does not lead out of the region.
        let mut budget = MovementBudget::new(ms(0));
        let start = Vec3::new(-1.0, 0.0, 0.0);
        let small = region(start, 0.2, ms(3_100));
        let got = judge_freely(
            &mut budget,
            ms(3_050),
            &Claim { tbv: Some(&small), ..Claim::new(order(0), &at(0.0), start, RTT) },
        );
        assert_eq!(got, ClaimVerdict::Refused { correct: true });
    }

    #[test]
    fn a_pushed_avatar_coasts_and_a_falling_one_falls() {
        let limits = ClaimLimits { fall_max: 20.0, ..LIMITS };
        let pose = |x: f32, y: f32, velocity: f32| Pose {
            eye: Vec3::new(x, y, 0.0),
            velocity: Vec3::X * velocity,
            ..Pose::default()
        };
        let mut budget = MovementBudget::new(ms(0));
        budget.relocate(ms(0), Vec3::X * 10.0);
        let mut judge = |t, sequence, claim: Pose, at: Pose| {
            let verdict = budget.judge(
                ms(t),
                &Claim::new(order(sequence), &claim, at.eye, RTT),
                &limits,
                |_| Some(0.0),
            );
            verdict == ClaimVerdict::Accepted
        };
        assert!(judge(100, 1, pose(1.0, 0.0, 8.0), pose(0.0, 0.0, 10.0)));
        assert!(!judge(200, 2, pose(2.3, 0.0, 8.0), pose(1.0, 0.0, 8.0)), "it has slowed to 8 m/s");
        assert!(judge(300, 3, pose(2.0, -4.0, 1.0), pose(1.0, 0.0, 8.0)), "down at 20 m/s");
        assert!(
            !judge(400, 4, pose(2.8, -4.0, 8.0), pose(2.0, -4.0, 1.0)),
            "lost speed does not come back"
        );
        let claimed = Vec3::new(9.0, -50.0, 0.0);
        assert_eq!(budget.plausible(claimed, &limits), Vec3::new(2.0, -20.0, 0.0));
    }

    #[test]
    fn a_push_is_not_believed_for_ever() {
        let mut budget = MovementBudget::new(ms(0));
        budget.relocate(ms(0), Vec3::X * 15.0);
        let mut x = 0.0_f32;
        for i in 1..=1_200_u64 {
            let (from, now) = (at(x).eye, ms(50 * i));
            for step in [0.75, 0.1] {
                let pose = Pose { velocity: Vec3::X * 15.0, ..at(x + step) };
                let claim = Claim::new(now + ms(step as u64), &pose, from, RTT);
                let claim = Claim { made: now + ms(u64::from(step < 0.5)), ..claim };
                if judge_freely(&mut budget, now, &claim) == ClaimVerdict::Accepted {
                    x += step;
                    break;
                }
            }
        }
        // A minute at two metres a second, and four seconds of the push.
        assert!((120.0..=120.0 + 60.0 + 5.0).contains(&x), "{x} m");
    }

    #[test]
    fn silence_earns_a_live_client_no_leap() {
        let is_accepted = |course_x: f32, x: f32| {
            let mut budget = MovementBudget::new(ms(0));
            let pose = at(x);
            let claim = Claim::new(order(0), &pose, Vec3::ZERO, RTT);
            let claim = Claim { course: Some(at(course_x).eye), ..claim };
            judge_freely(&mut budget, ms(5_000), &claim) == ClaimVerdict::Accepted
        };
        assert!(!is_accepted(0.0, 9.0), "it was to stand");
        assert!(is_accepted(8.0, 9.0), "it was to walk");
        assert!(is_accepted(0.0, 1.9), "it may have left its course a moment ago");
    }

    #[test]
    fn a_detour_round_a_wall_uses_up_the_budget_like_a_straight_way() {
        let mut budget = MovementBudget::new(ms(0));
        let mut round = |t, sequence, way_m: f64| {
            let find_way = |longest_m: f64| (way_m <= longest_m).then_some(way_m);
            budget.judge(
                ms(t),
                &Claim::new(order(sequence), &at(0.01), Vec3::ZERO, RTT),
                &LIMITS,
                find_way,
            )
        };
        assert_eq!(round(500, 1, 0.9), ClaimVerdict::Accepted);
        assert_eq!(round(550, 2, 0.9), ClaimVerdict::Refused { correct: true });
        assert_eq!(round(550, 3, 0.2), ClaimVerdict::Accepted);
        assert_eq!(round(1_000, 4, 0.9), ClaimVerdict::Accepted);
        // A way may be longer than any straight distance: the client may have gone to and fro.
        assert_eq!(round(9_000, 5, 16.0), ClaimVerdict::Accepted);
        assert_eq!(round(9_050, 6, 0.2), ClaimVerdict::Refused { correct: true });
    }

    #[test]
    fn a_client_that_persists_is_expelled_and_one_that_stumbles_is_not() {
        let run = |every_ms: u64, round_trip: Duration, good: u64| {
            let mut budget = MovementBudget::new(ms(0));
            (1..200_u64).position(|i| {
                let x = if good > 0 && i % good == 0 { 0.0 } else { 500.0 };
                let claim = at(x);
                judge_freely(
                    &mut budget,
                    ms(i * every_ms),
                    &Claim::new(order(i), &claim, Vec3::ZERO, round_trip),
                ) == ClaimVerdict::Expelled
            })
        };
        assert_eq!(run(50, RTT, 0), Some(19));
        assert_eq!(run(50, ms(1_000), 0), Some(40), "the correction must have been heard");
        assert_eq!(run(50, RTT, 10), None);
        assert_eq!(run(6_000, RTT, 0), None);
    }

    #[test]
    fn at_most_one_correction_is_sent_in_a_round_trip() {
        let mut budget = MovementBudget::new(ms(0));
        let corrected: Vec<bool> = (1..10_u32)
            .map(|i| {
                let claim = at(500.0);
                let now = ms(u64::from(i) * 25);
                let verdict =
                    judge_freely(&mut budget, now, &Claim::new(order(i), &claim, Vec3::ZERO, RTT));
                verdict == ClaimVerdict::Refused { correct: true }
            })
            .collect();
        assert_eq!(corrected, [true, false, false, false, true, false, false, false, true]);
    }

    #[test]
    fn a_corner_of_the_box_around_a_sphere_is_refused() {
        let tbv = Tbv {
            within: Aabb::around(Vec3::ZERO, 2.0),
            axes: Axes::WORLD,
            expiry: ms(2_000),
            notice: Duration::ZERO,
        };
        let sphere = Sphere { centre: Vec3::ZERO, radius_m: 2.0 };
        for (eye, verdict) in [
            (Vec3::new(1.4, 0.0, 1.4), ClaimVerdict::Accepted),
            (Vec3::new(1.6, 0.0, 1.6), ClaimVerdict::Refused { correct: true }),
        ] {
            let mut budget = MovementBudget::new(ms(0));
            let pose = Pose { eye, ..Pose::default() };
            let plain = Claim::new(order(0), &pose, Vec3::ZERO, RTT);
            let claim = Claim { tbv: Some(&tbv), sphere: Some(sphere), ..plain };
            assert_eq!(judge_freely(&mut budget, ms(2_000), &claim), verdict, "{eye}");
        }
    }
}
