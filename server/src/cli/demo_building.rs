//! `sightline-server demo-building`.

use std::path::PathBuf;

use anyhow::Context;
use sightline_server::compile::demo_building::{self, ROOMS_MAX};
use sightline_shared::world::write_whole;

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
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let building = demo_building::build(args.rooms as usize, args.seed);
    write_whole(&args.output, &building.glb)
        .with_context(|| format!("cannot write {}", args.output.display()))?;
    super::print(&format!(
        "{}: {} rooms on {} storeys, {} triangles, {} bytes\n",
        args.output.display(),
        building.plan.room_count(),
        building.plan.storeys,
        building.triangles,
        building.glb.len()
    ))
}
