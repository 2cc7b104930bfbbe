//! The path of a camera: along a recorded walk, or through a building where people can walk.
//!
//! Between two samples, each coordinate follows a monotone cubic (Fritsch and Carlson 1980). So the
//! path is smooth, and never leaves the box around the two samples. It cuts no corner that the walk
//! went round.

use std::f32::consts::{PI, TAU};

use glam::Vec3;
use rand::{SeedableRng, rngs::SmallRng};
use sightline_cli::trace::Track;
use sightline_client_core::navigation::Navigation;
use sightline_world::{World, motion::Pose};

/// The speed between two samples above which the avatar was put elsewhere, in metres per second.
const JUMP_M_PER_S: f32 = 40.0;
/// The time between two samples above which the avatar may have been put elsewhere, in seconds.
const ABSENCE_S: f64 = 0.4;
/// The speed of a walk through a building, in metres per second.
const WALK_M_PER_S: f32 = 1.5;
/// The longest walk through a building, in metres.
const LENGTH_MAX: f32 = 120.0;
/// The distance between two steps of a walk, in metres.
const STEP: f32 = 0.1;
/// The number of steps on either side over which a walk is smoothed.
const SMOOTHED: usize = 3;
/// The number of steps that the camera looks ahead.
const AHEAD: usize = 12;
/// The number of steps from one sample to the next.
const STEPS_A_SAMPLE: usize = 3;
/// The time of a turn on the spot where nobody can walk, in seconds.
const TURN_S: f64 = 8.0;

/// The position and direction of a camera over time.
#[derive(Clone, Debug)]
pub struct CameraPath {
    /// Never empty, and no segment is empty.
    segments: Vec<Segment>,
}

/// Samples without a jump between them.
#[derive(Clone, Debug)]
struct Segment {
    /// Seconds since the path's first sample, strictly ascending.
    times: Vec<f64>,
    /// Eye, yaw and pitch, and their rates per second. The yaw is continuous: it may exceed half a
    /// turn.
    samples: Vec<([f32; 5], [f32; 5])>,
}

impl CameraPath {
    /// The walk of a recorded avatar. `None` when it has no samples.
    pub fn of_track(track: &Track) -> Option<Self> {
        Self::of_samples(&track.samples)
    }

    /// A walk from spawn point to spawn point, each time to the nearest one left. Random places
    /// follow where there are few spawn points. Where nobody can walk, the camera turns on the
    /// spot.
    pub fn through(world: &World) -> Self {
        let spawns = world.spawns.iter().map(|spawn| spawn.eye).collect();
        Self::walk(world, spawns, &mut SmallRng::seed_from_u64(1), LENGTH_MAX)
    }

    /// A walk of this length, in metres, from a random place to random places. Where nobody can
    /// walk, the camera turns on the spot.
    pub fn wandering(world: &World, seed: u64, length_m: f32) -> Self {
        Self::walk(world, Vec::new(), &mut SmallRng::seed_from_u64(seed), length_m)
    }

    fn walk(world: &World, goals: Vec<Vec3>, random: &mut SmallRng, length_m: f32) -> Self {
        let steps = walk_steps(world, goals, random, length_m);
        let walk =
            (steps.len() > 2 * AHEAD).then(|| Self::of_samples(&smoothed_walk(&steps))).flatten();
        walk.unwrap_or_else(|| Self::turn_on_the_spot(world))
    }

    /// The duration in seconds.
    pub fn duration_s(&self) -> f64 {
        self.segments.last().and_then(|segment| segment.times.last()).copied().unwrap_or(0.0)
    }

    /// The pose at a time in seconds. Before the start and after the end it is the pose there.
    pub fn at(&self, seconds: f64) -> Pose {
        debug_assert!(!self.segments.is_empty(), "a path has a segment");
        let segment = self.segments.partition_point(|segment| segment.times[0] <= seconds);
        self.segments[segment.saturating_sub(1)].at(seconds)
    }

    /// Poses at equal intervals, from the first to the last of the path, each with its time in
    /// seconds.
    pub fn frames(&self, count: usize) -> impl Iterator<Item = (f64, Pose)> + '_ {
        self.frames_between(0.0, self.duration_s(), count)
    }

    /// Poses at equal intervals between two times, each with its time in seconds.
    pub fn frames_between(
        &self,
        from_s: f64,
        until_s: f64,
        count: usize,
    ) -> impl Iterator<Item = (f64, Pose)> + '_ {
        let step = (until_s - from_s) / count.saturating_sub(1).max(1) as f64;
        (0..count).map(move |i| from_s + i as f64 * step).map(|t| (t, self.at(t)))
    }

    /// One turn at the first spawn point.
    fn turn_on_the_spot(world: &World) -> Self {
        let (eye, yaw) = world.spawns.first().map_or((Vec3::ZERO, 0.0), |s| (s.eye, s.yaw));
        let turned = |quarter: u8| {
            let pose = Pose { eye, yaw: yaw + f32::from(quarter) * PI / 2.0, ..Pose::default() };
            (f64::from(quarter) * TURN_S / 4.0, pose)
        };
        let segment = Segment::new(&[0, 1, 2, 3, 4].map(turned));
        Self { segments: vec![segment] }
    }

    fn of_samples(samples: &[(f64, Pose)]) -> Option<Self> {
        let (start, _) = *samples.first()?;
        let samples: Vec<(f64, Pose)> =
            samples.iter().map(|(t, pose)| (t - start, *pose)).collect();
        let is_together = |a: &(f64, Pose), b: &(f64, Pose)| {
            let gap = b.0 - a.0;
            let way = a.1.eye.distance(b.1.eye);
            gap <= ABSENCE_S && f64::from(way) <= gap * f64::from(JUMP_M_PER_S)
        };
        Some(Self { segments: samples.chunk_by(is_together).map(Segment::new).collect() })
    }
}

impl Segment {
    fn new(poses: &[(f64, Pose)]) -> Self {
        let mut times = Vec::with_capacity(poses.len());
        let mut values: Vec<[f32; 5]> = Vec::with_capacity(poses.len());
        for (time, Pose { eye, yaw, pitch, .. }) in poses {
            // Of several samples at one time, the first counts.
            if times.last().is_some_and(|last| time <= last) {
                continue;
            }
            let before = values.last().map_or(*yaw, |value| value[3]);
            let turn = (yaw - before + PI).rem_euclid(TAU) - PI;
            times.push(*time);
            values.push([eye.x, eye.y, eye.z, before + turn, *pitch]);
        }
        let slopes =
            (0..times.len()).map(|i| std::array::from_fn(|k| slope(&times, &values, i, k)));
        let samples = values.iter().copied().zip(slopes).collect();
        debug_assert!(times.is_sorted_by(|a, b| a < b), "times ascend strictly");
        assert!(!times.is_empty(), "a segment has a sample");
        Self { times, samples }
    }

    fn at(&self, seconds: f64) -> Pose {
        let after = self.times.partition_point(|time| *time <= seconds);
        let [before, after] = [after.saturating_sub(1), after.min(self.times.len() - 1)];
        let span = (self.times[after] - self.times[before]) as f32;
        let t = (seconds - self.times[before]) as f32 / span.max(f32::MIN_POSITIVE);
        let t = t.clamp(0.0, 1.0);
        let ((a, slopes_a), (b, slopes_b)) = (self.samples[before], self.samples[after]);
        let [x, y, z, yaw, pitch] = std::array::from_fn(|k| {
            let (da, db) = (slopes_a[k] * span, slopes_b[k] * span);
            let rise = b[k] - a[k];
            a[k] + t * (da + t * ((3.0 * rise - 2.0 * da - db) + t * (da + db - 2.0 * rise)))
        });
        Pose { eye: Vec3::new(x, y, z), yaw, pitch, ..Pose::default() }
    }
}

/// The rate of a coordinate at a sample, such that the cubics on both sides are monotone: the
/// harmonic mean of the slopes of the two chords, or zero where the coordinate turns back.
fn slope(times: &[f64], values: &[[f32; 5]], i: usize, k: usize) -> f32 {
    let chord = |a: usize, b: usize| (values[b][k] - values[a][k]) / (times[b] - times[a]) as f32;
    match (i.checked_sub(1), i + 1 < times.len()) {
        (Some(before), true) => {
            let (a, b) = (chord(before, i), chord(i, i + 1));
            if a * b > 0.0 { 2.0 * a * b / (a + b) } else { 0.0 }
        }
        (Some(before), false) => chord(before, i),
        (None, true) => chord(i, i + 1),
        (None, false) => 0.0,
    }
}

/// The eyes of a walk of at most this length, in metres, one step apart: from the first goal to the
/// nearest one left, and after the last one to random places.
fn walk_steps(
    world: &World,
    mut goals: Vec<Vec3>,
    random: &mut SmallRng,
    length_m: f32,
) -> Vec<Vec3> {
    let navigation = Navigation::new(world);
    let first = if goals.is_empty() { None } else { Some(goals.remove(0)) };
    let Some(mut at) = first.or_else(|| navigation.random(random)) else { return Vec::new() };
    let mut steps = Vec::new();
    // All but the last goals are reached, so this ends soon. Goals on islands cannot be reached:
    // the bound is for them.
    for _ in 0..64 + (length_m as usize) {
        let nearest = (0..goals.len())
            .min_by(|&a, &b| goals[a].distance(at).total_cmp(&goals[b].distance(at)));
        let goal = nearest.map(|i| goals.swap_remove(i)).or_else(|| navigation.random(random));
        let Some(goal) = goal else { break };
        for place in navigation.path(at, goal).unwrap_or_default() {
            let count = (at.distance(place) / STEP).ceil().max(1.0);
            steps.extend((0..count as usize).map(|i| at.lerp(place, i as f32 / count)));
            at = place;
        }
        if steps.len() as f32 * STEP >= length_m {
            steps.truncate((length_m / STEP) as usize);
            break;
        }
    }
    steps
}

/// The walk with its corners smoothed, looking ahead.
fn smoothed_walk(steps: &[Vec3]) -> Vec<(f64, Pose)> {
    let smoothed = |i: usize, by: usize| {
        let around = &steps[i.saturating_sub(by)..(i + by + 1).min(steps.len())];
        around.iter().sum::<Vec3>() / around.len() as f32
    };
    let sample = |i: usize| {
        let eye = smoothed(i, SMOOTHED);
        let ahead = smoothed(i + AHEAD, AHEAD) - eye;
        let yaw = (-ahead.x).atan2(-ahead.z);
        (f64::from(i as f32 * STEP / WALK_M_PER_S), Pose { eye, yaw, ..Pose::default() })
    };
    (0..steps.len() - AHEAD).step_by(STEPS_A_SAMPLE).map(sample).collect()
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor::world;

    use super::*;

    fn sample(t: f64, x: f32, yaw: f32) -> (f64, Pose) {
        (t, Pose { eye: Vec3::new(x, 1.0, 0.0), yaw, ..Pose::default() })
    }

    #[test]
    fn a_path_passes_through_its_samples_and_never_overshoots() {
        let samples: Vec<_> = [0.0, 1.0, 1.0, 4.0, 3.5, 3.5].into_iter().zip(0..).collect();
        let samples: Vec<_> =
            samples.iter().map(|&(x, i)| sample(5.0 + f64::from(i) * 0.2, x, 0.0)).collect();
        let path = CameraPath::of_samples(&samples).unwrap();
        assert!((path.duration_s() - 1.0).abs() < 1e-9);
        let x = |seconds: f64| path.at(seconds).eye.x;
        for (t, pose) in &samples {
            assert!((x(t - 5.0) - pose.eye.x).abs() < 1e-5);
        }
        for i in 0..1_000 {
            let t = f64::from(i) * 1e-3;
            let pair = (t / 0.2) as usize;
            let (a, b) = (samples[pair].1.eye.x, samples[pair + 1].1.eye.x);
            assert!((a.min(b) - 1e-5..=a.max(b) + 1e-5).contains(&x(t)), "{} at {t}", x(t));
            // Smooth: the speed never changes abruptly.
            let accelerated = x(t + 2e-3) - 2.0 * x(t + 1e-3) + x(t);
            assert!(t > 0.99 || accelerated.abs() < 2e-3, "{accelerated} at {t}");
        }
        assert_eq!([x(-9.0), x(99.0)], [0.0, 3.5]);
    }

    #[test]
    fn the_yaw_turns_the_short_way_and_jumps_are_not_smoothed() {
        let samples = [sample(0.0, 0.0, 3.0), sample(0.1, 0.1, -3.0), sample(0.2, 99.0, 0.0)];
        let path = CameraPath::of_samples(&samples).unwrap();
        let yaw = path.at(0.05).yaw;
        assert!((3.0..3.3).contains(&yaw), "{yaw}");
        assert_eq!([path.at(0.15).eye.x, path.at(0.2).eye.x], [0.1, 99.0]);
        assert_eq!(path.frames(3).map(|(t, _)| t).collect::<Vec<_>>(), [0.0, 0.1, 0.2]);
        assert!(CameraPath::of_samples(&[]).is_none());
        assert_eq!(path.frames(0).count(), 0);
    }

    #[test]
    fn a_walk_through_a_building_touches_nothing_solid() {
        // A wall across the middle, with a gap of 1 m at one end.
        let mut world = world(&[([31, 1, 8], [33, 30, 64], 0)]);
        let east = sightline_world::Spawn { eye: Vec3::new(7.0, 1.725, 4.0), yaw: 0.0 };
        world.spawns.push(east);
        let path = CameraPath::through(&world);
        assert!(path.duration_s() > 5.0, "{}", path.duration_s());
        for (t, pose) in path.frames(500) {
            let near = sightline_world::geometry::Aabb::around(pose.eye, 0.1);
            assert!(!world.octree.solid_in(&near), "{} at {t}", pose.eye);
        }
        let crossed = path.frames(500).any(|(_, pose)| pose.eye.x > 5.0);
        assert!(crossed);
        let walks = [1, 2].map(|seed| CameraPath::wandering(&world, seed, 30.0));
        for walk in &walks {
            assert!((19.0..=20.0).contains(&walk.duration_s()), "{}", walk.duration_s());
        }
        assert_ne!(walks[0].at(0.0).eye, walks[1].at(0.0).eye);
    }

    #[test]
    fn the_camera_turns_on_the_spot_where_nobody_can_walk() {
        // Solid up to the shoulders.
        let world = world(&[([0, 1, 0], [64, 12, 64], 0)]);
        let path = CameraPath::through(&world);
        let turned = path.at(path.duration_s()).yaw - path.at(0.0).yaw;
        assert!((turned - TAU).abs() < 1e-4, "{turned}");
    }
}
