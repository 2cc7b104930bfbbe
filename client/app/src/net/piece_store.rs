//! Pieces on disk, by content id: those of one version of a world serve another one, too.

use std::{
    fs, io,
    path::{Path, PathBuf},
    time::SystemTime,
};

use sightline_world::PieceId;

/// The most bytes of all pieces on disk: 1 GiB. Beyond it, those that were stored first are
/// removed.
const BYTES_MAX: u64 = 1 << 30;

/// A folder of pieces. Damaged files count as missing.
#[derive(Clone, Debug)]
pub(super) struct PieceStore {
    folder: PathBuf,
}

impl PieceStore {
    /// The store in a folder, which is made when the first piece is kept.
    pub(super) fn new(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// The piece of an id, if it is here.
    pub(super) fn load(&self, id: PieceId) -> Option<Vec<u8>> {
        let piece = fs::read(self.path(id)).ok()?;
        (PieceId::of(&piece) == id).then_some(piece)
    }

    /// Keeps a piece. Where that fails, it is fetched again another time.
    pub(super) fn keep(&self, id: PieceId, piece: &[u8]) {
        let path = self.path(id);
        let folder_made = path.parent().map_or(Ok(()), fs::create_dir_all);
        // A file that is cut short by a crash is found by its id to be damaged.
        if let Err(error) = folder_made.and_then(|()| fs::write(&path, piece)) {
            tracing::debug!(path = %path.display(), %error, "a piece cannot be stored");
        }
    }

    /// Removes those that were stored first, as far as all of them take more than they may.
    pub(super) fn prune(&self) {
        if let Err(error) = self.prune_to(BYTES_MAX) {
            tracing::debug!(%error, "old pieces cannot be removed");
        }
    }

    fn prune_to(&self, bytes_max: u64) -> io::Result<()> {
        let mut files: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
        for folder in entries(&self.folder)? {
            for path in entries(&folder)? {
                let about = fs::metadata(&path)?;
                files.push((about.modified()?, about.len(), path));
            }
        }
        files.sort();
        let mut bytes: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, own, path) in files {
            if bytes <= bytes_max {
                break;
            }
            fs::remove_file(path)?;
            bytes -= own;
        }
        Ok(())
    }

    /// No folder gets too many files.
    fn path(&self, id: PieceId) -> PathBuf {
        let name = id.to_string();
        self.folder.join(name.get(..2).unwrap_or_default()).join(name)
    }
}

/// What is in a folder; nothing when there is none.
fn entries(folder: &Path) -> io::Result<Vec<PathBuf>> {
    match fs::read_dir(folder) {
        Ok(entries) => entries.map(|entry| Ok(entry?.path())).collect(),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_kept_until_they_are_damaged_or_there_are_too_many() {
        let folder = tempfile::tempdir().unwrap();
        let store = PieceStore::new(folder.path().join("pieces"));
        store.prune();
        let pieces: Vec<Vec<u8>> = (0..6u8).map(|i| vec![i; 100]).collect();
        let id = |i: usize| PieceId::of(&pieces[i]);
        for (i, piece) in pieces.iter().enumerate() {
            assert_eq!(store.load(id(i)), None);
            store.keep(id(i), piece);
            assert_eq!(store.load(id(i)).as_ref(), Some(piece));
            let at = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(i as u64);
            let file = fs::File::options().write(true).open(store.path(id(i))).unwrap();
            file.set_modified(at).unwrap();
        }
        fs::write(store.path(id(5)), &pieces[5][..50]).unwrap();
        assert_eq!(store.load(id(5)), None, "damaged");
        store.prune_to(350).unwrap();
        let kept: Vec<bool> = (0..5).map(|i| store.load(id(i)).is_some()).collect();
        assert_eq!(kept, [false, false, true, true, true]);
    }
}
