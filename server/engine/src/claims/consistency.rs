//! Whether a client moves as its own claims say.
//!
//! Regions follow from the velocity that a client claims. A client that claims to stand while it
//! runs would be believed nearer than it is, and others would be told of it late. So each claim is
//! kept for some ticks, and what its velocity allowed since must contain all later places. A client
//! that is found elsewhere is *doubted* for a while: its body counts as able to go anywhere at top
//! speed. Its eye region does not grow, so it is told of no more than before.

use std::time::Duration;

use sightline_world::{
    motion::{Agility, Pose},
    tolerance::WIRE_POSE_M,
};

/// How many claims are kept: as far back as most horizons reach ahead.
const CLAIMS_KEPT: usize = 8;
/// How long a client is doubted.
const DOUBT: Duration = Duration::from_secs(2);

/// An accepted claim.
#[derive(Clone, Copy, Debug)]
struct PastClaim {
    /// When it came in.
    heard: Duration,
    pose: Pose,
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
    /// Checks an accepted claim against earlier ones and keeps it. The time between two claims may
    /// differ by `slack` from the time between their arrivals.
    pub(crate) fn check(&mut self, now: Duration, pose: Pose, agility: &Agility, slack: Duration) {
        debug_assert!(pose.is_finite(), "only finite claims are accepted");
        let allows = |claim: &PastClaim| {
            let time = now.saturating_sub(claim.heard) + slack;
            let able = agility.eyes(claim.pose.eye, claim.pose.velocity, time);
            able.grown(WIRE_POSE_M).contains(pose.eye)
        };
        if !self.claims.iter().flatten().all(allows) {
            self.doubted_until = now + DOUBT;
            self.forget();
        }
        self.claims[self.next] = Some(PastClaim { heard: now, pose });
        self.next = (self.next + 1) % CLAIMS_KEPT;
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

    /// Whether a client that moves at one speed and claims another is believed after half a second.
    fn is_believed(speed: f32, claimed: f32) -> bool {
        let mut claims = ClaimConsistency::default();
        for tick in 0..10 {
            let now = Duration::from_millis(50 * tick);
            let eye = Vec3::X * speed * now.as_secs_f32();
            let pose = Pose { eye, velocity: Vec3::X * claimed, ..Pose::default() };
            claims.check(now, pose, &AGILITY, Duration::from_millis(20));
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
    fn doubt_passes_and_an_impulse_causes_none() {
        let mut claims = ClaimConsistency::default();
        let at = |x: f32| Pose { eye: Vec3::X * x, ..Pose::default() };
        let ms = Duration::from_millis;
        claims.check(ms(0), at(0.0), &AGILITY, ms(0));
        claims.forget();
        claims.check(ms(50), at(9.0), &AGILITY, ms(0));
        assert!(claims.is_consistent(ms(50)));
        claims.check(ms(100), at(18.0), &AGILITY, ms(0));
        assert!(!claims.is_consistent(ms(100)) && claims.is_consistent(ms(100) + DOUBT));
    }
}
