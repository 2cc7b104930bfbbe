//! The client for browsers: compiles it into `client/web/dist`, which the server embeds beside
//! `client/web/page`.
//!
//! * [`sources`]: the hash of what the client is compiled from, which is kept beside it.
//! * `build`, with the feature `web`: compiles the client. What it needs takes long to compile, so
//!   tests do without.

#[cfg(feature = "web")]
mod build;
#[cfg(feature = "web")]
mod compiler;
mod sources;

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::ensure;

/// The file with the hash of the sources that the client was compiled from.
const SOURCES: &str = "SOURCES";

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Compile nothing: only see whether `client/web/dist` was compiled from these sources.
    #[arg(long)]
    check: bool,
    /// Compile without SIMD, to see what it gives. The client goes to this folder instead.
    #[arg(long, value_name = "FOLDER")]
    without_simd: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let root = root()?;
    let dist = root.join("client/web/dist");
    if args.check {
        return check(&root, &dist);
    }
    #[cfg(feature = "web")]
    return build::build(&root, args.without_simd.as_deref(), &dist);
    #[cfg(not(feature = "web"))]
    anyhow::bail!("xtask was built without the feature web: use `cargo xtask web`");
}

/// The folder of the workspace.
fn root() -> anyhow::Result<PathBuf> {
    Ok(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize()?)
}

/// Fails unless the client was compiled from these sources.
fn check(root: &Path, dist: &Path) -> anyhow::Result<()> {
    let built = fs::read_to_string(dist.join(SOURCES)).unwrap_or_default();
    ensure!(
        built == sources::hash(root)?,
        "client/web/dist was compiled from other sources than these: run `cargo xtask web`, and \
         commit the folder"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_committed_client_was_compiled_from_these_sources() {
        let root = root().unwrap();
        check(&root, &root.join("client/web/dist")).unwrap();
    }
}
