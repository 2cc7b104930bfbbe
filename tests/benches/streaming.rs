//! How soon a world that arrives in pieces is seen, over a simulated link: by spawn point when the
//! first picture is there, when it is sharp, and what has been transferred by then.
//!
//! Times are virtual: those of the link alone, without the time that drawing and reading take.
//!
//! `cargo bench -p sightline-tests --bench streaming -- [WORLD.slw ...]`

use std::{path::PathBuf, time::Duration};

use clap::Parser;
use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use serde::Serialize;
use sightline_client::camera_path::CameraPath;
use sightline_renderer::{Camera, Frame, Renderer};
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
    /// How many walks to take, and for how many seconds.
    #[arg(long, default_value_t = 0)]
    walks: usize,
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
}

/// What is seen from a spawn point.
#[derive(Clone, Copy, Serialize)]
struct SpawnRow {
    first_picture_s: f64,
    sharp_s: f64,
    first_bytes: usize,
    sharp_bytes: usize,
    /// Pixels of the sharp picture that differ from the picture of the whole world.
    differing: usize,
}

/// What a walk takes.
#[derive(Clone, Copy, Serialize)]
struct WalkRow {
    transferred_bytes: usize,
    /// The bytes of the pieces that some picture showed.
    shown_bytes: usize,
    waited_s: f64,
    /// The share of pictures that were sharp.
    sharp: f64,
}

const SIZE: (usize, usize) = (1280, 720);
const WALK_SIZE: (usize, usize) = (640, 360);
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
    let pieces = streaming::pieces_of(world);
    let visit = StreamedVisit::new(&pieces, link, SIZE)?;
    let mut row = WorldRow {
        world: name.to_owned(),
        file_bytes: world.to_bytes().len(),
        head_bytes: pieces.head.len(),
        pieces_bytes: pieces.pieces.iter().map(Vec::len).sum(),
        branches: visit.fetcher.octree().branches(),
        spawns: Vec::new(),
        walks: Vec::new(),
    };
    let WorldRow { file_bytes, head_bytes, pieces_bytes, branches, .. } = row;
    println!(
        "{name}: file {file_bytes} bytes, head {head_bytes}, {branches} branches {pieces_bytes}"
    );
    for spawn in &world.spawns {
        let camera = Camera::at(&Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() });
        let seen = arrive(&pieces, link, &camera, world)?;
        let share = seen.sharp_bytes as f64 / file_bytes as f64;
        println!(
            "  first {:.2} s with {} bytes, sharp {:.2} s with {} bytes, {:.1} % of the file, {} pixels differ",
            seen.first_picture_s,
            seen.first_bytes,
            seen.sharp_s,
            seen.sharp_bytes,
            share * 100.0,
            seen.differing,
        );
        row.spawns.push(seen);
    }
    let mut random = SmallRng::seed_from_u64(1);
    for _ in 0..args.walks {
        let taken = walk(&pieces, link, world, args.seconds, &mut random)?;
        println!(
            "  walk: {} bytes, {:.2} times what was shown, waited {:.2} s, {:.1} % sharp",
            taken.transferred_bytes,
            taken.transferred_bytes as f64 / taken.shown_bytes.max(1) as f64,
            taken.waited_s,
            taken.sharp * 100.0,
        );
        row.walks.push(taken);
    }
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
            let differs = |(a, b): &(&u32, &u32)| a != b;
            return Ok(SpawnRow {
                first_picture_s,
                sharp_s: moment.at.as_secs_f64(),
                first_bytes,
                sharp_bytes: bytes,
                differing: whole.colour.iter().zip(&visit.frame.colour).filter(differs).count(),
            });
        }
        anyhow::ensure!(moment.at < PATIENCE, "the picture from {camera:?} is never sharp");
    }
}

/// A walk along a path through the building from a random place on it. A body waits where voxels
/// are missing.
fn walk(
    pieces: &WorldPieces,
    link: SimulatedLink,
    world: &World,
    seconds: u64,
    random: &mut SmallRng,
) -> anyhow::Result<WalkRow> {
    let path = CameraPath::through(world);
    let mut visit = StreamedVisit::new(pieces, link, WALK_SIZE)?;
    let mut at = random.random_range(0.0..=path.duration_s());
    let (mut waited, mut sharp, mut frames) = (0, 0, 0);
    let step = FRAME.as_secs_f64();
    while Duration::from_secs(seconds) > FRAME * frames {
        let (pose, next) = (path.at(at), path.at((at + step).min(path.duration_s())));
        let velocity = (next.eye - pose.eye) / FRAME.as_secs_f32();
        let moment = visit.step(&Camera::at(&pose), velocity)?;
        let is_open = visit.fetcher.is_open_at(next.eye);
        waited += u32::from(!is_open);
        sharp += u32::from(moment.is_sharp);
        frames += 1;
        if is_open {
            at = if at + step > path.duration_s() { 0.0 } else { at + step };
        }
    }
    let length = |&number: &usize| pieces.pieces.get(number).map_or(0, Vec::len);
    Ok(WalkRow {
        transferred_bytes: visit.bytes,
        shown_bytes: pieces.head.len() + visit.needed.iter().map(length).sum::<usize>(),
        waited_s: (FRAME * waited).as_secs_f64(),
        sharp: f64::from(sharp) / f64::from(frames.max(1)),
    })
}
