//! How soon a world that arrives in pieces is seen, over a simulated link: by spawn point when the
//! first picture is there, when it is sharp, and what has been transferred by then.
//!
//! Times are virtual: those of the link alone, without the time that drawing and reading take.
//!
//! `cargo bench -p sightline-tests --bench streaming -- [WORLD.slw ...]`

use std::{collections::BTreeSet, path::PathBuf, time::Duration};

use clap::Parser;
use glam::Vec3;
use serde::Serialize;
use sightline_client::camera_path::CameraPath;
use sightline_client_core::fetching::{Outlook, ShownBranch};
use sightline_compiler::storeys;
use sightline_renderer::{Camera, Frame, Renderer, streaming::shown_branches};
use sightline_tests::{
    bench_flags::BenchFlags,
    streaming::{FRAME, SimulatedLink, StreamedVisit},
};
use sightline_visibility::streaming;
use sightline_world::{World, WorldPieces, motion::Pose};

/// Measures how soon a world that arrives in pieces is seen.
#[derive(Parser)]
struct Args {
    /// Worlds; without any, a small hall.
    worlds: Vec<PathBuf>,
    /// The rate of the link, in megabits a second.
    #[arg(long, default_value_t = 10.0)]
    rate: f64,
    /// The delay of the link one way, in milliseconds.
    #[arg(long, default_value_t = 50)]
    delay: u64,
    /// The most spawn points to look from.
    #[arg(long, default_value_t = usize::MAX)]
    spawns: usize,
    /// How many random walks to take, and for how many seconds each.
    #[arg(long, default_value_t = 0)]
    walks: u64,
    #[arg(long, default_value_t = 60)]
    seconds: u64,
    #[command(flatten)]
    flags: BenchFlags,
}

/// What a world costs.
#[derive(Serialize)]
struct WorldRow {
    world: String,
    file_bytes: usize,
    head_bytes: usize,
    pieces_bytes: usize,
    branches: usize,
    spawns: Vec<SpawnRow>,
    walks: Vec<WalkRow>,
    summary: Summary,
}

/// The figures of all spawn points and walks: the median and the worst of each.
#[derive(Default, Serialize)]
struct Summary {
    first_picture_s: [f64; 2],
    sharp_s: [f64; 2],
    /// What was transferred when the picture was sharp, by the bytes of the file.
    sharp_share: [f64; 2],
    /// What walks transferred, by what is visible along them.
    walk_share: [f64; 2],
    /// How long the body waited on all walks together, in seconds.
    waited_s: f64,
}

impl Summary {
    fn of(file_bytes: usize, spawns: &[SpawnRow], walks: &[WalkRow]) -> Self {
        let of_spawns = |figure: fn(&SpawnRow) -> f64| middle(spawns.iter().map(figure).collect());
        let share = of_spawns(|row| row.sharp_bytes as f64);
        Self {
            first_picture_s: of_spawns(|row| row.first_picture_s),
            sharp_s: of_spawns(|row| row.sharp_s),
            sharp_share: share.map(|bytes| bytes / file_bytes as f64),
            walk_share: middle(walks.iter().map(WalkRow::share).collect()),
            waited_s: walks.iter().map(|walk| walk.waited_s).sum(),
        }
    }
}

/// The median and the greatest of some figures; zeros when there are none.
fn middle(mut figures: Vec<f64>) -> [f64; 2] {
    figures.sort_by(f64::total_cmp);
    let median = figures.get(figures.len() / 2);
    [median, figures.last()].map(|figure| figure.copied().unwrap_or(0.0))
}

/// What is seen from a spawn point.
#[derive(Clone, Copy, Serialize)]
struct SpawnRow {
    first_picture_s: f64,
    sharp_s: f64,
    first_bytes: usize,
    sharp_bytes: usize,
    /// The bytes of the head, and of the pieces that the picture of the whole world shows or that
    /// surround the body.
    visible_bytes: usize,
    /// Pixels of the sharp picture that differ from the picture of the whole world.
    differing: usize,
}

/// What a walk takes.
#[derive(Clone, Copy, Serialize)]
struct WalkRow {
    transferred_bytes: usize,
    /// The bytes of the head, and of the pieces that are visible along the way: those that pictures
    /// of the whole world show, and those around the body.
    visible_bytes: usize,
    /// The time that the body waited for voxels, in seconds.
    waited_s: f64,
    /// The share of pictures that were sharp.
    sharp: f64,
}

impl WalkRow {
    /// What was transferred, by what is visible.
    fn share(&self) -> f64 {
        self.transferred_bytes as f64 / self.visible_bytes.max(1) as f64
    }
}

const SIZE: (usize, usize) = (1280, 720);
const WALK_SIZE: (usize, usize) = (640, 360);
/// The speed of a walk, in metres a second.
const WALK_M_PER_S: f32 = 1.5;
/// A picture that is not sharp by then never is.
const PATIENCE: Duration = Duration::from_secs(60);

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let link =
        SimulatedLink { bits_per_s: args.rate * 1e6, delay: Duration::from_millis(args.delay) };
    let mut rows = Vec::new();
    for path in &args.worlds {
        rows.push(measure(&path.display().to_string(), &World::read(path)?, link, &args)?);
    }
    if args.worlds.is_empty() {
        let world = sightline_fixtures::voxel_floor::world(&[]);
        rows.push(measure("voxel floor", &world, link, &args)?);
    }
    args.flags.write(&rows)
}

fn measure(
    name: &str,
    world: &World,
    link: SimulatedLink,
    args: &Args,
) -> anyhow::Result<WorldRow> {
    let pieces = streaming::pieces_of(world, &storeys(world));
    let visit = StreamedVisit::new(&pieces, link, SIZE)?;
    let mut row = WorldRow {
        world: name.to_owned(),
        file_bytes: world.to_bytes().len(),
        head_bytes: pieces.head.len(),
        pieces_bytes: pieces.pieces.iter().map(Vec::len).sum(),
        branches: visit.fetcher.octree().branches(),
        spawns: Vec::new(),
        walks: Vec::new(),
        summary: Summary::default(),
    };
    let WorldRow { file_bytes, head_bytes, pieces_bytes, branches, .. } = row;
    println!(
        "{name}: file {file_bytes} bytes, head {head_bytes}, {branches} branches {pieces_bytes}"
    );
    for spawn in world.spawns.iter().take(args.spawns) {
        let camera = Camera::at(&Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() });
        let seen = arrive(&pieces, link, &camera, world)?;
        let share = seen.sharp_bytes as f64 / file_bytes as f64;
        println!(
            "  first {:.2} s with {} bytes, sharp {:.2} s with {} bytes, {:.1} % of the file, {} visible, {} pixels differ",
            seen.first_picture_s,
            seen.first_bytes,
            seen.sharp_s,
            seen.sharp_bytes,
            share * 100.0,
            seen.visible_bytes,
            seen.differing,
        );
        row.spawns.push(seen);
    }
    for seed in 0..args.walks {
        let taken = walk(&pieces, link, world, args.seconds, seed)?;
        println!(
            "  walk: {} bytes, {:.2} times what is visible, waited {:.2} s, {:.1} % sharp",
            taken.transferred_bytes,
            taken.share(),
            taken.waited_s,
            taken.sharp * 100.0,
        );
        row.walks.push(taken);
    }
    row.summary = Summary::of(file_bytes, &row.spawns, &row.walks);
    Ok(row)
}

fn arrive(
    pieces: &WorldPieces,
    link: SimulatedLink,
    camera: &Camera,
    world: &World,
) -> anyhow::Result<SpawnRow> {
    let mut visit = StreamedVisit::new(pieces, link, SIZE)?;
    let mut first = None;
    loop {
        let bytes = visit.bytes;
        let moment = visit.step(camera, Vec3::ZERO)?;
        if moment.is_open && first.is_none() {
            first = Some((moment.at.as_secs_f64(), bytes));
        }
        if moment.is_sharp {
            let (first_picture_s, first_bytes) = first.unwrap_or_default();
            let mut whole = Frame::new(SIZE.0, SIZE.1);
            Renderer::default().draw(&world.octree, camera, &mut whole);
            let shown = shown_branches(&whole, camera, visit.fetcher.octree(), 1);
            let visible: BTreeSet<usize> =
                visit.fetcher.needed(&outlook(camera, SIZE.1, &shown)).into_iter().collect();
            let differs = |(a, b): &(&u32, &u32)| a != b;
            return Ok(SpawnRow {
                first_picture_s,
                sharp_s: moment.at.as_secs_f64(),
                first_bytes,
                sharp_bytes: bytes,
                visible_bytes: pieces.head.len() + bytes_of(pieces, &visible),
                differing: whole.colour.iter().zip(&visit.frame.colour).filter(differs).count(),
            });
        }
        anyhow::ensure!(moment.at < PATIENCE, "the picture from {camera:?} is never sharp");
    }
}

/// A random walk through the building. A body waits where voxels are missing.
fn walk(
    pieces: &WorldPieces,
    link: SimulatedLink,
    world: &World,
    seconds: u64,
    seed: u64,
) -> anyhow::Result<WalkRow> {
    let path = CameraPath::wandering(world, seed, seconds as f32 * WALK_M_PER_S);
    let mut visit = StreamedVisit::new(pieces, link, WALK_SIZE)?;
    let (mut renderer, mut whole) = (Renderer::default(), Frame::new(WALK_SIZE.0, WALK_SIZE.1));
    let mut visible = BTreeSet::new();
    let (mut at, mut waited, mut sharp, mut frames) = (0.0, 0, 0, 0);
    let step = FRAME.as_secs_f64();
    while Duration::from_secs(seconds) > FRAME * frames {
        let (pose, next) = (path.at(at), path.at(at + step));
        let (camera, velocity) = (Camera::at(&pose), (next.eye - pose.eye) / FRAME.as_secs_f32());
        let moment = visit.step(&camera, velocity)?;
        renderer.draw(&world.octree, &camera, &mut whole);
        let shown = shown_branches(&whole, &camera, visit.fetcher.octree(), 1);
        visible.extend(visit.fetcher.needed(&outlook(&camera, WALK_SIZE.1, &shown)));
        let is_open = visit.fetcher.is_open_at(next.eye);
        waited += u32::from(!is_open);
        sharp += u32::from(moment.is_sharp);
        frames += 1;
        at += if is_open { step } else { 0.0 };
    }
    Ok(WalkRow {
        transferred_bytes: visit.bytes,
        visible_bytes: pieces.head.len() + bytes_of(pieces, &visible),
        waited_s: (FRAME * waited).as_secs_f64(),
        sharp: f64::from(sharp) / f64::from(frames.max(1)),
    })
}

/// What an eye that stands needs of a picture with this number of rows.
fn outlook<'a>(camera: &Camera, rows: usize, shown: &'a [ShownBranch]) -> Outlook<'a> {
    let (eye, focal) = (camera.eye, camera.focal(rows));
    Outlook { eye, velocity: Vec3::ZERO, focal, shown, plan: false, all: false }
}

fn bytes_of(pieces: &WorldPieces, numbers: &BTreeSet<usize>) -> usize {
    numbers.iter().filter_map(|number| pieces.pieces.get(*number)).map(Vec::len).sum()
}
