//! Statistics of a run: everything but what the audit finds.

use std::{collections::BTreeMap, time::Duration};

use sightline_cli::percentile::percentile;
use sightline_client_core::reporting::ReportingCounts;
use sightline_engine::{Engine, Stats};
use sightline_world::motion::AvatarId;

use super::{
    options::ReplayOptions,
    report::{ClientReport, ReplayReport},
    simulated_clients::SimulatedClients,
};

/// Clients that stay for less time have no share in the worst rates, in seconds.
const PRESENCE_MIN_S: f64 = 1.0;
/// An avatar that comes back into view sooner than this flickers.
const FLICKER: Duration = Duration::from_millis(500);

/// Messages in one direction.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MessageCount {
    messages: u64,
    bytes: u64,
}

impl MessageCount {
    /// Counts one message.
    pub(super) fn add(&mut self, bytes: usize) {
        debug_assert!(bytes > 0, "no message is empty");
        self.messages += 1;
        self.bytes += bytes as u64;
    }
}

/// Counts of one client. Those of ticks count the ticks at which it was present.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ClientStatistics {
    pub(super) received: MessageCount,
    pub(super) sent: MessageCount,
    ticks: u64,
    /// The sum over ticks of how many avatars it held.
    held: u64,
}

/// Counts of all clients, and of the engine's ticks.
#[derive(Clone, Debug, Default)]
pub(super) struct RunStatistics {
    clients: BTreeMap<AvatarId, ClientStatistics>,
    pub(super) updates: u64,
    enters: u64,
    leaves: u64,
    /// When each client was last told that an avatar vanished: viewer, then avatar.
    left_at: BTreeMap<(AvatarId, AvatarId), Duration>,
    flickers: u64,
    pub(super) reports: u64,
    pub(super) asks: u64,
    pub(super) corrections: u64,
    /// The engine's CPU time for each tick.
    cpu: Vec<Duration>,
}

impl RunStatistics {
    /// The counts of a client.
    pub(super) fn client(&mut self, client: AvatarId) -> &mut ClientStatistics {
        self.clients.entry(client).or_default()
    }

    /// Counts that a viewer is told of an avatar.
    pub(super) fn enter(&mut self, now: Duration, viewer: AvatarId, avatar: AvatarId) {
        self.enters += 1;
        let left_at = self.left_at.remove(&(viewer, avatar));
        self.flickers += u64::from(left_at.is_some_and(|at| now < at + FLICKER));
    }

    /// Counts that a viewer is told that an avatar vanished.
    pub(super) fn leave(&mut self, now: Duration, viewer: AvatarId, avatar: AvatarId) {
        self.leaves += 1;
        self.left_at.insert((viewer, avatar), now);
    }

    /// Counts a tick: the engines' CPU time for it, and what each client holds after it.
    pub(super) fn tick<'a>(&mut self, cpu: Duration, engines: impl Iterator<Item = &'a Engine>) {
        for engine in engines {
            for id in engine.avatars() {
                let client = self.client(id);
                client.ticks += 1;
                client.held += engine.held_by(id).count() as u64;
            }
        }
        self.cpu.push(cpu);
    }

    /// The figures of each client.
    pub(super) fn clients(
        &self,
        options: &ReplayOptions,
        clients: &SimulatedClients<'_>,
    ) -> Vec<ClientReport> {
        let tick_s = options.config.tick.as_secs_f64();
        self.clients
            .iter()
            .map(|(avatar, client)| {
                client.report(clients.trace_id(*avatar), clients.counts(*avatar), tick_s)
            })
            .collect()
    }

    /// The figures of all clients and of the engine. What this does not know has its default.
    pub(super) fn report(
        mut self,
        options: &ReplayOptions,
        stats: Stats,
        clients: &SimulatedClients<'_>,
    ) -> ReplayReport {
        self.cpu.sort_unstable();
        let config = &options.config;
        let tick_s = config.tick.as_secs_f64();
        let sum = |of: fn(&ClientStatistics) -> u64| self.clients.values().map(of).sum::<u64>();
        let present = sum(|client| client.ticks);
        let client_s = (present as f64 * tick_s).max(f64::MIN_POSITIVE);
        let mean = |count: u64| count as f64 / client_s;
        let worst = |of: fn(&ClientStatistics) -> u64| {
            let staying =
                |client: &&ClientStatistics| client.ticks as f64 * tick_s >= PRESENCE_MIN_S;
            let rates = self.clients.values().filter(staying);
            rates
                .map(|client| of(client) as f64 / (client.ticks as f64 * tick_s))
                .fold(0.0, f64::max)
        };
        let counts: Vec<ReportingCounts> =
            self.clients.keys().map(|client| clients.counts(*client)).collect();
        let of_ticks = |of: fn(&ReportingCounts) -> u64| {
            let ticks: u64 = counts.iter().map(|counts| counts.ticks).sum();
            counts.iter().map(of).sum::<u64>() as f64 / ticks.max(1) as f64
        };
        let seconds = (self.cpu.len() as f64 * tick_s).max(f64::MIN_POSITIVE);
        let rate = |count: u64| count as f64 / seconds;
        let cpu = |percent| percentile(&self.cpu, percent).unwrap_or_default();
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        ReplayReport {
            policy: config.policy.to_string(),
            round_trip_ms: ms(options.round_trip),
            loss_percent: options.network.loss * 100.0,
            tick_ms: ms(config.tick),
            by_exception: config.reports_by_exception(),
            validity: config.validity.to_string(),
            shape: config.shape.to_string(),
            present_mean: present as f64 / self.cpu.len().max(1) as f64,
            held_mean: sum(|client| client.held) as f64 / present.max(1) as f64,
            quiet_share: of_ticks(|counts| counts.quiet),
            course_share: of_ticks(|counts| counts.on_course),
            messages_to_client: mean(sum(|client| client.received.messages)),
            messages_to_client_worst: worst(|client| client.received.messages),
            bytes_to_client: mean(sum(|client| client.received.bytes)),
            bytes_to_client_worst: worst(|client| client.received.bytes),
            updates_to_client: mean(self.updates),
            messages_from_client: mean(sum(|client| client.sent.messages)),
            messages_from_client_worst: worst(|client| client.sent.messages),
            bytes_from_client: mean(sum(|client| client.sent.bytes)),
            bytes_from_client_worst: worst(|client| client.sent.bytes),
            reports_from_client: mean(self.reports),
            reports: self.reports,
            asks: self.asks,
            expiries: stats.expiries,
            reveals: stats.reveals,
            enters: self.enters,
            leaves: self.leaves,
            flickers: self.flickers,
            states_per_s: rate(self.updates),
            asks_per_s: rate(self.asks),
            expiries_per_s: rate(stats.expiries),
            reveals_per_s: rate(stats.reveals),
            enters_per_s: rate(self.enters),
            leaves_per_s: rate(self.leaves),
            corrections: self.corrections,
            tick_cpu_median_ms: ms(cpu(50)),
            tick_cpu_p99_ms: ms(cpu(99)),
            ..ReplayReport::default()
        }
    }
}

impl ClientStatistics {
    fn report(&self, id: u32, counts: ReportingCounts, tick_s: f64) -> ClientReport {
        debug_assert!(counts.quiet + counts.on_course <= counts.ticks, "shares: {counts:?}");
        let share = |ticks: u64| ticks as f64 / counts.ticks.max(1) as f64;
        ClientReport {
            id,
            seconds: self.ticks as f64 * tick_s,
            held_mean: self.held as f64 / self.ticks.max(1) as f64,
            quiet_share: share(counts.quiet),
            course_share: share(counts.on_course),
            messages_to: self.received.messages,
            bytes_to: self.received.bytes,
            messages_from: self.sent.messages,
            bytes_from: self.sent.bytes,
        }
    }
}
