//! The demo building: generated, imported and compiled like any other, or read from the cache.

use std::{
    ops::ControlFlow,
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};

use sightline_cli::progress::Progress;
use sightline_compiler::{CompileOptions, compile, import::glb};
use sightline_server::net::ServedWorld;
use sightline_world::World;

use super::{
    building_cache::{BuildingCache, CacheKey},
    options::DemoOptions,
};

/// The building to walk in: the file that the options name, or the demo building. Says on one line
/// where the demo building came from.
///
/// # Errors
/// When the file cannot be read, or the building does not compile.
pub(super) fn building(options: &DemoOptions) -> anyhow::Result<ServedWorld> {
    match &options.world {
        Some(path) => Ok(ServedWorld::from_world(Arc::new(World::read(path)?))),
        None => demo_building(options.rooms, options.seed, &options.cache),
    }
}

fn demo_building(rooms: usize, seed: u64, cache: &Path) -> anyhow::Result<ServedWorld> {
    let start = Instant::now();
    let cache = BuildingCache::new(cache);
    let model = sightline_demo_building::glb(rooms, seed);
    let compile_options = CompileOptions::default();
    let key = CacheKey::new(&model, &format!("{compile_options:?}")).ok();
    if let Some(building) = key.and_then(|key| cache.load(key)) {
        announce(rooms, building.world(), "read from the cache", start.elapsed());
        return Ok(building);
    }
    let building = ServedWorld::from_world(Arc::new(compiled(&model, &compile_options)?));
    announce(rooms, building.world(), "compiled", start.elapsed());
    // Without a cache the next run compiles again: slower, and not wrong.
    if let Some(Err(error)) = key.map(|key| cache.store(key, &building)) {
        println!("the building cannot be kept for the next run: {error}");
    }
    Ok(building)
}

fn compiled(model: &[u8], options: &CompileOptions) -> anyhow::Result<World> {
    let model = glb::read_slice(model, None, "demo building")?;
    let progress = Progress::new();
    let (world, _) = compile(&model, options, &|stage, share| {
        progress.show(stage.name(), share);
        ControlFlow::Continue(())
    })?;
    progress.finish();
    Ok(world)
}

fn announce(rooms: usize, world: &World, how: &str, took: Duration) {
    println!(
        "the demo building: {rooms} rooms, {} cells, {} portals, {} voxels, {how} in {:.1} s",
        world.cells.cells.len(),
        world.cells.portals.len(),
        world.octree.leaves.len(),
        took.as_secs_f64()
    );
}
