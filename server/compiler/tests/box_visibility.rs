//! Box visibility in real maps, against random lines: see `random_buildings/box_visibility.rs`.

#[path = "random_buildings/box_visibility.rs"]
mod pairs;

use std::{ops::ControlFlow, path::PathBuf};

use rand::{SeedableRng, rngs::SmallRng};
use sightline_compiler::{CompileOptions, compile, import};

#[test]
fn nobody_is_missed_in_open_arenas() {
    nobody_is_missed("maps/oa_dm4.bsp", 0.8);
}

#[test]
fn nobody_is_missed_among_stairs_and_curves() {
    nobody_is_missed("maps/oa_dm2.bsp", 0.8);
}

#[test]
fn nobody_is_missed_between_rooms() {
    nobody_is_missed("traces/rooms400.glb", 0.85);
}

fn nobody_is_missed(map: &str, share_min: f64) {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared");
    let shared = std::env::var_os("SIGHTLINE_SHARED").map_or_else(|| beside.into(), PathBuf::from);
    let path = shared.join(map);
    if !path.is_file() {
        println!("skipped: {} is absent", path.display());
        return;
    }
    let model = import::read(&path, &[]).unwrap();
    // The PVS is not asked, so large cells will do.
    let options = CompileOptions { voxel: Some(4.0), cell: Some(20.0), ..Default::default() };
    let (world, _) = compile(&model, &options, &|_, _| ControlFlow::Continue(())).unwrap();
    let mut tally = pairs::BoxPairTally::default();
    let mut rng = SmallRng::seed_from_u64(4);
    tally.add(&world, 400, &mut rng, map);
    tally.judge(map, share_min);
}
