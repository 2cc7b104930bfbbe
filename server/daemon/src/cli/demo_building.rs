//! The command `sightline-server demo-building`.

use std::path::PathBuf;

use anyhow::Context;
use sightline_cli::{files::check_output, output};
use sightline_demo_building::ROOMS_MAX;
use sightline_world::write_whole;

/// Writes the demo building as a GLB, with as many rooms as you like.
#[derive(clap::Args)]
pub struct DemoBuildingArgs {
    /// The file to write.
    #[arg(short, long, value_name = "OUT.glb")]
    output: PathBuf,
    /// The number of rooms.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=ROOMS_MAX as i64))]
    rooms: u32,
    /// The seed; the same seed gives the same building.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write a floor with eight arched windows instead, which shows what carving does.
    #[arg(long, conflicts_with_all = ["rooms", "seed"])]
    arched_floor: bool,
}

/// Runs the command.
pub fn run(args: &DemoBuildingArgs) -> anyhow::Result<()> {
    check_output(&args.output)?;
    let (glb, summary) = if args.arched_floor {
        let floor = sightline_demo_building::arched_floor();
        (floor.glb, format!("{} polygons, {} triangles", floor.polygons, floor.triangles))
    } else {
        let building = sightline_demo_building::build(args.rooms as usize, args.seed);
        let (rooms, storeys) = (building.plan.room_count(), building.plan.storeys);
        let summary =
            format!("{rooms} rooms on {storeys} storeys, {} triangles", building.triangles);
        (building.glb, summary)
    };
    write_whole(&args.output, &glb)
        .with_context(|| format!("cannot write {}", args.output.display()))?;
    output::print(&format!("{}: {summary}, {} bytes\n", args.output.display(), glb.len()))
}
