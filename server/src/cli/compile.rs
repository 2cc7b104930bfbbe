//! `sightline-server compile`.

/// Makes a world (.slw) of a building (.glb, .gltf or a Quake III .bsp).
#[derive(clap::Args)]
pub struct Args {}

/// Runs the command.
pub fn run(_args: &Args) -> anyhow::Result<()> {
    anyhow::bail!("not built yet")
}
