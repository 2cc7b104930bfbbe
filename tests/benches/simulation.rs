//! Many simulations of the whole system, each compared with brute force at every tick.
//!
//! ```text
//! cargo bench -p sightline-tests --bench simulation -- --seeds 10000
//! cargo bench -p sightline-tests --bench simulation -- --seed 4711
//! ```
//!
//! The second command repeats one simulation and prints everything about it. The bench fails when a
//! promise is broken. With `--fault` it injects a fault into the engine, runs each simulation with
//! and without it, and fails when too few of the simulations in which the fault could act find it.

use std::{
    sync::atomic::{AtomicU64, Ordering::Relaxed},
    time::Instant,
};

use clap::{Parser, ValueEnum};
use rayon::prelude::*;
use sightline_tests::simulation::{BuildingPool, DetectionRate, Fault, SimulationOutcome, run};

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
    /// Inject a fault into the engine, and count how often it is found.
    #[arg(long, default_value = "none")]
    fault: FaultFlag,
    /// Passed by `cargo bench`. Without it, and unless told otherwise, there are few simulations,
    /// to show that the bench works.
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum FaultFlag {
    None,
    SmallTbv,
    ShortNotice,
    LostPortal,
    LateExpiry,
    WideRegions,
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
        }
    }
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let fault = Fault::from(args.fault);
    if let Some(seed) = args.seed {
        let outcome = run(seed, &BuildingPool::only(seed, args.buildings), fault);
        println!("{outcome}\n\n{}", outcome.report);
        anyhow::ensure!(outcome.is_good(), "a promise is broken");
        return Ok(());
    }
    let seeds = args.seeds.unwrap_or(if args.bench { 10_000 } else { 4 });
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
    conclude(&outcomes)?;
    if fault == Fault::None {
        return Ok(());
    }
    let pairs = || outcomes.iter().zip(broken.iter().flatten());
    let missed = pairs().filter(|(whole, broken)| fault.could_act(whole, broken));
    let missed = missed.filter(|(_, broken)| broken.is_good()).map(|(_, broken)| broken.seed);
    println!("not found in seeds   {:?} ...", missed.take(TOLD).collect::<Vec<_>>());
    let findings = DetectionRate::of(fault, pairs());
    println!("{fault:?} was {findings}");
    anyhow::ensure!(findings.are_enough(fault), "the fault is found too seldom");
    Ok(())
}

fn conclude(outcomes: &[SimulationOutcome]) -> anyhow::Result<()> {
    let bad: Vec<&SimulationOutcome> =
        outcomes.iter().filter(|outcome| !outcome.is_good()).collect();
    bad.iter().take(TOLD).for_each(|outcome| println!("{outcome}\n"));
    let oracles = || outcomes.iter().filter_map(|outcome| outcome.report.oracle.as_ref());
    let visible: u64 = oracles().map(|oracle| oracle.pairs_visible).sum();
    let held: u64 = oracles().map(|oracle| oracle.pairs_held).sum();
    let excused: u64 = oracles().map(|oracle| oracle.misses_late).sum();
    let thrown: u64 = oracles().map(|oracle| oracle.misses_after_jumps).sum();
    let hidden: u64 = outcomes.iter().map(|outcome| outcome.observed.hidden_ticks).sum();
    let asks: u64 = outcomes.iter().map(|outcome| outcome.report.asks).sum();
    let worst = oracles().map(|oracle| oracle.age_worst_ms).fold(0.0, f64::max);
    println!("simulations        {}", outcomes.len());
    println!("broken promises in {}", bad.len());
    println!("visible pairs      {visible}, held {held}");
    println!("misses excused     {excused}, after messages later than the engine allows for");
    println!("misses after jumps {thrown}, or after joining");
    println!("oldest position    {worst:.0} ms, where messages were lost");
    println!("hidden             {hidden} ticks, summed over avatars; {asks} asks");
    anyhow::ensure!(bad.is_empty(), "promises are broken in {} simulations", bad.len());
    Ok(())
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
