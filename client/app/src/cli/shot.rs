//! `sightline-client shot`.

use std::{
    path::PathBuf,
    sync::Arc,
    time::{Duration, Instant},
};

use anyhow::{bail, ensure};
use glam::Vec3;
use sightline_cli::{
    files::{check_output, read_world},
    flags::{point, time},
    output,
    progress::Progress,
};
use sightline_renderer::{
    Camera, Frame, Renderer,
    mover_visibility::MoverVisibility,
    movers,
    node_visibility::{self, NodeVisibility, VoxelOccluders},
    rooms::RoomWireframes,
};
use sightline_visibility::rooms::{BuildingSight, RoomIndex};
use sightline_world::{Mover, World, motion::Pose, rooms::Rooms};

use super::{
    flags::{self, ModeFlag, PathFlags},
    picture::{self, FRAMES_MAX, FrameFiles},
};

/// Draws a picture of a world as a PNG, or a film as many PNGs.
///
/// A film follows a path. `shot house.slw --frames 240 -o film/` walks through the building. `shot
/// house.slw --path trace.csv --frames 600 -o film-%04d.png` looks through the eyes of a recorded
/// avatar.
#[derive(clap::Args)]
pub struct Args {
    /// The world file (.slw).
    world: PathBuf,
    /// The position of the eye, in metres; when absent, a spawn point.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    eye: Option<Vec3>,
    /// A point to look at, in metres; when absent, straight ahead.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    look: Option<Vec3>,
    /// The spawn point to stand at, from 0.
    #[arg(long, value_name = "N", default_value_t = 0, conflicts_with = "eye")]
    spawn: usize,
    /// The size of the picture, in pixels.
    #[arg(long, value_name = "WxH", value_parser = flags::size, default_value = "960x540")]
    size: (usize, usize),
    /// Smooth edges (antialiasing). Drawing takes more than twice as long.
    #[arg(long)]
    aa: bool,
    /// Draw rooms as wire frames, with their names and windows.
    #[arg(long)]
    rooms: bool,
    /// Draw what rooms hide from the eye, too. It makes no difference where no room has a set or a
    /// window.
    #[arg(long)]
    hidden: bool,
    /// The vertical field of view, in degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = Camera::FOV_Y.to_degrees())]
    fov: f32,
    /// The time on the server's clock, in seconds: doors and lifts move by it. A film begins at
    /// this time.
    #[arg(long, value_name = "S", value_parser = time, default_value = "0")]
    time: Duration,
    #[command(flatten)]
    path: PathFlags,
    /// Draw a film of this many frames, at equal intervals along the path.
    #[arg(long, value_name = "N", conflicts_with_all = ["eye", "look", "spawn"])]
    frames: Option<usize>,
    /// Leave out the nodes that cannot be seen from a box around the eye. The picture is the same.
    /// The reported time excludes finding those nodes; `bench --fuzzy` measures it.
    #[arg(long)]
    fuzzy: bool,
    /// How the building is drawn. The picture is the same.
    #[arg(long, value_name = "MODE", value_enum, default_value_t)]
    mode: ModeFlag,
    /// The file to write: for a film, a folder or a pattern such as film-%04d.png.
    #[arg(short, long, value_name = "OUT.png")]
    output: PathBuf,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    ensure!((1.0..=170.0).contains(&args.fov), "--fov must be between 1 and 170 degrees");
    let frames = args.frames.unwrap_or(1);
    ensure!((1..=FRAMES_MAX).contains(&frames), "--frames must be between 1 and {FRAMES_MAX}");
    ensure!(
        args.frames.is_some() || !args.path.is_named(),
        "--path makes a film: give --frames too"
    );
    if args.frames.is_none() {
        check_output(&args.output)?;
    }
    let world = read_world(&args.world)?;
    match args.frames {
        Some(frames) => film(args, &world, frames),
        None => picture(args, &world),
    }
}

fn picture(args: &Args, world: &World) -> anyhow::Result<()> {
    let (width, height) = args.size;
    let mut frame = Frame::new(width, height);
    let camera = camera(args, world)?;
    let rooms = rooms(args, world);
    let mut scene = ShotRenderer::new(args, world, &rooms)?;
    let movers = world.movers.iter().collect();
    let milliseconds = scene.draw(camera, movers, args.time, &mut frame);
    picture::save(&args.output, &[(width, &frame.colour)])?;
    let output = args.output.display();
    output::print(&format!("{output}: {width} × {height}, drawn in {milliseconds:.1} ms\n"))
}

fn film(args: &Args, world: &World, frames: usize) -> anyhow::Result<()> {
    let (path, from, until) = args.path.read(world)?;
    let frame_files = FrameFiles::new(&args.output)?;
    let (width, height) = args.size;
    let (rooms, fov_y) = (rooms(args, world), args.fov.to_radians());
    let mut scene = ShotRenderer::new(args, world, &rooms)?;
    let mut frame = Frame::new(width, height);
    let (mut mover_visibility, mut drawn) = (MoverVisibility::new(args.size, fov_y), 0);
    let progress = Progress::new();
    let mut total = 0.0;
    for (i, (seconds, pose)) in path.frames_between(from, until, frames).enumerate() {
        let now = args.time + Duration::from_secs_f64(seconds - from);
        let movers = mover_visibility.movers(world, &rooms, &pose);
        drawn += movers.len();
        total += scene.draw(Camera::at(&pose), movers, now, &mut frame);
        picture::save(&frame_files.frame(i), &[(width, &frame.colour)])?;
        progress.show("frames", (i + 1) as f32 / frames as f32);
    }
    progress.finish();
    let movers = match world.movers.len() {
        0 => String::new(),
        all => format!(
            ", on average {:.1} of {all} movers, found with {} visibility sets",
            drawn as f64 / frames as f64,
            mover_visibility.sets_made()
        ),
    };
    output::print(&format!(
        "{} to {}: {width} × {height}, {:.1} s of the path, {:.1} ms per frame{movers}\n",
        frame_files.frame(0).display(),
        frame_files.frame(frames - 1).display(),
        until - from,
        total / frames as f64
    ))
}

/// The rooms that hide something: none where what they hide is drawn, too.
fn rooms(args: &Args, world: &World) -> RoomIndex {
    if args.hidden { RoomIndex::of(&Rooms::default(), &world.cells) } else { RoomIndex::new(world) }
}

/// Draws the pictures of one run.
struct ShotRenderer<'a> {
    world: &'a World,
    /// The rooms that hide something.
    rooms: &'a RoomIndex,
    renderer: Renderer,
    wires: Option<RoomWireframes>,
    /// The occluders for finding hidden nodes, if asked for.
    walls: Option<VoxelOccluders>,
    fov_y: f32,
}

impl<'a> ShotRenderer<'a> {
    fn new(args: &Args, world: &'a World, rooms: &'a RoomIndex) -> anyhow::Result<Self> {
        let mut renderer = Renderer::default();
        renderer.antialias = args.aa;
        renderer.mode = args.mode.into();
        let wires = args.rooms.then(|| RoomWireframes::new(world));
        let walls = args.fuzzy.then(|| VoxelOccluders::new(&world.octree)).transpose()?;
        Ok(Self { world, rooms, renderer, wires, walls, fov_y: args.fov.to_radians() })
    }

    /// Draws a picture. Returns the milliseconds spent on the building.
    fn draw(
        &mut self,
        camera: Camera,
        mut movers: Vec<&Mover>,
        now: Duration,
        frame: &mut Frame,
    ) -> f64 {
        let camera = Camera { fov_y: self.fov_y, ..camera };
        if let Some(walls) = &self.walls {
            let known =
                self.renderer.node_visibility.take().filter(|it| it.eyes().contains(camera.eye));
            let find =
                |eyes| Arc::new(NodeVisibility::new(walls, eyes, camera.focal(frame.height())));
            let eyes = node_visibility::boxes_ahead(camera.eye, Vec3::ZERO).into_iter().next();
            self.renderer.node_visibility = known.or_else(|| eyes.map(find));
        }
        self.renderer.building_sight = BuildingSight::of(self.world, self.rooms, camera.eye);
        let start = Instant::now();
        self.renderer.draw(&self.world.octree, &camera, frame);
        let milliseconds = start.elapsed().as_secs_f64() * 1.0e3;
        if let Some(sight) = &self.renderer.building_sight {
            movers.retain(|mover| sight.may_show(mover));
        }
        movers::draw_selected(frame, &camera, self.world, &movers, now);
        if let Some(wires) = &self.wires {
            wires.draw(frame, &camera);
        }
        milliseconds
    }
}

fn camera(args: &Args, world: &World) -> anyhow::Result<Camera> {
    let (eye, yaw) = match args.eye {
        Some(eye) => (eye, 0.0),
        None => {
            let Some(spawn) = world.spawns.get(args.spawn) else {
                let last = world.spawns.len().saturating_sub(1);
                bail!("there is no spawn point {}: the numbers go from 0 to {last}", args.spawn);
            };
            (spawn.eye, spawn.yaw)
        }
    };
    Ok(match args.look {
        Some(target) => Camera::looking_at(eye, target),
        None => Camera::at(&Pose { eye, yaw, ..Pose::default() }),
    })
}
