//! Compiled demo buildings on disk, so that only the first run has to compile.

use std::{
    fs, io,
    path::{Path, PathBuf},
    time::SystemTime,
};

use sightline_server::net::ServedWorld;
use sightline_world::write_whole;

/// Buildings kept in the folder, the newest ones: about 30 MB each for the default building.
const BUILDINGS_MAX: usize = 4;

/// What a compiled building depends on. Two equal keys stand for equal buildings.
///
/// The program's own bytes are part of the key. They contain the compiler and the version of the
/// world file format, so a changed compiler never serves a building that an older one made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CacheKey(blake3::Hash);

impl CacheKey {
    /// The key of a model compiled by this program with some options, given as text.
    ///
    /// # Errors
    /// When the program's own file cannot be read.
    pub(super) fn new(model: &[u8], options: &str) -> io::Result<Self> {
        let program = fs::read(std::env::current_exe()?)?;
        Ok(Self::of_parts(&[&program, model, options.as_bytes()]))
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

/// A folder of compiled buildings, one world file per key.
#[derive(Clone, Debug)]
pub(super) struct BuildingCache {
    folder: PathBuf,
}

impl BuildingCache {
    /// A cache in a folder, which is created when the first building is stored.
    pub(super) fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// The file of a key.
    pub(super) fn path(&self, key: CacheKey) -> PathBuf {
        self.folder.join(format!("building-{}.slw", &key.0.to_hex()[..16]))
    }

    /// The building of a key. `None` when it is not there, or its file is damaged: then it has to
    /// be compiled again.
    pub(super) fn load(&self, key: CacheKey) -> Option<ServedWorld> {
        let bytes = fs::read(self.path(key)).ok()?;
        ServedWorld::from_bytes(bytes).ok()
    }

    /// Stores a building, and removes the oldest ones beyond [`BUILDINGS_MAX`].
    ///
    /// # Errors
    /// When the file system refuses. The building can be used all the same.
    pub(super) fn store(&self, key: CacheKey, building: &ServedWorld) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        write_whole(&self.path(key), building.bytes())?;
        self.prune()
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
    use std::sync::Arc;

    use sightline_fixtures::voxel_floor;

    use super::*;

    fn building() -> ServedWorld {
        ServedWorld::from_world(Arc::new(voxel_floor::world(&[])))
    }

    #[test]
    fn a_stored_building_is_loaded_until_its_file_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let cache = BuildingCache::new(&folder.path().join("cache"));
        let key = CacheKey::new(b"model", "options").unwrap();
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
