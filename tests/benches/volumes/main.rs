//! Two indices of avatars' volumes compared: the octree of moving boxes
//! ([`sightline_world::octree::occupants`]; Sudarsky and Gotsman 1996, section 3.1.1), and a list
//! of members for each convex space, as the engine has.
//!
//! ```text
//! cargo bench -p sightline-tests --bench volumes -- --volumes 1000,10000 --rooms 200
//! ```
//!
//! A volume is a box, 0.8 m to 4 m wide and 2 m high, around an avatar that walks in a generated
//! building. Both indices do the same work by turns:
//!
//! * **insert** all volumes, and **move** those that walk by a quarter of a second;
//! * **meet**: find the volumes that a region may meet;
//! * **see**: find the volumes that are in some space that a space of the region may see by the
//!   PVS. This is what the engine asks. The octree is asked for the box around each such space,
//!   or once for the box around them all.
//!
//! Each time is the median of several repeats, in nanoseconds an operation. For spaces it has two
//! parts, since the engine knows the spaces of a region before it asks the index: finding the
//! spaces of a box, and the work on lists. Answers are compared with those of all volumes one by
//! one: neither index may leave out any.

#[path = "../engine/crowd.rs"]
mod crowd;
mod measure;
mod scene;
mod spaces;

use clap::Parser;
use sightline_tests::bench_flags::BenchFlags;

use measure::VolumesRow;
use scene::{Building, Motion};

/// Measures the octree of volumes and the index by spaces in a generated building.
#[derive(Parser)]
struct Args {
    /// The numbers of volumes.
    #[arg(long, value_delimiter = ',', num_args = 1.., value_name = "N,N,...")]
    volumes: Option<Vec<usize>>,
    /// The number of rooms in the building.
    #[arg(long, value_name = "N")]
    rooms: Option<usize>,
    /// The seed of the building and of the walkers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    flags: BenchFlags,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let (rooms, default): (_, &[usize]) = if args.flags.bench {
        (args.rooms.unwrap_or(200), &[1_000, 3_000, 10_000, 30_000, 100_000])
    } else {
        (args.rooms.unwrap_or(4), &[40])
    };
    let building = Building::generate(rooms, args.seed)?;
    println!("{rooms} rooms, {} spaces", building.spaces().len());
    let mut rows = Vec::new();
    for &volumes in args.volumes.as_deref().unwrap_or(default) {
        for motion in [Motion::Rest, Motion::Half, Motion::All] {
            eprintln!("{volumes} volumes, {motion}");
            rows.push(VolumesRow::measure(&building, volumes, motion, args.seed));
        }
    }
    println!("\n{}\n{}", measure::update_table(&rows), measure::query_table(&rows));
    args.flags.write(&rows)
}
