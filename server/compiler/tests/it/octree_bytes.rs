//! The size of an octree, in memory and on the wire.

use std::ops::ControlFlow;

use sightline_compiler::{
    import::{self, glb},
    model::Model,
    octree_statistics::OctreeStatistics,
    voxelise,
};
use sightline_fixtures::shared_files::shared_file;

/// The most bytes of a leaf in memory, with its share of inner nodes and materials.
const MEMORY_BYTES_MAX: f64 = 6.0;
/// The most bytes of a leaf on the wire.
const WIRE_BYTES_MAX: f64 = 1.0;

fn check(name: &str, model: &Model, voxel: f32) {
    let bounds = model.bounds().expect("there are triangles");
    let go_on = |_| ControlFlow::Continue(());
    let octree = voxelise::voxelise(&model.surfaces, &bounds, voxel, &go_on).expect("they fit");
    let figures = OctreeStatistics::of(&octree);
    assert!(figures.voxels > 100_000, "{name}: {figures:?}");
    assert!(figures.memory_bytes_per_voxel <= MEMORY_BYTES_MAX, "{name}: {figures:?}");
    assert!(figures.wire_bytes_per_voxel <= WIRE_BYTES_MAX, "{name}: {figures:?}");
}

#[test]
fn a_voxel_takes_six_bytes_in_memory_and_one_on_the_wire() {
    let building = sightline_demo_building::glb(6, 3);
    let model = glb::read_slice(&building, None, "demo").expect("our own");
    check("demo building", &model, 0.06);
    let Some(map) = shared_file("maps/oa_dm4.bsp") else { return };
    let model = import::read(&map, &[]).expect("a real map");
    check("oa_dm4", &model, 0.05);
}
