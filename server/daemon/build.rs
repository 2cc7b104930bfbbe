//! Lists the files of the page for browsers, which the program carries.

use std::{
    env, fs, io,
    path::{Path, PathBuf},
};

/// The kinds of files that belong to the page.
const KINDS: [&str; 6] = ["html", "js", "css", "wasm", "svg", "png"];

fn main() -> io::Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../client/web/dist");
    let watched = if folder.exists() { "../../client/web/dist" } else { "../../client" };
    println!("cargo::rerun-if-changed={watched}");
    let mut list = "&[\n".to_owned();
    for path in files(&folder)? {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        list += &format!("    ({name:?}, include_bytes!({path:?})),\n");
    }
    list += "]\n";
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("Cargo sets OUT_DIR"))?;
    fs::write(Path::new(&out).join("page_files.rs"), list)
}

/// The files of the page; none where it has not been built.
fn files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let paths = entries.map(|entry| entry.map(|entry| entry.path()));
    let mut paths = paths.collect::<io::Result<Vec<_>>>()?;
    paths.retain(|path| path.extension().is_some_and(|kind| KINDS.iter().any(|k| kind == *k)));
    paths.sort();
    Ok(paths)
}
