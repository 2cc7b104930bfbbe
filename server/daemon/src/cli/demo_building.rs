//! `sightline-server demo-building`.

use std::path::PathBuf;

use anyhow::Context;
use sightline_cli::output;
use sightline_demo_building::ROOMS_MAX;
use sightline_world::write_whole;

/// Writes the demo building, of any size, as a GLB.
#[derive(clap::Args)]
pub struct Args {
    /// Where to write it.
    #[arg(short, long, value_name = "OUT.glb")]
    output: PathBuf,
    /// How many rooms it has.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=ROOMS_MAX as i64))]
    rooms: u32,
    /// The same seed gives the same building.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write a floor with eight arched windows instead, on which carving can be seen.
    #[arg(long, conflicts_with_all = ["rooms", "seed"])]
    arched_floor: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let (glb, told) = if args.arched_floor {
        let floor = sightline_demo_building::arched_floor();
        (floor.glb, format!("{} polygons, {} triangles", floor.polygons, floor.triangles))
    } else {
        let building = sightline_demo_building::build(args.rooms as usize, args.seed);
        let (rooms, storeys) = (building.plan.room_count(), building.plan.storeys);
        let told = format!("{rooms} rooms on {storeys} storeys, {} triangles", building.triangles);
        (building.glb, told)
    };
    write_whole(&args.output, &glb)
        .with_context(|| format!("cannot write {}", args.output.display()))?;
    output::print(&format!("{}: {told}, {} bytes\n", args.output.display(), glb.len()))
}
