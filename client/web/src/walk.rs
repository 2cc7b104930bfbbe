//! The own body: it walks as its person wants, or along a route.

use std::time::Duration;

use glam::Vec3;
use sightline_client_core::{
    arriving::ArrivingWorld,
    footing::{Footing, Rescue},
    gaze::Gaze,
    navigation::Navigation,
    route::Route,
    walker::{MoveInput, Walker},
};
use sightline_world::{Spawn, World, motion::Pose};

/// A pose that is farther from the one before was not walked to, in metres.
const LEAP_M: f32 = 2.0;
/// How fast a body walks along a route, in metres a second.
const PACE: f32 = 1.8;
/// A place to go to is looked for within this distance, in metres.
const GOAL_WITHIN_M: f32 = 3.0;
/// The distance between the places that are tried, in metres.
const GOAL_STEP_M: f32 = 0.5;

/// The own body in a world.
pub(crate) struct Walk {
    walker: Walker,
    footing: Footing,
    gaze: Gaze,
    route: Route,
    /// Made when first needed.
    navigation: Option<Navigation>,
    before: Option<Duration>,
}

impl Walk {
    pub(crate) fn new(world: &World, pose: Pose) -> Self {
        let walker = Walker::new(world, Spawn { eye: pose.eye, yaw: pose.yaw });
        let mut walk = Self {
            walker,
            footing: Footing::default(),
            gaze: Gaze::default(),
            route: Route::default(),
            navigation: None,
            before: None,
        };
        walk.gaze.face(&pose);
        walk
    }

    pub(crate) fn pose(&self) -> Pose {
        self.walker.pose()
    }

    /// Whether the body walks along a route.
    pub(crate) fn is_on_route(&self) -> bool {
        !self.route.is_over()
    }

    /// Stops walking along a route.
    pub(crate) fn stop(&mut self) {
        self.route = Route::default();
    }

    /// Puts the body elsewhere.
    pub(crate) fn put(&mut self, pose: Pose) {
        if self.pose().eye.distance(pose.eye) > LEAP_M {
            self.footing.forget();
            self.route = Route::default();
            self.gaze.face(&pose);
        }
        self.walker.place(pose);
    }

    /// Turns the view, in radians.
    pub(crate) fn turn(&mut self, left: f32, up: f32) {
        if (left, up) != (0.0, 0.0) {
            self.route = Route::default();
            self.gaze.turn(left, up);
        }
    }

    /// Moves on to a moment: forward, right and up as shares of the greatest speed. The body waits
    /// where the building is not here. Returns whether it is stuck.
    pub(crate) fn step(
        &mut self,
        building: &ArrivingWorld,
        now: Duration,
        [forward, right, up]: [f32; 3],
        jump: bool,
        fly: bool,
        stands: bool,
    ) -> bool {
        let dt_s = self.before.map_or(0.0, |before| now.saturating_sub(before).as_secs_f32());
        self.before = Some(now);
        let (yaw, pitch) = (self.gaze.yaw(), self.gaze.pitch());
        if stands || !building.is_open_at(self.pose().eye) {
            // The eye looks around and stays where it is.
            let stands = Pose { yaw, pitch, ..self.pose() };
            self.walker.place(Pose { velocity: Vec3::ZERO, ..stands });
            return false;
        }
        // Diagonal steps are no faster than straight ones.
        let most = forward.hypot(right).max(1.0);
        let (forward, right) = (forward / most, right / most);
        if (forward, right, jump) != (0.0, 0.0, false) {
            self.route = Route::default();
        }
        let wish = MoveInput { forward, right, up, yaw, pitch, fly, jump };
        let wish = self.along_route(building.world().speed_max, dt_s).unwrap_or(wish);
        let (world, octree) = (building.world(), building.octree());
        let rescue = self.footing.rescue(world, octree, &self.walker, &wish, dt_s);
        let input = match rescue {
            Some(Rescue::Back(way)) => way,
            Some(Rescue::Stuck) | None => wish,
        };
        let before = self.walker.clone();
        self.walker.step(octree, input, dt_s);
        if !building.is_open_at(self.pose().eye) {
            self.walker = before;
            let waits = Pose { yaw, pitch, velocity: Vec3::ZERO, ..self.pose() };
            self.walker.place(waits);
        }
        rescue == Some(Rescue::Stuck)
    }

    fn along_route(&mut self, speed_max: f32, dt_s: f32) -> Option<MoveInput> {
        let wish = self.route.wish(&self.walker.pose(), PACE, speed_max, dt_s)?;
        self.gaze.face(&Pose { yaw: wish.yaw, pitch: wish.pitch, ..Pose::default() });
        Some(wish)
    }

    /// Begins to walk to the floor at a point, or near it. Returns whether a way leads there.
    pub(crate) fn go_to(&mut self, world: &World, floor: Vec3) -> bool {
        if !floor.is_finite() {
            return false;
        }
        let navigation = self.navigation.get_or_insert_with(|| Navigation::new(world));
        let (from, goal) = (self.walker.pose().eye, floor + Vec3::Y * world.body.below_eye);
        let way = goals(goal).find_map(|goal| navigation.path(from, goal));
        self.route = Route::new(way.unwrap_or_default());
        !self.route.is_over()
    }
}

/// A goal, and places around it, the nearest first.
fn goals(goal: Vec3) -> impl Iterator<Item = Vec3> {
    let rings = (GOAL_WITHIN_M / GOAL_STEP_M) as u32;
    let around = (1..=rings).flat_map(move |ring| {
        (0..8).map(move |eighth| {
            let (sin, cos) = (eighth as f32 * std::f32::consts::FRAC_PI_4).sin_cos();
            goal + Vec3::new(cos, 0.0, sin) * (ring as f32 * GOAL_STEP_M)
        })
    });
    std::iter::once(goal).chain(around)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use sightline_fixtures::voxel_floor;

    use super::*;

    fn building() -> ArrivingWorld {
        ArrivingWorld::whole(Arc::new(voxel_floor::world(&[])))
    }

    /// Walks for a number of seconds.
    fn walked(walk: &mut Walk, from_s: u32, seconds: u32, forward: f32) {
        let building = building();
        for frame in from_s * 30..(from_s + seconds) * 30 {
            let now = Duration::from_secs(frame.into()) / 30;
            walk.step(&building, now, [forward, 0.0, 0.0], false, false, false);
        }
    }

    fn walk() -> Walk {
        let pose = Pose { eye: voxel_floor::SPAWN.eye, ..Pose::default() };
        Walk::new(building().world(), pose)
    }

    #[test]
    fn a_body_goes_to_a_place_and_stops_when_its_person_wants_otherwise() {
        let (mut walk, building) = (walk(), building());
        let goal = Vec3::new(6.0, 0.125, 6.0);
        assert!(walk.go_to(building.world(), goal) && walk.is_on_route());
        walked(&mut walk, 0, 10, 0.0);
        let off = (walk.pose().eye - goal).with_y(0.0).length();
        assert!(off < 0.5 && !walk.is_on_route(), "{off} m off");
        assert!(walk.go_to(building.world(), voxel_floor::SPAWN.eye.with_y(0.125)));
        walked(&mut walk, 10, 1, -0.5);
        assert!(!walk.is_on_route());
        let outside = walk.go_to(building.world(), Vec3::splat(900.0));
        assert!(!outside, "no way leads out of the world");
    }

    #[test]
    fn who_is_lost_to_the_server_looks_around_and_stays() {
        let (mut walk, building) = (walk(), building());
        let start = walk.pose().eye;
        walk.turn(0.5, 0.1);
        for ms in [100, 200, 300] {
            let now = Duration::from_millis(ms);
            walk.step(&building, now, [1.0, 0.0, 0.0], false, false, true);
        }
        assert_eq!(walk.pose().eye, start);
        assert!((walk.pose().pitch - 0.1).abs() < 1e-6 && walk.pose().velocity == Vec3::ZERO);
    }
}
