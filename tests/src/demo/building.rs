//! The demo building: generated, imported and compiled like any other, or read from the cache.

use std::{
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};

use sightline_cli::progress::Progress;
use sightline_compiler::{CompileOptions, Stage};
use sightline_server::{
    building_cache::{BuildingCache, CachedBuilding, Origin},
    building_files::BuildingSource,
    net::ServedWorld,
};
use sightline_world::World;

use super::options::DemoOptions;

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
    let bytes = sightline_demo_building::glb(rooms, seed);
    let source = BuildingSource::Glb { bytes, title: "demo building".to_owned() };
    let progress = Progress::new();
    let cache = BuildingCache::new(cache);
    let show = |stage: Stage, share| progress.show(stage.name(), share);
    let CachedBuilding { world, origin } =
        cache.load_or_compile(&source, &CompileOptions::default(), &show)?;
    progress.finish();
    match origin {
        Origin::Cache => {
            announce(rooms, world.world(), "read from the cache", start.elapsed());
        }
        Origin::Compiled { stored, .. } => {
            announce(rooms, world.world(), "compiled", start.elapsed());
            if let Err(error) = stored {
                println!("the building cannot be kept for the next run: {error}");
            }
        }
    }
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
