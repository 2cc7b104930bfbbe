//! Whether a client moves as its own claims say.
//!
//! Regions follow from the velocity that a client claims. A client that claims to stand while it
//! runs would be believed nearer than it is, and others would be told of it late. So each claim is
//! kept for some ticks, and what its velocity allowed since must contain all later places. A client
//! that is found elsewhere is *doubted* for a while: its body counts as able to go anywhere at top
//! speed. Its eye region does not grow, so it is told of no more than before.

use std::time::Duration;

use sightline_world::{
    motion::{Agility, Pose, Tolerance},
    tolerance::WIRE_POSE_M,
};

/// How many claims are kept: as far back as most horizons reach ahead.
const CLAIMS_KEPT: usize = 8;
/// How long a client is doubted.
const DOUBT: Duration = Duration::from_secs(2);

/// When a claim came in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arrival {
    pub(crate) now: Duration,
    /// By how much that is later than usual.
    pub(crate) late: Duration,
}

/// An accepted claim.
#[derive(Clone, Copy, Debug)]
struct PastClaim {
    /// When it would have come in if it had not been late.
    due: Duration,
    pose: Pose,
}

/// Where a client's silence has put its avatar: on its course, at the client's last tick before a
/// claim. Silence is a claim, too.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OnCourse {
    pub(crate) pose: Pose,
    /// How long before the claim that is.
    pub(crate) before: Duration,
    /// By how much the avatar may have been elsewhere then.
    pub(crate) tolerance: Tolerance,
}

impl OnCourse {
    /// Whether an avatar at a pose is no longer on this course.
    pub(crate) fn departs(&self, pose: &Pose, agility: &Agility) -> bool {
        let course = self.pose.on_course(self.before, agility);
        let tolerance = &self.tolerance;
        !tolerance.holds(&course, pose, agility) || !tolerance.holds_turn(&course, pose)
    }

    fn allows(&self, pose: &Pose, agility: &Agility, slack: Duration) -> bool {
        let time = self.before + slack;
        let able = agility.eyes(self.pose.eye, self.pose.velocity, time);
        able.grown(WIRE_POSE_M + self.tolerance.growth_m(time)).contains(pose.eye)
    }
}

/// The last claims of a client, in a ring.
#[derive(Clone, Debug, Default)]
pub(crate) struct ClaimConsistency {
    claims: [Option<PastClaim>; CLAIMS_KEPT],
    /// Where the oldest claim is, which is overwritten next.
    next: usize,
    doubted_until: Duration,
}

impl ClaimConsistency {
    /// Checks an accepted claim against earlier ones, and against where the client's silence has
    /// put it, and keeps it. The time between two claims may differ by `slack` from the time
    /// between their arrivals, lateness apart.
    pub(crate) fn check(
        &mut self,
        Arrival { now, late }: Arrival,
        pose: Pose,
        course: Option<&OnCourse>,
        agility: &Agility,
        slack: Duration,
    ) {
        debug_assert!(pose.is_finite(), "only finite claims are accepted");
        let due = now.saturating_sub(late);
        let allows = |claim: &PastClaim| {
            let time = due.saturating_sub(claim.due) + slack;
            let able = agility.eyes(claim.pose.eye, claim.pose.velocity, time);
            able.grown(WIRE_POSE_M).contains(pose.eye)
        };
        let was_on_course = course.is_none_or(|course| course.allows(&pose, agility, slack));
        if !was_on_course || !self.claims.iter().flatten().all(allows) {
            self.doubted_until = now + DOUBT;
            self.forget();
        }
        self.claims[self.next] = Some(PastClaim { due, pose });
        self.next = (self.next + 1) % CLAIMS_KEPT;
    }

    /// What another station has found of a client of its own.
    pub(crate) fn relayed(is_consistent: bool) -> Self {
        let doubted_until = if is_consistent { Duration::ZERO } else { Duration::MAX };
        Self { doubted_until, ..Self::default() }
    }

    /// Forgets all claims: something else has moved the body.
    pub(crate) fn forget(&mut self) {
        self.claims = Default::default();
    }

    /// Whether the client has moved as its claims say for some seconds.
    pub(crate) fn is_consistent(&self, now: Duration) -> bool {
        now >= self.doubted_until
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    const AGILITY: Agility = Agility {
        speed_max: 5.0,
        dash: 1.4,
        acceleration_max: 6.0,
        step: 0.35,
        climb: 2.0,
        fall_max: 5.0,
    };

    fn on_time(now: Duration) -> Arrival {
        Arrival { now, late: Duration::ZERO }
    }

    /// Whether a client that moves at one speed and claims another is believed after half a second.
    fn is_believed(speed: f32, claimed: f32) -> bool {
        let mut claims = ClaimConsistency::default();
        for tick in 0..10 {
            let now = Duration::from_millis(50 * tick);
            let eye = Vec3::X * speed * now.as_secs_f32();
            let pose = Pose { eye, velocity: Vec3::X * claimed, ..Pose::default() };
            claims.check(on_time(now), pose, None, &AGILITY, Duration::from_millis(20));
        }
        claims.is_consistent(Duration::from_millis(500))
    }

    #[test]
    fn a_client_that_runs_but_claims_to_stand_is_doubted() {
        assert!(is_believed(5.0, 5.0) && is_believed(0.0, 0.0) && is_believed(1.0, 0.0));
        // A wall may have stopped it.
        assert!(is_believed(0.0, 5.0));
        assert!(!is_believed(5.0, 0.0) && !is_believed(5.0, -5.0));
    }

    #[test]
    fn a_client_that_leaves_its_course_in_silence_is_doubted() {
        let ahead = Duration::from_millis(200);
        let tolerance = Tolerance { metres: 0.1, radians: 0.1, ahead };
        let is_believed = |x: f32| {
            let mut claims = ClaimConsistency::default();
            let pose = Pose { velocity: Vec3::X, ..Pose::default() };
            let course = OnCourse { pose, before: Duration::from_millis(50), tolerance };
            let claim = Pose { eye: Vec3::X * x, ..pose };
            claims.check(on_time(Duration::ZERO), claim, Some(&course), &AGILITY, Duration::ZERO);
            claims.is_consistent(Duration::ZERO)
        };
        assert!(is_believed(0.05) && is_believed(0.2) && is_believed(-0.15));
        assert!(!is_believed(0.4) && !is_believed(-0.4));
    }

    #[test]
    fn doubt_passes_and_an_impulse_causes_none() {
        let mut claims = ClaimConsistency::default();
        let at = |x: f32| Pose { eye: Vec3::X * x, ..Pose::default() };
        let ms = Duration::from_millis;
        claims.check(on_time(ms(0)), at(0.0), None, &AGILITY, ms(0));
        claims.forget();
        claims.check(on_time(ms(50)), at(9.0), None, &AGILITY, ms(0));
        assert!(claims.is_consistent(ms(50)));
        claims.check(on_time(ms(100)), at(18.0), None, &AGILITY, ms(0));
        assert!(!claims.is_consistent(ms(100)) && claims.is_consistent(ms(100) + DOUBT));
    }

    #[test]
    fn claims_that_were_held_up_together_are_no_reason_for_doubt() {
        let ms = Duration::from_millis;
        let doubts = |late_ms: fn(u64) -> u64| {
            let mut claims = ClaimConsistency::default();
            for i in 0..8 {
                let pose = Pose { eye: Vec3::X * i as f32, velocity: Vec3::X, ..Pose::default() };
                let arrival = Arrival { now: ms(9_000), late: ms(late_ms(i)) };
                claims.check(arrival, pose, None, &AGILITY, ms(20));
            }
            !claims.is_consistent(ms(9_000))
        };
        assert!(!doubts(|i| 7_000 - 1_000 * i) && doubts(|_| 0));
    }
}
