//! The page for browsers: builds `client/web/dist`, which the server embeds.
//!
//! * [`compiler`]: which toolchain compiles for WebAssembly on this machine.
//! * [`sources`]: the hash of what the page is built from, which is kept beside it.

mod compiler;
mod sources;

use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, ensure};
use flate2::{Compression, write::GzEncoder};
use wasm_bindgen_cli_support::Bindgen;

use self::compiler::Compiler;

/// The most bytes of all files together, compressed as servers and proxies do.
const PACKED_BYTES_MAX: usize = 1_500_000;
/// The hash of the sources that the page was built from.
const SOURCES: &str = "SOURCES";

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Build nothing: only see whether the page was built from these sources.
    #[arg(long)]
    check: bool,
    /// Build without SIMD, to see what it gives. The page goes to this folder instead.
    #[arg(long, value_name = "FOLDER")]
    without_simd: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let root = root()?;
    let dist = root.join("client/web/dist");
    if args.check {
        return check(&root, &dist);
    }
    let target = args.without_simd.clone().unwrap_or_else(|| dist.clone());
    let program = Compiler::find()?.build(&root, args.without_simd.is_none())?;
    if target.exists() {
        fs::remove_dir_all(&target)?;
    }
    fs::create_dir_all(&target)?;
    Bindgen::new()
        .input_path(&program)
        .web(true)?
        .typescript(false)
        .remove_name_section(true)
        .remove_producers_section(true)
        .generate(&target)?;
    optimise(&target.join("sightline_web_bg.wasm"))?;
    let page = root.join("client/web/page");
    for file in fs::read_dir(&page)? {
        let file = file?;
        fs::copy(file.path(), target.join(file.file_name()))?;
    }
    fs::write(target.join(SOURCES), sources::hash(&root)?)?;
    report(&target)
}

/// The folder of the workspace.
fn root() -> anyhow::Result<PathBuf> {
    Ok(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize()?)
}

/// Fails unless the page was built from these sources.
fn check(root: &Path, dist: &Path) -> anyhow::Result<()> {
    let built = fs::read_to_string(dist.join(SOURCES)).unwrap_or_default();
    ensure!(
        built == sources::hash(root)?,
        "client/web/dist was built from other sources than these: run `cargo xtask web`, and commit \
         the folder"
    );
    Ok(())
}

/// Lets Binaryen make a program faster and smaller, where it is installed.
fn optimise(program: &Path) -> anyhow::Result<()> {
    let better = program.with_extension("optimised");
    let optimiser = Command::new("wasm-opt")
        .args(["-O3", "--enable-simd", "--enable-bulk-memory", "--enable-sign-ext"])
        .args(["--enable-nontrapping-float-to-int", "--enable-mutable-globals"])
        .args(["--enable-reference-types", "--enable-multivalue"])
        .arg(program)
        .arg("-o")
        .arg(&better)
        .status();
    match optimiser {
        Ok(status) if status.success() => fs::rename(&better, program)?,
        Ok(_) => println!("wasm-opt does not understand the program, which stays as it is"),
        Err(_) => println!("wasm-opt is not installed: the program stays as it is"),
    }
    Ok(())
}

/// Prints the size of each file and of all together.
fn report(folder: &Path) -> anyhow::Result<()> {
    let mut all = 0;
    let mut files: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|file| Ok(file?.path())).collect::<anyhow::Result<_>>()?;
    files.sort();
    for file in files {
        let bytes = fs::read(&file)?;
        let mut packer = GzEncoder::new(Vec::new(), Compression::best());
        packer.write_all(&bytes)?;
        let packed = packer.finish()?.len();
        let name = file.file_name().context("files have names")?.to_string_lossy();
        println!("{name:<24} {:>9} bytes, {packed:>8} compressed", bytes.len());
        all += packed;
    }
    println!("{:<24} {:>9}        {all:>8} compressed", "all", "");
    ensure!(all <= PACKED_BYTES_MAX, "a page may take {PACKED_BYTES_MAX} bytes at most");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_committed_page_was_built_from_these_sources() {
        let root = root().unwrap();
        check(&root, &root.join("client/web/dist")).unwrap();
    }
}
