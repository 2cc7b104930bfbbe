//! Folders of files that can be made again, of which those that were used last are kept.

use std::{
    fs, io,
    path::{Path, PathBuf},
    time::SystemTime,
};

/// The hash of the program's own bytes. What is kept by it was never made by another version.
///
/// # Errors
/// When the program's file cannot be read.
pub(crate) fn program() -> io::Result<blake3::Hash> {
    Ok(blake3::hash(&fs::read(std::env::current_exe()?)?))
}

/// A hash of hashes. No two lists of parts run together.
pub(crate) fn joined(hashes: &[blake3::Hash]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    hashes.iter().for_each(|hash| {
        hasher.update(hash.as_bytes());
    });
    hasher.finalize()
}

/// Takes in that a file was used now. A folder that cannot be written still serves.
pub(crate) fn used(path: &Path) {
    let file = fs::File::options().write(true).open(path);
    let _ = file.and_then(|file| file.set_modified(SystemTime::now()));
}

/// Removes files with an extension from a folder, those that were used least recently, until there
/// are no more than `most`.
///
/// # Errors
/// When the file system refuses.
pub(crate) fn prune(folder: &Path, extension: &str, most: usize) -> io::Result<()> {
    let mut files: Vec<(SystemTime, PathBuf)> = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.path().extension().is_some_and(|found| found == extension) {
            files.push((entry.metadata()?.modified()?, entry.path()));
        }
    }
    files.sort();
    let excess = files.len().saturating_sub(most);
    files.iter().take(excess).try_for_each(|(_, path)| fs::remove_file(path))
}
