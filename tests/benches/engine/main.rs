//! What a tick of the engine costs as the crowd grows.
//!
//! ```text
//! cargo bench -p sightline-tests --bench engine -- --avatars 1000,3000,10000 --seconds 5
//! ```
//!
//! Avatars walk through a generated building of 2,000 rooms, from room to room, at 1.0 to 1.5 m/s; each
//! has a client that does as it is told, 100 ms away. Then as many more hide, each walking about in a
//! closed room of its own beside the building; then twice as many. At the smallest sizes the ways of
//! others follow: everyone to everyone, and a grid.
//!
//! Time is virtual. CPU time is that of the engine alone: of all the reports of a tick and of
//! the tick, of all threads together; beside it stands how long that takes. Memory is what the engine, the walkers and the messages under way take. The building is compiled once
//! and kept under `target`; `--fresh` compiles it again.

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
use sightline_world::World;

use run::EngineRow;

/// Measures the engine in a generated building.
#[derive(Parser, Clone)]
struct Args {
    /// How many walk in the building, ascending.
    #[arg(long, value_delimiter = ',', num_args = 1.., value_name = "N,N,...")]
    avatars: Option<Vec<usize>>,
    /// Rooms of the building.
    #[arg(long, value_name = "N")]
    rooms: Option<usize>,
    /// How much virtual time is measured, after as much again to settle.
    #[arg(long, value_name = "S", default_value_t = 10)]
    seconds: u32,
    /// A row settles, and then measures, no longer than so many seconds of real time each, but a second of
    /// virtual time.
    #[arg(long, value_name = "S", default_value_t = 60)]
    patience: u64,
    /// Nobody hides where more walk than this.
    #[arg(long, value_name = "N", default_value_t = 30_000)]
    hidden_max: usize,
    /// The ways of others are left out where more walk than this: they look at all pairs.
    #[arg(long, value_name = "N", default_value_t = 3_000)]
    peers_max: usize,
    /// The policy that is measured.
    #[arg(long, default_value = "tbv")]
    policy: Policy,
    /// Every client's round trip, in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 100)]
    rtt: u32,
    /// Threads that share a tick. With one, what two do is told as well where nobody hides.
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    /// Of the building and of the walkers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Compile the building again.
    #[arg(long)]
    fresh: bool,
    /// Write the rows to this file too.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Measure one row and print it as JSON; for the bench itself, so that each row has a process
    /// and its memory can be told: walkers, hidden.
    #[arg(long, hide = true, value_delimiter = ',')]
    row: Option<Vec<usize>>,
    /// What `cargo bench` passes. Without it (as when all targets are tested), and unless told
    /// otherwise, the building and the crowd are small, to show that this works.
    #[arg(long, hide = true)]
    bench: bool,
}

impl Args {
    fn rooms(&self) -> usize {
        self.rooms.unwrap_or(if self.bench { 2_000 } else { 12 })
    }

    fn avatars(&self) -> Vec<usize> {
        let default: &[usize] =
            if self.bench { &[1_000, 3_000, 10_000, 30_000, 100_000] } else { &[40] };
        self.avatars.clone().unwrap_or_else(|| default.to_vec())
    }
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let path = building(&args)?;
    if let Some(row) = &args.row {
        let &[walkers, hidden] = &row[..] else { anyhow::bail!("a row has two numbers") };
        let row = run::row(&World::read(&path)?, &args, [walkers, hidden])?;
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
            let row = measured(&args, [walkers, hidden])?;
            println!("{row}");
            rows.push(row);
        }
    }
    println!("\n{}", findings(&rows));
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&rows)? + "\n";
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// What twice as many hidden avatars cost.
fn findings(rows: &[EngineRow]) -> String {
    let mut lines = String::new();
    for pair in rows.windows(2) {
        let [once, twice] = pair else { continue };
        if once.hidden > 0 && twice.hidden == 2 * once.hidden {
            let more = |of: fn(&EngineRow) -> f64| 100.0 * (of(twice) / of(once).max(1e-9) - 1.0);
            lines += &format!(
                "{} walk: with {} hidden in place of {}, the mean tick costs {:+.1} %, the median {:+.1} %\n",
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

/// A row, from a process of its own.
fn measured(args: &Args, [walkers, hidden]: [usize; 2]) -> anyhow::Result<EngineRow> {
    let mut child = Command::new(std::env::current_exe()?)
        .args(["--row", &format!("{walkers},{hidden}"), "--policy", &args.policy.to_string()])
        .args(["--threads", &args.threads.to_string()])
        .args(["--rooms", &args.rooms().to_string(), "--seed", &args.seed.to_string()])
        .args(["--rtt", &args.rtt.to_string(), "--seconds", &args.seconds.to_string()])
        .args(["--patience", &args.patience.to_string()])
        .stdout(Stdio::piped())
        .spawn()?;
    let out = child.stdout.take().context("the row has no output")?;
    let line = BufReader::new(out).lines().next().transpose()?;
    anyhow::ensure!(child.wait()?.success(), "{walkers} walkers: the row failed");
    Ok(serde_json::from_str(&line.context("the row printed nothing")?)?)
}

/// The compiled building's file; compiles it unless it is there.
fn building(args: &Args) -> anyhow::Result<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join(format!("engine-{}-{}.slw", args.rooms(), args.seed));
    let compiles = args.row.is_none() && (args.fresh || World::read(&path).is_err());
    if compiles {
        eprintln!("compiling {} rooms", args.rooms());
        let glb = sightline_demo_building::glb(args.rooms(), args.seed);
        let model = glb::read_slice(&glb, None, "generated")?;
        // Nobody draws it.
        let options = CompileOptions { voxel: Some(1.0), ..Default::default() };
        let (world, _) = compile(&model, &options, &|_, _| ControlFlow::Continue(()))?;
        std::fs::create_dir_all(folder)?;
        world.write(&path)?;
    }
    Ok(path)
}
