//! The command `sightline-server serve`.

use std::{
    io::Read,
    net::SocketAddr,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::Duration,
};

use anyhow::{Context, ensure};
use sightline_cli::{
    flags::listen_address,
    log::{self, LogFormat},
    output,
};
use sightline_compiler::CompileOptions;
use sightline_server::{
    building_cache::BuildingCache,
    building_files::BuildingSource,
    bus::{Bus, BusOptions},
    net::{HttpAddress, Identity, ServeConfig, Server, WebAddress},
    supply::{Supplied, Supply, SupplyError, SupplyNews},
};
use sightline_world::is_world_file;
use tokio::sync::oneshot;

use super::{joining::how_to_join, model_flags::ModelFlags, news::Newsreader};

/// Serves a building to clients; without one, a demo building.
///
/// A .glb, .gltf or .bsp is compiled, quickly at first and then finely, and kept for the next
/// start. People join by the link that it prints, in a browser, or with `sightline-client walk
/// HOST:PORT`. It serves until Ctrl-C, on one port: UDP for clients, TCP for pages.
#[derive(clap::Args)]
pub struct ServeArgs {
    /// The building: a .glb, .gltf or .bsp, or a world (.slw) made by `compile`.
    #[arg(value_name = "BUILDING")]
    world: Option<PathBuf>,
    /// The UDP address for clients: a port, or an address and a port, such as 4777 or
    /// localhost:4777. Port 0 picks a free one. By default [::]:4777, which is every address of
    /// this machine.
    #[arg(long, value_name = "ADDR", value_parser = listen_address)]
    listen: Option<SocketAddr>,
    /// The TCP address for operators: a port of this machine's own address, an address and a port,
    /// or off. It has a live page, metrics for Prometheus at /metrics, health at /healthz, and no
    /// password. By default 127.0.0.1:4778.
    #[arg(long, value_name = "ADDR")]
    http: Option<HttpAddress>,
    /// Where browsers find the page: same (the port number for clients, by TCP), a port, an address
    /// and a port, or off. By default same.
    #[arg(long, value_name = "ADDR")]
    web: Option<WebAddress>,
    /// The certificate for browsers on the open internet and its key, in PEM. Pages then come by
    /// HTTPS. The files are read again when they change.
    #[arg(long, num_args = 2, value_names = ["CERT.pem", "KEY.pem"])]
    tls: Option<Vec<PathBuf>>,
    /// Share the building with other servers, over a NATS server: their visitors meet. All serve the
    /// same world file. They share bans, mutes, roles and names if NATS has JetStream
    /// (nats-server -js).
    #[arg(long, value_name = "nats://HOST:PORT")]
    bus: Option<String>,
    /// A file of NATS credentials for the bus.
    #[arg(long, value_name = "FILE")]
    bus_creds: Option<PathBuf>,
    /// Where visitors of the other servers on the bus reach this one when theirs is lost. By
    /// default the address to listen on, if it is a certain one.
    #[arg(long, value_name = "IP:PORT")]
    bus_address: Option<SocketAddr>,
    /// Compile the building again whenever its files change, and move visitors over.
    #[arg(long)]
    watch: bool,
    /// A TOML file with settings and limits. `--print-config` shows all of them. Flags override it.
    #[arg(long, value_name = "F.toml")]
    config: Option<PathBuf>,
    /// Print all settings and limits with their comments, ranges and worst-case memory, and end.
    /// What is printed can be the file for --config.
    #[arg(long)]
    print_config: bool,
    /// The folder for the certificate, the database of visitors, compiled buildings and their
    /// pieces. By default it is in your home folder.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// How the log on stderr is written: as lines for people, or as one JSON object a line.
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = LogFormat::Text)]
    log: LogFormat,
    #[command(flatten)]
    model: ModelFlags,
}

/// How often the log shows the state of the server.
const STATUS_INTERVAL: Duration = Duration::from_secs(60);
/// How long the supply may take to end. It is not waited for longer.
const SUPPLY_PATIENCE: Duration = Duration::from_millis(700);

/// Runs the command.
pub fn run(args: &ServeArgs) -> anyhow::Result<()> {
    let mut config = config(args)?;
    if args.print_config {
        return output::print(&config.to_toml());
    }
    log::show_log("info", args.log);
    let data = match config.data.take() {
        Some(folder) => folder,
        None => data_folder()?,
    };
    config.data = Some(data.clone());
    let supplied = supplied(args, config.world.as_deref(), &data)?;
    let identity = Identity::keep(&data)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(serve(supplied, args, config, &data, &identity))
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
    config.http = args.http.unwrap_or(config.http);
    config.web = args.web.unwrap_or(config.web);
    if let Some([certificate, key]) = args.tls.as_deref() {
        config.tls_certificate = Some(certificate.clone());
        config.tls_key = Some(key.clone());
    }
    config.listen = args.listen.unwrap_or(config.listen);
    config.bus = args.bus.clone().or(config.bus);
    config.bus_credentials = args.bus_creds.clone().or(config.bus_credentials);
    config.bus_address = args.bus_address.or(config.bus_address);
    config.data = args.data.clone().or(config.data);
    config.world = args.world.clone().or(config.world);
    Ok(config)
}

pub(super) fn data_folder() -> anyhow::Result<PathBuf> {
    directories::ProjectDirs::from("", "", "sightline")
        .map(|folders| folders.data_dir().to_owned())
        .context("there is no home folder: choose a data folder with --data DIR")
}

/// What is served: a world as it is, or a building to compile.
fn supplied(args: &ServeArgs, path: Option<&Path>, data: &Path) -> anyhow::Result<Supplied> {
    let cache = BuildingCache::new(&data.join("buildings"));
    let Some(path) = path else {
        ensure!(!args.watch, "--watch needs a building: the demo building does not change");
        ensure!(!args.model.are_given(), "flags about a model need one: name its file");
        return Ok(demo_building(cache));
    };
    let mut begins = Vec::new();
    let file = std::fs::File::open(path);
    file.and_then(|file| file.take(64).read_to_end(&mut begins))
        .with_context(|| format!("cannot read {}", path.display()))?;
    if is_world_file(&begins) || path.extension().is_some_and(|extension| extension == "slw") {
        ensure!(
            !args.model.are_given(),
            "{} is a world, which is compiled already: leave out the flags about models",
            path.display()
        );
        return Ok(Supplied::World(path.to_owned()));
    }
    let source = BuildingSource::Files(args.model.files(path));
    Ok(Supplied::Building { source, options: args.model.options(), cache })
}

/// The demo building.
fn demo_building(cache: BuildingCache) -> Supplied {
    const ROOMS: usize = 60;
    const SEED: u64 = 1;
    let bytes = sightline_demo_building::glb(ROOMS, SEED);
    let source = BuildingSource::Glb { bytes, title: "demo building".to_owned() };
    Supplied::Building { source, options: CompileOptions::default(), cache }
}

async fn serve(
    supplied: Supplied,
    args: &ServeArgs,
    config: ServeConfig,
    data: &Path,
    identity: &Identity,
) -> anyhow::Result<()> {
    let (http, web, limits) = (config.http, config.web, config.limits.clone());
    tracing::info!("{}", config.cost());
    let mut server = start(config, identity).await?;
    output::print(&how_to_join(&server)?)?;
    let _browsers = super::browsers::listen(&server, web)?;
    let _operators = super::operators::listen(&server, http, &limits, data).await?;
    let ends = Arc::new(AtomicBool::new(false));
    let mut supply = start_supply(supplied, args, &server, ends.clone())?;
    let mut is_supplied = false;
    let mut status = tokio::time::interval(STATUS_INTERVAL);
    status.tick().await;
    let mut ended = std::pin::pin!(super::interrupt::ended());
    loop {
        tokio::select! {
            signal = &mut ended => {
                signal?;
                tracing::info!("closing");
                ends.store(true, Relaxed);
                server.shutdown().await;
                if !is_supplied {
                    let _ = tokio::time::timeout(SUPPLY_PATIENCE, supply).await;
                }
                return Ok(());
            }
            outcome = &mut supply, if !is_supplied => {
                is_supplied = true;
                if let Err(error) = outcome.context("compiling failed: the log above says why")? {
                    server.shutdown().await;
                    return Err(error.into());
                }
            }
            () = server.failed() => anyhow::bail!("the engine failed: the log above says why"),
            _ = status.tick() => log_status(&server),
        }
    }
}

/// Starts the server, on its bus if there is one.
async fn start(config: ServeConfig, identity: &Identity) -> anyhow::Result<Server> {
    let Some(url) = config.bus.clone() else { return Ok(Server::listen(config, identity)?) };
    let credentials = config.bus_credentials.clone();
    let bus = Bus::connect(&BusOptions { url, credentials }).await?;
    tracing::info!(station = bus.station().0, "on the bus");
    Ok(Server::listen_on_bus(config, identity, bus)?)
}

/// Starts the supply on a thread of its own. Its outcome arrives when it ends.
fn start_supply(
    supplied: Supplied,
    args: &ServeArgs,
    server: &Server,
    ends: Arc<AtomicBool>,
) -> anyhow::Result<oneshot::Receiver<Result<(), SupplyError>>> {
    let (send, receive) = oneshot::channel();
    let (watches, log, changer) = (args.watch, args.log, server.world_changer());
    std::thread::Builder::new().name("supply".into()).spawn(move || {
        let reader = Newsreader::new(changer.clone(), log);
        let tell = &|news: SupplyNews<'_>| reader.hear(&news);
        let outcome = Supply { supplied, watches, changer, ends: &ends, tell }.run();
        reader.finish();
        let _ = send.send(outcome);
    })?;
    Ok(receive)
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
