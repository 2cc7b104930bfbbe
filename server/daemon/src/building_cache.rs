//! Compiled buildings on disk, so that only the first run has to compile.

use std::{
    fs, io,
    ops::ControlFlow,
    path::{Path, PathBuf},
    sync::Arc,
};

use sightline_compiler::{CompileError, CompileOptions, CompileReport, Stage, compile};
use sightline_world::write_whole;
use thiserror::Error;

use crate::{
    building_files::{BuildingSource, SourceError},
    kept_files,
    net::ServedWorld,
};

/// Buildings kept in the folder, those that were used last: about 30 MB each for the default
/// building.
const BUILDINGS_MAX: usize = 8;

/// What a compiled building depends on. Two equal keys stand for equal buildings.
///
/// The program's own bytes are part of the key. They contain the compiler and the version of the
/// world file format, so a changed compiler never serves a building that an older one made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CacheKey(blake3::Hash);

impl CacheKey {
    /// The key of a building compiled by this program with some options.
    ///
    /// # Errors
    /// When a file, or the program's own, cannot be read.
    pub fn new(source: &BuildingSource, options: &CompileOptions) -> io::Result<Self> {
        let program = kept_files::program()?;
        let options = blake3::hash(format!("{options:?}").as_bytes());
        Ok(Self::of_hashes(&[vec![program, options], source.content()?].concat()))
    }

    fn of_hashes(hashes: &[blake3::Hash]) -> Self {
        Self(kept_files::joined(hashes))
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
    pub origin: Origin,
}

/// Where a building came from.
#[derive(Debug)]
pub enum Origin {
    /// An earlier run compiled it.
    Cache,
    /// It was compiled now. The building can be used even if it could not be stored.
    Compiled {
        /// The stored file, or why there is none: then the next run compiles again.
        stored: io::Result<PathBuf>,
        /// What came of it.
        report: Box<CompileReport>,
    },
}

/// Why there is no building.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BuildingError {
    /// The model cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The model does not compile.
    #[error(transparent)]
    Compile(#[from] CompileError),
}

impl BuildingCache {
    /// A cache in a folder, which is created when the first building is stored. The folder is for
    /// this alone: when there are too many world files in it, those that were used least recently
    /// are removed.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// A building: from the cache, or else compiled and stored. `progress` hears the stages of
    /// compiling, and the share of each that is done.
    ///
    /// # Errors
    /// When the model cannot be read or does not compile.
    pub fn load_or_compile(
        &self,
        source: &BuildingSource,
        options: &CompileOptions,
        progress: &(dyn Fn(Stage, f32) + Sync),
    ) -> Result<CachedBuilding, BuildingError> {
        let key = CacheKey::new(source, options);
        if let Ok(key) = key
            && let Some(world) = self.load(key)
        {
            return Ok(CachedBuilding { world, origin: Origin::Cache });
        }
        let model = source.read()?;
        let (world, report) = compile(&model, options, &|stage, share| {
            progress(stage, share);
            ControlFlow::Continue(())
        })?;
        let world = ServedWorld::from_world(Arc::new(world));
        let stored = key.and_then(|key| self.store(key, &world));
        Ok(CachedBuilding { world, origin: Origin::Compiled { stored, report: Box::new(report) } })
    }

    /// The file of a key.
    fn path(&self, key: CacheKey) -> PathBuf {
        self.folder.join(format!("building-{}.slw", &key.0.to_hex()[..16]))
    }

    /// The building of a key. `None` when it is not there, or its file is damaged: then it has to
    /// be compiled again.
    pub fn load(&self, key: CacheKey) -> Option<ServedWorld> {
        let path = self.path(key);
        let world = ServedWorld::from_bytes(fs::read(&path).ok()?).ok()?;
        kept_files::used(&path);
        Some(world)
    }

    /// Stores a building. Eight stay at most: the one that was used least recently is removed.
    ///
    /// # Errors
    /// When the file system refuses. The building can be used all the same.
    pub fn store(&self, key: CacheKey, building: &ServedWorld) -> io::Result<PathBuf> {
        fs::create_dir_all(&self.folder)?;
        let path = self.path(key);
        write_whole(&path, building.bytes())?;
        kept_files::prune(&self.folder, "slw", BUILDINGS_MAX)?;
        Ok(path)
    }

    /// Removes a building, if it is there.
    pub fn remove(&self, key: CacheKey) {
        let _ = fs::remove_file(self.path(key));
    }
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor;

    use super::*;
    use crate::building_files::BuildingFiles;

    fn building() -> ServedWorld {
        ServedWorld::from_world(Arc::new(voxel_floor::world(&[])))
    }

    fn key_of(part: &[u8]) -> CacheKey {
        CacheKey::of_hashes(&[blake3::hash(part)])
    }

    #[test]
    fn a_stored_building_is_loaded_until_its_file_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BuildingCache::new(&folder.path().join("cache"));
        let key = key_of(b"model");
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
        cache.remove(key);
        assert!(cache.load(key).is_none());
    }

    #[test]
    fn only_the_first_run_compiles() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BuildingCache::new(folder.path());
        let (bytes, title) = (sightline_demo_building::glb(4, 1), "cottage".to_owned());
        let source = BuildingSource::Glb { bytes, title };
        let options =
            CompileOptions { voxel: Some(0.5), cell: Some(4.0), ..CompileOptions::default() };
        let building = || cache.load_or_compile(&source, &options, &|_, _| ()).unwrap();
        let first = building();
        let Origin::Compiled { stored, .. } = first.origin else { panic!("not compiled") };
        assert!(stored.unwrap().is_file());
        let second = building();
        assert!(matches!(second.origin, Origin::Cache));
        assert_eq!(first.world.bytes(), second.world.bytes());
        let source = BuildingSource::Glb { bytes: b"no model".to_vec(), title: String::new() };
        assert!(cache.load_or_compile(&source, &options, &|_, _| ()).is_err());
    }

    #[test]
    fn every_file_and_option_changes_the_key() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| folder.path().join(name);
        let json = |uri: &str| {
            let buffers = format!(r#"[{{"byteLength":4,"uri":"{uri}"}}]"#);
            format!(r#"{{"asset":{{"version":"2.0"}},"buffers":{buffers}}}"#)
        };
        fs::write(file("house.gltf"), json("house%20parts.bin")).unwrap();
        let files = BuildingFiles::of(&file("house.gltf"));
        let options = CompileOptions::default();
        let key = |files: &BuildingFiles, options: &CompileOptions| {
            CacheKey::new(&BuildingSource::Files(files.clone()), options).unwrap()
        };
        let mut known = vec![key(&files, &options)];
        let mut differs = |what: &str, key: CacheKey| {
            assert!(!known.contains(&key), "{what}");
            known.push(key);
        };
        differs("voxel", key(&files, &CompileOptions { voxel: Some(0.1), ..options }));
        for (name, text) in [
            ("house parts.bin", "1234"),
            ("house parts.bin", "1235"),
            ("house.rooms.toml", "# none"),
            ("house.gltf", &json("other.bin")),
        ] {
            fs::write(file(name), text).unwrap();
            differs(name, key(&files, &options));
        }
        let mut placed = files.clone();
        placed.placing.recentre = true;
        differs("recentre", key(&placed, &options));
        let archived = BuildingFiles { pk3: vec![file("a.pk3")], ..files.clone() };
        differs("an archive that is not there", key(&archived, &options));
        assert_eq!(key(&files, &options), key(&files, &options));
    }

    #[test]
    fn only_the_buildings_that_were_used_last_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BuildingCache::new(folder.path());
        let keys: Vec<CacheKey> = (0..=BUILDINGS_MAX as u8).map(|i| key_of(&[i])).collect();
        // Files of one moment have no order.
        let wait = || std::thread::sleep(std::time::Duration::from_millis(20));
        for key in &keys[..BUILDINGS_MAX] {
            cache.store(*key, &building()).unwrap();
            wait();
        }
        assert!(cache.load(keys[0]).is_some());
        wait();
        cache.store(keys[BUILDINGS_MAX], &building()).unwrap();
        assert!(cache.load(keys[1]).is_none());
        assert!(cache.load(keys[0]).is_some() && cache.load(keys[2]).is_some());
    }
}
