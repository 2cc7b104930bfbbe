//! What the visitors of a swarm received.

use std::{
    collections::{HashMap, VecDeque},
    time::Duration,
};

use glam::Vec3;
use serde::Serialize;
use sightline_cli::percentile;
use sightline_client_core::reporting::ReportingCounts;
use sightline_world::motion::{ACUITY_DISTANCES, AvatarId};

use super::{STEP, SwarmSnapshot};
use crate::net::{Session, SessionStats};

/// How long the past positions of a visitor are kept.
const HISTORY: Duration = Duration::from_secs(3);
/// The least tolerance of a person, in metres.
const TOLERANCE_MIN_M: f32 = 0.05;
/// What rounding adds to tolerances, in metres.
const ROUNDING_M: f32 = 0.02;
/// The width of a bin in the histogram of ages, in milliseconds.
const AGE_BIN_MS: f64 = 5.0;

/// What the visitors of a swarm received. Figures per client are means over all that came in.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SwarmReport {
    /// Visitors that came in.
    pub clients: usize,
    /// Visitors that could not come in.
    pub refused: usize,
    /// Visitors whose connection ended early.
    pub disconnected: usize,
    /// Reports that the server refused and corrected.
    pub corrections: usize,
    /// How often a visitor was in another's sight for more than half a second and the other did not
    /// hold it. In a large swarm only a part of the pairs is looked at at a time.
    pub misses: usize,
    /// The measured time, in seconds.
    pub seconds: f64,
    /// Application messages to a client, per second.
    pub messages_in_per_s: f64,
    /// Application messages from a client, per second.
    pub messages_out_per_s: f64,
    /// Bytes of application messages to a client, per second.
    pub bytes_in_per_s: f64,
    /// Bytes of application messages from a client, per second.
    pub bytes_out_per_s: f64,
    /// UDP payload to a client, in bytes per second.
    pub udp_bytes_in_per_s: f64,
    /// UDP payload from a client, in bytes per second.
    pub udp_bytes_out_per_s: f64,
    /// The mean number of avatars that a client holds.
    pub visible_mean: f64,
    /// The share of a client's ticks at which it is quiet, from 0 to 1.
    pub quiet_share: f64,
    /// The share of a client's ticks at which it is live, on course and silent, from 0 to 1.
    pub course_share: f64,
    /// The 99th percentile of the distances between where a visitor is shown and where it is then,
    /// in metres.
    pub shown_error_p99_m: f64,
    /// The mean age of shown positions: how long ago the visitor was last there, within what it may
    /// leave unsaid and what its viewer can hardly tell. In milliseconds.
    pub age_mean_ms: f64,
    /// The 99th percentile of the ages, in milliseconds.
    pub age_p99_ms: f64,
    /// The greatest age, in milliseconds: at most 3,000, because older positions are not kept.
    pub age_max_ms: f64,
    /// The mean round trip, in milliseconds.
    pub round_trip_ms: f64,
}

/// Counts what happens while a swarm walks.
pub struct SwarmStatistics {
    pub corrections: usize,
    pub disconnected: usize,
    pub misses: usize,
    refused: usize,
    start: Vec<SessionStats>,
    history: HashMap<AvatarId, VecDeque<(Duration, Vec3)>>,
    ages: Vec<u64>,
    age_sum_ms: f64,
    age_max_ms: f64,
    held: u64,
    views: u64,
    /// Distances between where visitors are shown and where they are, in metres.
    shown_errors: Vec<f32>,
}

impl SwarmStatistics {
    /// Starts counting.
    pub fn new<'a>(sessions: impl Iterator<Item = &'a Session>, refused: usize) -> Self {
        Self {
            corrections: 0,
            disconnected: 0,
            misses: 0,
            refused,
            start: sessions.map(Session::stats).collect(),
            history: HashMap::new(),
            ages: vec![0; (HISTORY.as_secs_f64() * 1e3 / AGE_BIN_MS) as usize + 1],
            age_sum_ms: 0.0,
            age_max_ms: 0.0,
            held: 0,
            views: 0,
            shown_errors: Vec::new(),
        }
    }

    /// Records a visitor's position.
    pub fn moved(&mut self, avatar: AvatarId, elapsed: Duration, eye: Vec3) {
        let history = self.history.entry(avatar).or_default();
        debug_assert!(history.back().is_none_or(|(t, _)| *t <= elapsed), "time goes forward");
        history.push_back((elapsed, eye));
        while history.front().is_some_and(|(t, _)| elapsed.saturating_sub(*t) > HISTORY) {
            history.pop_front();
        }
    }

    /// Counts what all visitors hold.
    pub fn observe(&mut self, snapshot: &SwarmSnapshot) {
        for view in &snapshot.visitors {
            self.views += 1;
            for shown in &view.shown {
                self.held += 1;
                let Some(history) = self.history.get(&shown.id) else { continue };
                let eye = shown.pose.eye;
                let truth = history.back().map_or(eye, |(_, truth)| *truth);
                self.shown_errors.push(eye.distance(truth));
                let within_m = same_place_m(view.pose.eye.distance(truth));
                let age_ms = age_ms(history, snapshot.elapsed, eye, within_m);
                let bin = ((age_ms / AGE_BIN_MS) as usize).min(self.ages.len() - 1);
                self.ages[bin] += 1;
                self.age_sum_ms += age_ms;
                self.age_max_ms = self.age_max_ms.max(age_ms);
            }
        }
    }

    /// The final report.
    pub fn report<'a>(
        &self,
        sessions: impl Iterator<Item = &'a Session>,
        elapsed: Duration,
    ) -> SwarmReport {
        let end: Vec<SessionStats> = sessions.map(Session::stats).collect();
        let seconds = elapsed.as_secs_f64();
        let client_seconds = (seconds * end.len() as f64).max(1e-9);
        let rate = |figure: fn(&SessionStats) -> u64| {
            let pairs = end.iter().zip(&self.start);
            let sum: u64 = pairs.map(|(e, s)| figure(e).saturating_sub(figure(s))).sum();
            sum as f64 / client_seconds
        };
        assert_eq!(end.len(), self.start.len(), "the sessions that were counted from the start");
        let views = self.views.max(1) as f64;
        let sum = |figure: fn(&ReportingCounts) -> u64| {
            let of = |all: &[SessionStats]| all.iter().map(|s| figure(&s.reporting)).sum::<u64>();
            of(&end).saturating_sub(of(&self.start)) as f64
        };
        let ticks = sum(|counts| counts.ticks).max(1.0);
        let mut shown_errors = self.shown_errors.clone();
        shown_errors.sort_unstable_by(f32::total_cmp);
        let shown_error_p99 = percentile::percentile(&shown_errors, 99).unwrap_or_default();
        let aged: u64 = self.ages.iter().sum();
        let round_trips = end.iter().map(|stats| stats.round_trip.as_secs_f64() * 1e3);
        SwarmReport {
            clients: end.len(),
            refused: self.refused,
            disconnected: self.disconnected,
            corrections: self.corrections,
            misses: self.misses,
            seconds,
            messages_in_per_s: rate(|s| s.messages_in),
            messages_out_per_s: rate(|s| s.messages_out),
            bytes_in_per_s: rate(|s| s.bytes_in),
            bytes_out_per_s: rate(|s| s.bytes_out),
            udp_bytes_in_per_s: rate(|s| s.udp_bytes_in),
            udp_bytes_out_per_s: rate(|s| s.udp_bytes_out),
            visible_mean: self.held as f64 / views,
            quiet_share: sum(|counts| counts.quiet) / ticks,
            course_share: sum(|counts| counts.on_course) / ticks,
            shown_error_p99_m: f64::from(shown_error_p99),
            age_mean_ms: self.age_sum_ms / aged.max(1) as f64,
            age_p99_ms: self.age_percentile(aged, 99),
            age_max_ms: self.age_max_ms,
            round_trip_ms: round_trips.sum::<f64>() / end.len().max(1) as f64,
        }
    }

    fn age_percentile(&self, aged: u64, percent: u64) -> f64 {
        let mut left = percentile::rank(aged, percent);
        for (bin, count) in self.ages.iter().enumerate() {
            if *count >= left {
                let age_ms = ((bin + 1) as f64 * AGE_BIN_MS).min(HISTORY.as_secs_f64() * 1e3);
                return if aged == 0 { 0.0 } else { age_ms };
            }
            left -= count;
        }
        HISTORY.as_secs_f64() * 1e3
    }
}

/// The distance within which an avatar is shown where it was, for a viewer at a distance. Both are
/// in metres. The avatar may be off its course by as much as its nearest viewer can hardly tell, and
/// a viewer is not told of a course that it can hardly tell from the one that it knows.
fn same_place_m(away_m: f32) -> f32 {
    2.0 * (away_m / ACUITY_DISTANCES).max(TOLERANCE_MIN_M) + ROUNDING_M
}

/// How long ago the visitor left the position at which it is shown, within a distance in metres.
fn age_ms(history: &VecDeque<(Duration, Vec3)>, now: Duration, shown: Vec3, within_m: f32) -> f64 {
    let was_there = |(_, eye): &&(Duration, Vec3)| eye.distance(shown) < within_m;
    match history.iter().rev().find(was_there) {
        // It was there until the next position was recorded.
        Some((t, _)) => {
            let until =
                history.iter().find(|(later, _)| later > t).map_or(now, |(later, _)| *later);
            now.saturating_sub(until).as_secs_f64() * 1e3
        }
        None if history.front().is_some_and(|(t, _)| now.saturating_sub(*t) + STEP >= HISTORY) => {
            HISTORY.as_secs_f64() * 1e3
        }
        // The shown position is older than the first recorded position.
        None => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shown_position_ages_from_the_moment_the_visitor_left_it() {
        let ms = Duration::from_millis;
        let steps = [(0, 1.0), (50, 2.0), (100, 2.0), (150, 3.0), (200, 4.0)];
        let history = steps.map(|(t, x)| (ms(t), Vec3::X * x)).into();
        for (x, age) in [(4.0, 0.0), (3.0, 10.0), (2.0, 60.0), (1.0, 160.0), (9.0, 0.0)] {
            assert_eq!(age_ms(&history, ms(210), Vec3::X * x, 0.07), age, "at {x}");
        }
        assert_eq!(age_ms(&history, ms(3_000), Vec3::X * 9.0, 0.07), 3_000.0);
    }

    #[test]
    fn percentiles_follow_the_histogram() {
        let mut statistics = SwarmStatistics::new([].into_iter(), 0);
        assert_eq!(statistics.age_percentile(0, 99), 0.0);
        statistics.ages[0] = 98;
        statistics.ages[10] = 2;
        assert_eq!(statistics.age_percentile(100, 50), AGE_BIN_MS);
        assert_eq!(statistics.age_percentile(100, 99), 11.0 * AGE_BIN_MS);
    }
}
