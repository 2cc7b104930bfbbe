//! `cargo demo`: the demo building with simulated visitors, a window among them or pictures of them,
//! and a table of what it cost.

use std::{path::PathBuf, process::ExitCode, time::Duration};

use clap::Parser;
use sightline_cli::exit;
use sightline_tests::demo::{self, DemoOptions};

/// Fills a building with simulated visitors, puts your window among them where there is a
/// display, or writes pictures, and ends with a table of what each client was told.
#[derive(Parser)]
#[command(name = "cargo demo", version)]
struct Args {
    /// Simulated visitors.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=2000))]
    visitors: u32,
    /// How long they walk.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u64).range(2..=3600))]
    seconds: u64,
    /// Rooms of the building.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rooms: u32,
    /// The same seed gives the same building and the same goals.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Another building: a world made by `sightline-server compile`.
    #[arg(long, value_name = "WORLD.slw", conflicts_with = "rooms")]
    world: Option<PathBuf>,
    /// Where the pictures go.
    #[arg(long, value_name = "DIR", default_value = "target/demo")]
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
        pictures: args.pictures,
        window: !args.no_window,
    };
    exit::code("cargo demo", demo::run(&options))
}
