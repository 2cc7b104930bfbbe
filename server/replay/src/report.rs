//! The figures of a run.

use std::fmt;

use serde::Serialize;
use sightline_cli::pose_error::DistanceBand;

use super::stations::StationReport;

/// The figures of a run. Rates are means over all clients while they are present.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ReplayReport {
    /// The world's title.
    pub world: String,
    /// The policy, as on the command line.
    pub policy: String,
    /// Whether live clients report by exception, and not at every tick.
    pub by_exception: bool,
    /// The round trip of every client, in milliseconds.
    pub round_trip_ms: f64,
    /// The share of messages that were lost, in per cent.
    pub loss_percent: f64,
    /// The tick interval, in milliseconds.
    pub tick_ms: f64,
    /// How long TBVs are made to last, as on the command line.
    pub validity: String,
    /// What bounds TBVs in space, as on the command line.
    pub shape: String,
    /// The speed limit, in metres a second.
    pub speed_max: f32,
    /// The number of avatars in the trace.
    pub avatars: usize,
    /// The length of the run, in seconds.
    pub seconds: f64,
    /// The mean number of avatars that are present.
    pub present_mean: f64,
    /// The mean number of avatars that a client holds.
    pub held_mean: f64,
    /// The share of clients' ticks at which they are quiet, from 0 to 1.
    pub quiet_share: f64,
    /// The share of clients' ticks at which they are live and send no report, since their avatars
    /// are on course. With [`ReplayReport::quiet_share`] and the share of ticks at which clients
    /// report it makes 1.
    pub course_share: f64,
    /// Messages to a client, a second: datagrams and control messages.
    pub messages_to_client: f64,
    /// Messages a second to the client that gets most, of those that stay for a second.
    pub messages_to_client_worst: f64,
    /// Bytes of messages to a client, a second, without what QUIC and UDP add.
    pub bytes_to_client: f64,
    /// Bytes a second to the client that gets most.
    pub bytes_to_client_worst: f64,
    /// States of avatars sent to a client, a second.
    pub updates_to_client: f64,
    /// Messages from a client, a second.
    pub messages_from_client: f64,
    /// Messages a second from the client that sends most.
    pub messages_from_client_worst: f64,
    /// Bytes of messages from a client, a second, without what QUIC and UDP add.
    pub bytes_from_client: f64,
    /// Bytes a second from the client that sends most.
    pub bytes_from_client_worst: f64,
    /// Reports from a client, a second.
    pub reports_from_client: f64,
    /// What stations cost, if there are several.
    pub stations: Option<StationReport>,
    /// All reports that reached the server.
    pub reports: u64,
    /// All asks: after an expiry, after a reveal, and again where no answer came.
    pub asks: u64,
    /// TBVs whose validity ended.
    pub expiries: u64,
    /// TBVs that came into view.
    pub reveals: u64,
    /// How often a client was told of an avatar.
    pub enters: u64,
    /// How often a client was told that an avatar vanished.
    pub leaves: u64,
    /// Enters within half a second after a leave of the same viewer and avatar.
    pub flickers: u64,
    /// States of avatars sent to all clients together, a second.
    pub states_per_s: f64,
    /// Asks to all clients together, a second.
    pub asks_per_s: f64,
    /// Expiries of all clients together, a second.
    pub expiries_per_s: f64,
    /// Reveals of all clients together, a second.
    pub reveals_per_s: f64,
    /// Enters of all clients together, a second.
    pub enters_per_s: f64,
    /// Leaves of all clients together, a second.
    pub leaves_per_s: f64,
    /// Reports that quiet clients made unasked, because they were about to leave their TBVs. Where
    /// TBVs hold all that a body can do, a number above 0 means a jump or a fault.
    pub left_tbv: u64,
    /// Jumps that were announced: movements that no body can make, or that the server would not
    /// believe.
    pub jumps: u64,
    /// Corrections sent. A number above 0 means a fault, or a network so bad that honest clients
    /// seem too fast.
    pub corrections: u64,
    /// Samples of the trace outside the world.
    pub outside: u64,
    /// The engine's CPU time for a tick, in milliseconds: the median.
    pub tick_cpu_median_ms: f64,
    /// The engine's CPU time for a tick, in milliseconds: the 99th percentile.
    pub tick_cpu_p99_ms: f64,
    /// The figures of each client, from its join to its leave.
    pub clients: Vec<ClientReport>,
    /// What the audit found; `None` without an audit.
    pub oracle: Option<OracleReport>,
}

/// The figures of one client.
#[derive(Clone, Debug, Serialize)]
pub struct ClientReport {
    /// The trace's id of its avatar. An avatar that comes again has another client.
    pub id: u32,
    /// How long it was present, in seconds.
    pub seconds: f64,
    /// The mean number of avatars that it held.
    pub held_mean: f64,
    /// The share of its ticks at which it was quiet, from 0 to 1.
    pub quiet_share: f64,
    /// The share of its ticks at which it was live, on course and silent, from 0 to 1.
    pub course_share: f64,
    /// Messages to it: datagrams and control messages.
    pub messages_to: u64,
    /// Bytes of messages to it, without what QUIC and UDP add.
    pub bytes_to: u64,
    /// Messages from it.
    pub messages_from: u64,
    /// Bytes of messages from it, without what QUIC and UDP add.
    pub bytes_from: u64,
}

/// What the audit found: what clients held, compared with what rays found visible. A pair is a
/// viewer and another avatar. Pairs of which one has just joined or jumped count in nothing but
/// [`OracleReport::misses_after_jumps`].
#[derive(Clone, Debug, Default, Serialize)]
pub struct OracleReport {
    /// How often the audit compared.
    pub instants: u64,
    /// The interval between comparisons, in milliseconds.
    pub stride_ms: f64,
    /// Pairs whose avatar was visible: some sampled point of its body was in sight.
    pub pairs_visible: u64,
    /// Those of them whose two clients are at different stations.
    pub pairs_abroad: u64,
    /// Pairs whose avatar the viewer's client held.
    pub pairs_held: u64,
    /// Held pairs whose avatar was visible, or could be within the horizon, as far as sampling
    /// finds.
    pub pairs_foreseen: u64,
    /// Visible pairs that were not held, without an excuse.
    pub misses: u64,
    /// Visible pairs that were not held just after a join or a jump.
    pub misses_after_jumps: u64,
    /// Visible pairs that were not held while messages were later than the engine allows for.
    pub misses_late: u64,
    /// The first misses without an excuse.
    pub first_misses: Vec<MissedAvatar>,
    /// Pairs held for each visible pair: over-send against sight at that instant.
    pub over_send: f64,
    /// Pairs held for each foreseen pair: over-send against an oracle with the same horizon. It is
    /// an upper bound, since sampling finds too little.
    pub over_send_horizon: f64,
    /// The share of time that an avatar is in nobody's sight, from 0 to 1.
    pub hidden_share: f64,
    /// The share of ticks at which an avatar in nobody's sight reports. It is 1 for a client that
    /// always reports.
    pub hidden_reports: f64,
    /// The share of ticks at which an avatar in nobody's sight is held by a client, or its client
    /// holds another. One of the two may come into sight within the horizon, so it must report.
    pub hidden_held: f64,
    /// How many reports a client would make in a second if it knew the future: the fewest straight
    /// courses that stay within 5 cm of its way while somebody sees it. No client can do that. It
    /// is a yardstick for [`ReplayReport::reports_from_client`].
    pub floor_reports: f64,
    /// The share of time in which nobody sees an avatar, so that the floor has no course of it,
    /// from 0 to 1. Between two comparisons an avatar counts as seen when it was seen at one of
    /// them.
    pub floor_hidden_share: f64,
    /// The distance of the place at which a visible avatar is shown from where it is now, in
    /// metres: the median.
    pub shown_error_p50_m: f64,
    /// That distance: the 99th percentile.
    pub shown_error_p99_m: f64,
    /// The angle between the shown pose of a visible avatar and that of now, in degrees: the larger
    /// of those of yaw and pitch. The median.
    pub shown_error_p50_deg: f64,
    /// That angle: the 99th percentile.
    pub shown_error_p99_deg: f64,
    /// The distance of the place at which a visible avatar is shown from where it was one delay and
    /// two ticks ago, as promised, in metres: the median. The delay is the one-way delay of its
    /// client and that of its viewer. Jitter and loss count as errors.
    pub promised_error_p50_m: f64,
    /// That distance: the 99th percentile.
    pub promised_error_p99_m: f64,
    /// The angle between the shown pose of a visible avatar and that of one delay and two ticks
    /// ago, in degrees: the larger of those of yaw and pitch. The median.
    pub promised_error_p50_deg: f64,
    /// That angle: the 99th percentile.
    pub promised_error_p99_deg: f64,
    /// These distances and angles by how far the avatar is from its viewer.
    pub promised_errors_by_distance: Vec<DistanceBand>,
    /// The mean age of the place at which a visible avatar is shown, in milliseconds. The age is
    /// the time since the avatar was last there, within its tolerance and 2 cm; where messages were
    /// lost, also within the way that it goes in the time that this takes.
    pub age_mean_ms: f64,
    /// The greatest age of the place at which a visible avatar is shown, in milliseconds.
    pub age_worst_ms: f64,
    /// The greatest age that a place may have, in milliseconds: two ticks, and the delay from
    /// client to client. Each lost datagram allows two more ticks, since reports that jitter
    /// brings in together are lost together. Each lost piece of a stream allows for its
    /// retransmission.
    pub age_bound_ms: f64,
    /// Visible avatars that were shown where they had not been for longer than that.
    pub stale: u64,
    /// The first of these.
    pub first_stale: Vec<StalePosition>,
}

/// A visible avatar that its viewer did not hold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MissedAvatar {
    /// The time in the trace, in milliseconds.
    pub t_ms: f64,
    /// The trace's id of the viewer.
    pub viewer: u32,
    /// The trace's id of the avatar.
    pub avatar: u32,
}

/// A visible avatar that was shown at too old a place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StalePosition {
    /// The viewer, the avatar and the time.
    #[serde(flatten)]
    pub what: MissedAvatar,
    /// The age of that place, in milliseconds.
    pub age_ms: f64,
    /// The greatest age that was allowed, in milliseconds.
    pub bound_ms: f64,
    /// The least distance from where the avatar has been since, in metres.
    pub off_m: f32,
}

/// The table that ends a run.
impl fmt::Display for ReplayReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |name: &str, value: String| writeln!(f, "{name:<34} {value}");
        row("world", self.world.clone())?;
        row("policy", self.policy.clone())?;
        let reports = if self.by_exception { "by exception" } else { "at every tick" };
        row("live clients report", reports.to_owned())?;
        let (round_trip, loss) = (self.round_trip_ms, self.loss_percent);
        row("round trip, messages lost", format!("{round_trip:.0} ms, {loss:.1} %"))?;
        row("avatars", format!("{} ({:.1} at a time)", self.avatars, self.present_mean))?;
        row("seconds", format!("{:.1}", self.seconds))?;
        row("avatars held by a client", format!("{:.2}", self.held_mean))?;
        let (quiet, course) = (self.quiet_share * 100.0, self.course_share * 100.0);
        row("share of time quiet, on course", format!("{quiet:.1} %, {course:.1} %"))?;
        let (to, to_worst) = (self.messages_to_client, self.messages_to_client_worst);
        row("messages/s to a client, worst", format!("{to:.2}, {to_worst:.2}"))?;
        let (to, to_worst) = (self.bytes_to_client, self.bytes_to_client_worst);
        row("bytes/s to a client, worst", format!("{to:.0}, {to_worst:.0}"))?;
        row("states/s to a client", format!("{:.2}", self.updates_to_client))?;
        let (from, from_worst) = (self.messages_from_client, self.messages_from_client_worst);
        row("messages/s from a client, worst", format!("{from:.2}, {from_worst:.2}"))?;
        let (from, from_worst) = (self.bytes_from_client, self.bytes_from_client_worst);
        row("bytes/s from a client, worst", format!("{from:.0}, {from_worst:.0}"))?;
        let reports = format!("{:.2}", self.reports_from_client);
        match &self.oracle {
            Some(oracle) => {
                row(
                    "reports/s from a client, floor",
                    format!("{reports}, {:.3}", oracle.floor_reports),
                )?;
            }
            None => row("reports/s from a client", reports)?,
        }
        row("reports", self.reports.to_string())?;
        for (name, count, rate) in [
            ("asks", self.asks, self.asks_per_s),
            ("expiries", self.expiries, self.expiries_per_s),
            ("reveals", self.reveals, self.reveals_per_s),
            ("enters", self.enters, self.enters_per_s),
            ("leaves", self.leaves, self.leaves_per_s),
        ] {
            row(name, format!("{count} ({rate:.2} a second)"))?;
        }
        row("enters within 0.5 s of a leave", self.flickers.to_string())?;
        row("jumps", self.jumps.to_string())?;
        if self.left_tbv > 0 {
            row("reports on leaving a TBV", self.left_tbv.to_string())?;
        }
        if self.corrections > 0 {
            row("corrections", self.corrections.to_string())?;
        }
        if self.outside > 0 {
            row("samples outside the world", self.outside.to_string())?;
        }
        let cpu = format!("{:.3} / {:.3} ms", self.tick_cpu_median_ms, self.tick_cpu_p99_ms);
        row("CPU for a tick, median / p99", cpu)?;
        self.oracle.as_ref().map_or(Ok(()), |oracle| write!(f, "{oracle}"))
    }
}

impl fmt::Display for OracleReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |name: &str, value: String| writeln!(f, "{name:<34} {value}");
        let every = format!("{} times, every {:.1} s", self.instants, self.stride_ms / 1e3);
        row("oracle", every)?;
        row("pairs visible / held", format!("{} / {}", self.pairs_visible, self.pairs_held))?;
        row("misses", self.misses.to_string())?;
        row("misses just after a jump or join", self.misses_after_jumps.to_string())?;
        if self.misses_late > 0 {
            row("misses by late messages", self.misses_late.to_string())?;
        }
        row("over-send against sight", format!("{:.2}", self.over_send))?;
        row("over-send against the horizon", format!("{:.2} at most", self.over_send_horizon))?;
        row("share of time truly hidden", format!("{:.1} %", self.hidden_share * 100.0))?;
        let silence = 1.0 / self.hidden_reports.max(f64::MIN_POSITIVE);
        let silence =
            if silence < 1e6 { format!(", {silence:.1} times less often") } else { String::new() };
        let hidden = format!("{:.2} % of ticks{silence}", self.hidden_reports * 100.0);
        row("reports while truly hidden", hidden)?;
        let held = format!("{:.2} % of ticks", self.hidden_held * 100.0);
        row("truly hidden, but in a horizon", held)?;
        let metres = [self.promised_error_p50_m, self.promised_error_p99_m].map(|m| m * 100.0);
        let degrees = [self.promised_error_p50_deg, self.promised_error_p99_deg];
        row("off the promise, median, p99", format!("{:.1}, {:.1} cm", metres[0], metres[1]))?;
        row("turned off it, median, p99", format!("{:.1}, {:.1} degrees", degrees[0], degrees[1]))?;
        for band in &self.promised_errors_by_distance {
            row(&band.name(), band.to_string())?;
        }
        let metres = [self.shown_error_p50_m, self.shown_error_p99_m].map(|m| m * 100.0);
        let degrees = [self.shown_error_p50_deg, self.shown_error_p99_deg];
        row("shown off by, median, p99", format!("{:.1}, {:.1} cm", metres[0], metres[1]))?;
        row(
            "shown turned by, median, p99",
            format!("{:.1}, {:.1} degrees", degrees[0], degrees[1]),
        )?;
        if self.stale > 0 {
            row("positions older than the bound", self.stale.to_string())?;
        }
        let worst = format!("{:.0}, bound {:.0} ms", self.age_worst_ms, self.age_bound_ms);
        row("age of positions, mean, worst", format!("{:.0}, {worst}", self.age_mean_ms))
    }
}
