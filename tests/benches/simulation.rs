//! Many simulations of the whole system, each compared with brute force at every tick.
//!
//! ```text
//! cargo bench -p sightline-tests --bench simulation -- --seeds 10000
//! cargo bench -p sightline-tests --bench simulation -- --seed 4711
//! ```
//!
//! The second command repeats one simulation and prints everything about it. The bench fails when a
//! promise is broken. With `--fault` it injects a fault, runs each simulation with
//! and without it, and fails when too few of the simulations in which the fault could act find it.

use std::{
    fmt,
    sync::atomic::{AtomicU64, Ordering::Relaxed},
    time::Instant,
};

use clap::{Parser, ValueEnum};
use rayon::prelude::*;
use serde::Serialize;
use sightline_engine::StationFault;
use sightline_tests::{
    bench_flags::BenchFlags,
    simulation::{BuildingPool, DetectionRate, Fault, SimulationOutcome, run, run_stations},
};

/// The number of failures that are printed one by one.
const TOLD: usize = 10;

/// Simulates buildings, walkers and networks, and checks every promise at every tick.
#[derive(Parser)]
struct Args {
    /// The number of simulations; by default 10,000.
    #[arg(long, value_name = "N")]
    seeds: Option<u64>,
    /// The first seed.
    #[arg(long, value_name = "N", default_value_t = 0)]
    from: u64,
    /// Run only this seed, and print everything about it.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// The number of buildings to compile. The building of a seed depends on it.
    #[arg(long, value_name = "N", default_value_t = 200)]
    buildings: u64,
    /// Simulate several stations.
    #[arg(long)]
    stations: bool,
    /// Inject a fault, and count how often it is found.
    #[arg(long, default_value = "none")]
    fault: FaultFlag,
    #[command(flatten)]
    flags: BenchFlags,
}

#[derive(Clone, Copy, ValueEnum)]
enum FaultFlag {
    None,
    SmallTbv,
    ShortNotice,
    LostPortal,
    LateExpiry,
    WideRegions,
    DepartureLate,
    ToleranceDoubled,
    LostDeparture,
    LateCertificate,
    BusIgnored,
    LateSubscription,
    SilenceUnasked,
    LeavingUnsaid,
}

impl From<FaultFlag> for Fault {
    fn from(broken: FaultFlag) -> Self {
        match broken {
            FaultFlag::None => Self::None,
            FaultFlag::SmallTbv => Self::SmallTbv,
            FaultFlag::ShortNotice => Self::ShortNotice,
            FaultFlag::LostPortal => Self::LostPortal,
            FaultFlag::LateExpiry => Self::LateExpiry,
            FaultFlag::WideRegions => Self::WideRegions,
            FaultFlag::DepartureLate => Self::DepartureLate,
            FaultFlag::ToleranceDoubled => Self::ToleranceDoubled,
            FaultFlag::LostDeparture => Self::LostDeparture,
            FaultFlag::LateCertificate => Self::LateCertificate,
            FaultFlag::BusIgnored => Self::Station(StationFault::BusIgnored),
            FaultFlag::LateSubscription => Self::Station(StationFault::LateSubscription),
            FaultFlag::SilenceUnasked => Self::Station(StationFault::SilenceUnasked),
            FaultFlag::LeavingUnsaid => Self::Station(StationFault::LeavingUnsaid),
        }
    }
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let fault = Fault::from(args.fault);
    let run = if args.stations { run_stations } else { run };
    if let Some(seed) = args.seed {
        let outcome = run(seed, &BuildingPool::only(seed, args.buildings), fault);
        println!("{outcome}\n\n{}", outcome.report);
        anyhow::ensure!(outcome.is_good(), "a promise is broken");
        return Ok(());
    }
    let seeds = args.seeds.unwrap_or(if args.flags.bench { 10_000 } else { 4 });
    let buildings = args.buildings.min(seeds.max(1));
    let progress = Counter::new("buildings", buildings);
    let pool = BuildingPool::new(buildings, &|| progress.count());
    let progress = Counter::new("simulations", seeds);
    let simulated = (args.from..args.from + seeds).into_par_iter().map(|seed| {
        let outcome = run(seed, &pool, Fault::None);
        let broken = (fault != Fault::None).then(|| run(seed, &pool, fault));
        progress.count();
        (outcome, broken)
    });
    let (outcomes, broken): (Vec<SimulationOutcome>, Vec<Option<SimulationOutcome>>) =
        simulated.unzip();
    outcomes
        .iter()
        .filter(|outcome| !outcome.is_good())
        .take(TOLD)
        .for_each(|outcome| println!("{outcome}\n"));
    let totals = Totals::of(&outcomes);
    println!("{totals}");
    anyhow::ensure!(totals.broken == 0, "promises are broken in {} simulations", totals.broken);
    if fault == Fault::None {
        return args.flags.write(&SimulationFigures { totals, detection: None });
    }
    let pairs = || outcomes.iter().zip(broken.iter().flatten());
    let missed = pairs().filter(|(whole, broken)| fault.could_act(whole, broken));
    let missed = missed.filter(|(_, broken)| broken.is_good()).map(|(_, broken)| broken.seed);
    println!("not found in seeds   {:?} ...", missed.take(TOLD).collect::<Vec<_>>());
    let findings = DetectionRate::of(fault, pairs());
    println!("{fault:?} was {findings}");
    anyhow::ensure!(findings.are_enough(fault), "the fault is found too seldom");
    args.flags.write(&SimulationFigures { totals, detection: Some(findings) })
}

#[derive(Serialize)]
struct SimulationFigures {
    totals: Totals,
    /// How often the fault was found, if there was one.
    detection: Option<DetectionRate>,
}

/// Sums over all simulations without a fault.
#[derive(Serialize)]
struct Totals {
    simulations: usize,
    /// Simulations in which a promise is broken.
    broken: usize,
    pairs_visible: u64,
    pairs_held: u64,
    misses_late: u64,
    misses_after_jumps: u64,
    age_worst_ms: f64,
    /// Ticks in which an avatar is hidden, summed over avatars.
    hidden_ticks: u64,
    asks: u64,
}

impl Totals {
    fn of(outcomes: &[SimulationOutcome]) -> Self {
        let oracles = || outcomes.iter().filter_map(|outcome| outcome.report.oracle.as_ref());
        Self {
            simulations: outcomes.len(),
            broken: outcomes.iter().filter(|outcome| !outcome.is_good()).count(),
            pairs_visible: oracles().map(|oracle| oracle.pairs_visible).sum(),
            pairs_held: oracles().map(|oracle| oracle.pairs_held).sum(),
            misses_late: oracles().map(|oracle| oracle.misses_late).sum(),
            misses_after_jumps: oracles().map(|oracle| oracle.misses_after_jumps).sum(),
            age_worst_ms: oracles().map(|oracle| oracle.age_worst_ms).fold(0.0, f64::max),
            hidden_ticks: outcomes.iter().map(|outcome| outcome.observed.hidden_ticks).sum(),
            asks: outcomes.iter().map(|outcome| outcome.report.asks).sum(),
        }
    }
}

impl fmt::Display for Totals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "simulations        {}", self.simulations)?;
        writeln!(f, "broken promises in {}", self.broken)?;
        writeln!(f, "visible pairs      {}, held {}", self.pairs_visible, self.pairs_held)?;
        writeln!(
            f,
            "misses excused     {}, after messages later than the engine allows for",
            self.misses_late
        )?;
        writeln!(f, "misses after jumps {}, or after joining", self.misses_after_jumps)?;
        writeln!(f, "oldest position    {:.0} ms, where messages were lost", self.age_worst_ms)?;
        write!(
            f,
            "hidden             {} ticks, summed over avatars; {} asks",
            self.hidden_ticks, self.asks
        )
    }
}

/// Prints from time to time how many are done.
struct Counter {
    what: &'static str,
    all: u64,
    done: AtomicU64,
    start: Instant,
}

impl Counter {
    fn new(what: &'static str, all: u64) -> Self {
        Self { what, all, done: AtomicU64::new(0), start: Instant::now() }
    }

    fn count(&self) {
        let done = self.done.fetch_add(1, Relaxed) + 1;
        if done == self.all || done.is_multiple_of((self.all / 20).max(1)) {
            let seconds = self.start.elapsed().as_secs();
            eprintln!("{done} of {} {} in {seconds} s", self.all, self.what);
        }
    }
}
