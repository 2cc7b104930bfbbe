//! How far off avatars are shown: distances between shown and true poses, and angles.

use std::fmt;

use serde::Serialize;
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

/// Where the bands of distance from the viewer begin, in metres.
const BANDS_M: [f32; 5] = [0.0, 5.0, 10.0, 20.0, 40.0];

/// Collects how far off avatars are shown, by their distance from the viewer.
#[derive(Clone, Debug, Default)]
pub struct ErrorsByDistance {
    bands: [PoseErrors; BANDS_M.len()],
}

/// How far off avatars are shown in a band of distances from the viewer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DistanceBand {
    /// Where the band begins, in metres.
    pub from_m: f32,
    /// Where it ends, in metres; `None` when it has no end.
    pub to_m: Option<f32>,
    /// How many shown poses were compared.
    pub compared: usize,
    /// The median distance, in metres.
    pub p50_m: f64,
    /// The 99th percentile of the distances, in metres.
    pub p99_m: f64,
    /// The 99th percentile of the angles, in degrees.
    pub p99_deg: f64,
}

impl ErrorsByDistance {
    /// Takes in the shown pose and the true one of an avatar at a distance in metres.
    pub fn add(&mut self, away_m: f32, shown: &Pose, truth: &Pose) {
        let band = BANDS_M.iter().rposition(|from_m| away_m >= *from_m).unwrap_or(0);
        self.bands[band].add(shown, truth);
    }

    /// Takes in all that another one has.
    pub fn append(&mut self, other: &Self) {
        self.bands.iter_mut().zip(&other.bands).for_each(|(band, more)| band.append(more));
    }

    /// The percentiles over all distances.
    pub fn percentiles(&self) -> PoseErrorPercentiles {
        let mut all = PoseErrors::default();
        self.bands.iter().for_each(|band| all.append(band));
        all.percentiles()
    }

    /// The bands in which there is something, nearest first.
    pub fn bands(&self) -> Vec<DistanceBand> {
        let band = |(i, errors): (usize, &PoseErrors)| {
            let PoseErrorPercentiles { p50_m, p99_m, p99_deg, .. } = errors.percentiles();
            let to_m = BANDS_M.get(i + 1).copied();
            let compared = errors.distances_m.len();
            DistanceBand { from_m: BANDS_M[i], to_m, compared, p50_m, p99_m, p99_deg }
        };
        let bands = self.bands.iter().enumerate().map(band);
        bands.filter(|band| band.compared > 0).collect()
    }
}

impl DistanceBand {
    /// The name of its row in a table.
    pub fn name(&self) -> String {
        match self.to_m {
            Some(to_m) => format!("off it at {} to {to_m} m", self.from_m),
            None => format!("off it from {} m on", self.from_m),
        }
    }
}

/// Its row in a table.
impl fmt::Display for DistanceBand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [p50_cm, p99_cm] = [self.p50_m, self.p99_m].map(|m| m * 100.0);
        write!(f, "{p50_cm:.1}, {p99_cm:.1} cm")
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use glam::Vec3;

    use super::*;

    #[test]
    fn errors_are_in_the_band_of_their_distance() {
        let mut errors = ErrorsByDistance::default();
        let at = |x: f32| Pose { eye: Vec3::X * x, ..Pose::default() };
        for (away_m, off) in [(0.5, 0.1), (4.9, 0.1), (5.0, 0.2), (90.0, 0.4)] {
            errors.add(away_m, &at(off), &at(0.0));
        }
        let mut all = ErrorsByDistance::default();
        all.append(&errors);
        let bands = all.bands();
        let found: Vec<_> = bands.iter().map(|band| (band.name(), band.compared)).collect();
        let named = |name: &str, compared| (name.to_owned(), compared);
        let of = ["off it at 0 to 5 m", "off it at 5 to 10 m", "off it from 40 m on"];
        assert_eq!(found, [named(of[0], 2), named(of[1], 1), named(of[2], 1)]);
        assert_eq!(bands[1].to_string(), "20.0, 20.0 cm");
        assert!((all.percentiles().p99_m - 0.4).abs() < 1e-6);
    }

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
