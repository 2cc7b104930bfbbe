//! What a run comes to.

use std::{fmt, time::Duration};

use serde::Serialize;

use super::Options;
use crate::engine::{Engine, Policy, Stats};

/// The figures of a run. Rates are means for one client while it is present.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The world's title.
    pub world: String,
    /// The policy, as it is given on the command line.
    pub policy: String,
    /// Every client's.
    pub round_trip_ms: f64,
    /// From tick to tick.
    pub tick_ms: f64,
    /// How long a TBV lasts.
    pub validity_ms: f64,
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
    /// Bytes of these to a client, a second, without those that QUIC and UDP add.
    pub bytes_to_client: f64,
    /// States of avatars in these, a second.
    pub updates_to_client: f64,
    /// Messages from a client, a second.
    pub messages_from_client: f64,
    /// Bytes from a client, a second.
    pub bytes_from_client: f64,
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
    /// Moves that no body can make, announced by their clients.
    pub jumps: u64,
    /// Corrections sent; 0 unless something is wrong.
    pub corrections: u64,
    /// Samples of the trace that are outside the world.
    pub outside: u64,
    /// CPU time of the engine for a tick, median, in milliseconds.
    pub tick_cpu_median_ms: f64,
    /// The same at the 99th percentile.
    pub tick_cpu_p99_ms: f64,
    /// What rays said, if they were asked.
    pub oracle: Option<OracleReport>,
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
    /// Visible pairs that were not held.
    pub misses: u64,
    /// The same, of those that had just come or jumped.
    pub misses_after_jumps: u64,
    /// Pairs held for each visible one.
    pub over_send: f64,
    /// How old the held position of a visible avatar was.
    pub age_mean_ms: f64,
    /// The same, at worst.
    pub age_worst_ms: f64,
    /// No position may be older: two ticks and the way from client to client.
    pub age_bound_ms: f64,
}

/// Messages one way.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Traffic {
    messages: u64,
    bytes: u64,
}

impl Traffic {
    pub(super) fn add(&mut self, bytes: usize) {
        self.messages += 1;
        self.bytes += bytes as u64;
    }
}

/// What is counted on the way.
#[derive(Clone, Debug, Default)]
pub(super) struct Tally {
    pub(super) to_clients: Traffic,
    pub(super) from_clients: Traffic,
    pub(super) updates: u64,
    pub(super) reports: u64,
    pub(super) asks: u64,
    pub(super) corrections: u64,
    present: u64,
    quiet: u64,
    held: u64,
    cpu: Vec<Duration>,
}

impl Tally {
    /// Counts who is present after a tick.
    pub(super) fn tick(&mut self, cpu: Duration, engine: &Engine) {
        let counts = engine.counts();
        self.present += (counts.live + counts.quiet + counts.asked) as u64;
        self.quiet += counts.quiet as u64;
        self.held += engine.avatars().map(|id| engine.held_by(id).count() as u64).sum::<u64>();
        self.cpu.push(cpu);
    }

    pub(super) fn report(
        mut self,
        world: String,
        options: &Options,
        length: Duration,
        (stats, speed_max): (Stats, f32),
        (avatars, jumps, outside): (usize, u64, u64),
        oracle: Option<OracleReport>,
    ) -> Report {
        self.cpu.sort_unstable();
        let config = &options.config;
        let client_s = (self.present as f64 * config.tick.as_secs_f64()).max(f64::MIN_POSITIVE);
        let present = (self.present as f64).max(1.0);
        let rate = |count: u64| count as f64 / client_s;
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        Report {
            world,
            policy: config.policy.to_string(),
            round_trip_ms: ms(options.round_trip),
            tick_ms: ms(config.tick),
            validity_ms: if config.policy == Policy::Tbv { ms(config.validity) } else { 0.0 },
            speed_max,
            avatars,
            seconds: length.as_secs_f64(),
            present_mean: self.present as f64 / self.cpu.len().max(1) as f64,
            held_mean: self.held as f64 / present,
            quiet_share: self.quiet as f64 / present,
            messages_to_client: rate(self.to_clients.messages),
            bytes_to_client: rate(self.to_clients.bytes),
            updates_to_client: rate(self.updates),
            messages_from_client: rate(self.from_clients.messages),
            bytes_from_client: rate(self.from_clients.bytes),
            reports_from_client: rate(self.reports),
            reports: self.reports,
            asks: self.asks,
            expiries: stats.expiries,
            reveals: stats.reveals,
            jumps,
            corrections: self.corrections,
            outside,
            tick_cpu_median_ms: ms(percentile(&self.cpu, 50)),
            tick_cpu_p99_ms: ms(percentile(&self.cpu, 99)),
            oracle,
        }
    }
}

/// Of sorted times; zero when there are none.
fn percentile(sorted: &[Duration], percent: usize) -> Duration {
    let place = (sorted.len() * percent).div_ceil(100).saturating_sub(1);
    sorted.get(place).copied().unwrap_or_default()
}

/// The closing table.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |name: &str, value: String| writeln!(f, "{name:<34} {value}");
        row("world", self.world.clone())?;
        row("policy", self.policy.clone())?;
        row("round trip", format!("{:.0} ms", self.round_trip_ms))?;
        row("avatars", format!("{} ({:.1} at a time)", self.avatars, self.present_mean))?;
        row("seconds", format!("{:.1}", self.seconds))?;
        row("avatars held by a client", format!("{:.2}", self.held_mean))?;
        row("share of time quiet", format!("{:.1} %", self.quiet_share * 100.0))?;
        row("messages/s to a client", format!("{:.2}", self.messages_to_client))?;
        row("bytes/s to a client", format!("{:.0}", self.bytes_to_client))?;
        row("states/s to a client", format!("{:.2}", self.updates_to_client))?;
        row("messages/s from a client", format!("{:.2}", self.messages_from_client))?;
        row("bytes/s from a client", format!("{:.0}", self.bytes_from_client))?;
        row("reports/s from a client", format!("{:.2}", self.reports_from_client))?;
        row("asks", self.asks.to_string())?;
        row("reports", self.reports.to_string())?;
        row("expiries", self.expiries.to_string())?;
        row("reveals", self.reveals.to_string())?;
        row("jumps", self.jumps.to_string())?;
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
        row("over-send", format!("{:.2}", self.over_send))?;
        let worst = format!("{:.0}, bound {:.0} ms", self.age_worst_ms, self.age_bound_ms);
        row("age of positions, mean, worst", format!("{:.0}, {worst}", self.age_mean_ms))
    }
}
