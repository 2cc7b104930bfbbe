//! What is counted on the way.

use std::{collections::BTreeMap, time::Duration};

use sightline_cli::percentile::percentile;
use sightline_world::motion::{AvatarId, ReportingState};

use super::{ClientReport, ReplayOptions, ReplayReport};
use sightline_engine::{Engine, Stats};

/// Clients that were there for less time tell no rates, in seconds.
const PRESENCE_MIN_S: f64 = 1.0;
/// Whoever comes back sooner flickers.
const FLICKER: Duration = Duration::from_millis(500);

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

/// What one client gets and says.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ClientTally {
    pub(super) to: Traffic,
    pub(super) from: Traffic,
    ticks: u64,
    quiet: u64,
    held: u64,
}

/// Everything but what rays say.
#[derive(Clone, Debug, Default)]
pub(super) struct Tally {
    clients: BTreeMap<AvatarId, ClientTally>,
    pub(super) updates: u64,
    enters: u64,
    leaves: u64,
    /// When each client was told last that it cannot see an avatar any more.
    left: BTreeMap<(AvatarId, AvatarId), Duration>,
    flickers: u64,
    pub(super) reports: u64,
    pub(super) asks: u64,
    pub(super) corrections: u64,
    cpu: Vec<Duration>,
}

impl Tally {
    /// What is counted of a client.
    pub(super) fn client(&mut self, client: AvatarId) -> &mut ClientTally {
        self.clients.entry(client).or_default()
    }

    /// A client was told of an avatar.
    pub(super) fn enter(&mut self, now: Duration, to: AvatarId, avatar: AvatarId) {
        self.enters += 1;
        let left = self.left.remove(&(to, avatar));
        self.flickers += u64::from(left.is_some_and(|at| now < at + FLICKER));
    }

    /// A client was told that it cannot see an avatar any more.
    pub(super) fn leave(&mut self, now: Duration, to: AvatarId, avatar: AvatarId) {
        self.leaves += 1;
        self.left.insert((to, avatar), now);
    }

    /// Counts who is present after a tick.
    pub(super) fn tick(&mut self, cpu: Duration, engine: &Engine) {
        for id in engine.avatars() {
            let client = self.client(id);
            client.ticks += 1;
            client.held += engine.held_by(id).count() as u64;
            client.quiet += u64::from(engine.state(id) == Some(ReportingState::Quiet));
        }
        self.cpu.push(cpu);
    }

    /// What each client cost, by the id that the trace has for its avatar.
    pub(super) fn clients(
        &self,
        options: &ReplayOptions,
        id: impl Fn(AvatarId) -> u32,
    ) -> Vec<ClientReport> {
        let tick_s = options.config.tick.as_secs_f64();
        self.clients.iter().map(|(avatar, client)| client.report(id(*avatar), tick_s)).collect()
    }

    /// All that it knows; the rest is as by default.
    pub(super) fn report(mut self, options: &ReplayOptions, stats: Stats) -> ReplayReport {
        self.cpu.sort_unstable();
        let config = &options.config;
        let tick_s = config.tick.as_secs_f64();
        let sum = |of: fn(&ClientTally) -> u64| self.clients.values().map(of).sum::<u64>();
        let present = sum(|client| client.ticks);
        let client_s = (present as f64 * tick_s).max(f64::MIN_POSITIVE);
        let mean = |count: u64| count as f64 / client_s;
        let worst = |of: fn(&ClientTally) -> u64| {
            let staying = |client: &&ClientTally| client.ticks as f64 * tick_s >= PRESENCE_MIN_S;
            let rates = self.clients.values().filter(staying);
            rates
                .map(|client| of(client) as f64 / (client.ticks as f64 * tick_s))
                .fold(0.0, f64::max)
        };
        let seconds = (self.cpu.len() as f64 * tick_s).max(f64::MIN_POSITIVE);
        let rate = |count: u64| count as f64 / seconds;
        let cpu = |percent| percentile(&self.cpu, percent).unwrap_or_default();
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        ReplayReport {
            policy: config.policy.to_string(),
            round_trip_ms: ms(options.round_trip),
            tick_ms: ms(config.tick),
            validity: config.validity.to_string(),
            shape: config.shape.to_string(),
            present_mean: present as f64 / self.cpu.len().max(1) as f64,
            held_mean: sum(|client| client.held) as f64 / present.max(1) as f64,
            quiet_share: sum(|client| client.quiet) as f64 / present.max(1) as f64,
            messages_to_client: mean(sum(|client| client.to.messages)),
            messages_to_client_worst: worst(|client| client.to.messages),
            bytes_to_client: mean(sum(|client| client.to.bytes)),
            bytes_to_client_worst: worst(|client| client.to.bytes),
            updates_to_client: mean(self.updates),
            messages_from_client: mean(sum(|client| client.from.messages)),
            messages_from_client_worst: worst(|client| client.from.messages),
            bytes_from_client: mean(sum(|client| client.from.bytes)),
            bytes_from_client_worst: worst(|client| client.from.bytes),
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

impl ClientTally {
    fn report(&self, id: u32, tick_s: f64) -> ClientReport {
        let share = |ticks: u64| ticks as f64 / self.ticks.max(1) as f64;
        ClientReport {
            id,
            seconds: self.ticks as f64 * tick_s,
            held_mean: share(self.held),
            quiet_share: share(self.quiet),
            messages_to: self.to.messages,
            bytes_to: self.to.bytes,
            messages_from: self.from.messages,
            bytes_from: self.from.bytes,
        }
    }
}
