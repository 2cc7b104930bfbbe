//! Whether a body has a footing in the building: where it stood last, and the way back there once
//! it has fallen out of the world.

use glam::Vec3;
use sightline_world::{World, geometry::Aabb, octree::Octree};

use crate::walker::{MoveInput, Walker};

/// A floor within this distance below the soles carries the body, in metres.
const FLOOR_WITHIN_M: f32 = 0.06;
/// A body that falls where there is no floor at all has left the world this far below its last
/// footing, in metres.
const FALL_M: f32 = 3.0;
/// A body that has had no room for this long is stuck, in seconds.
const STUCK_S: f32 = 2.0;
/// A body on its way back that has come no nearer for this long is stuck, in seconds.
const HELD_UP_S: f32 = 2.0;
/// The distance between two places of the trail, in metres.
const TRAIL_STEP_M: f32 = 0.5;
/// A place of the trail is reached within this distance, in metres, and the first one, where the
/// body stood, within the other.
const REACHED_M: [f32; 2] = [0.3, 0.05];
/// A body flies to so far above the place where it stood, so that it gets over the edge of the
/// floor, in metres.
const LIFT_M: f32 = 0.15;
/// A body stands well when there is a floor this close to the vertical below its eye, in metres.
const MIDDLE_M: f32 = 0.02;
/// The number of places of a trail. On a longer way the oldest are left out.
const TRAIL_MAX: usize = 1_024;

/// Where a body stood last, and the way that it went from there.
#[derive(Clone, Debug, Default)]
pub struct Footing {
    /// The eye where the body stood last, and the places that it passed since, the newest last.
    trail: Vec<Vec3>,
    /// Whether it is on its way back along the trail.
    is_returning: bool,
    /// For how long it has not fitted, or come no nearer to its last footing, in seconds.
    troubled_s: f32,
    /// How near it has come to the next place of its way back, in metres.
    nearest_m: f32,
}

/// What a body in trouble must do in place of what its person wants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rescue {
    /// It has fallen out of the world, and flies back to where it stood last.
    Back(MoveInput),
    /// It is stuck: it must be put elsewhere, such as to a spawn point.
    Stuck,
}

impl Footing {
    /// Forgets everything: the body was put elsewhere.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// Looks at a body that is about to move for `dt_s` seconds, as `wish` says, among the voxels
    /// of a world as far as they are here. `None` while it is not in trouble.
    pub fn rescue(
        &mut self,
        world: &World,
        octree: &Octree,
        walker: &Walker,
        wish: &MoveInput,
        dt_s: f32,
    ) -> Option<Rescue> {
        let eye = walker.pose().eye;
        let body = world.body.around(eye);
        if octree.solid_in(&body) {
            return self.is_troubled_for(dt_s, STUCK_S).then_some(Rescue::Stuck);
        }
        if self.is_returning {
            return self.way_back(eye, wish, dt_s);
        }
        self.troubled_s = 0.0;
        let below = |depth: f32, half: f32| {
            let (soles, half) = (eye.with_y(body.min.y), Vec3::new(half, 0.0, half));
            octree.solid_in(&Aabb { min: soles - half - Vec3::Y * depth, max: soles + half })
        };
        if walker.is_grounded() && below(FLOOR_WITHIN_M, MIDDLE_M) {
            self.trail.clear();
            self.trail.push(eye);
            return None;
        }
        let (stood, newest) = (*self.trail.first()?, *self.trail.last()?);
        if newest.distance(eye) > TRAIL_STEP_M {
            if self.trail.len() >= TRAIL_MAX {
                self.trail.remove(1);
            }
            self.trail.push(eye);
        }
        let is_below = stood.y - eye.y > FALL_M || walker.is_grounded();
        let depth = body.min.y - world.bounds().min.y;
        let is_out = !wish.fly && is_below && !below(depth, world.body.half_width);
        if is_out {
            (self.is_returning, self.nearest_m) = (true, f32::INFINITY);
        }
        None
    }

    /// Goes on along the trail, towards its beginning.
    fn way_back(&mut self, eye: Vec3, wish: &MoveInput, dt_s: f32) -> Option<Rescue> {
        while let Some(next) = self.trail.last().copied() {
            let is_first = self.trail.len() == 1;
            let lift = if is_first { LIFT_M } else { 0.0 };
            let way = next + Vec3::Y * lift - eye;
            let distance = way.length();
            if distance > REACHED_M[usize::from(is_first)] {
                if distance < self.nearest_m - 0.001 {
                    (self.nearest_m, self.troubled_s) = (distance, 0.0);
                } else if self.is_troubled_for(dt_s, HELD_UP_S) {
                    self.forget();
                    return Some(Rescue::Stuck);
                }
                return Some(Rescue::Back(flight(way, wish)));
            }
            self.nearest_m = f32::INFINITY;
            if is_first {
                break;
            }
            self.trail.pop();
        }
        (self.is_returning, self.troubled_s) = (false, 0.0);
        None
    }

    /// Counts the time in trouble. Returns whether it has lasted this long, and then begins anew.
    fn is_troubled_for(&mut self, dt_s: f32, limit_s: f32) -> bool {
        self.troubled_s += dt_s;
        let is_over = self.troubled_s >= limit_s;
        if is_over {
            self.troubled_s = 0.0;
        }
        is_over
    }
}

/// The input by which a body flies along a way, given in metres, while it looks as it wishes, but
/// not steeply: it flies in the direction of view.
fn flight(way: Vec3, wish: &MoveInput) -> MoveInput {
    // A metre before its goal it slows down.
    let way = way.clamp_length_max(1.0) * 0.7;
    let pitch = wish.pitch.clamp(-0.5, 0.5);
    let ((sin, cos), (rise, level)) = (wish.yaw.sin_cos(), pitch.sin_cos());
    let forward = (-way.x * sin - way.z * cos) / level;
    let right = way.x * cos - way.z * sin;
    let up = way.y - forward * rise;
    MoveInput { forward, right, up, pitch, fly: true, jump: false, ..*wish }
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor;
    use sightline_world::{Cells, Spawn};

    use super::*;

    /// The yaw of a view along +x.
    const EAST: f32 = -std::f32::consts::FRAC_PI_2;
    const DT_S: f32 = 1.0 / 60.0;

    /// A floor of 8 m by 8 m in a void that is 10 m deep.
    fn floor_over_a_void(boxes: &[([u32; 3], [u32; 3], u8)]) -> World {
        let bounds = Aabb::new(Vec3::new(-4.0, -10.0, -4.0), Vec3::new(14.0, 8.0, 12.0));
        World { cells: Cells::whole(bounds), ..voxel_floor::world(boxes) }
    }

    /// Moves a body for some seconds, and returns where it was and in what trouble.
    fn walk(
        world: &World,
        walker: &mut Walker,
        footing: &mut Footing,
        wish: MoveInput,
        seconds: f32,
    ) -> Vec<(Vec3, Option<Rescue>)> {
        let step = |_| {
            let rescue = footing.rescue(world, &world.octree, walker, &wish, DT_S);
            let input = match rescue {
                Some(Rescue::Back(input)) => input,
                _ => wish,
            };
            (walker.step(&world.octree, input, DT_S).eye, rescue)
        };
        (0..(seconds / DT_S) as u32).map(step).collect()
    }

    #[test]
    fn who_falls_out_of_the_world_comes_back_to_where_it_stood() {
        let world = floor_over_a_void(&[]);
        for pitch in [0.0, -1.5] {
            let mut walker = Walker::new(&world, voxel_floor::SPAWN);
            let mut footing = Footing::default();
            let east = MoveInput { forward: 1.0, yaw: EAST, pitch, ..MoveInput::default() };
            let way = walk(&world, &mut walker, &mut footing, east, 3.5);
            let deepest = way.iter().map(|(eye, _)| eye.y).fold(f32::INFINITY, f32::min);
            assert!(deepest < -1.0, "it fell to {deepest}");
            let rest = MoveInput { forward: 0.0, ..east };
            let way = walk(&world, &mut walker, &mut footing, rest, 15.0);
            let end = walker.pose().eye;
            assert!(walker.is_grounded() && (end.y - 1.725).abs() < 0.02, "{end}");
            assert!((6.5..8.3).contains(&end.x), "{end}");
            assert!(way.iter().any(|(_, rescue)| matches!(rescue, Some(Rescue::Back(_)))));
            assert_eq!(way.last().and_then(|(_, rescue)| *rescue), None);
        }
    }

    #[test]
    fn walks_jumps_falls_on_a_floor_and_flights_are_no_trouble() {
        let world = floor_over_a_void(&[([40, 1, 0], [64, 36, 64], 0)]);
        let start = Spawn { eye: Vec3::new(6.5, 6.2, 4.0), yaw: EAST };
        let mut walker = Walker::new(&world, start);
        let mut footing = Footing::default();
        let rest = MoveInput::default();
        let west = MoveInput { forward: 1.0, yaw: -EAST, jump: true, ..rest };
        let mut way = walk(&world, &mut walker, &mut footing, rest, 1.0);
        way.extend(walk(&world, &mut walker, &mut footing, west, 1.3));
        way.extend(walk(&world, &mut walker, &mut footing, rest, 1.5));
        assert!(walker.pose().eye.y < 3.0, "it jumped down, by more than three metres");
        let fly = MoveInput { forward: 1.0, yaw: -EAST, fly: true, ..rest };
        way.extend(walk(&world, &mut walker, &mut footing, fly, 4.0));
        assert!(walker.pose().eye.x < -3.0, "it flew out: {}", walker.pose().eye);
        assert!(way.iter().all(|(_, rescue)| rescue.is_none()));
    }

    #[test]
    fn who_does_not_fit_for_two_seconds_is_stuck() {
        // The block is wider than the walker's search for a free place.
        let world = voxel_floor::world(&[([0, 0, 0], [64, 64, 64], 0)]);
        let mut walker = Walker::new(&world, voxel_floor::SPAWN);
        let mut footing = Footing::default();
        let way = walk(&world, &mut walker, &mut footing, MoveInput::default(), 5.0);
        let stuck = way.iter().filter(|(_, rescue)| *rescue == Some(Rescue::Stuck)).count();
        assert_eq!(stuck, 2, "once every two seconds");
    }

    #[test]
    fn who_cannot_get_back_is_stuck_too() {
        let world = floor_over_a_void(&[]);
        let mut walker = Walker::new(&world, voxel_floor::SPAWN);
        let mut footing = Footing::default();
        let east = MoveInput { forward: 1.0, yaw: EAST, ..MoveInput::default() };
        walk(&world, &mut walker, &mut footing, east, 3.5);
        let held: Vec<Option<Rescue>> =
            (0..200).map(|_| footing.rescue(&world, &world.octree, &walker, &east, DT_S)).collect();
        assert!(held.contains(&Some(Rescue::Stuck)));
        assert_eq!(held.last(), Some(&None), "it waits to be put elsewhere");
    }
}
