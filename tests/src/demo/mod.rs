//! The demo: the real server and real clients over loopback QUIC, in one process.

mod pictures;
mod summary;

use std::{
    path::PathBuf,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc,
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use anyhow::{Context, anyhow};
use sightline_cli::progress::Progress;
use sightline_client::{
    net::{self, Session, Trust},
    swarm::{self, Snapshot},
};
use sightline_compiler::{CompileOptions, compile, import::glb};
use sightline_protocol::text::Name;
use sightline_server::net::{Identity, ServeConfig, ServedWorld, Server};
use sightline_world::{Spawn, World, motion::Pose};
use tokio::runtime::Runtime;

/// How often the truth and what everybody knows of it is written down.
const SNAPSHOT_INTERVAL: Duration = Duration::from_millis(100);

/// The cosine of the angle to each side of one's line of sight within which something is shown.
const AHEAD: f32 = 0.7;

/// What to show.
#[derive(Clone, Debug)]
pub struct DemoOptions {
    /// Simulated visitors.
    pub visitors: usize,
    /// How long they walk.
    pub duration: Duration,
    /// Rooms of the building.
    pub rooms: usize,
    /// Of the building and of the visitors' goals.
    pub seed: u64,
    /// Another building than the demo's.
    pub world: Option<PathBuf>,
    /// Where the pictures go, when there is no window.
    pub pictures: PathBuf,
    /// Whether to open a window where there is a display.
    pub window: bool,
}

/// Builds, serves, walks, and prints the table.
///
/// # Errors
/// When a part of it cannot start.
pub fn run(options: &DemoOptions) -> anyhow::Result<()> {
    let world = match &options.world {
        Some(path) => Arc::new(World::read(path)?),
        None => build(options)?,
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let server = serve(&runtime, &world)?;
    let address = server.local_addr()?;
    let trust = Trust::Pinned(server.fingerprint());
    let you = join(&runtime, address, trust.clone(), &world)?;

    println!("{} visitors walk for {} s", options.visitors, options.duration.as_secs());
    let crowd = Visitors::send(&runtime, address, trust, options)?;
    let frames = show(&you, &crowd, &world, options)?;
    let (snapshots, report) = crowd.end()?;

    let server_stats = server.stats();
    runtime.block_on(async {
        you.leave().await;
        server.shutdown().await;
    });
    summary::print(&world, &snapshots, &report, &server_stats, &frames)
}

/// The demo building, through the same importer and compiler as any other.
fn build(options: &DemoOptions) -> anyhow::Result<Arc<World>> {
    let start = Instant::now();
    let file = sightline_demo_building::glb(options.rooms, options.seed);
    let model = glb::read_slice(&file, None, "demo building")?;
    let progress = Progress::new();
    let (world, report) = compile(&model, &CompileOptions::default(), &|stage, share| {
        progress.show(stage.name(), share);
        std::ops::ControlFlow::Continue(())
    })?;
    progress.finish();
    println!(
        "the demo building: {} rooms, {} cells, {} portals, {} voxels, compiled in {:.1} s",
        options.rooms,
        report.cells,
        report.portals,
        report.octree.voxels,
        start.elapsed().as_secs_f64()
    );
    Ok(Arc::new(world))
}

fn serve(runtime: &Runtime, world: &Arc<World>) -> anyhow::Result<Server> {
    let _inside = runtime.enter();
    let config = ServeConfig { listen: "127.0.0.1:0".parse()?, ..ServeConfig::default() };
    let served = ServedWorld::from_world(world.clone());
    Ok(Server::bind(served, config, &Identity::generate()?)?)
}

/// Your own client, at the spawn point that shows most of the building.
fn join(
    runtime: &Runtime,
    address: std::net::SocketAddr,
    trust: Trust,
    world: &World,
) -> anyhow::Result<Session> {
    let shown = |spawn: &&Spawn| {
        let eye = world.cells.axes.own(spawn.eye);
        let ahead = Pose { yaw: spawn.yaw, ..Pose::default() }.forward();
        let ahead = world.cells.axes.own(spawn.eye + ahead) - eye;
        let visible = world.cells.visible_from_point(spawn.eye);
        let cells = visible.iter().map(|cell| world.cells.cells[cell as usize].bounds.centre());
        cells.filter(|cell| (cell - eye).normalize_or_zero().dot(ahead) > AHEAD).count()
    };
    let place = world.spawns.iter().max_by_key(shown).map(|spawn| spawn.eye);
    let options = net::ConnectOptions {
        name: Name::new("you")?,
        colour: [255, 255, 255],
        place,
        trust,
        progress: None,
    };
    Ok(runtime.block_on(net::Dialer::new(None).connect(address, &options))?)
}

/// Stays until the visitors are done, you leave, or somebody interrupts: in a window where there is
/// a display, else with pictures.
fn show(
    you: &Session,
    crowd: &Visitors,
    world: &World,
    options: &DemoOptions,
) -> anyhow::Result<FrameRate> {
    #[cfg(feature = "desktop")]
    if options.window && sightline_client::desktop::has_display() {
        use sightline_client::desktop::{self, WorldSource};
        println!("your window: WASD and the mouse, F to fly, Enter to chat, Escape to leave");
        let title = "Sightline demo";
        let window =
            desktop::WindowOptions { title, end: None, stop: Some(&crowd.is_over), fuzzy: false };
        let summary = desktop::run(WorldSource::Shared(you), window)?;
        crowd.stop();
        return Ok(FrameRate {
            per_s: summary.frames_per_s(),
            draw_ms: summary.draw_ms,
            size: summary.size,
            note: "in the window",
        });
    }
    pictures::take(you, crowd, world, options)
}

/// How fast the building was drawn.
struct FrameRate {
    per_s: f64,
    draw_ms: f64,
    size: (usize, usize),
    note: &'static str,
}

/// The simulated visitors, on a thread of their own.
struct Visitors {
    thread: JoinHandle<anyhow::Result<swarm::SwarmReport>>,
    stop: mpsc::Sender<()>,
    snapshots: Arc<Mutex<Vec<Snapshot>>>,
    /// Set when they have ended.
    is_over: Arc<AtomicBool>,
}

impl Visitors {
    /// Sends them in. The first error is told when they end.
    fn send(
        runtime: &Runtime,
        address: std::net::SocketAddr,
        trust: Trust,
        options: &DemoOptions,
    ) -> anyhow::Result<Self> {
        let swarm_options = swarm::SwarmOptions {
            seed: options.seed,
            snapshot_interval: SNAPSHOT_INTERVAL,
            ..swarm::SwarmOptions::new(options.visitors, options.duration, trust)
        };
        let snapshots: Arc<Mutex<Vec<Snapshot>>> = Arc::default();
        let is_over = Arc::new(AtomicBool::new(false));
        let (stop, stopped) = mpsc::channel();
        let handle = runtime.handle().clone();
        let thread = thread::Builder::new().name("visitors".into()).spawn({
            let (snapshots, is_over) = (snapshots.clone(), is_over.clone());
            move || {
                let walk = swarm::run(address, &swarm_options, |snapshot| {
                    lock(&snapshots).push(snapshot.clone());
                });
                let report = handle.block_on(async {
                    tokio::select! {
                        report = walk => report.map_err(anyhow::Error::from),
                        () = interrupted(stopped) => Ok(swarm::SwarmReport::default()),
                    }
                });
                is_over.store(true, Relaxed);
                report
            }
        })?;
        Ok(Self { thread, stop, snapshots, is_over })
    }

    /// Asks them to go.
    fn stop(&self) {
        // They may have gone by themselves.
        let _ = self.stop.send(());
    }

    fn has_ended(&self) -> bool {
        self.is_over.load(Relaxed)
    }

    /// Waits for the end. The report is empty when they were interrupted.
    fn end(self) -> anyhow::Result<(Vec<Snapshot>, swarm::SwarmReport)> {
        let report = self.thread.join().map_err(|_| anyhow!("the visitors' thread failed"))??;
        let snapshots = std::mem::take(&mut *lock(&self.snapshots));
        snapshots.first().context("the visitors were stopped before they were in")?;
        Ok((snapshots, report))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Until Ctrl-C, or until somebody asks.
async fn interrupted(stopped: mpsc::Receiver<()>) {
    let mut looks = tokio::time::interval(Duration::from_millis(50));
    loop {
        tokio::select! {
            _ = tokio::signal::ctrl_c() => return,
            _ = looks.tick() => {
                if stopped.try_recv().is_ok() {
                    return;
                }
            }
        }
    }
}
