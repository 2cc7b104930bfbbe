//! Box visibility in real maps.

use std::ops::ControlFlow;

use rand::{SeedableRng, rngs::SmallRng};
use sightline_compiler::{CompileOptions, LightMethod, compile, import};
use sightline_fixtures::shared_files::shared_file;

use crate::box_pairs::BoxPairTally;

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
    let Some(path) = shared_file(map) else { return };
    let model = import::read(&path, &[]).unwrap();
    // The PVS is not used, so cells may be coarse.
    let options = CompileOptions {
        voxel: Some(4.0),
        cell: Some(20.0),
        light: LightMethod::None,
        ..Default::default()
    };
    let (world, _) = compile(&model, &options, &|_, _| ControlFlow::Continue(())).unwrap();
    let mut tally = BoxPairTally::default();
    let mut rng = SmallRng::seed_from_u64(4);
    tally.add(&world, 400, &mut rng, map);
    tally.judge(map, share_min);
}
