//! `cargo demo`: the demo building with simulated visitors, and a table of what each client was
//! told.

use std::{path::PathBuf, process::ExitCode, time::Duration};

use clap::Parser;
use sightline_cli::exit;
use sightline_tests::demo::{self, DemoOptions};

/// Fills a building with simulated visitors, and shows what each client is told of the others.
///
/// Starts the real server and real clients over QUIC in one process. Where there is a display, a
/// window opens among the visitors; elsewhere the demo writes two pictures: a view and a plan. It
/// ends with a table: the same walk under four policies, and how they compare with rays against
/// the building's triangles.
///
/// The first run compiles the building. Later runs read it from the cache.
#[derive(Parser)]
#[command(name = "cargo demo", version)]
struct Args {
    /// The number of simulated visitors.
    #[arg(long, value_name = "N", default_value_t = 60,
          value_parser = clap::value_parser!(u32).range(1..=2000))]
    visitors: u32,
    /// How long they walk, in seconds.
    #[arg(long, value_name = "S", default_value_t = 60,
          value_parser = clap::value_parser!(u64).range(2..=3600))]
    seconds: u64,
    /// The number of rooms in the building.
    #[arg(long, value_name = "N", default_value_t = 200,
          value_parser = clap::value_parser!(u32).range(1..=1000))]
    rooms: u32,
    /// The seed of the building and of the visitors' goals: the same seed gives the same ones.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Walk in another building: a world file made by `sightline-server compile`.
    #[arg(long, value_name = "WORLD.slw", conflicts_with = "rooms")]
    world: Option<PathBuf>,
    /// The folder where compiled buildings are kept for the next run.
    #[arg(long, value_name = "DIR", default_value = "target/demo-cache")]
    cache: PathBuf,
    /// The folder for the pictures.
    #[arg(long, value_name = "DIR", default_value = "target/demo-pictures")]
    pictures: PathBuf,
    /// Write pictures even where there is a display.
    #[arg(long)]
    no_window: bool,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let options = DemoOptions {
        visitors: args.visitors as usize,
        duration: Duration::from_secs(args.seconds),
        rooms: args.rooms as usize,
        seed: args.seed,
        world: args.world,
        cache: args.cache,
        pictures: args.pictures,
        window: !args.no_window,
    };
    exit::code("cargo demo", demo::run(&options))
}
