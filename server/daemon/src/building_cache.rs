//! Compiled buildings on disk, so that only the first run has to compile.

use std::{
    fs, io,
    ops::ControlFlow,
    path::{Path, PathBuf},
    sync::Arc,
    time::SystemTime,
};

use sightline_compiler::{
    CompileError, CompileOptions, Stage, compile,
    import::glb::{self, GlbError},
};
use sightline_world::write_whole;
use thiserror::Error;

use crate::net::ServedWorld;

/// Buildings kept in the folder, the newest ones: about 30 MB each for the default building.
const BUILDINGS_MAX: usize = 4;

/// What a compiled building depends on. Two equal keys stand for equal buildings.
///
/// The program's own bytes are part of the key. They contain the compiler and the version of the
/// world file format, so a changed compiler never serves a building that an older one made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct CacheKey(blake3::Hash);

impl CacheKey {
    /// The key of a model compiled by this program with some options.
    ///
    /// # Errors
    /// When the program's own file cannot be read.
    fn new(model: &[u8], options: &CompileOptions) -> io::Result<Self> {
        let program = fs::read(std::env::current_exe()?)?;
        Ok(Self::of_parts(&[&program, model, format!("{options:?}").as_bytes()]))
    }

    /// Hashes each part by itself first, so that no two lists of parts run together.
    fn of_parts(parts: &[&[u8]]) -> Self {
        let mut hasher = blake3::Hasher::new();
        for part in parts {
            hasher.update(blake3::hash(part).as_bytes());
        }
        Self(hasher.finalize())
    }
}

/// A folder of compiled buildings, one world file for each model, program and set of options.
#[derive(Clone, Debug)]
pub struct BuildingCache {
    folder: PathBuf,
}

/// A building, and where it came from.
#[derive(Debug)]
pub struct CachedBuilding {
    /// The building.
    pub world: ServedWorld,
    /// Where it came from.
    pub source: BuildingSource,
}

/// Where a building came from.
#[derive(Debug)]
pub enum BuildingSource {
    /// An earlier run compiled it.
    Cache,
    /// It was compiled now. The building can be used even if it could not be stored.
    Compiled {
        /// The stored file, or why there is none: then the next run compiles again.
        stored: io::Result<PathBuf>,
    },
}

/// Why there is no building.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BuildingError {
    /// The model cannot be read.
    #[error(transparent)]
    Model(#[from] GlbError),
    /// The model does not compile.
    #[error(transparent)]
    Compile(#[from] CompileError),
}

impl BuildingCache {
    /// A cache in a folder, which is created when the first building is stored. The folder is for
    /// this alone: when there are too many world files in it, the oldest ones are removed.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// The building of a GLB model: from the cache, or else compiled and stored. `progress` hears
    /// the stages of compiling, and the share of each that is done.
    ///
    /// # Errors
    /// When the model cannot be read or does not compile.
    pub fn load_or_compile(
        &self,
        model: &[u8],
        options: &CompileOptions,
        title: &str,
        progress: &(dyn Fn(Stage, f32) + Sync),
    ) -> Result<CachedBuilding, BuildingError> {
        let key = CacheKey::new(model, options);
        if let Ok(key) = key
            && let Some(world) = self.load(key)
        {
            return Ok(CachedBuilding { world, source: BuildingSource::Cache });
        }
        let model = glb::read_slice(model, None, title)?;
        let (world, _) = compile(&model, options, &|stage, share| {
            progress(stage, share);
            ControlFlow::Continue(())
        })?;
        let world = ServedWorld::from_world(Arc::new(world));
        let stored = key.and_then(|key| self.store(key, &world));
        Ok(CachedBuilding { world, source: BuildingSource::Compiled { stored } })
    }

    /// The file of a key.
    fn path(&self, key: CacheKey) -> PathBuf {
        self.folder.join(format!("building-{}.slw", &key.0.to_hex()[..16]))
    }

    /// The building of a key. `None` when it is not there, or its file is damaged: then it has to
    /// be compiled again.
    fn load(&self, key: CacheKey) -> Option<ServedWorld> {
        let bytes = fs::read(self.path(key)).ok()?;
        ServedWorld::from_bytes(bytes).ok()
    }

    /// Stores a building, and removes the oldest ones beyond [`BUILDINGS_MAX`].
    ///
    /// # Errors
    /// When the file system refuses. The building can be used all the same.
    fn store(&self, key: CacheKey, building: &ServedWorld) -> io::Result<PathBuf> {
        fs::create_dir_all(&self.folder)?;
        let path = self.path(key);
        write_whole(&path, building.bytes())?;
        self.prune()?;
        Ok(path)
    }

    fn prune(&self) -> io::Result<()> {
        let mut files: Vec<(SystemTime, PathBuf)> = Vec::new();
        for entry in fs::read_dir(&self.folder)? {
            let entry = entry?;
            if entry.path().extension().is_some_and(|extension| extension == "slw") {
                files.push((entry.metadata()?.modified()?, entry.path()));
            }
        }
        files.sort();
        let excess = files.len().saturating_sub(BUILDINGS_MAX);
        files[..excess].iter().try_for_each(|(_, path)| fs::remove_file(path))
    }
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor;

    use super::*;

    fn building() -> ServedWorld {
        ServedWorld::from_world(Arc::new(voxel_floor::world(&[])))
    }

    #[test]
    fn a_stored_building_is_loaded_until_its_file_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BuildingCache::new(&folder.path().join("cache"));
        let key = CacheKey::new(b"model", &CompileOptions::default()).unwrap();
        assert!(cache.load(key).is_none());
        cache.store(key, &building()).unwrap();
        assert_eq!(cache.load(key).unwrap().world(), building().world());
        let mut damaged = fs::read(cache.path(key)).unwrap();
        let middle = damaged.len() / 2;
        damaged[middle] ^= 1;
        fs::write(cache.path(key), &damaged).unwrap();
        assert!(cache.load(key).is_none(), "damaged");
        fs::write(cache.path(key), &damaged[..9]).unwrap();
        assert!(cache.load(key).is_none(), "cut short");
        cache.store(key, &building()).unwrap();
        assert!(cache.load(key).is_some(), "a damaged file is replaced");
    }

    #[test]
    fn the_options_change_the_key() {
        let key = |voxel| {
            CacheKey::new(b"model", &CompileOptions { voxel, ..Default::default() }).unwrap()
        };
        assert_eq!(key(None), key(None));
        assert_ne!(key(None), key(Some(0.1)));
    }

    #[test]
    fn only_the_first_run_compiles() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BuildingCache::new(folder.path());
        let model = sightline_demo_building::glb(4, 1);
        let options =
            CompileOptions { voxel: Some(0.5), cell: Some(4.0), ..CompileOptions::default() };
        let building = || cache.load_or_compile(&model, &options, "cottage", &|_, _| ()).unwrap();
        let first = building();
        let BuildingSource::Compiled { stored } = first.source else { panic!("not compiled") };
        assert!(stored.unwrap().is_file());
        let second = building();
        assert!(matches!(second.source, BuildingSource::Cache));
        assert_eq!(first.world.bytes(), second.world.bytes());
        assert!(cache.load_or_compile(b"no model", &options, "", &|_, _| ()).is_err());
    }

    #[test]
    fn every_part_changes_the_key() {
        let key = |parts: [&str; 3]| CacheKey::of_parts(&parts.map(str::as_bytes));
        let whole = key(["program", "model", "options"]);
        assert_eq!(whole, key(["program", "model", "options"]));
        for other in [
            ["programme", "model", "options"],
            ["program", "models", "options"],
            ["program", "model", "option"],
            ["programm", "odel", "options"],
        ] {
            assert_ne!(whole, key(other), "{other:?}");
        }
    }

    #[test]
    fn only_the_newest_buildings_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BuildingCache::new(folder.path());
        let keys: Vec<CacheKey> =
            (0..=BUILDINGS_MAX as u8).map(|number| CacheKey::of_parts(&[&[number]])).collect();
        for key in &keys {
            cache.store(*key, &building()).unwrap();
            // Files of one moment have no order.
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        assert!(cache.load(keys[0]).is_none());
        assert!(keys[1..].iter().all(|key| cache.load(*key).is_some()));
    }
}
