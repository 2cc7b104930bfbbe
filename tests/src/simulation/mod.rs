//! The whole system in virtual time: random buildings, walkers and networks, compared at every tick with
//! brute force.
//!
//! A seed chooses everything: a small [`Building`] that is compiled for real, walkers that stand,
//! walk, pace through doors and run, round trips up to 300 ms, jitter, lost, doubled and overtaken messages.
//! What is checked, tick by tick:
//!
//! * whoever has a sampled point of its body in sight of a viewer's eye, by rays against the original
//!   triangles, is in that viewer's replica, and its position is no older than promised;
//! * the rest is for [`Watch`]: nothing is sent about whom the viewer cannot come to see, nothing is said
//!   while a TBV lasts, a TBV holds its avatar, and it is asked in time.
//!
//! What follows from messages that took longer than the engine allows for is excused, and counted.

mod building;
mod walkers;
mod watch;

use std::{collections::BTreeMap, fmt, ops::ControlFlow, sync::Arc, time::Duration};

use rand::{Rng, SeedableRng, rngs::SmallRng};
use rayon::prelude::*;
use sightline_server::{
    compile::pvs,
    engine::{Config, Margin, Output, Policy, Sabotage, Validity},
    replay::{self, Network, Options, OracleStride, Report},
    trace::Trace,
};
use sightline_shared::world::{CellId, Portal, World};

pub use building::Building;
pub use watch::{Breach, Watch};

/// No round trip is longer, in milliseconds.
const ROUND_TRIP_MAX_MS: u64 = 300;

/// What is broken on purpose, to see that it is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fault {
    /// Nothing.
    #[default]
    None,
    /// TBVs are made for nine tenths of the speed limit.
    SmallTbv,
    /// The compiler has lost the portal that walkers go through most.
    LostPortal,
    /// Expiries are asked a tick late.
    LateExpiry,
}

impl Fault {
    /// All that can be broken.
    pub const ALL: [Self; 3] = [Self::SmallTbv, Self::LostPortal, Self::LateExpiry];
}

/// The buildings of many simulations. Which one a seed gets depends on how many there are.
#[derive(Clone, Debug)]
pub struct Pool {
    buildings: BTreeMap<u64, Building>,
    size: u64,
}

impl Pool {
    /// Compiles so many buildings; tells each.
    pub fn new(buildings: u64, done: &(dyn Fn() + Sync)) -> Self {
        let compiled = (0..buildings).into_par_iter().map(|seed| {
            let building = Building::new(seed);
            done();
            (seed, building)
        });
        Self { buildings: compiled.collect(), size: buildings }
    }

    /// As much of a pool of so many buildings as one simulation needs.
    pub fn only(seed: u64, buildings: u64) -> Self {
        let number = seed % buildings.max(1);
        let buildings_of = BTreeMap::from([(number, Building::new(number))]);
        Self { buildings: buildings_of, size: buildings.max(1) }
    }

    fn of(&self, seed: u64) -> &Building {
        &self.buildings[&(seed % self.size)]
    }
}

/// What a simulation came to.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Which simulation.
    pub seed: u64,
    /// How many buildings the pool has.
    pub buildings: u64,
    /// The network, in words.
    pub network: String,
    /// What was wrong, the first few.
    pub breaches: Vec<String>,
    /// What replay tells of it.
    pub report: Report,
    /// Ticks of avatars that were hidden in a TBV.
    pub hidden_ticks: u64,
}

impl Outcome {
    /// Whether all promises were kept.
    pub fn is_good(&self) -> bool {
        self.breaches.is_empty()
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { seed, buildings, network, breaches, .. } = self;
        writeln!(f, "seed {seed}: {} breaches; {network}", breaches.len())?;
        breaches.iter().try_for_each(|breach| writeln!(f, "  {breach}"))?;
        let command = "cargo bench -p sightline-tests --bench simulation --";
        write!(f, "again: {command} --seed {seed} --buildings {buildings}")
    }
}

/// Runs the simulation of a seed, in the building that a pool has for it.
pub fn run(seed: u64, pool: &Pool, fault: Fault) -> Outcome {
    let building = pool.of(seed);
    let mut rng = SmallRng::seed_from_u64(seed);
    let speed_max = [1.5, 2.0, 4.0, 7.0][rng.random_range(0..4)];
    let (walkers, steps) = (rng.random_range(3..=8), rng.random_range(120..=240));
    let trace = walkers::trace(building, &mut rng, walkers, steps, speed_max);
    let options = options(seed, &mut rng, speed_max, fault);
    let Options { round_trip, network, config: Config { validity, .. }, .. } = &options;
    let network = format!("{speed_max} m/s, {validity}, round trip {round_trip:?}, {network:?}");
    let lost = (fault == Fault::LostPortal).then(|| without_portal(building, &trace, speed_max));
    let world = lost.unwrap_or_else(|| Arc::clone(&building.world));
    let mut watch = Watch::new(&building.world, &options);
    let run = replay::run_watched(&world, &trace, &options, None, &mut |now| watch.look(now));
    let report = run.expect("there is no dump to write");
    let (mut breaches, hidden_ticks) = watch.end();
    breaches.extend(of_report(&report, &options));
    Outcome { seed, buildings: pool.size, network, breaches, report, hidden_ticks }
}

/// All that the engine says in a simulation with so many walkers, tick by tick, as so many threads decide
/// it with a budget for looks.
pub fn said(
    seed: u64,
    pool: &Pool,
    walkers: usize,
    [threads, look_budget]: [u32; 2],
) -> Vec<Vec<Output>> {
    let building = pool.of(seed);
    let mut rng = SmallRng::seed_from_u64(seed);
    let trace = walkers::trace(building, &mut rng, walkers, 120, 4.0);
    let mut options = options(seed, &mut rng, 4.0, Fault::None);
    options.oracle = OracleStride::Off;
    options.config = Config { threads: threads as usize, look_budget, ..options.config };
    let mut said = Vec::new();
    let watch = &mut |now: &replay::Moment<'_>| said.push(now.outputs.to_vec());
    replay::run_watched(&building.world, &trace, &options, None, watch)
        .expect("there is no dump to write");
    said
}

/// The network and the engine of a simulation.
fn options(seed: u64, rng: &mut SmallRng, speed_max: f32, fault: Fault) -> Options {
    let round_trip_ms = [0, 0, 30, 80, 150, 250][rng.random_range(0..6)];
    let spread_ms = rng.random_range(0..=ROUND_TRIP_MAX_MS - round_trip_ms);
    let mut options = Options::new(Policy::Tbv, Duration::from_millis(round_trip_ms));
    let is_lossy = rng.random_bool(0.75);
    let jitter = Duration::from_millis(if is_lossy { rng.random_range(0..=25) } else { 0 });
    options.network = Network {
        spread: Duration::from_millis(if rng.random_bool(0.7) { spread_ms } else { 0 }),
        jitter,
        loss: if is_lossy { 0.05 } else { 0.0 },
        duplication: if is_lossy { 0.02 } else { 0.0 },
        seed,
    };
    options.oracle = OracleStride::Every(options.config.tick);
    options.foresight = false;
    let sabotage = Sabotage {
        tbv_scale: if fault == Fault::SmallTbv { 0.9 } else { 1.0 },
        expiry_late: if fault == Fault::LateExpiry { options.config.tick } else { Duration::ZERO },
    };
    let validities =
        [Validity::UntilLeft, Validity::UntilLeft, Validity::Maximal, Validity::Adaptive];
    let validity = validities[rng.random_range(0..validities.len())];
    let config =
        Config { margin: Margin::Fixed(jitter), speed_max: Some(speed_max), ..options.config };
    options.config = Config { validity, sabotage, ..config };
    options
}

/// What the closing figures say against it.
fn of_report(report: &Report, options: &Options) -> Vec<String> {
    let mut breaches = Vec::new();
    if let Some(oracle) = &report.oracle {
        breaches.extend(oracle.first_misses.iter().map(|miss| format!("missed: {miss:?}")));
        breaches.extend(oracle.first_stale.iter().map(|stale| format!("too old: {stale:?}")));
    }
    // Nobody leaves a TBV that was made for all that a body can do; who is asked late may come to the edge.
    let may_leave = options.config.validity == Validity::UntilLeft || options.network.loss > 0.0;
    if report.left_tbv > 0 && !may_leave {
        breaches.push(format!("{} times somebody came to the edge of its TBV", report.left_tbv));
    }
    breaches
}

/// The world as it would be compiled without what joins two spaces, where walkers go through most.
fn without_portal(building: &Building, trace: &Trace, speed_max: f32) -> Arc<World> {
    let mut world = World::clone(&building.world);
    let Some(lost) = most_crossed(&world, trace, speed_max) else { return Arc::new(world) };
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
    Arc::new(world)
}

/// The two spaces between which walkers go most.
fn most_crossed(world: &World, trace: &Trace, speed_max: f32) -> Option<[u32; 2]> {
    let mut crossed: BTreeMap<[u32; 2], u32> = BTreeMap::new();
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
            {
                *crossed.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
            }
            before = space;
            at += Duration::from_millis(50);
        }
    }
    crossed.into_iter().max_by_key(|(_, times)| *times).map(|(spaces, _)| spaces)
}
