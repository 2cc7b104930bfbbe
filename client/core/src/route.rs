//! Walking along a route: from one place to the next, as people walk.

use std::{collections::VecDeque, f32::consts::TAU};

use glam::Vec3;
use sightline_world::motion::{Pose, turn_between};

use crate::walker::MoveInput;

/// The distance within which a place counts as reached, in metres.
const NEAR_M: f32 = 0.12;
/// A body that gets no nearer for this time gives up, in seconds.
const STUCK_S: f32 = 2.0;
/// How fast people turn to go on, in radians a second.
const TURN_SPEED: f32 = 3.0;
/// A walker that must turn by more than this stands meanwhile, in radians.
const TURN_FIRST: f32 = 1.2;

/// The places that a body walks to, one after the other. The default has none.
#[derive(Clone, Debug, Default)]
pub struct Route {
    places: VecDeque<Vec3>,
    progress: Progress,
}

/// How a body nears the next place.
#[derive(Clone, Copy, Debug)]
struct Progress {
    /// The smallest distance so far, in metres.
    nearest_m: f32,
    /// The time since then, in seconds.
    since_s: f32,
}

impl Default for Progress {
    fn default() -> Self {
        Self { nearest_m: f32::MAX, since_s: 0.0 }
    }
}

impl Route {
    /// A route along eyes that straight lines lead to, as
    /// [`Navigation::path`](crate::navigation::Navigation::path) finds them.
    pub fn new(places: Vec<Vec3>) -> Self {
        Self { places: places.into(), progress: Progress::default() }
    }

    /// Whether there is no place to walk to any more: the last one was reached, or the body was
    /// held up.
    pub fn is_over(&self) -> bool {
        self.places.is_empty()
    }

    /// The wish of a body at a pose for the next `dt_s` seconds. It walks at `pace` metres a second
    /// where the world allows `speed_max`. `None` when the route is over.
    pub fn wish(&mut self, pose: &Pose, pace: f32, speed_max: f32, dt_s: f32) -> Option<MoveInput> {
        let next = self.next_place(pose.eye)?;
        let way = (next - pose.eye).with_y(0.0);
        self.watch_progress(way.length(), dt_s);
        let heading = (-way.x).atan2(-way.z);
        let yaw = turned(pose.yaw, heading, TURN_SPEED * dt_s);
        let aside = turn_between(yaw, heading);
        // Slower over the last stretch, to avoid overshooting.
        let pace = pace.min(way.length() / dt_s.max(1e-3));
        let pace = if aside.abs() > TURN_FIRST { 0.0 } else { pace / speed_max.max(0.1) };
        let (left, forward) = (pace * aside.sin(), pace * aside.cos());
        Some(MoveInput { forward, right: -left, yaw, ..MoveInput::default() })
    }

    /// Removes the places that were reached, and returns the next one.
    fn next_place(&mut self, eye: Vec3) -> Option<Vec3> {
        while let Some(next) = self.places.front().copied() {
            if (next - eye).with_y(0.0).length() > NEAR_M {
                return Some(next);
            }
            self.places.pop_front();
            self.progress = Progress::default();
        }
        None
    }

    /// Gives up when the body gets no nearer.
    fn watch_progress(&mut self, distance_m: f32, dt_s: f32) {
        let progress = &mut self.progress;
        if distance_m < progress.nearest_m - 0.05 {
            *progress = Progress { nearest_m: distance_m, since_s: 0.0 };
            return;
        }
        progress.since_s += dt_s;
        if progress.since_s > STUCK_S {
            *self = Self::default();
        }
    }
}

/// A heading turned towards another one, by an angle at most.
pub fn turned(yaw: f32, towards: f32, angle_max: f32) -> f32 {
    (yaw + turn_between(yaw, towards).clamp(-angle_max, angle_max)).rem_euclid(TAU)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Walks for at most 20 seconds where nothing, or everything, is in the way.
    fn walked(route: &mut Route, is_held: bool) -> (Pose, f32) {
        let (mut pose, dt_s, mut time_s) = (Pose::default(), 0.05, 0.0);
        while let Some(wish) = route.wish(&pose, 1.4, 2.8, dt_s) {
            let (sin, cos) = wish.yaw.sin_cos();
            let (ahead, right) = (Vec3::new(-sin, 0.0, -cos), Vec3::new(cos, 0.0, -sin));
            let way = (ahead * wish.forward + right * wish.right) * 2.8 * dt_s;
            assert!(way.length() <= 1.401 * dt_s, "no faster than its pace");
            pose.eye += if is_held { Vec3::ZERO } else { way };
            pose.yaw = wish.yaw;
            time_s += dt_s;
            assert!(time_s < 20.0);
        }
        (pose, time_s)
    }

    #[test]
    fn a_route_leads_to_its_last_place_and_turns_on_the_way() {
        let (corner, end) = (Vec3::new(0.0, 0.0, -3.0), Vec3::new(4.0, 0.0, -3.0));
        let mut route = Route::new(vec![corner, end]);
        let (pose, time_s) = walked(&mut route, false);
        assert!(route.is_over() && pose.eye.distance(end) <= NEAR_M, "{pose:?}");
        assert!((5.0..8.0).contains(&time_s), "seven metres took {time_s} s");
    }

    #[test]
    fn who_is_held_up_gives_up() {
        let mut route = Route::new(vec![Vec3::X * 9.0]);
        let (_, time_s) = walked(&mut route, true);
        assert!((STUCK_S..STUCK_S + 0.3).contains(&time_s), "{time_s} s");
    }
}
