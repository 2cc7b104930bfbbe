//! What the visitors of a swarm received.

use std::time::Duration;

use serde::Serialize;
use sightline_cli::{
    percentile,
    pose_error::{DistanceBand, PoseErrors},
};
use sightline_client_core::reporting::ReportingCounts;
use sightline_world::motion::{ACUITY_DISTANCES, AvatarId, Pose};

use super::{
    SwarmSnapshot,
    history::{HISTORY, Histories, History},
    processes::{Process, Usage},
    promises::Promises,
    sight::Sight,
};
use crate::net::{Session, SessionStats};

/// A visitor moves while it is faster than this, in metres a second.
const MOVING: f32 = 0.1;
/// The least tolerance of a person, in metres.
const TOLERANCE_MIN_M: f32 = 0.05;
/// What rounding adds to tolerances, in metres.
const ROUNDING_M: f32 = 0.02;
/// With more time than this between two steps, visitors move in leaps, and are shown off where they
/// are for want of the swarm's own time. In milliseconds.
const STEP_LATE_MS: f64 = 100.0;
/// The width of a bin in the histogram of ages, in milliseconds.
const AGE_BIN_MS: f64 = 5.0;

/// What the visitors of a swarm received. Figures per client are means over all that came in.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SwarmReport {
    /// Visitors that came in.
    pub clients: usize,
    /// Visitors that could not come in.
    pub refused: usize,
    /// Visitors whose connection ended early, or was broken at the end.
    pub disconnected: usize,
    /// How often a visitor's connection broke and the visitor came back by itself.
    pub returned: usize,
    /// Reports that the server refused and corrected.
    pub corrections: usize,
    /// How often a visitor was in another's sight for more than half a second and the other did not
    /// hold it. In a large swarm only a part of the pairs is looked at at a time.
    pub misses: usize,
    /// How often a pair was looked at for that. Visitors that have leapt are left out for a while,
    /// so a swarm that is late looks at none.
    pub looks: u64,
    /// The measured time, in seconds.
    pub seconds: f64,
    /// How long it took until all visitors were in, in seconds.
    pub joined_s: f64,
    /// How long a visitor took to come in, in milliseconds: the median.
    pub join_p50_ms: f64,
    /// That time: the 99th percentile.
    pub join_p99_ms: f64,
    /// The share of datagrams with poses that arrived, from 0 to 1.
    pub delivered_share: f64,
    /// The time between two steps of the visitors, in milliseconds: the 99th percentile. It is 25
    /// unless the swarm itself is late.
    pub step_p99_ms: f64,
    /// Whether the swarm itself was so late that the figures show its own limits.
    pub is_bottleneck: bool,
    /// Processor time of the swarm in a second, in seconds; 0 where the system does not tell.
    pub swarm_cpu: f64,
    /// Processor time in a second of the servers, if they run beside the swarm.
    pub server_cpu: Option<f64>,
    /// Memory of these servers at the end, in bytes.
    pub server_memory_bytes: Option<u64>,
    /// The share of time in which visitors walked, from 0 to 1.
    pub moving_share: f64,
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
    /// The distance between where a visitor in sight is shown and where it was one delay and two
    /// ticks ago, as promised, in metres: the median. The delay is half of the round trips of both,
    /// as QUIC measures them. By rays, and where more than 1,000 pairs are held, of some at a time.
    pub promised_error_p50_m: f64,
    /// That distance: the 99th percentile.
    pub promised_error_p99_m: f64,
    /// The angle between the shown pose of a visitor in sight and that of one delay and two ticks
    /// ago, in degrees: the larger of those of yaw and pitch. The median.
    pub promised_error_p50_deg: f64,
    /// That angle: the 99th percentile.
    pub promised_error_p99_deg: f64,
    /// These distances and angles by how far a visitor is from its viewer.
    pub promised_errors_by_distance: Vec<DistanceBand>,
    /// The 99th percentile of the ages of certainty, in milliseconds: since when something may be
    /// missing of what the server said of a visitor that is held. A server with nothing to say lets
    /// certainty age.
    pub certainty_p99_ms: f64,
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

/// How visitors came in.
#[derive(Clone, Debug, Default)]
pub struct Joining {
    /// How many did not.
    pub refused: usize,
    /// How long each took.
    pub times: Vec<Duration>,
    /// How long all took together.
    pub whole: Duration,
}

/// Counts what happens while a swarm walks.
pub struct SwarmStatistics {
    pub corrections: usize,
    pub disconnected: usize,
    pub misses: usize,
    pub looks: u64,
    joining: Joining,
    /// The times between steps.
    steps: Vec<Duration>,
    own: Process,
    servers: Vec<Process>,
    /// What both had used at the start.
    used: [Option<Usage>; 2],
    start: Vec<SessionStats>,
    histories: Histories,
    promises: Promises,
    /// How long visitors were watched, and how long they moved, summed over all, in seconds.
    watched_s: f64,
    moved_s: f64,
    ages: Vec<u64>,
    age_sum_ms: f64,
    age_max_ms: f64,
    held: u64,
    views: u64,
    /// How far visitors are shown off where they are.
    shown_errors: PoseErrors,
    /// How old the certainty was of each held visitor.
    certainty: Vec<Duration>,
}

impl SwarmStatistics {
    /// Starts counting.
    pub fn new<'a>(
        sessions: impl Iterator<Item = &'a Session>,
        joining: Joining,
        servers: Vec<Process>,
    ) -> Self {
        let own = Process::own();
        Self {
            corrections: 0,
            disconnected: 0,
            misses: 0,
            looks: 0,
            joining,
            steps: Vec::new(),
            used: [own.usage(), Process::usage_of(&servers)],
            own,
            servers,
            start: sessions.map(Session::stats).collect(),
            histories: Histories::default(),
            promises: Promises::default(),
            watched_s: 0.0,
            moved_s: 0.0,
            ages: vec![0; (HISTORY.as_secs_f64() * 1e3 / AGE_BIN_MS) as usize + 1],
            age_sum_ms: 0.0,
            age_max_ms: 0.0,
            held: 0,
            views: 0,
            shown_errors: PoseErrors::default(),
            certainty: Vec::new(),
        }
    }

    /// Records that visitors take a step, this long after the last one.
    pub fn stepped(&mut self, after: Duration) {
        self.steps.push(after);
    }

    /// Takes in a visitor's pose, `dt_s` seconds after its last one.
    pub fn moved(&mut self, avatar: AvatarId, elapsed: Duration, pose: Pose, dt_s: f32) {
        let before = self.histories.of(avatar).and_then(History::newest);
        self.histories.push(avatar, elapsed, pose);
        let Some(before) = before else { return };
        let has_moved = pose.eye.distance(before.eye) > MOVING * dt_s;
        self.watched_s += f64::from(dt_s);
        self.moved_s += f64::from(if has_moved { dt_s } else { 0.0 });
    }

    /// Counts what all visitors hold, and compares it with the truth.
    pub fn observe(&mut self, snapshot: &SwarmSnapshot, sight: &Sight) {
        self.promises.observe(snapshot, sight, &self.histories);
        for view in &snapshot.visitors {
            self.views += 1;
            self.certainty.extend(view.held.iter().map(|held| held.certainty));
            for shown in &view.shown {
                self.held += 1;
                let Some(history) = self.histories.of(shown.id) else { continue };
                let truth = history.newest().unwrap_or(shown.pose);
                self.shown_errors.add(&shown.pose, &truth);
                let within_m = same_place_m(view.pose.eye.distance(truth.eye));
                let age_ms = history.age_ms(snapshot.elapsed, shown.pose.eye, within_m);
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
        let promised = self.promises.percentiles();
        let mut certainty = self.certainty.clone();
        certainty.sort_unstable();
        let certainty_p99 = percentile::percentile(&certainty, 99).unwrap_or_default();
        let aged: u64 = self.ages.iter().sum();
        let ms = |times: &[Duration], percent| {
            let mut times = times.to_vec();
            times.sort_unstable();
            let time = percentile::percentile(&times, percent).unwrap_or_default();
            time.as_secs_f64() * 1e3
        };
        let step_p99_ms = ms(&self.steps, 99);
        let now = [self.own.usage(), Process::usage_of(&self.servers)];
        let [swarm_cpu, server_cpu] = [0, 1].map(|i| {
            let (now, then) = now[i].zip(self.used[i])?;
            Some(now.cpu.saturating_sub(then.cpu).as_secs_f64() / seconds.max(1e-9))
        });
        let [arrived, sent] =
            [0, 1].map(|i| end.iter().map(|s| f64::from(s.delivered[i])).sum::<f64>());
        let round_trips = end.iter().map(|stats| stats.round_trip.as_secs_f64() * 1e3);
        SwarmReport {
            clients: end.len(),
            refused: self.joining.refused,
            disconnected: self.disconnected,
            returned: end.iter().map(|stats| stats.returns as usize).sum(),
            corrections: self.corrections,
            misses: self.misses,
            looks: self.looks,
            seconds,
            joined_s: self.joining.whole.as_secs_f64(),
            join_p50_ms: ms(&self.joining.times, 50),
            join_p99_ms: ms(&self.joining.times, 99),
            delivered_share: if sent > 0.0 { arrived / sent } else { 1.0 },
            step_p99_ms,
            is_bottleneck: step_p99_ms > STEP_LATE_MS,
            swarm_cpu: swarm_cpu.unwrap_or(0.0),
            server_cpu,
            server_memory_bytes: now[1].map(|usage| usage.memory_bytes),
            moving_share: self.moved_s / self.watched_s.max(1e-9),
            messages_in_per_s: rate(|s| s.messages_in),
            messages_out_per_s: rate(|s| s.messages_out),
            bytes_in_per_s: rate(|s| s.bytes_in),
            bytes_out_per_s: rate(|s| s.bytes_out),
            udp_bytes_in_per_s: rate(|s| s.udp_bytes_in),
            udp_bytes_out_per_s: rate(|s| s.udp_bytes_out),
            visible_mean: self.held as f64 / views,
            quiet_share: sum(|counts| counts.quiet) / ticks,
            course_share: sum(|counts| counts.on_course) / ticks,
            shown_error_p99_m: self.shown_errors.percentiles().p99_m,
            promised_error_p50_m: promised.p50_m,
            promised_error_p99_m: promised.p99_m,
            promised_error_p50_deg: promised.p50_deg,
            promised_error_p99_deg: promised.p99_deg,
            promised_errors_by_distance: self.promises.bands(),
            certainty_p99_ms: certainty_p99.as_secs_f64() * 1e3,
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
/// in metres. The avatar may be off its course by as much as its nearest viewer can hardly tell,
/// and a viewer is not told of a course that it can hardly tell from the one that it knows.
fn same_place_m(away_m: f32) -> f32 {
    2.0 * (away_m / ACUITY_DISTANCES).max(TOLERANCE_MIN_M) + ROUNDING_M
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_follow_the_histogram() {
        let mut statistics = SwarmStatistics::new([].into_iter(), Joining::default(), Vec::new());
        assert_eq!(statistics.age_percentile(0, 99), 0.0);
        statistics.ages[0] = 98;
        statistics.ages[10] = 2;
        assert_eq!(statistics.age_percentile(100, 50), AGE_BIN_MS);
        assert_eq!(statistics.age_percentile(100, 99), 11.0 * AGE_BIN_MS);
    }
}
