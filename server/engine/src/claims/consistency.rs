//! Whether a client moves as it says that it does.
//!
//! Regions follow from the velocities that clients claim. One who claims to stand while it runs would be
//! believed to be nearer than it is, and others would be told of it late. So each claim is kept for some
//! ticks, and what its velocity allowed since must hold all later places. Who is found elsewhere is
//! doubted for a while: it counts as able to go anywhere at top speed. It is told of no more for that: only where
//! its body can be grows, not where its eyes can.

use std::time::Duration;

use sightline_world::{
    motion::{Agility, Pose},
    tolerance::WIRE_POSE_M,
};

/// So many claims are kept: as far back as most horizons reach ahead.
const KEPT: usize = 8;
/// For so long is a client doubted.
const DOUBT: Duration = Duration::from_secs(2);

/// The last claims of a client.
#[derive(Clone, Debug, Default)]
pub(crate) struct ClaimConsistency {
    /// When each came in; the oldest is the next to go.
    kept: [Option<(Duration, Pose)>; KEPT],
    next: usize,
    doubted_until: Duration,
}

impl ClaimConsistency {
    /// Takes in an accepted claim. When two were made may differ by `slack` from when they came in.
    pub(crate) fn keep(&mut self, now: Duration, pose: Pose, agility: &Agility, slack: Duration) {
        let holds = |(then, pledge): &(Duration, Pose)| {
            let time = now.saturating_sub(*then) + slack;
            let able = agility.eyes(pledge.eye, pledge.velocity, time);
            able.grown(WIRE_POSE_M).contains(pose.eye)
        };
        if !self.kept.iter().flatten().all(holds) {
            self.doubted_until = now + DOUBT;
            self.forget();
        }
        self.kept[self.next] = Some((now, pose));
        self.next = (self.next + 1) % KEPT;
    }

    /// The body was moved by something else.
    pub(crate) fn forget(&mut self) {
        self.kept = Default::default();
    }

    /// Whether it moves as its claims say, as far as is known.
    pub(crate) fn are_kept(&self, now: Duration) -> bool {
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

    /// Whether somebody who runs at some speed and claims another is believed, after half a second.
    fn is_believed(speed: f32, claimed: f32) -> bool {
        let mut pledges = ClaimConsistency::default();
        for tick in 0..10 {
            let now = Duration::from_millis(50 * tick);
            let eye = Vec3::X * speed * now.as_secs_f32();
            let pose = Pose { eye, velocity: Vec3::X * claimed, ..Pose::default() };
            pledges.keep(now, pose, &AGILITY, Duration::from_millis(20));
        }
        pledges.are_kept(Duration::from_millis(500))
    }

    #[test]
    fn who_runs_but_claims_to_stand_is_doubted() {
        assert!(is_believed(5.0, 5.0) && is_believed(0.0, 0.0) && is_believed(1.0, 0.0));
        // A wall may have stopped it.
        assert!(is_believed(0.0, 5.0));
        assert!(!is_believed(5.0, 0.0) && !is_believed(5.0, -5.0));
    }

    #[test]
    fn doubt_passes_and_who_is_moved_by_others_is_not_doubted() {
        let mut pledges = ClaimConsistency::default();
        let at = |x: f32| Pose { eye: Vec3::X * x, ..Pose::default() };
        let ms = Duration::from_millis;
        pledges.keep(ms(0), at(0.0), &AGILITY, ms(0));
        pledges.forget();
        pledges.keep(ms(50), at(9.0), &AGILITY, ms(0));
        assert!(pledges.are_kept(ms(50)));
        pledges.keep(ms(100), at(18.0), &AGILITY, ms(0));
        assert!(!pledges.are_kept(ms(100)) && pledges.are_kept(ms(100) + DOUBT));
    }
}
