//! The demo: the real server and real clients over loopback QUIC, in one process.

mod building;
mod live_check;
mod options;
mod pictures;
mod summary;
mod visitors;

use std::{net::SocketAddr, sync::Arc};

use glam::Vec3;
use sightline_client::net::{ConnectOptions, Dialer, Session, Trust};
use sightline_protocol::text::Name;
use sightline_server::net::{Identity, ServeConfig, ServedWorld, Server};
use sightline_world::{Spawn, World, motion::Pose};
use tokio::runtime::Runtime;

use self::{pictures::PictureWatch, summary::Summary, visitors::Visitors};

pub use self::options::DemoOptions;

/// The cosine of half the field of view that counts as ahead when a spawn point is rated.
const AHEAD: f32 = 0.7;

/// Serves a building, lets visitors walk in it, and prints what each client was told.
///
/// # Errors
/// When the building, the server, your client or all visitors fail to start, or a picture cannot
/// be written.
pub fn run(options: &DemoOptions) -> anyhow::Result<()> {
    let building = building::building(options)?;
    let world = building.world().clone();
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let server = serve(&runtime, building)?;
    let address = server.local_addr()?;
    let trust = Trust::Pinned(server.fingerprint());
    // All clients share one download of the world.
    let dialer = Arc::new(Dialer::new(None));
    let you = join(&runtime, &dialer, address, trust.clone(), best_spawn(&world))?;

    println!("{} visitors walk for {} s", options.visitors, options.duration.as_secs());
    let visitors = Visitors::send(&runtime, dialer, address, trust, options)?;
    let shown = show(&you, &visitors, &world, options)?;
    // Before pictures are drawn: idle ticks would dilute the figures.
    let server_stats = server.stats();
    let (snapshots, report) = visitors.end()?;
    runtime.block_on(async {
        you.leave().await;
        server.shutdown().await;
    });
    let frames = match shown {
        #[cfg(feature = "desktop")]
        Shown::Window(frames) => frames,
        Shown::Pictures(watch) => watch.finish(&world, &options.pictures)?,
    };
    Summary::new(&world, &snapshots, &report)?.print(&report, &server_stats, &frames);
    Ok(())
}

fn serve(runtime: &Runtime, building: ServedWorld) -> anyhow::Result<Server> {
    let _inside = runtime.enter();
    let config = ServeConfig { listen: "127.0.0.1:0".parse()?, ..ServeConfig::default() };
    Ok(Server::bind(building, config, &Identity::generate()?)?)
}

/// The spawn point from which most cells ahead are potentially visible.
fn best_spawn(world: &World) -> Option<Vec3> {
    let cells_ahead = |spawn: &&Spawn| {
        let eye = world.cells.axes.own(spawn.eye);
        let forward = Pose { yaw: spawn.yaw, ..Pose::default() }.forward();
        let forward = world.cells.axes.own(spawn.eye + forward) - eye;
        let visible = world.cells.visible_from_point(spawn.eye);
        let centres = visible.iter().map(|cell| world.cells.cells[cell as usize].bounds.centre());
        centres.filter(|centre| (centre - eye).normalize_or_zero().dot(forward) > AHEAD).count()
    };
    world.spawns.iter().max_by_key(cells_ahead).map(|spawn| spawn.eye)
}

/// Connects your own client.
fn join(
    runtime: &Runtime,
    dialer: &Dialer,
    address: SocketAddr,
    trust: Trust,
    place: Option<Vec3>,
) -> anyhow::Result<Session> {
    let options = ConnectOptions {
        name: Name::new("you")?,
        colour: [255, 255, 255],
        place,
        trust,
        identity: Arc::new(Identity::generate()?),
        invitation: None,
        in_pieces: false,
        progress: None,
    };
    Ok(runtime.block_on(dialer.connect(address, &options))?)
}

/// How the walk was shown.
enum Shown {
    /// In a window, at this frame rate.
    #[cfg(feature = "desktop")]
    Window(summary::FrameRate),
    /// Without a window: pictures are still to be drawn.
    Pictures(PictureWatch),
}

/// Shows the walk in a window where there is a display, else watches it for pictures. Returns when
/// the visitors are done, you leave, or somebody interrupts.
fn show(
    you: &Session,
    visitors: &Visitors,
    world: &Arc<World>,
    options: &DemoOptions,
) -> anyhow::Result<Shown> {
    #[cfg(feature = "desktop")]
    if options.window && sightline_client::desktop::has_display() {
        use sightline_client::desktop::{self, WindowOptions, WorldSource};
        println!("your window: WASD and the mouse, F1 for the keys, Escape to leave");
        let stop = Some(visitors.is_over());
        let window = WindowOptions { title: "Sightline demo", stop, ..WindowOptions::default() };
        let summary = desktop::run(WorldSource::Shared(you), window)?;
        visitors.stop();
        return Ok(Shown::Window(summary::FrameRate {
            per_s: summary.frames_per_s(),
            draw_ms: summary.draw_ms,
            size: summary.size,
            note: "in the window",
        }));
    }
    Ok(Shown::Pictures(PictureWatch::new(you, visitors, world, options.duration)))
}
