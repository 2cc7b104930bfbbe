//! The cost of an engine tick as the crowd grows.
//!
//! ```text
//! cargo bench -p sightline-tests --bench engine -- --avatars 1000,3000,10000 --seconds 5
//! ```
//!
//! Avatars walk from room to room in a generated building of 2,000 rooms, at 1.0 to 1.5 m/s. Each
//! has an obedient client with a round trip of 100 ms. Then as many more avatars hide, each walking
//! in a closed room of its own beside the building; then twice as many. At the smallest sizes, two
//! other policies follow: broadcast and a grid.
//!
//! Time is virtual. CPU time is that of the engine alone, summed over all threads: handling all
//! reports of a tick, and the tick itself. The wall-clock time stands beside it. Memory is that of
//! the engine, the walkers and the messages in flight. The building is compiled once and kept under
//! `target`; `--fresh` compiles it again.

mod annex;
mod crowd;
mod run;

use std::{
    io::{BufRead, BufReader},
    ops::ControlFlow,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use anyhow::Context;
use clap::Parser;
use sightline_compiler::{CompileOptions, compile, import::glb};
use sightline_engine::Policy;
use sightline_tests::bench_flags::BenchFlags;
use sightline_world::World;

use run::{CrowdSize, EngineRow};

/// Measures the engine in a generated building.
#[derive(Parser, Clone)]
struct Args {
    /// The numbers of avatars that walk in the building, ascending.
    #[arg(long, value_delimiter = ',', num_args = 1.., value_name = "N,N,...")]
    avatars: Option<Vec<usize>>,
    /// The number of rooms in the building.
    #[arg(long, value_name = "N")]
    rooms: Option<usize>,
    /// The measured virtual time, in seconds, after as much again to settle.
    #[arg(long, value_name = "S", default_value_t = 10)]
    seconds: u32,
    /// The longest real time to settle a row, and to measure it, in seconds. At least a second of
    /// virtual time is always simulated.
    #[arg(long, value_name = "S", default_value_t = 60)]
    patience: u64,
    /// The largest number of walkers for which rows with hidden avatars are measured.
    #[arg(long, value_name = "N", default_value_t = 30_000)]
    hidden_max: usize,
    /// The largest number of walkers for which the other policies are measured: they compare all
    /// pairs.
    #[arg(long, value_name = "N", default_value_t = 3_000)]
    peers_max: usize,
    /// Have live clients report at every tick.
    #[arg(long)]
    every_tick: bool,
    /// The measured policy.
    #[arg(long, default_value = "tbv")]
    policy: Policy,
    /// The round trip of every client, in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 100)]
    rtt: u32,
    /// The number of threads that share a tick. With one, a row for two threads is measured too.
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    /// The seed of the building and of the walkers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Compile the building again.
    #[arg(long)]
    fresh: bool,
    /// Measure one row and print it as JSON: the numbers of walkers and of hidden avatars. The
    /// bench calls itself this way, so that each row has a process and its memory can be measured.
    #[arg(long, hide = true, value_delimiter = ',')]
    row: Option<Vec<usize>>,
    #[command(flatten)]
    flags: BenchFlags,
}

impl Args {
    fn rooms(&self) -> usize {
        self.rooms.unwrap_or(if self.flags.bench { 2_000 } else { 12 })
    }

    fn avatars(&self) -> Vec<usize> {
        let default: &[usize] =
            if self.flags.bench { &[1_000, 3_000, 10_000, 30_000, 100_000] } else { &[40] };
        self.avatars.clone().unwrap_or_else(|| default.to_vec())
    }
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let path = building(&args)?;
    if let Some(row) = &args.row {
        let &[walkers, hidden] = &row[..] else { anyhow::bail!("a row has two numbers") };
        let row = run::row(&World::read(&path)?, &args, CrowdSize { walkers, hidden })?;
        println!("{}", serde_json::to_string(&row)?);
        return Ok(());
    }
    let mut rows: Vec<EngineRow> = Vec::new();
    println!("{}", EngineRow::heading());
    for walkers in args.avatars() {
        let hidden =
            if walkers <= args.hidden_max { vec![0, walkers, 2 * walkers] } else { vec![0] };
        let of = |hidden: usize| (args.policy, args.threads, walkers, hidden);
        let mut planned: Vec<_> = hidden.into_iter().map(of).collect();
        if args.threads == 1 {
            planned.insert(1, (args.policy, 2, walkers, 0));
        }
        if walkers <= args.peers_max {
            let peers = [Policy::Broadcast, Policy::Grid(16.0)];
            planned.extend(peers.map(|policy| (policy, args.threads, walkers, 0)));
        }
        for (policy, threads, walkers, hidden) in planned {
            let args = Args { policy, threads, ..args.clone() };
            let row = measured(&args, CrowdSize { walkers, hidden })?;
            println!("{row}");
            rows.push(row);
        }
    }
    println!("\n{}", findings(&rows));
    args.flags.write(&rows)
}

/// The cost of twice as many hidden avatars, in words.
fn findings(rows: &[EngineRow]) -> String {
    let mut lines = String::new();
    for pair in rows.windows(2) {
        let [once, twice] = pair else { continue };
        if once.hidden > 0 && twice.hidden == 2 * once.hidden {
            let more = |of: fn(&EngineRow) -> f64| 100.0 * (of(twice) / of(once).max(1e-9) - 1.0);
            lines += &format!(
                "{} walking: with {} hidden instead of {}, the mean tick costs {:+.1} %, the median {:+.1} %\n",
                once.walkers,
                twice.hidden,
                once.hidden,
                more(|row| row.cpu_mean_ms),
                more(|row| row.cpu_median_ms),
            );
        }
    }
    lines
}

/// Measures a row in a process of its own.
fn measured(args: &Args, size: CrowdSize) -> anyhow::Result<EngineRow> {
    let CrowdSize { walkers, hidden } = size;
    let mut child = Command::new(std::env::current_exe()?)
        .args(["--row", &format!("{walkers},{hidden}"), "--policy", &args.policy.to_string()])
        .args(args.every_tick.then_some("--every-tick"))
        .args(["--threads", &args.threads.to_string()])
        .args(["--rooms", &args.rooms().to_string(), "--seed", &args.seed.to_string()])
        .args(["--rtt", &args.rtt.to_string(), "--seconds", &args.seconds.to_string()])
        .args(["--patience", &args.patience.to_string()])
        .stdout(Stdio::piped())
        .spawn()?;
    let out = child.stdout.take().context("the row's process has no output")?;
    let line = BufReader::new(out).lines().next().transpose()?;
    anyhow::ensure!(child.wait()?.success(), "{walkers} walkers: the row's process failed");
    Ok(serde_json::from_str(&line.context("the row printed nothing")?)?)
}

/// The file of the compiled building. Compiles it unless it is there.
fn building(args: &Args) -> anyhow::Result<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join(format!("engine-{}-{}.slw", args.rooms(), args.seed));
    let compiles = args.row.is_none() && (args.fresh || World::read(&path).is_err());
    if compiles {
        eprintln!("compiling {} rooms", args.rooms());
        let glb = sightline_demo_building::glb(args.rooms(), args.seed);
        let model = glb::read_slice(&glb, None, "generated")?;
        // It is never drawn, so coarse voxels do.
        let options = CompileOptions { voxel: Some(1.0), ..Default::default() };
        let (world, _) = compile(&model, &options, &|_, _| ControlFlow::Continue(()))?;
        std::fs::create_dir_all(folder)?;
        world.write(&path)?;
    }
    Ok(path)
}
