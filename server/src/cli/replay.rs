//! `sightline-server replay`.

/// Runs the engine over a recorded trace, without sockets.
#[derive(clap::Args)]
pub struct Args {}

/// Runs the command.
pub fn run(_args: &Args) -> anyhow::Result<()> {
    anyhow::bail!("not built yet")
}
