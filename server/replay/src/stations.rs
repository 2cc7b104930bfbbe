//! The stations of a run, and the bus between them in virtual time.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::Duration,
};

use cpu_time::ProcessTime;
use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use serde::Serialize;
use sightline_cli::trace::Trace;
use sightline_engine::{Engine, Input, Output, StationId, StationMessage, StationOutput, Stats};
use sightline_protocol::bus::{self, Parcels};
use sightline_world::{World, motion::AvatarId};

use super::options::{Assignment, BusFaults, ReplayOptions, StationOptions, Trouble};

/// Salt of the random numbers from which it follows to which station each visitor goes.
const HOME_SALT: u64 = 0x57a7;

/// All stations, and what is on its way between them.
pub(super) struct Stations {
    options: StationOptions,
    engines: Vec<Engine>,
    is_alive: Vec<bool>,
    /// The station of each avatar there ever was.
    homes: BTreeMap<AvatarId, usize>,
    /// Where one station's part of the building ends and the next one's begins, along x.
    borders: Vec<f32>,
    bus: Bus,
    /// Since when each two stations take in what they say to each other, the lesser first.
    linked: BTreeMap<[usize; 2], Duration>,
    /// CPU time of each station since the last tick, and in all.
    cpu: Vec<Duration>,
    cpu_total: Vec<Duration>,
    subscribed: [u64; 2],
    guests: [u64; 2],
    ticks: u64,
}

/// What is on its way between stations.
struct Bus {
    rng: SmallRng,
    /// By arrival, then in the order of sending.
    packets: BTreeMap<(Duration, u64), Packet>,
    sent: u64,
    /// When the last message of one station to another arrives.
    last: BTreeMap<[usize; 2], Duration>,
    counts: BTreeMap<&'static str, u64>,
    bytes: u64,
}

struct Packet {
    from: usize,
    to: usize,
    parcel: Vec<u8>,
}

/// What stations cost.
#[derive(Clone, Debug, Default, Serialize)]
pub struct StationReport {
    /// How many stations there are.
    pub stations: usize,
    /// Messages on the bus, by kind. One to several stations counts for each.
    pub messages: BTreeMap<&'static str, u64>,
    /// How many bytes they take, without what the bus adds.
    pub bytes: u64,
    /// The share of sectors that a station subscribes to, in the mean.
    pub subscribed_share: f64,
    /// How many avatars of others a station knows of, in the mean.
    pub guests_mean: f64,
    /// How many of them it follows.
    pub guests_live_mean: f64,
    /// CPU time of each station for a tick, in milliseconds, in the mean.
    pub tick_cpu_mean_ms: Vec<f64>,
}

impl Stations {
    pub(super) fn new(world: &Arc<World>, trace: &Trace, options: &ReplayOptions) -> Self {
        let stations = options.stations.clone();
        let count = stations.count.max(1);
        let engine = |k: usize| {
            let engine = Engine::new(Arc::clone(world), options.config.clone());
            let is_station = stations.count > 0;
            if is_station { engine.as_station(StationId(k as u32 + 1)) } else { engine }
        };
        Self {
            engines: (0..count).map(engine).collect(),
            is_alive: vec![true; count],
            homes: BTreeMap::new(),
            borders: borders(trace, count),
            bus: Bus {
                rng: SmallRng::seed_from_u64(options.network.seed ^ HOME_SALT),
                packets: BTreeMap::new(),
                sent: 0,
                last: BTreeMap::new(),
                counts: BTreeMap::new(),
                bytes: 0,
            },
            linked: BTreeMap::new(),
            cpu: vec![Duration::ZERO; count],
            cpu_total: vec![Duration::ZERO; count],
            subscribed: [0; 2],
            guests: [0; 2],
            ticks: 0,
            options: stations,
        }
    }

    /// One of the engines that run.
    pub(super) fn first(&self) -> &Engine {
        let alive = self.is_alive.iter().position(|alive| *alive);
        &self.engines[alive.unwrap_or(0)]
    }

    /// All engines that run.
    pub(super) fn engines(&self) -> impl Iterator<Item = &Engine> {
        self.engines.iter().zip(&self.is_alive).filter(|(_, alive)| **alive).map(|(e, _)| e)
    }

    /// The engine that an avatar's client is connected to.
    pub(super) fn engine_of(&self, avatar: AvatarId) -> &Engine {
        &self.engines[self.homes.get(&avatar).copied().unwrap_or(0)]
    }

    pub(super) fn are_several(&self) -> bool {
        self.engines.len() > 1
    }

    /// Whether two avatars belong to the same station.
    pub(super) fn are_together(&self, one: AvatarId, other: AvatarId) -> bool {
        self.homes.get(&one) == self.homes.get(&other)
    }

    /// Since when the stations of two avatars have known each other; `None` when they do not.
    pub(super) fn linked_since(&self, one: AvatarId, other: AvatarId) -> Option<Duration> {
        let [a, b] = [one, other].map(|id| self.homes.get(&id).copied().unwrap_or(0));
        if a == b {
            return Some(Duration::ZERO);
        }
        self.linked.get(&[a.min(b), a.max(b)]).copied()
    }

    /// Lets an avatar's client connect to a station.
    pub(super) fn assign(&mut self, avatar: AvatarId, place: Option<Vec3>) {
        let alive: Vec<usize> = (0..self.engines.len()).filter(|k| self.is_alive[*k]).collect();
        let home = match (self.options.assignment, place) {
            (Assignment::ByPlace, Some(place)) => {
                let part = self.borders.partition_point(|border| *border <= place.x);
                alive.iter().copied().min_by_key(|k| k.abs_diff(part))
            }
            (Assignment::Each, _) => Some(alive[self.homes.len() % alive.len()]),
            _ => {
                let mut rng = SmallRng::seed_from_u64(HOME_SALT ^ u64::from(avatar.0));
                Some(alive[rng.random_range(0..alive.len())])
            }
        };
        self.homes.insert(avatar, home.unwrap_or(0));
    }

    /// Whether an avatar's client is still connected to a station that runs.
    pub(super) fn is_connected(&self, avatar: AvatarId) -> bool {
        self.homes.get(&avatar).is_none_or(|home| self.is_alive[*home])
    }

    /// Passes an input to the engine of an avatar.
    pub(super) fn handle(&mut self, at: Duration, avatar: AvatarId, input: Input) {
        let home = self.homes.get(&avatar).copied().unwrap_or(0);
        if self.is_alive[home] {
            self.call(at, home, |engine| engine.handle(at, input));
        }
    }

    /// Ticks every engine, one after the other. Returns what clients are told.
    pub(super) fn tick(&mut self, now: Duration) -> Vec<Output> {
        let mut outputs = Vec::new();
        for k in 0..self.engines.len() {
            if self.is_alive[k] {
                let mut told = Vec::new();
                self.call(now, k, |engine| engine.tick(now, &mut told));
                outputs.append(&mut told);
            }
        }
        self.note(now);
        outputs
    }

    /// CPU time since the last call: of the slowest station.
    pub(super) fn take_cpu(&mut self) -> Duration {
        self.cpu_total.iter_mut().zip(&self.cpu).for_each(|(all, cpu)| *all += *cpu);
        self.cpu.iter_mut().map(std::mem::take).max().unwrap_or_default()
    }

    /// When the next message on the bus arrives.
    pub(super) fn next_arrival(&self) -> Option<Duration> {
        self.bus.packets.first_key_value().map(|((at, _), _)| *at)
    }

    /// Delivers the next message on the bus.
    pub(super) fn deliver_next(&mut self) {
        let Some(((at, _), Packet { from, to, parcel })) = self.bus.packets.pop_first() else {
            return;
        };
        if self.is_alive[to] {
            let from = StationId(from as u32 + 1);
            let messages = bus::decode(&parcel).expect("stations send what they can read");
            for (message, _) in messages {
                self.call(at, to, |engine| engine.handle_station(at, from, &message));
            }
        }
    }

    /// What the engines have counted.
    pub(super) fn stats(&self) -> Stats {
        self.engines.iter().fold(Stats::default(), |mut all, engine| {
            all += engine.stats();
            all
        })
    }

    /// How many reports an avatar's engine has accepted.
    pub(super) fn reports(&self, avatar: AvatarId) -> u64 {
        self.engine_of(avatar).stats().reports
    }

    pub(super) fn report(&self) -> StationReport {
        let share = |part: u64, of: u64| part as f64 / of.max(1) as f64;
        let each = self.ticks * self.engines.len() as u64;
        StationReport {
            stations: self.engines.len(),
            messages: self.bus.counts.clone(),
            bytes: self.bus.bytes,
            subscribed_share: share(self.subscribed[1], self.subscribed[0]),
            guests_mean: share(self.guests[0], each),
            guests_live_mean: share(self.guests[1], each),
            tick_cpu_mean_ms: self
                .cpu_total
                .iter()
                .map(|cpu| cpu.as_secs_f64() * 1e3 / self.ticks.max(1) as f64)
                .collect(),
        }
    }

    fn call(&mut self, at: Duration, k: usize, act: impl FnOnce(&mut Engine)) {
        let start = ProcessTime::now();
        act(&mut self.engines[k]);
        let said = self.engines[k].take_station_outputs();
        self.cpu[k] += start.elapsed();
        said.into_iter().for_each(|output| self.send(at, k, output));
    }

    fn send(&mut self, at: Duration, from: usize, StationOutput { to, message }: StationOutput) {
        let all = 0..self.engines.len();
        let named = to.map(|to| to.0 as usize - 1);
        let others: Vec<usize> =
            all.filter(|k| *k != from && named.is_none_or(|named| named == *k)).collect();
        let parcel = packed(&message);
        for to in others {
            let BusFaults { reports_late } = self.options.faults;
            let kind = message.word.kind();
            *self.bus.counts.entry(kind).or_insert(0) += 1;
            self.bus.bytes += parcel.len() as u64;
            if self.is_parted(at, from, to) {
                continue;
            }
            let jitter = self.options.jitter.mul_f64(self.bus.rng.random::<f64>());
            let late = if kind == "report" { reports_late } else { Duration::ZERO };
            let last = self.bus.last.entry([from, to]).or_default();
            *last = (*last).max(at + self.options.delay + jitter + late);
            self.bus.sent += 1;
            let packet = Packet { from, to, parcel: parcel.clone() };
            self.bus.packets.insert((*last, self.bus.sent), packet);
        }
    }

    /// Whether nothing that one station says reaches another.
    fn is_parted(&self, at: Duration, from: usize, to: usize) -> bool {
        self.options.troubles.iter().any(|trouble| match trouble {
            Trouble::Loss { .. } => false,
            Trouble::Partition { stations, from: start, until } => {
                (*start..*until).contains(&at) && (from < *stations) != (to < *stations)
            }
        })
    }

    /// Stops the stations that are to stop by now.
    pub(super) fn look_for_trouble(&mut self, now: Duration) {
        for trouble in &self.options.troubles {
            if let Trouble::Loss { station, at } = trouble
                && now >= *at
                && self.engines.len() > 1
            {
                self.is_alive[*station] = false;
            }
        }
    }

    /// Takes in which stations know each other, and what they know.
    fn note(&mut self, now: Duration) {
        self.ticks += 1;
        let known = |k: usize| -> BTreeSet<usize> {
            self.engines[k].neighbours().map(|id| id.0 as usize - 1).collect()
        };
        let known: Vec<BTreeSet<usize>> = (0..self.engines.len()).map(known).collect();
        for a in 0..known.len() {
            for b in a + 1..known.len() {
                let is_linked = known[a].contains(&b)
                    && known[b].contains(&a)
                    && !self.is_parted(now, a, b)
                    && self.is_alive[a]
                    && self.is_alive[b];
                if is_linked {
                    self.linked.entry([a, b]).or_insert(now);
                } else {
                    self.linked.remove(&[a, b]);
                }
            }
        }
        for engine in &self.engines {
            let [all, subscribed] = engine.sectors();
            self.subscribed[0] += all as u64;
            self.subscribed[1] += subscribed as u64;
            for (_, is_live) in engine.guests() {
                self.guests[0] += 1;
                self.guests[1] += u64::from(is_live);
            }
        }
    }
}

/// A message as it is on the bus, alone.
fn packed(message: &StationMessage) -> Vec<u8> {
    let mut parcels = Parcels::default();
    parcels.push(message);
    parcels.take().concat()
}

/// The borders that give each station about as many visitors, by where they begin.
fn borders(trace: &Trace, count: usize) -> Vec<f32> {
    let (first, _) = trace.span();
    let mut begin: Vec<f32> =
        trace.ids().filter_map(|id| Some(trace.pose_at(id, first, f32::MAX)?.eye.x)).collect();
    begin.sort_unstable_by(f32::total_cmp);
    (1..count).filter_map(|k| begin.get(k * begin.len() / count).copied()).collect()
}
