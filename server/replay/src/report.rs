//! What a run comes to.

use std::fmt;

use serde::Serialize;

use super::{MissedAvatar, StalePosition};

/// The figures of a run. Rates are means for one client while it is present.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ReplayReport {
    /// The world's title.
    pub world: String,
    /// The policy, as it is given on the command line.
    pub policy: String,
    /// Every client's.
    pub round_trip_ms: f64,
    /// From tick to tick.
    pub tick_ms: f64,
    /// How long a TBV is made to last.
    pub validity: String,
    /// What bounds it in space.
    pub shape: String,
    /// In metres a second.
    pub speed_max: f32,
    /// How many there are in the trace.
    pub avatars: usize,
    /// How long the run was.
    pub seconds: f64,
    /// The mean number of those present.
    pub present_mean: f64,
    /// The mean number of avatars that a client holds.
    pub held_mean: f64,
    /// The share of all time that clients are quiet, from 0 to 1.
    pub quiet_share: f64,
    /// Messages to a client, a second: datagrams and control messages.
    pub messages_to_client: f64,
    /// The same, of the client that gets most of those that stay for a second.
    pub messages_to_client_worst: f64,
    /// Bytes of these to a client, a second, without those that QUIC and UDP add.
    pub bytes_to_client: f64,
    /// The same, at most.
    pub bytes_to_client_worst: f64,
    /// States of avatars in these, a second.
    pub updates_to_client: f64,
    /// Messages from a client, a second.
    pub messages_from_client: f64,
    /// The same, at most.
    pub messages_from_client_worst: f64,
    /// Bytes from a client, a second.
    pub bytes_from_client: f64,
    /// The same, at most.
    pub bytes_from_client_worst: f64,
    /// Reports from a client, a second.
    pub reports_from_client: f64,
    /// All reports that reached the server.
    pub reports: u64,
    /// All asks: of expired, of revealed, and again of those who did not answer.
    pub asks: u64,
    /// TBVs that ended.
    pub expiries: u64,
    /// TBVs that came into view.
    pub reveals: u64,
    /// How often a client was told of an avatar.
    pub enters: u64,
    /// How often a client was told that it cannot see an avatar any more.
    pub leaves: u64,
    /// Enters less than half a second after a leave of the same two.
    pub flickers: u64,
    /// States sent in a second to all clients together.
    pub states_per_s: f64,
    /// Asks in a second, of all clients together.
    pub asks_per_s: f64,
    /// Likewise, expiries.
    pub expiries_per_s: f64,
    /// Likewise, reveals.
    pub reveals_per_s: f64,
    /// Likewise, enters.
    pub enters_per_s: f64,
    /// Likewise, leaves.
    pub leaves_per_s: f64,
    /// Times that a quiet client reported unasked, as it was about to leave its TBV: where TBVs hold all that a
    /// body can do, 0 unless somebody jumps, or something is wrong.
    pub left_tbv: u64,
    /// Moves that no body can make, or that the server would not believe, and so announced.
    pub jumps: u64,
    /// Corrections sent: 0 unless something is wrong, or the network so bad that honest clients seem too fast.
    pub corrections: u64,
    /// Samples of the trace that are outside the world.
    pub outside: u64,
    /// CPU time of the engine for a tick, median, in milliseconds.
    pub tick_cpu_median_ms: f64,
    /// The same at the 99th percentile.
    pub tick_cpu_p99_ms: f64,
    /// Each client's, from its coming to its going.
    pub clients: Vec<ClientReport>,
    /// What rays said, if they were asked.
    pub oracle: Option<OracleReport>,
}

/// What one client cost.
#[derive(Clone, Debug, Serialize)]
pub struct ClientReport {
    /// The trace's id of its avatar; one that comes again is another client.
    pub id: u32,
    /// How long it was there.
    pub seconds: f64,
    /// The mean number of avatars that it held.
    pub held_mean: f64,
    /// The share of its time that it was quiet, from 0 to 1.
    pub quiet_share: f64,
    /// Messages to it: datagrams and control messages.
    pub messages_to: u64,
    /// Bytes of these, without those that QUIC and UDP add.
    pub bytes_to: u64,
    /// Messages from it.
    pub messages_from: u64,
    /// Bytes of these.
    pub bytes_from: u64,
}

/// What clients held, compared with what was visible. Pairs of which one has just come or jumped
/// count in nothing but [`OracleReport::misses_after_jumps`].
#[derive(Clone, Debug, Default, Serialize)]
pub struct OracleReport {
    /// How often it looked.
    pub instants: u64,
    /// From look to look.
    pub stride_ms: f64,
    /// Pairs of a viewer and an avatar of which some sampled point was in sight.
    pub pairs_visible: u64,
    /// Pairs of a viewer and an avatar that its client held.
    pub pairs_held: u64,
    /// Of these, those of which samples find that they are in sight, or could be within the horizon.
    pub pairs_foreseen: u64,
    /// Visible pairs that were not held.
    pub misses: u64,
    /// The same, of those that had just come or jumped.
    pub misses_after_jumps: u64,
    /// The same, of those whose messages had just taken longer than the engine allows for.
    pub misses_late: u64,
    /// The first of the misses that have no excuse.
    pub first_misses: Vec<MissedAvatar>,
    /// Pairs held for each visible one: over-send against sight at that instant.
    pub over_send: f64,
    /// Pairs held for each foreseen one: over-send against an oracle with the same horizon, at
    /// most, since sampling finds too little.
    pub over_send_horizon: f64,
    /// The share of time that an avatar is in nobody's sight, from 0 to 1.
    pub hidden_share: f64,
    /// The share of ticks at which an avatar reports while in nobody's sight: always reporting is 1.
    pub hidden_reports: f64,
    /// The share of ticks at which an avatar in nobody's sight is held by somebody or holds somebody: one of them may come
    /// into sight within the horizon, so that it must report.
    pub hidden_held: f64,
    /// How old the held position of a visible avatar was.
    pub age_mean_ms: f64,
    /// The same, at worst.
    pub age_worst_ms: f64,
    /// No position may be older: two ticks and the way from client to client. Where messages are lost,
    /// each that was makes it up to two ticks more: reports that
    /// jitter brings in together are lost together.
    pub age_bound_ms: f64,
    /// Positions that were older all the same.
    pub stale: u64,
    /// The first of them.
    pub first_stale: Vec<StalePosition>,
}

/// The closing table.
impl fmt::Display for ReplayReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |name: &str, value: String| writeln!(f, "{name:<34} {value}");
        row("world", self.world.clone())?;
        row("policy", self.policy.clone())?;
        row("round trip", format!("{:.0} ms", self.round_trip_ms))?;
        row("avatars", format!("{} ({:.1} at a time)", self.avatars, self.present_mean))?;
        row("seconds", format!("{:.1}", self.seconds))?;
        row("avatars held by a client", format!("{:.2}", self.held_mean))?;
        row("share of time quiet", format!("{:.1} %", self.quiet_share * 100.0))?;
        let (to, to_worst) = (self.messages_to_client, self.messages_to_client_worst);
        row("messages/s to a client, worst", format!("{to:.2}, {to_worst:.2}"))?;
        let (to, to_worst) = (self.bytes_to_client, self.bytes_to_client_worst);
        row("bytes/s to a client, worst", format!("{to:.0}, {to_worst:.0}"))?;
        row("states/s to a client", format!("{:.2}", self.updates_to_client))?;
        let (from, from_worst) = (self.messages_from_client, self.messages_from_client_worst);
        row("messages/s from a client, worst", format!("{from:.2}, {from_worst:.2}"))?;
        let (from, from_worst) = (self.bytes_from_client, self.bytes_from_client_worst);
        row("bytes/s from a client, worst", format!("{from:.0}, {from_worst:.0}"))?;
        row("reports/s from a client", format!("{:.2}", self.reports_from_client))?;
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
        if self.stale > 0 {
            row("positions older than the bound", self.stale.to_string())?;
        }
        let worst = format!("{:.0}, bound {:.0} ms", self.age_worst_ms, self.age_bound_ms);
        row("age of positions, mean, worst", format!("{:.0}, {worst}", self.age_mean_ms))
    }
}
