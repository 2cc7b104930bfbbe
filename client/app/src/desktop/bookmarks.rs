//! Bookmarked views, and flights to them.

use std::{
    f32::consts::{PI, TAU},
    time::{Duration, Instant},
};

use sightline_world::motion::Pose;

/// The number of views: one for each of the keys 1 to 9.
const VIEWS: usize = 9;
/// The mean speed of a flight, in metres per second.
const SPEED_M_PER_S: f32 = 8.0;
/// The shortest and the longest duration of a flight, in seconds.
const FLIGHT_S: [f32; 2] = [1.0, 6.0];

/// The bookmarked views, and the current flight.
#[derive(Clone, Debug, Default)]
pub(super) struct Bookmarks {
    views: [Option<Pose>; VIEWS],
    flight: Option<Flight>,
}

#[derive(Clone, Copy, Debug)]
struct Flight {
    from: Pose,
    to: Pose,
    begun: Instant,
    length: Duration,
}

impl Bookmarks {
    /// Bookmarks a view under a number from 0.
    pub(super) fn keep(&mut self, number: usize, pose: Pose) {
        if let Some(view) = self.views.get_mut(number) {
            *view = Some(Pose { velocity: Default::default(), ..pose });
        }
    }

    /// Starts a flight to a view. Returns false when there is no such view.
    pub(super) fn fly(&mut self, number: usize, from: Pose, now: Instant) -> bool {
        let Some(to) = self.views.get(number).copied().flatten() else { return false };
        let seconds = from.eye.distance(to.eye) / SPEED_M_PER_S;
        let length = Duration::from_secs_f32(seconds.clamp(FLIGHT_S[0], FLIGHT_S[1]));
        self.flight = Some(Flight { from, to, begun: now, length });
        true
    }

    /// The pose of the current flight, if any. The flight ends at its goal.
    pub(super) fn flight(&mut self, now: Instant) -> Option<Pose> {
        let Flight { from, to, begun, length } = self.flight?;
        let share = now.saturating_duration_since(begun).as_secs_f32() / length.as_secs_f32();
        if share >= 1.0 {
            self.flight = None;
            return Some(to);
        }
        // Smoothstep: the flight starts and ends gently.
        debug_assert!((0.0..1.0).contains(&share), "the flight is on");
        let share = share * share * (3.0 - 2.0 * share);
        let turn = (to.yaw - from.yaw + PI).rem_euclid(TAU) - PI;
        Some(Pose {
            eye: from.eye.lerp(to.eye, share),
            yaw: from.yaw + turn * share,
            pitch: from.pitch + (to.pitch - from.pitch) * share,
            ..to
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn a_flight_turns_the_short_way_to_its_view() {
        let mut bookmarks = Bookmarks::default();
        let pose = |x: f32, yaw: f32| Pose { eye: Vec3::X * x, yaw, ..Pose::default() };
        let now = Instant::now();
        assert!(!bookmarks.fly(2, pose(0.0, 0.0), now));
        bookmarks.keep(2, Pose { velocity: Vec3::ONE, ..pose(16.0, 6.0) });
        bookmarks.keep(99, pose(1.0, 1.0));
        assert!(!bookmarks.fly(99, pose(0.0, 0.0), now));
        assert!(bookmarks.flight(now).is_none());
        assert!(bookmarks.fly(2, pose(0.0, 0.2), now));
        let at = |bookmarks: &mut Bookmarks, ms| bookmarks.flight(now + Duration::from_millis(ms));
        let middle = at(&mut bookmarks, 1_000).unwrap();
        assert!((middle.eye.x - 8.0).abs() < 1e-3, "{middle:?}");
        assert!((middle.yaw - (0.1 - (TAU - 6.0) * 0.5)).abs() < 1e-3, "{middle:?}");
        let before = (0..1_000).step_by(20).map(|ms| at(&mut bookmarks, ms).unwrap().eye.x);
        assert!(before.collect::<Vec<_>>().is_sorted());
        let end = at(&mut bookmarks, 2_000).unwrap();
        assert_eq!((end.eye.x, end.yaw, end.velocity), (16.0, 6.0, Vec3::ZERO));
        assert!(at(&mut bookmarks, 2_001).is_none());
    }
}
