//! Writing a file whole or not at all.

use std::{fs, io, path::Path};

/// Writes a file whole or not at all: first under another name, which then replaces the old file. A
/// crash leaves either the old file or the new one.
///
/// Symbolic links are followed. Whatever exists at the path and is not a file, such as a device, is
/// left alone.
///
/// # Errors
/// When the file system refuses, or the path exists and is not a file.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let path = &fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if fs::metadata(path).is_ok_and(|there| !there.is_file()) {
        return Err(io::Error::other("the path exists and is not a file"));
    }
    let mut partial = path.as_os_str().to_owned();
    partial.push(format!(".{}.partial", std::process::id()));
    let partial = Path::new(&partial);
    fs::write(partial, bytes).and_then(|()| fs::rename(partial, path)).inspect_err(|_| {
        // The first error is the one to report.
        let _ = fs::remove_file(partial);
    })
}
