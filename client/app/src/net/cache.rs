//! Worlds on disk and in memory, by content id.

use std::{
    collections::HashMap,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    sync::{Arc, Weak},
    time::SystemTime,
};

use sightline_world::{ContentId, ReadError, World, content_id, write_whole};

use super::piece_store::PieceStore;

/// The most worlds on disk, and the most bytes of them together. The one that was used longest ago
/// goes first.
const FILES_MAX: usize = 32;
const BYTES_MAX: u64 = 4 << 30;

/// Worlds that were fetched. Connections that need the same world at the same time share one copy.
#[derive(Debug, Default)]
pub(super) struct WorldCache {
    /// The folder of the files; `None` to keep worlds only in memory.
    folder: Option<PathBuf>,
    /// Pieces on disk, beside the files.
    pieces: Option<PieceStore>,
    /// The worlds in use, by content id.
    open: tokio::sync::Mutex<HashMap<[u8; 32], Weak<World>>>,
}

impl WorldCache {
    /// A cache in a folder, which is created when the first world arrives.
    pub fn new(folder: Option<PathBuf>) -> Self {
        let pieces = folder.as_ref().map(|folder| PieceStore::new(folder.join("pieces")));
        Self { folder, pieces, open: tokio::sync::Mutex::default() }
    }

    /// The pieces on disk; `None` where nothing is kept there.
    pub fn pieces(&self) -> Option<&PieceStore> {
        self.pieces.as_ref()
    }

    /// The world of an id, if it is in use or on disk.
    pub async fn find(&self, id: ContentId) -> Result<Option<Arc<World>>, ReadError> {
        let mut open = self.open.lock().await;
        if let Some(world) = open.get(&id.0).and_then(Weak::upgrade) {
            return Ok(Some(world));
        }
        let Some(path) = self.path(id) else { return Ok(None) };
        let kept = blocking(move || Ok(load(&path, id))).await?;
        Ok(kept.map(|world| keep(&mut open, id, world)))
    }

    fn path(&self, id: ContentId) -> Option<PathBuf> {
        self.folder.as_ref().map(|folder| folder.join(format!("{id}.slw")))
    }

    /// The world of an id: the one in use, or from disk, or from `fetch`. Other callers wait
    /// meanwhile.
    pub async fn get<E: From<ReadError>>(
        &self,
        id: ContentId,
        fetch: impl Future<Output = Result<Vec<u8>, E>>,
    ) -> Result<Arc<World>, E> {
        let mut open = self.open.lock().await;
        if let Some(world) = open.get(&id.0).and_then(Weak::upgrade) {
            return Ok(world);
        }
        let path = self.path(id);
        let kept = match path.clone() {
            Some(path) => blocking(move || Ok(load(&path, id))).await?,
            None => None,
        };
        let world = match kept {
            Some(world) => world,
            None => {
                let bytes = fetch.await?;
                blocking(move || receive(&bytes, id, path.as_deref())).await?
            }
        };
        Ok(keep(&mut open, id, world))
    }
}

/// Notes a world as one in use.
fn keep(open: &mut HashMap<[u8; 32], Weak<World>>, id: ContentId, world: World) -> Arc<World> {
    let world = Arc::new(world);
    open.retain(|_, world| world.strong_count() > 0);
    open.insert(id.0, Arc::downgrade(&world));
    world
}

/// Runs work on a thread where it does not delay connections: reading a world takes a while.
pub(super) async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, ReadError> + Send + 'static,
) -> Result<T, ReadError> {
    match tokio::task::spawn_blocking(work).await {
        Ok(result) => result,
        Err(_) => Err(ReadError::Malformed("reading it panicked")),
    }
}

/// The world in a file. `None` when there is no such file, or it is damaged: then it is removed.
fn load(path: &Path, id: ContentId) -> Option<World> {
    let bytes = fs::read(path).ok()?;
    match check(&bytes, id) {
        Ok(world) => {
            let used = File::options().append(true).open(path);
            if let Err(error) = used.and_then(|file| file.set_modified(SystemTime::now())) {
                tracing::debug!(path = %path.display(), %error, "its time of use cannot be set");
            }
            Some(world)
        }
        Err(error) => {
            tracing::warn!(path = %path.display(), %error, "a cached world is damaged, and is fetched again");
            let _ = fs::remove_file(path);
            None
        }
    }
}

/// Reads the bytes that a server sent, and stores them at the path, if any.
fn receive(bytes: &[u8], id: ContentId, path: Option<&Path>) -> Result<World, ReadError> {
    let world = check(bytes, id)?;
    if let Some(path) = path
        && let Err(error) = store(bytes, path)
    {
        tracing::warn!(path = %path.display(), %error, "the world cannot be stored");
    }
    Ok(world)
}

/// Writes a world, and removes others where there are too many.
fn store(bytes: &[u8], path: &Path) -> io::Result<()> {
    let Some(folder) = path.parent() else { return write_whole(path, bytes) };
    fs::create_dir_all(folder)?;
    write_whole(path, bytes)?;
    prune(folder, path, FILES_MAX, BYTES_MAX)
}

/// Removes worlds that were used longest ago, until no more than these are left. One stays in any
/// case.
fn prune(folder: &Path, kept: &Path, files_max: usize, bytes_max: u64) -> io::Result<()> {
    let mut files: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let path = entry.path();
        if path != kept && path.extension().is_some_and(|extension| extension == "slw") {
            let about = entry.metadata()?;
            files.push((about.modified()?, about.len(), path));
        }
    }
    files.sort();
    let mut count = files.len() + 1;
    let mut bytes = files.iter().map(|(_, len, _)| len).sum::<u64>() + fs::metadata(kept)?.len();
    for (_, len, path) in files {
        if count <= files_max && bytes <= bytes_max {
            break;
        }
        fs::remove_file(path)?;
        count -= 1;
        bytes -= len;
    }
    Ok(())
}

fn check(bytes: &[u8], id: ContentId) -> Result<World, ReadError> {
    if content_id(bytes)? != id {
        return Err(ReadError::Damaged);
    }
    World::from_bytes(bytes)
}

#[cfg(test)]
mod tests {
    use std::{cell::Cell, time::Duration};

    use sightline_fixtures::voxel_floor;

    use super::*;

    fn world() -> World {
        voxel_floor::world(&[])
    }

    #[tokio::test]
    async fn a_world_is_fetched_once_and_again_when_its_file_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let bytes = world().to_bytes();
        let id = content_id(&bytes).unwrap();
        let fetches = Cell::new(0);
        let get = async || {
            let cache = WorldCache::new(Some(folder.path().join("worlds")));
            let fetch = async {
                fetches.set(fetches.get() + 1);
                Ok::<_, ReadError>(bytes.clone())
            };
            *cache.get(id, fetch).await.unwrap() == world()
        };
        assert!(get().await && get().await);
        assert_eq!(fetches.get(), 1);
        let path = folder.path().join("worlds").join(format!("{id}.slw"));
        let mut damaged = fs::read(&path).unwrap();
        let middle = damaged.len() / 2;
        damaged[middle] ^= 1;
        fs::write(&path, damaged).unwrap();
        assert!(get().await && get().await);
        assert_eq!(fetches.get(), 2);
    }

    #[test]
    fn the_worlds_that_were_used_longest_ago_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: u64| folder.path().join(format!("{name}.slw"));
        for name in 0..6 {
            fs::write(path(name), [0; 100]).unwrap();
            let used = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000 - name);
            File::options().append(true).open(path(name)).unwrap().set_modified(used).unwrap();
        }
        fs::write(folder.path().join("notes.txt"), [0; 900]).unwrap();
        let left = || (0..6).filter(|name| path(*name).exists()).collect::<Vec<_>>();
        prune(folder.path(), &path(5), 5, 1_000).unwrap();
        assert_eq!(left(), [0, 1, 2, 3, 5], "the oldest but the one that stays");
        prune(folder.path(), &path(5), 5, 350).unwrap();
        assert_eq!(left(), [0, 1, 5]);
        prune(folder.path(), &path(5), 0, 0).unwrap();
        assert_eq!(left(), [5]);
        assert!(folder.path().join("notes.txt").exists());
    }

    #[tokio::test]
    async fn a_world_that_was_not_announced_is_refused() {
        let bytes = world().to_bytes();
        let cache = WorldCache::new(None);
        let fetch = async { Ok::<_, ReadError>(bytes) };
        assert!(matches!(cache.get(ContentId([7; 32]), fetch).await, Err(ReadError::Damaged)));
    }
}
