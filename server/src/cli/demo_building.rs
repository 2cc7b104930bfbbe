//! `sightline-server demo-building`.

/// Writes the demo building, of any size, as a GLB.
#[derive(clap::Args)]
pub struct Args {}

/// Runs the command.
pub fn run(_args: &Args) -> anyhow::Result<()> {
    anyhow::bail!("not built yet")
}
