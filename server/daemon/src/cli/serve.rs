//! The command `sightline-server serve`.

use std::{
    net::SocketAddr,
    path::{Path, PathBuf},
    time::Duration,
};

use anyhow::Context;
use sightline_cli::{log, output, progress::Progress};
use sightline_compiler::CompileOptions;
use sightline_server::{
    building_cache::{BuildingCache, BuildingSource, CachedBuilding},
    net::{Identity, ServeConfig, ServedWorld, Server},
};

/// Serves a world to clients; without a world, a demo building.
///
/// It prints its address and its fingerprint, which clients may check, and serves until Ctrl-C.
/// Clients enter with `sightline-client walk HOST:PORT`.
#[derive(clap::Args)]
pub struct ServeArgs {
    /// The world file, made by `compile`.
    #[arg(value_name = "WORLD.slw")]
    world: Option<PathBuf>,
    /// The address for clients, such as 0.0.0.0:4777; port 0 picks a free port.
    #[arg(long, value_name = "ADDR")]
    listen: Option<SocketAddr>,
    /// A TOML file with settings: listen, tick_hz, clients_max, clients_per_address_max,
    /// horizon_max_ms, validity, shape, sight_test_budget, validity_max_s, threads, hello_s,
    /// silence_s, free_entry, data, world. Flags override it.
    #[arg(long, value_name = "F.toml")]
    config: Option<PathBuf>,
    /// The folder for the certificate and the demo building. By default it is in your home folder.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

/// How often the log shows the state of the server.
const STATUS_INTERVAL: Duration = Duration::from_secs(60);

/// Runs the command.
pub fn run(args: &ServeArgs) -> anyhow::Result<()> {
    log::show_log("info");
    let config = config(args)?;
    let data = match &config.data {
        Some(folder) => folder.clone(),
        None => data_folder()?,
    };
    let identity = Identity::keep(&data)?;
    let world = match &config.world {
        Some(path) => read(path)?,
        None => demo_building(&data)?,
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(serve(world, config, &identity))
}

/// The settings of the file, overridden by those of the flags.
fn config(args: &ServeArgs) -> anyhow::Result<ServeConfig> {
    let mut config = match &args.config {
        Some(path) => {
            let text = std::fs::read_to_string(path)
                .with_context(|| format!("cannot read {}", path.display()))?;
            ServeConfig::from_toml(&text).with_context(|| path.display().to_string())?
        }
        None => ServeConfig::default(),
    };
    config.listen = args.listen.unwrap_or(config.listen);
    config.data = args.data.clone().or(config.data);
    config.world = args.world.clone().or(config.world);
    Ok(config)
}

fn data_folder() -> anyhow::Result<PathBuf> {
    directories::ProjectDirs::from("", "", "sightline")
        .map(|folders| folders.data_dir().to_owned())
        .context("there is no home folder: choose a data folder with --data DIR")
}

fn read(path: &Path) -> anyhow::Result<ServedWorld> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    ServedWorld::from_bytes(bytes).with_context(|| path.display().to_string())
}

/// The demo building, which is compiled once and kept below the data folder.
fn demo_building(data: &Path) -> anyhow::Result<ServedWorld> {
    const ROOMS: usize = 60;
    const SEED: u64 = 1;
    let model = sightline_demo_building::glb(ROOMS, SEED);
    let progress = Progress::new();
    let CachedBuilding { world, source } = BuildingCache::new(&data.join("buildings"))
        .load_or_compile(&model, &CompileOptions::default(), "demo building", &|stage, share| {
            progress.show(stage.name(), share);
        })?;
    progress.finish();
    if let BuildingSource::Compiled { stored } = source {
        output::note(&match stored {
            Ok(path) => format!("compiled the demo building, once, into {}", path.display()),
            Err(error) => format!("the demo building cannot be kept for the next run: {error}"),
        });
    }
    Ok(world)
}

async fn serve(world: ServedWorld, config: ServeConfig, identity: &Identity) -> anyhow::Result<()> {
    let title = world.world().title.clone();
    let mut server = Server::bind(world, config, identity)?;
    output::print(&format!(
        "serving {title:?} on {}\nfingerprint {}\n",
        server.local_addr()?,
        server.fingerprint()
    ))?;
    let mut status = tokio::time::interval(STATUS_INTERVAL);
    status.tick().await;
    loop {
        tokio::select! {
            signal = super::interrupt::ended() => {
                signal?;
                tracing::info!("closing");
                server.shutdown().await;
                return Ok(());
            }
            () = server.failed() => anyhow::bail!("the engine failed: the log above says why"),
            _ = status.tick() => log_status(&server),
        }
    }
}

fn log_status(server: &Server) {
    let stats = server.stats();
    tracing::info!(
        live = stats.counts.live,
        quiet = stats.counts.quiet,
        asked = stats.counts.asked,
        tick_median_us = stats.ticks.median_us,
        tick_p99_us = stats.ticks.p99_us,
        "serving"
    );
}
