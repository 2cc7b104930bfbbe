//! The renderer's inner loops and the octree's bytes, each measured on a scene that exercises
//! little else.
//!
//! * *layers*: a floor and a ceiling of voxels that fill the picture;
//! * *bricks*: hills, where no node is a whole layer;
//! * *outlines*: hills of voxels larger than 8 pixels;
//! * *sky*: nothing;
//! * and hills written as bytes and read back.
//!
//! Prints nanoseconds of CPU time per pixel in both modes, and per voxel: the least of several
//! rounds.
//!
//! `cargo bench -p sightline-tests --bench drawing`

use clap::Parser;
use cpu_time::ThreadTime;
use glam::{UVec3, Vec3};
use serde::Serialize;
use sightline_renderer::{Camera, Frame, Mode, Renderer};
use sightline_tests::bench_flags::BenchFlags;
use sightline_world::octree::{Octree, Voxel, morton};

const SIZE: (usize, usize) = (1920, 1080);
const ROUNDS: usize = 15;
/// The depth of the octrees.
const DEPTH: u8 = 10;

/// Measures the renderer's inner loops.
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    flags: BenchFlags,
}

/// What one scene costs, in nanoseconds of CPU time per pixel.
#[derive(Serialize)]
struct SceneRow {
    scene: &'static str,
    orthogonal_ns: f64,
    perspective_ns: f64,
    /// The share of pixels that show a voxel.
    hit: f64,
}

/// What the octree's bytes cost, for each voxel.
#[derive(Serialize)]
struct ByteCosts {
    written_ns: f64,
    read_ns: f64,
    bytes: f64,
}

#[derive(Serialize)]
struct DrawingFigures {
    per_pixel: Vec<SceneRow>,
    per_voxel: ByteCosts,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let rounds = if args.flags.bench { ROUNDS } else { 1 };
    // Thread time counts one thread only, so everything is drawn on this one.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
    let figures = pool?.install(|| measure(rounds));
    args.flags.write(&figures)
}

fn measure(rounds: usize) -> DrawingFigures {
    let side = 1 << DEPTH;
    let hills = octree(|x, z| hill(x, z)..hill(x, z) + 3);
    let flat = octree(|_, _| 300..301);
    let (middle, above) = (side as f32 * 0.5, 400.0);
    let down = Vec3::new(0.31, -0.5, 0.8);
    let from = |eye: Vec3, along: Vec3| Camera::looking_at(eye, eye + along);
    let scenes = [
        ("layers", &flat, from(Vec3::new(middle, above, middle), down)),
        ("bricks", &hills, from(Vec3::new(middle, above, middle), down)),
        ("outlines", &hills, from(Vec3::new(middle, 358.0, middle), down)),
        ("sky", &hills, from(Vec3::new(middle, above, middle), Vec3::new(0.3, 0.9, 0.2))),
    ];
    println!(
        "{:<12} {:>12} {:>12} {:>12}",
        "ns per pixel", "orthogonal", "perspective", "pixels hit"
    );
    let mut per_pixel = Vec::new();
    for (scene, octree, camera) in scenes {
        let [(orthogonal_ns, hit), (perspective_ns, _)] =
            [Mode::Orthogonal, Mode::Perspective].map(|mode| draw(octree, &camera, mode, rounds));
        let percent = hit * 100.0;
        println!("{scene:<12} {orthogonal_ns:>12.2} {perspective_ns:>12.2} {percent:>11.1}%");
        per_pixel.push(SceneRow { scene, orthogonal_ns, perspective_ns, hit });
    }
    let voxels = hills.leaves.len() as f64;
    let encoded = hills.to_bytes();
    let written_ns = least_ns(3, || drop(hills.to_bytes())) / voxels;
    let read_ns =
        least_ns(3, || drop(Octree::from_bytes(&encoded).expect("just written"))) / voxels;
    let bytes = encoded.len() as f64 / voxels;
    println!("{:<12} {:>12} {:>12} {:>12}", "ns per voxel", "written", "read", "bytes");
    println!("{:<12} {written_ns:>12.1} {read_ns:>12.1} {bytes:>12.2}", "hills");
    DrawingFigures { per_pixel, per_voxel: ByteCosts { written_ns, read_ns, bytes } }
}

/// Columns of voxels with an edge of 1 m, in varying colours.
fn octree(column: impl Fn(u32, u32) -> std::ops::Range<u32>) -> Octree {
    let side = 1u32 << DEPTH;
    let all = (0..side).flat_map(|x| (0..side).map(move |z| (x, z)));
    let voxels = all.flat_map(|(x, z)| column(x, z).map(move |y| UVec3::new(x, y, z)));
    let voxels = voxels.map(|at| {
        let shade = |part: u32| (128.0 + (part as f32 * 0.19).sin() * 90.0) as u8;
        let colour = [shade(at.x), shade(at.y * 3), shade(at.z)];
        Voxel { key: morton(at), colour, normal: [0, 127, 0], ..Voxel::default() }
    });
    Octree::from_voxels(Vec3::ZERO, 1.0, DEPTH, voxels.collect()).expect("small")
}

fn hill(x: u32, z: u32) -> u32 {
    let waves = (x as f32 * 0.11).sin() * 9.0 + (z as f32 * 0.07).cos() * 11.0;
    (300.0 + waves) as u32 + x * 31 % 3
}

/// Nanoseconds per pixel, and the share of pixels that show a voxel.
fn draw(octree: &Octree, camera: &Camera, mode: Mode, rounds: usize) -> (f64, f64) {
    let mut renderer = Renderer::default();
    renderer.mode = mode;
    let mut frame = Frame::new(SIZE.0, SIZE.1);
    let time = least_ns(rounds, || renderer.draw(octree, camera, &mut frame));
    let pixels = (SIZE.0 * SIZE.1) as f64;
    (time / pixels, renderer.counters().pixels as f64 / pixels)
}

fn least_ns(rounds: usize, mut work: impl FnMut()) -> f64 {
    let round = |_| {
        let start = ThreadTime::now();
        work();
        start.elapsed().as_secs_f64() * 1.0e9
    };
    (0..rounds).map(round).fold(f64::INFINITY, f64::min)
}
