//! `sightline-client swarm`.

/// Sends simulated visitors to a server, and reports what they received.
#[derive(clap::Args)]
pub struct Args {}

/// Runs the command.
pub fn run(_args: &Args) -> anyhow::Result<()> {
    anyhow::bail!("not built yet")
}
