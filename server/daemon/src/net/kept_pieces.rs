//! The pieces of worlds on disk, so that a server that starts again offers them at once.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use sightline_world::{ContentId, write_whole};

use super::served_pieces::ServedPieces;
use crate::kept_files;

/// The worlds of which pieces are kept, those that were used last: about a quarter more bytes each
/// than the file of the world has.
const WORLDS_MAX: usize = 8;

/// A folder with the pieces of worlds, one file for each world and program.
#[derive(Clone, Debug)]
pub struct KeptPieces {
    folder: PathBuf,
    /// Whether they are those of private geometry.
    is_private: bool,
}

impl KeptPieces {
    /// Those in a server's data folder, of private geometry or not.
    pub fn new(data: &Path, is_private: bool) -> Self {
        Self { folder: data.join("pieces"), is_private }
    }

    /// The pieces of a world. `None` when they are not there, or damaged: then it has to be cut.
    pub fn load(&self, world: &ContentId) -> Option<ServedPieces> {
        let path = self.path(world).ok()?;
        let pieces = ServedPieces::from_block(fs::read(&path).ok()?.into())?;
        kept_files::used(&path);
        Some(pieces)
    }

    /// Stores the pieces of a world. Those that were used least recently are removed.
    ///
    /// # Errors
    /// When the file system refuses.
    pub fn store(&self, world: &ContentId, pieces: &ServedPieces) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        write_whole(&self.path(world)?, pieces.block())?;
        kept_files::prune(&self.folder, "slp", WORLDS_MAX)
    }

    fn path(&self, world: &ContentId) -> io::Result<PathBuf> {
        let parts = [kept_files::program()?, blake3::Hash::from_bytes(world.0)];
        let kind = if self.is_private { "private" } else { "world" };
        let key = kept_files::joined(&parts).to_hex();
        Ok(self.folder.join(format!("{kind}-{}.slp", &key[..16])))
    }
}
