//! How far off avatars are shown: distances between shown and true poses, and angles.

use sightline_world::motion::{Pose, turn_between};

use crate::percentile::percentile;

/// Collects how far off avatars are shown.
#[derive(Clone, Debug, Default)]
pub struct PoseErrors {
    /// Distances in metres.
    distances_m: Vec<f32>,
    /// Angles in degrees.
    angles_deg: Vec<f32>,
}

/// The median and the 99th percentile of collected errors. All are zero when there are none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseErrorPercentiles {
    /// The median distance, in metres.
    pub p50_m: f64,
    /// The 99th percentile of the distances, in metres.
    pub p99_m: f64,
    /// The median angle, in degrees.
    pub p50_deg: f64,
    /// The 99th percentile of the angles, in degrees.
    pub p99_deg: f64,
}

impl PoseErrors {
    /// Takes in a shown pose and the true one. The angle is the larger of those of yaw and pitch.
    pub fn add(&mut self, shown: &Pose, truth: &Pose) {
        let turned = turn_between(truth.yaw, shown.yaw).abs();
        let tilted = (shown.pitch - truth.pitch).abs();
        self.distances_m.push(shown.eye.distance(truth.eye));
        self.angles_deg.push(turned.max(tilted).to_degrees());
    }

    /// Takes in all that another one has.
    pub fn append(&mut self, other: &Self) {
        self.distances_m.extend(&other.distances_m);
        self.angles_deg.extend(&other.angles_deg);
    }

    /// The percentiles of what was collected up to now.
    pub fn percentiles(&self) -> PoseErrorPercentiles {
        let [[p50_m, p99_m], [p50_deg, p99_deg]] =
            [&self.distances_m, &self.angles_deg].map(|values| {
                let mut sorted = values.clone();
                sorted.sort_unstable_by(f32::total_cmp);
                [50, 99].map(|percent| f64::from(percentile(&sorted, percent).unwrap_or_default()))
            });
        PoseErrorPercentiles { p50_m, p99_m, p50_deg, p99_deg }
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use glam::Vec3;

    use super::*;

    #[test]
    fn an_error_is_a_distance_and_the_larger_angle() {
        let mut errors = PoseErrors::default();
        assert_eq!(errors.percentiles(), PoseErrorPercentiles::default());
        let truth = Pose { yaw: 0.1, ..Pose::default() };
        errors.add(&Pose { eye: Vec3::new(0.3, 0.0, 0.4), yaw: TAU - 0.1, ..truth }, &truth);
        let mut more = PoseErrors::default();
        more.add(&Pose { pitch: -0.5, ..truth }, &truth);
        more.add(&Pose { eye: Vec3::X * 0.1, ..truth }, &truth);
        errors.append(&more);
        let PoseErrorPercentiles { p50_m, p99_m, p50_deg, p99_deg } = errors.percentiles();
        let close = |a: f64, b: f64| (a - b).abs() < 1e-5;
        assert!(close(p50_m, 0.1) && close(p99_m, 0.5), "{p50_m} {p99_m}");
        assert!(close(p50_deg, 0.2_f64.to_degrees()), "{p50_deg}");
        assert!(close(p99_deg, 0.5_f64.to_degrees()), "{p99_deg}");
    }
}
