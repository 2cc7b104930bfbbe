//! The whole system in virtual time: random buildings, walkers and networks, compared with brute
//! force at every tick.
//!
//! A seed chooses everything: a small compiled building ([`SimulatedBuilding`]); walkers that
//! stand, walk, pace through doors and run; round trips up to 300 ms, jitter, and messages that are
//! lost, duplicated and reordered. At every tick:
//!
//! * If a ray reaches a sampled point of an avatar's body from a viewer's eye, the viewer's replica
//!   holds that avatar, and its position is no older than promised.
//! * [`InvariantChecker`] checks the rest: no message is about an avatar that the viewer cannot
//!   come to see, none is sent while a TBV lasts, a TBV holds its avatar, the avatar is asked in
//!   time, and silent clients are on course.
//!
//! Consequences of messages later than the engine allows for are excused, and counted.

mod building;
mod invariants;
mod walkers;

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
    ops::ControlFlow,
    sync::Arc,
    time::Duration,
};

use rand::{Rng, SeedableRng, rngs::SmallRng};
use rayon::prelude::*;
use serde::Serialize;
use sightline_cli::trace::Trace;
use sightline_compiler::pvs;
use sightline_engine::{Config, FaultInjection, Margin, Output, Policy, StationFault, Validity};
use sightline_replay::{
    ClientFaults, NetworkConditions, OracleStride, ReplayOptions, ReplayReport, StationOptions,
    TickView, Trouble, run_watched,
};
use sightline_world::{CellId, Portal, World};

pub use building::SimulatedBuilding;
pub use invariants::{InvariantChecker, Observations, SMALL_TBV_SCALE, Violation};
use walkers::Walks;

/// The longest round trip, in milliseconds.
const ROUND_TRIP_MAX_MS: u64 = 300;
/// The largest drift of a round trip, in milliseconds.
const DRIFT_MAX_MS: u64 = 80;
/// Salt of the random numbers that choose stations, so that they leave all else as it is without.
const STATIONS_SALT: u64 = 0x57a7_1075;
/// The most stations and visitors of a simulation of several stations.
const STATIONS_MAX: usize = 16;
const VISITORS_MAX: usize = 32;

/// The chance per step that an avatar is put elsewhere, in simulations where that happens.
const JUMP_CHANCE: f64 = 0.005;

/// A fault injected on purpose: the simulation must find it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fault {
    /// No fault.
    #[default]
    None,
    /// TBVs have nine tenths of their size.
    SmallTbv,
    /// Clients give only nine tenths of the notice needed before they leave their TBV.
    ShortNotice,
    /// The compiler lost the portal that walkers cross most.
    LostPortal,
    /// Avatars are asked one tick late.
    LateExpiry,
    /// Regions of live avatars are half as large again, so too much is sent.
    WideRegions,
    /// Clients tell a departure from the course one tick late.
    DepartureLate,
    /// Clients allow themselves twice the tolerance that the server knows of.
    ToleranceDoubled,
    /// A departure that the network loses is not sent again.
    LostDeparture,
    /// That a result of sight tests no longer holds shows one tick late.
    LateCertificate,
    /// A station does something wrong with its neighbours.
    Station(StationFault),
}

impl Fault {
    /// All faults that need several stations.
    pub const OF_STATIONS: [Self; 4] = [
        Self::Station(StationFault::BusIgnored),
        Self::Station(StationFault::LateSubscription),
        Self::Station(StationFault::SilenceUnasked),
        Self::Station(StationFault::LeavingUnsaid),
    ];

    /// All other faults.
    pub const ALL: [Self; 9] = [
        Self::SmallTbv,
        Self::ShortNotice,
        Self::LostPortal,
        Self::LateExpiry,
        Self::WideRegions,
        Self::DepartureLate,
        Self::ToleranceDoubled,
        Self::LostDeparture,
        Self::LateCertificate,
    ];

    /// Whether the fault made a difference, or must have, judged by a simulation without it and
    /// with it.
    pub fn could_act(self, whole: &SimulationOutcome, broken: &SimulationOutcome) -> bool {
        match self {
            Self::None => false,
            Self::SmallTbv => whole.observed.tight > 0,
            Self::ShortNotice => whole.observed.stays > 0,
            Self::LostPortal => broken.has_lost_portal,
            Self::LateExpiry => broken.report.expiries > 0,
            Self::LateCertificate => whole.observed.told > 0,
            Self::WideRegions => broken.observed.told > whole.observed.told,
            Self::Station(_) => {
                let told = |outcome: &SimulationOutcome| {
                    let stations = outcome.report.stations.as_ref();
                    (stations.map(|stations| stations.messages.clone()), outcome.observed.told)
                };
                told(whole) != told(broken)
            }
            Self::DepartureLate | Self::ToleranceDoubled | Self::LostDeparture => {
                let sent = |outcome: &SimulationOutcome| {
                    (outcome.report.reports, outcome.report.bytes_from_client)
                };
                sent(whole) != sent(broken)
            }
        }
    }

    /// The least share of simulations, of those where the fault could act, in which it must be
    /// found.
    fn found_min(self) -> f64 {
        match self {
            // Where another way around is hardly longer, walkers through the lost portal are still
            // believed and seen.
            Self::LostPortal => 0.85,
            // Where only a turn is lost, no promise is broken: in one of five seeds or so.
            Self::LostDeparture => 0.6,
            // A smaller TBV may still hold its avatar from a later moment: in one of forty seeds or
            // so all of them do. Few of sixty seeds have one that is tight.
            Self::SmallTbv => 0.85,
            // In buildings this small most cells see each other, so the PVS allows what sight tests
            // had ruled out. Only what cells rule out too is found: in every fourth seed or so.
            Self::WideRegions => 0.1,
            Self::Station(StationFault::BusIgnored) => 0.5,
            // In buildings this small most sectors see each other, so that hardly any is new, and
            // two that are both hidden from each other are rare.
            Self::Station(StationFault::LateSubscription) => 0.02,
            Self::Station(StationFault::SilenceUnasked) => 0.1,
            Self::Station(StationFault::LeavingUnsaid) => 0.3,
            // A fault changes what happens before, so that the chance to act may not come about,
            // and what follows from a lost message is excused.
            _ => 0.9,
        }
    }

    fn client_faults(self) -> ClientFaults {
        ClientFaults {
            departures_late: self == Self::DepartureLate,
            tolerance_scale: if self == Self::ToleranceDoubled { 2.0 } else { 1.0 },
            departures_lost: self == Self::LostDeparture,
        }
    }

    fn injection(self, tick: Duration) -> FaultInjection {
        let part = |fault: Self, part: f32| if self == fault { part } else { 1.0 };
        FaultInjection {
            tbv_scale: part(Self::SmallTbv, SMALL_TBV_SCALE),
            notice_scale: part(Self::ShortNotice, 0.9),
            region_scale: part(Self::WideRegions, 1.5),
            expiry_late: if self == Self::LateExpiry { tick } else { Duration::ZERO },
            certificates_late: u32::from(self == Self::LateCertificate),
            station: match self {
                Self::Station(fault) => Some(fault),
                _ => None,
            },
        }
    }
}

/// In how many simulations a fault could act, and in how many of these it was found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DetectionRate {
    /// Simulations in which it was found.
    pub found: usize,
    /// Simulations in which it could act.
    pub acted: usize,
    /// All simulations.
    pub all: usize,
}

impl DetectionRate {
    /// Counts pairs of simulations of the same seeds: without the fault, and with it.
    pub fn of<'a>(
        fault: Fault,
        outcomes: impl IntoIterator<Item = (&'a SimulationOutcome, &'a SimulationOutcome)>,
    ) -> Self {
        let mut findings = Self::default();
        for (whole, broken) in outcomes {
            let acted = fault.could_act(whole, broken);
            findings.all += 1;
            findings.acted += usize::from(acted);
            findings.found += usize::from(acted && !broken.is_good());
        }
        findings
    }

    /// Whether the fault was found often enough.
    pub fn are_enough(self, fault: Fault) -> bool {
        self.found as f64 >= fault.found_min() * self.acted as f64
    }
}

impl fmt::Display for DetectionRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { found, acted, all } = self;
        write!(f, "found in {found} of {acted} seeds in which it could act (of {all} seeds)")
    }
}

/// The buildings of many simulations. The building of a seed depends on their number.
#[derive(Clone, Debug)]
pub struct BuildingPool {
    buildings: BTreeMap<u64, SimulatedBuilding>,
    size: u64,
}

impl BuildingPool {
    /// Compiles a number of buildings. Calls `done` after each.
    pub fn new(buildings: u64, done: &(dyn Fn() + Sync)) -> Self {
        let compiled = (0..buildings).into_par_iter().map(|seed| {
            let building = SimulatedBuilding::new(seed);
            done();
            (seed, building)
        });
        Self { buildings: compiled.collect(), size: buildings }
    }

    /// The part of a pool that one simulation needs: its own building.
    pub fn only(seed: u64, buildings: u64) -> Self {
        let number = seed % buildings.max(1);
        let buildings_of = BTreeMap::from([(number, SimulatedBuilding::new(number))]);
        Self { buildings: buildings_of, size: buildings.max(1) }
    }

    fn of(&self, seed: u64) -> &SimulatedBuilding {
        assert!(self.size > 0, "a pool has a building");
        &self.buildings[&(seed % self.size)]
    }
}

/// The result of a simulation.
#[derive(Clone, Debug)]
pub struct SimulationOutcome {
    /// The seed.
    pub seed: u64,
    /// The number of buildings in the pool.
    pub buildings: u64,
    /// The network and the engine's settings, in words.
    pub network: String,
    /// The first violations, in words.
    pub violations: Vec<String>,
    /// The report of the replay.
    pub report: ReplayReport,
    /// What was observed tick by tick.
    pub observed: Observations,
    /// Whether a portal that walkers cross was removed.
    pub has_lost_portal: bool,
}

impl SimulationOutcome {
    /// Whether all promises were kept.
    pub fn is_good(&self) -> bool {
        self.violations.is_empty()
    }
}

impl fmt::Display for SimulationOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { seed, buildings, network, violations, report, .. } = self;
        writeln!(f, "seed {seed}: {} violations; {network}", violations.len())?;
        violations.iter().try_for_each(|violation| writeln!(f, "  {violation}"))?;
        let command = "cargo bench -p sightline-tests --bench simulation --";
        let stations = if report.stations.is_some() { " --stations" } else { "" };
        write!(f, "repeat with: {command} --seed {seed} --buildings {buildings}{stations}")
    }
}

/// Runs the simulation of a seed, in its building of the pool.
pub fn run(seed: u64, pool: &BuildingPool, fault: Fault) -> SimulationOutcome {
    let building = pool.of(seed);
    let mut rng = SmallRng::seed_from_u64(seed);
    let speed_max = [1.5, 2.0, 4.0, 7.0][rng.random_range(0..4)];
    let (agents, steps) = (rng.random_range(3..=8), rng.random_range(120..=240));
    let jump_chance = if rng.random_bool(0.2) { JUMP_CHANCE } else { 0.0 };
    let trace =
        walkers::trace(building, &mut rng, &Walks { agents, steps, speed_max, jump_chance });
    let options = options(seed, &mut rng, speed_max, fault);
    simulate(seed, pool, fault, &trace, &options, jump_chance)
}

/// Runs the simulation of a seed with several stations: 1 to 16, with 1 to 32 visitors, a bus that
/// is slow and uneven, and stations that stop or lose each other.
pub fn run_stations(seed: u64, pool: &BuildingPool, fault: Fault) -> SimulationOutcome {
    let building = pool.of(seed);
    let mut rng = SmallRng::seed_from_u64(seed ^ STATIONS_SALT);
    let speed_max = [1.5, 2.0, 4.0, 7.0][rng.random_range(0..4)];
    // Most are small, so that many are run.
    let visitors_max = if rng.random_bool(0.15) { VISITORS_MAX } else { 8 };
    let agents = rng.random_range(1..=visitors_max);
    let steps = rng.random_range(120..=200);
    let jump_chance = if rng.random_bool(0.2) { JUMP_CHANCE } else { 0.0 };
    let trace =
        walkers::trace(building, &mut rng, &Walks { agents, steps, speed_max, jump_chance });
    let mut options = options(seed, &mut rng, speed_max, fault);
    // What a station knows of round trips elsewhere is a moment old.
    options.network.drift = Duration::ZERO;
    let stations_max = if rng.random_bool(0.2) { STATIONS_MAX } else { 4 };
    let count = rng.random_range(1..=stations_max);
    let ms = |all: &[u64], rng: &mut SmallRng| {
        Duration::from_millis(all[rng.random_range(0..all.len())])
    };
    let jitter = ms(&[0, 2, 10], &mut rng);
    options.stations = StationOptions {
        count,
        delay: ms(&[0, 1, 5, 20, 50, 120], &mut rng),
        jitter,
        troubles: troubles(count, steps, &mut rng),
        ..StationOptions::default()
    };
    options.config.bus_margin = Margin::Fixed(jitter);
    simulate(seed, pool, fault, &trace, &options, jump_chance)
}

/// What goes wrong between stations in a simulation: nothing in most.
fn troubles(count: usize, steps: u32, rng: &mut SmallRng) -> Vec<Trouble> {
    let at = Duration::from_secs_f32(walkers::STEP_S) * rng.random_range(50..steps);
    let station = rng.random_range(0..count);
    match rng.random_range(0..10) {
        _ if count < 2 => Vec::new(),
        0..2 => vec![Trouble::Loss { station, at }],
        2..4 => {
            let until = at + Duration::from_millis(rng.random_range(100..4_000));
            vec![Trouble::Partition { stations: station.max(1), from: at, until }]
        }
        _ => Vec::new(),
    }
}

fn simulate(
    seed: u64,
    pool: &BuildingPool,
    fault: Fault,
    trace: &Trace,
    options: &ReplayOptions,
    jump_chance: f64,
) -> SimulationOutcome {
    let building = pool.of(seed);
    let ReplayOptions { round_trip, network, stations, config, .. } = options;
    let Config { validity, margin, speed_max, .. } = config;
    let speed_max = speed_max.unwrap_or(building.world.speed_max);
    let network = format!(
        "{speed_max} m/s, {jump_chance} jumps per step, {validity}, round trip {round_trip:?}, {network:?}, {margin:?}, {stations:?}"
    );
    let lost = (fault == Fault::LostPortal).then(|| without_portal(building, trace, speed_max));
    let lost = lost.flatten();
    let has_lost_portal = lost.is_some();
    let world = lost.unwrap_or_else(|| Arc::clone(&building.world));
    let mut checker = InvariantChecker::new(&building.world, options);
    let run = run_watched(&world, trace, options, None, &mut |now| checker.check(now));
    let report = run.expect("there is no dump to write");
    let observed = checker.end();
    let mut violations = observed.violations.clone();
    violations.extend(violations_of(&report, options));
    SimulationOutcome {
        seed,
        buildings: pool.size,
        network,
        violations,
        report,
        observed,
        has_lost_portal,
    }
}

/// All outputs of the engine in a simulation, tick by tick, with a number of threads and a budget
/// for sight tests. With no station there is one server, which is no station.
pub fn outputs_by_tick(
    seed: u64,
    pool: &BuildingPool,
    agents: usize,
    threads: usize,
    sight_test_budget: u32,
    stations: usize,
) -> Vec<Vec<Output>> {
    let building = pool.of(seed);
    let mut rng = SmallRng::seed_from_u64(seed);
    let walks = Walks { agents, steps: 120, speed_max: 4.0, jump_chance: JUMP_CHANCE };
    let trace = walkers::trace(building, &mut rng, &walks);
    let mut options = options(seed, &mut rng, 4.0, Fault::None);
    options.oracle = OracleStride::Off;
    options.config = Config { threads, sight_test_budget, ..options.config };
    options.stations.count = stations;
    let mut outputs_by_tick = Vec::new();
    let record = &mut |now: &TickView<'_>| outputs_by_tick.push(now.outputs.to_vec());
    run_watched(&building.world, &trace, &options, None, record)
        .expect("there is no dump to write");
    outputs_by_tick
}

/// The random network and engine settings of a simulation.
fn options(seed: u64, rng: &mut SmallRng, speed_max: f32, fault: Fault) -> ReplayOptions {
    let round_trip_ms = [0, 0, 30, 80, 150, 250][rng.random_range(0..6)];
    let spread_ms = rng.random_range(0..=ROUND_TRIP_MAX_MS - round_trip_ms);
    let mut options = ReplayOptions::new(Policy::Tbv, Duration::from_millis(round_trip_ms));
    let is_lossy = rng.random_bool(0.75);
    let jitter = Duration::from_millis(if is_lossy { rng.random_range(0..=25) } else { 0 });
    options.network = NetworkConditions {
        spread: Duration::from_millis(if rng.random_bool(0.7) { spread_ms } else { 0 }),
        jitter,
        drift: Duration::ZERO,
        loss: if is_lossy { 0.05 } else { 0.0 },
        duplication: if is_lossy { 0.02 } else { 0.0 },
        seed,
    };
    options.oracle = OracleStride::Every(options.config.tick);
    options.look_ahead = false;
    options.faults = fault.client_faults();
    let faults = fault.injection(options.config.tick);
    let validities =
        [Validity::UntilLeft, Validity::UntilLeft, Validity::Maximal, Validity::Adaptive];
    let validity = validities[rng.random_range(0..validities.len())];
    let mut margin = Margin::Fixed(jitter);
    if rng.random_bool(1.0 / 3.0) {
        margin = Config::default().margin;
        let left_ms = ROUND_TRIP_MAX_MS - round_trip_ms - options.network.spread.as_millis() as u64;
        let drift_ms = if rng.random_bool(0.5) { left_ms.min(DRIFT_MAX_MS) } else { 0 };
        options.network.drift = Duration::from_millis(rng.random_range(0..=drift_ms));
    }
    // TBVs with an early end are asked before it, even where clients report when they leave.
    let validity_max = Duration::from_secs([2, 4, 8][rng.random_range(0..3)]);
    let config = Config { margin, validity_max, speed_max: Some(speed_max), ..options.config };
    options.config = Config { validity, faults, ..config };
    options
}

/// The violations that the closing report shows.
fn violations_of(report: &ReplayReport, options: &ReplayOptions) -> Vec<String> {
    let mut violations = Vec::new();
    if let Some(oracle) = &report.oracle {
        violations.extend(oracle.first_misses.iter().map(|miss| format!("missed: {miss:?}")));
        violations
            .extend(oracle.first_stale.iter().map(|stale| format!("shown too late: {stale:?}")));
    }
    // A TBV made for everything a body can do is never left. Exceptions: an avatar asked late may
    // come to its edge, and one put elsewhere leaves it before it is told.
    let is_even =
        options.network.loss == 0.0 && options.network.drift.is_zero() && report.jumps == 0;
    let may_leave = options.config.validity == Validity::UntilLeft || !is_even;
    if report.left_tbv > 0 && !may_leave {
        violations.push(format!("avatars came to the edge of their TBV {} times", report.left_tbv));
    }
    violations
}

/// The world as compiled without the portals between the two spaces that walkers cross most. `None`
/// if they cross none.
fn without_portal(
    building: &SimulatedBuilding,
    trace: &Trace,
    speed_max: f32,
) -> Option<Arc<World>> {
    let mut world = World::clone(&building.world);
    let lost = most_crossed(&world, trace, speed_max)?;
    let cells = &mut world.cells;
    let space_of: Vec<u32> = cells.cells.iter().map(|cell| cell.space).collect();
    let joins = |a: u32, b: u32| [a.min(b), a.max(b)] == lost;
    cells.gates.retain(|gate| !joins(gate.spaces[0], gate.spaces[1]));
    cells.portals.retain(|portal| {
        let [a, b] = portal.cells.map(|cell| space_of[cell.0 as usize]);
        !joins(a, b)
    });
    for (number, space) in (0..).zip(&mut cells.spaces) {
        let gates = (0..).zip(&cells.gates).filter(|(_, gate)| gate.spaces.contains(&number));
        space.gates = gates.map(|(index, _)| index).collect();
    }
    for (number, cell) in (0..).zip(&mut cells.cells) {
        let is_its = |portal: &Portal| portal.cells.contains(&CellId(number));
        let portals = (0..).zip(&cells.portals).filter(|(_, portal)| is_its(portal));
        cell.portals = portals.map(|(index, _)| index).collect();
    }
    let go_on = |_: f32| ControlFlow::Continue(());
    let seen = pvs::spaces_seen(cells, &go_on).expect("nobody cancels");
    cells.pvs = pvs::potentially_visible(cells, &seen, &go_on).expect("nobody cancels");
    Some(Arc::new(world))
}

/// The two spaces between which walkers cross most.
fn most_crossed(world: &World, trace: &Trace, speed_max: f32) -> Option<[u32; 2]> {
    let mut crossed: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    // Jumps cross nothing, and fast walkers may pass two spaces in a step: only neighbouring spaces
    // count.
    let ends = world.cells.gates.iter().map(|gate| gate.spaces);
    let joined: BTreeSet<[u32; 2]> = ends.map(|[a, b]| [a.min(b), a.max(b)]).collect();
    let (first, last) = trace.span();
    for id in trace.ids() {
        let mut before: Option<u32> = None;
        let mut at = first;
        while at <= last {
            let pose = trace.pose_at(id, at, speed_max);
            let cell = pose.and_then(|pose| world.cells.at(pose.eye));
            let space = cell.map(|cell| world.cells.cells[cell.0 as usize].space);
            if let (Some(a), Some(b)) = (before, space)
                && a != b
                && joined.contains(&[a.min(b), a.max(b)])
            {
                *crossed.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
            }
            before = space;
            at += Duration::from_millis(50);
        }
    }
    crossed.into_iter().max_by_key(|(_, times)| *times).map(|(spaces, _)| spaces)
}
