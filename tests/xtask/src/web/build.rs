//! Compiles the client for browsers, and makes the script by which the page calls it.

use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, ensure};
use flate2::{Compression, write::GzEncoder};
use wasm_bindgen_cli_support::Bindgen;

use super::{SOURCES, compiler::Compiler, sources};

/// The most bytes of all files of the page together, compressed as servers and proxies do.
const PACKED_BYTES_MAX: usize = 1_500_000;

/// Compiles the client into `dist`, or without SIMD into another folder.
pub(super) fn build(root: &Path, without_simd: Option<&Path>, dist: &Path) -> anyhow::Result<()> {
    let target = without_simd.unwrap_or(dist);
    let program = Compiler::find()?.build(root, without_simd.is_none())?;
    if target.exists() {
        fs::remove_dir_all(target)?;
    }
    fs::create_dir_all(target)?;
    Bindgen::new()
        .input_path(&program)
        .web(true)?
        .typescript(false)
        .remove_name_section(true)
        .remove_producers_section(true)
        .generate(target)?;
    optimise(&target.join("sightline_web_bg.wasm"))?;
    fs::write(target.join(SOURCES), sources::hash(root)?)?;
    report(&[&root.join("client/web/page"), target])
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

/// Prints the size of each file of the page and of all together.
fn report(folders: &[&Path]) -> anyhow::Result<()> {
    let mut all = 0;
    let mut files: Vec<PathBuf> = Vec::new();
    for folder in folders {
        for file in fs::read_dir(folder)? {
            files.push(file?.path());
        }
    }
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
