//! What several stations cost, in virtual time.
//!
//! ```text
//! cargo bench -p sightline-tests --bench stations -- --stations 1,2,4,8 --visitors 400 --rooms 400
//! ```
//!
//! Visitors walk from room to room in a generated building, at 1.0 to 1.5 m/s, with a round trip of
//! 100 ms. They are at any station, or at that of the part of the building in which they begin. CPU
//! time is that of the engines alone. Messages on the bus stand beside those of stations that pass
//! on every report to all others. Bytes are estimated.

#[path = "../engine/crowd.rs"]
mod crowd;

use std::{fmt, fmt::Write, ops::ControlFlow, path::Path, sync::Arc, time::Duration};

use clap::Parser;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use serde::Serialize;
use sightline_cli::trace::Trace;
use sightline_compiler::{CompileOptions, compile, import::glb};
use sightline_engine::Policy;
use sightline_replay::{Assignment, OracleStride, ReplayOptions, StationOptions, run};
use sightline_tests::bench_flags::BenchFlags;
use sightline_world::World;

use crowd::{Floors, Pedestrians};

/// The time between two samples of the walks, in seconds.
const STEP_S: f32 = 0.05;

/// Measures stations in a generated building.
#[derive(Parser)]
struct Args {
    /// The numbers of stations.
    #[arg(long, value_delimiter = ',', num_args = 1.., value_name = "N,N,...")]
    stations: Option<Vec<usize>>,
    /// The number of visitors.
    #[arg(long, value_name = "N")]
    visitors: Option<usize>,
    /// The number of rooms.
    #[arg(long, value_name = "N")]
    rooms: Option<usize>,
    /// The virtual time, in seconds.
    #[arg(long, value_name = "S")]
    seconds: Option<u32>,
    /// The round trip of every client, in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 100)]
    rtt: u64,
    /// How long a message on the bus takes, in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 1)]
    bus: u64,
    /// Compare with rays each second: whether anybody is missed.
    #[arg(long)]
    oracle: bool,
    /// The seed of the building and of the walkers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    flags: BenchFlags,
}

/// The figures of a number of stations.
#[derive(Serialize)]
struct Row {
    stations: usize,
    assignment: &'static str,
    /// CPU time of the busiest station for a tick, in milliseconds, in the mean.
    cpu_ms: f64,
    /// The same as a share of that of one station with everybody.
    cpu_share: f64,
    /// Messages on the bus a second, without heartbeats.
    messages: f64,
    /// Those, as a share of what they are if every station hears every report.
    messages_share: f64,
    /// About how many bytes on the bus a second a station sends and receives.
    bytes_each: f64,
    /// The share of sectors that a station subscribes to.
    subscribed_share: f64,
    /// How many avatars of others a station knows of.
    guests: f64,
    /// How many of them it follows.
    guests_live: f64,
    /// The share of clients' ticks at which they are quiet.
    quiet_share: f64,
    /// How many avatars a client holds.
    held: f64,
    /// Visible avatars that a viewer did not hold; `None` where that was not looked at.
    misses: Option<u64>,
}

const HEADING: &str = "stations assigned   cpu ms  share  bus msg/s  of all    kB/s each  sectors   \
                       guests     live  quiet   held  misses";

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let misses = self.misses.map_or("-".to_owned(), |misses| misses.to_string());
        write!(
            f,
            "{:>8} {:<8} {:>8.3} {:>6.3} {:>10.1} {:>7.3} {:>12.2} {:>8.3} {:>8.1} {:>8.1} {:>6.3} {:>6.2} {:>7}",
            self.stations,
            self.assignment,
            self.cpu_ms,
            self.cpu_share,
            self.messages,
            self.messages_share,
            self.bytes_each / 1e3,
            self.subscribed_share,
            self.guests,
            self.guests_live,
            self.quiet_share,
            self.held,
            misses
        )
    }
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let is_whole = args.flags.bench;
    let stations: &[usize] = if is_whole { &[1, 2, 4, 8] } else { &[1, 2] };
    let stations = args.stations.clone().unwrap_or_else(|| stations.to_vec());
    let rooms = args.rooms.unwrap_or(if is_whole { 400 } else { 12 });
    let world = building(rooms, args.seed)?;
    let trace = walks(&args, &world, rooms)?;
    println!("{HEADING}");
    let mut rows: Vec<Row> = Vec::new();
    let mut one_ms: Option<f64> = None;
    for count in stations {
        for assignment in [Assignment::Random, Assignment::ByPlace] {
            if count == 1 && assignment == Assignment::ByPlace {
                continue;
            }
            let mut row = measure(&args, &world, &trace, count, assignment)?;
            row.cpu_share = row.cpu_ms / *one_ms.get_or_insert(row.cpu_ms);
            println!("{row}");
            rows.push(row);
        }
    }
    args.flags.write(&rows)
}

fn measure(
    args: &Args,
    world: &Arc<World>,
    trace: &Trace,
    count: usize,
    assignment: Assignment,
) -> anyhow::Result<Row> {
    let mut options = ReplayOptions::new(Policy::Tbv, Duration::from_millis(args.rtt));
    options.oracle =
        if args.oracle { OracleStride::Every(Duration::from_secs(1)) } else { OracleStride::Off };
    options.look_ahead = false;
    let delay = Duration::from_millis(args.bus);
    options.stations = StationOptions { count, assignment, delay, ..StationOptions::default() };
    let report = run(world, trace, &options, None, &mut |_| ())?;
    let stations = report.stations.unwrap_or_default();
    let said: u64 =
        stations.messages.iter().filter(|(kind, _)| **kind != "heartbeat").map(|(_, n)| n).sum();
    let all = report.reports * (count as u64 - 1);
    let seconds = report.seconds.max(f64::MIN_POSITIVE);
    Ok(Row {
        stations: count,
        assignment: match assignment {
            Assignment::Random => "any",
            Assignment::ByPlace => "by place",
            Assignment::Each => "each its own",
        },
        cpu_ms: stations.tick_cpu_mean_ms.iter().copied().fold(0.0, f64::max),
        cpu_share: 1.0,
        messages: said as f64 / seconds,
        messages_share: said as f64 / all.max(1) as f64,
        bytes_each: 2.0 * stations.bytes as f64 / seconds / count as f64,
        subscribed_share: stations.subscribed_share,
        guests: stations.guests_mean,
        guests_live: stations.guests_live_mean,
        quiet_share: report.quiet_share,
        held: report.held_mean,
        misses: report.oracle.map(|oracle| oracle.misses),
    })
}

/// The compiled building, kept under `target`.
fn building(rooms: usize, seed: u64) -> anyhow::Result<Arc<World>> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join(format!("engine-{rooms}-{seed}.slw"));
    if let Ok(world) = World::read(&path) {
        return Ok(Arc::new(world));
    }
    eprintln!("compiling {rooms} rooms");
    let model = glb::read_slice(&sightline_demo_building::glb(rooms, seed), None, "generated")?;
    // It is never drawn, so coarse voxels do.
    let options = CompileOptions { voxel: Some(1.0), ..Default::default() };
    let (world, _) = compile(&model, &options, &|_, _| ControlFlow::Continue(()))?;
    std::fs::create_dir_all(folder)?;
    world.write(&path)?;
    Ok(Arc::new(world))
}

/// The walks of all visitors, as a trace.
fn walks(args: &Args, world: &World, rooms: usize) -> anyhow::Result<Trace> {
    let is_whole = args.flags.bench;
    let visitors = args.visitors.unwrap_or(if is_whole { 400 } else { 12 });
    let seconds = args.seconds.unwrap_or(if is_whole { 10 } else { 2 });
    let plan = sightline_demo_building::plan(rooms, args.seed);
    let mut seeds = SmallRng::seed_from_u64(args.seed);
    let mut rng = || SmallRng::seed_from_u64(seeds.random());
    let mut crowd = Pedestrians::new(Floors::new(&plan), visitors, &[], &mut rng);
    let mut rows = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n".to_owned();
    for step in 0..(seconds as f32 / STEP_S) as u32 {
        for (id, walker) in crowd.walkers.iter().enumerate() {
            let pose = walker.pose();
            let (eye, v) = (pose.eye, pose.velocity);
            writeln!(
                rows,
                "{},{id},{:.4},{:.4},{:.4},{:.4},0,{:.4},{:.4},{:.4}",
                step * 50,
                eye.x,
                eye.y,
                eye.z,
                pose.yaw,
                v.x,
                v.y,
                v.z
            )?;
        }
        crowd.step(world, STEP_S);
    }
    Trace::read(rows.as_bytes()).map_err(Into::into)
}
