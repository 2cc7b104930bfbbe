//! Lists the files of the page for browsers, which the program carries: the page's own, and the
//! client as it was compiled for it.

use std::{
    env, fs, io,
    path::{Path, PathBuf},
};

/// The folder of the page's own files.
const PAGE: &str = "../../client/web/page";
/// The folder of the compiled client.
const COMPILED: &str = "../../client/web/dist";
/// The kinds of files that belong to the page.
const KINDS: [&str; 6] = ["html", "js", "css", "wasm", "svg", "png"];

fn main() -> io::Result<()> {
    let mut list = "&[\n".to_owned();
    for path in page_files()? {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        list += &format!("    ({name:?}, include_bytes!({path:?})),\n");
    }
    list += "]\n";
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("Cargo sets OUT_DIR"))?;
    fs::write(Path::new(&out).join("page_files.rs"), list)
}

/// The files of the page; none where the client has not been compiled for it.
fn page_files() -> io::Result<Vec<PathBuf>> {
    let (own, compiled) = (files(PAGE)?, files(COMPILED)?);
    Ok(if compiled.is_empty() { compiled } else { [own, compiled].concat() })
}

/// The files in a folder that browsers ask for; none where there is no folder. Cargo runs this
/// program again when the folder changes.
fn files(folder: &str) -> io::Result<Vec<PathBuf>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let watched = if path.exists() { folder } else { "../../client" };
    println!("cargo::rerun-if-changed={watched}");
    let entries = match fs::read_dir(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let paths = entries.map(|entry| entry.map(|entry| entry.path()));
    let mut paths = paths.collect::<io::Result<Vec<_>>>()?;
    paths.retain(|path| path.extension().is_some_and(|kind| KINDS.iter().any(|k| kind == *k)));
    paths.sort();
    Ok(paths)
}
