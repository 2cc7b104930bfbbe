//! `sightline-client bench`.

mod fuzzy;
mod gallery;
mod moving;
mod table;

use std::path::PathBuf;

use anyhow::ensure;
use serde::Serialize;
use sightline_cli::{output, progress::Progress};
use sightline_client::{
    bench::{
        self, BenchOptions, BenchRun, DepthAgreement, DrawMethod, ModeComparison, RayCaster,
        Shimmer, Views,
    },
    camera_path::CameraPath,
};
use sightline_renderer::{Camera, Renderer};
use sightline_world::World;

use super::{
    flags::{self, PathFlags},
    picture,
};
use gallery::Gallery;

/// A slow path, for shimmer: so many frames, …
const SHIMMER_FRAMES: usize = 12;
/// … a sixtieth of a second apart, at a fifth of the path's speed, …
const SHIMMER_S: f64 = 1.0 / 60.0 / 5.0;
/// … of so many columns and rows.
const SHIMMER_SIZE: (usize, usize) = (640, 360);

/// The sizes of pictures when none is named, and the same to compare modes.
const SIZES: [(usize, usize); 1] = [(1920, 1080)];
const SIZES_COMPARED: [(usize, usize); 2] = [(640, 480), (1920, 1080)];

/// Measures what drawing a world costs, beside rays through its triangles.
///
/// Draws the view from every spawn point, and frames of a path, in each mode of the renderer and with smooth edges, and in the same run a primary
/// ray for every pixel of these views through the world's opaque triangles, by obvhs: its BVH2 and its CWBVH, built as well as it
/// can, without shading. Everything is drawn again and again in turn, on the same threads, and the least time counts. CPU time is
/// that of all threads together: other programs disturb it little. `busiest` is that of the thread that worked most: what
/// a frame takes by the clock where nothing else runs. A ratio is the CPU time of rays over that of the row, the
/// median over the spawn points.
///
/// Then a part of the path is drawn very slowly: `shimmer` is how much more its pixels change than those of pictures with nine
/// samples a pixel, in levels of 255. And depths are compared with those of rays: what a pixel shows must lie within a voxel's
/// diagonal of some triangle (a pixel's, where it spans more), and not beyond what the ray meets. In a Quake map rays also meet what
/// is not drawn, and some of what is drawn is no occluder, so depths agree less there.
#[derive(clap::Args)]
pub struct Args {
    /// The world (.slw).
    world: PathBuf,
    /// The size of the pictures in pixels; may be given several times. 1920x1080 when absent; with
    /// --compare 640x480 too.
    #[arg(long, value_name = "WxH", value_parser = flags::size)]
    size: Vec<(usize, usize)>,
    /// On how many threads to draw; several numbers are measured one after the other.
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', default_value = "1",
          value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Vec<u16>,
    #[command(flatten)]
    way: PathFlags,
    /// Frames of the path.
    #[arg(long, value_name = "N", default_value_t = 24)]
    frames: usize,
    /// How often each frame is drawn; the least time counts.
    #[arg(long, value_name = "N", default_value_t = 3,
          value_parser = clap::value_parser!(u16).range(1..=1_000))]
    repeats: u16,
    /// Draw octrees only: no rays, no depths.
    #[arg(long)]
    no_rays: bool,
    /// Compare the renderer's modes instead, from every spawn point and along the path: which part of the pixels differ in
    /// colour by more than rounding; are unlike all pixels next to their place; show a depth that is shifted by more than a pixel,
    /// and by how many pixels at most; and which part of the projections is left.
    #[arg(long)]
    compare: bool,
    /// Measure things that move instead: up to so many chairs, or people, everywhere and where the first spawn point sees
    /// nothing of them. From there the eye turns round once in --frames pictures. Everything is drawn, or what the Z
    /// pyramid lets through, or what volumes in place of what is hidden do; the picture must be the same. A ratio is the CPU time
    /// of the picture to that of the building alone. Rows of hidden things are Fig. 6 (c) of the paper on temporal bounding volumes. For
    /// (a) and (b) run it on buildings of several sizes: with the same N for (a), with N by their rooms for (b).
    #[arg(long, value_name = "N", conflicts_with_all = ["compare", "pictures", "path", "from", "until"],
          value_parser = clap::value_parser!(u32).range(1..=16_000))]
    moving: Option<u32>,
    /// Measure instead what it saves to leave out what no eye in a box can see: --frames pictures of the path, a sixtieth of a
    /// second apart, whole, without what is hidden from the box that the eye is in, and besides without tests against the mask
    /// buffer of what every eye in it sees whole; they must be the same. Boxes are prepared by a thread beside those that draw,
    /// along the eye's motion.
    #[arg(long, conflicts_with_all = ["compare", "pictures", "moving"])]
    fuzzy: bool,
    /// Write the views as PNGs, side by side: orthogonal mode, perspective mode, their difference, eight times as strong,
    /// and in grey what does not agree with rays: red is too far away, blue is where no triangle is.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// Write the figures for machines.
    #[arg(long, value_name = "F")]
    json: Option<PathBuf>,
}

/// All figures.
#[derive(Serialize)]
struct BenchReport {
    world: String,
    voxel_m: f32,
    depth: u8,
    triangles: usize,
    spawns: usize,
    frames: usize,
    path_s: f64,
    runs: Vec<BenchRun>,
    comparisons: Vec<ModeComparison>,
    quality: Vec<Quality>,
}

/// How good a mode's pictures are.
#[derive(Serialize)]
struct Quality {
    mode: &'static str,
    shimmer: Shimmer,
    /// From each spawn point; none without rays.
    depths: Vec<DepthAgreement>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    ensure!((1..=picture::FRAMES_MAX).contains(&args.frames), "--frames must be from 1 to 100000");
    let world = World::read(&args.world)?;
    if let Some(most) = args.moving {
        let progress = Progress::new();
        let (text, figures) = moving::run(args, world, most as usize, &progress)?;
        progress.finish();
        return tell(args, &text, &figures);
    }
    if args.fuzzy {
        let progress = Progress::new();
        let (text, figures) = fuzzy::run(args, &world, &progress)?;
        progress.finish();
        return tell(args, &text, &figures);
    }
    let (path, from, until) = args.way.read(&world)?;
    let mut views = Views::new(&world, &path, 0);
    let along = path.frames_between(from, until, args.frames);
    views.path = along.map(|(_, pose)| Camera::at(&pose)).collect();
    let progress = Progress::new();
    let mut report = BenchReport {
        world: args.world.display().to_string(),
        voxel_m: world.octree.voxel(),
        depth: world.octree.depth,
        triangles: world.mesh.triangles.len(),
        spawns: views.spawns.len(),
        frames: views.path.len(),
        path_s: until - from,
        runs: Vec::new(),
        comparisons: Vec::new(),
        quality: Vec::new(),
    };
    let rays = if args.compare || args.no_rays {
        None
    } else {
        progress.show("trees", 0.0);
        RayCaster::new(&world.mesh)
    };
    if args.compare {
        report.comparisons = compare(args, &world, &views, &progress);
    } else {
        report.runs = measure(args, &world, rays.as_ref(), &views, &progress)?;
        let middle = 0.5 * (from + until);
        let ways =
            DrawMethod::ALL.into_iter().filter(|way| !matches!(way, DrawMethod::RayCaster(_)));
        let quality = ways.map(|way| Quality {
            mode: way.name(),
            shimmer: shimmer(&world, way, &path, middle, &progress),
            depths: depths(&world, rays.as_ref(), way, &views, sizes(args)[0], &progress),
        });
        report.quality = quality.collect();
    }
    if let Some(folder) = &args.pictures {
        let gallery = Gallery { world: &world, rays: rays.as_ref(), size: sizes(args)[0] };
        gallery.write(&views, folder, &progress)?;
    }
    progress.finish();
    tell(args, &table::text(&report), &report)
}

/// For people, and for machines.
fn tell(args: &Args, text: &str, figures: &impl Serialize) -> anyhow::Result<()> {
    output::print(text)?;
    output::write_json(args.json.as_deref(), figures)
}

/// The sizes that were asked for.
fn sizes(args: &Args) -> &[(usize, usize)] {
    match (args.size.as_slice(), args.compare) {
        ([], true) => &SIZES_COMPARED,
        ([], false) => &SIZES,
        (named, _) => named,
    }
}

/// Every size with every number of threads.
fn measure(
    args: &Args,
    world: &World,
    rays: Option<&RayCaster>,
    views: &Views,
    progress: &Progress,
) -> anyhow::Result<Vec<BenchRun>> {
    let mut runs = Vec::new();
    for &size in sizes(args) {
        for &threads in &args.threads {
            let options =
                BenchOptions { size, threads: threads.into(), repeats: args.repeats.into() };
            let stage = table::stage(size, threads.into());
            let hear = &mut |share| progress.show(&stage, share);
            runs.push(bench::measure(world, rays, views, &options, hear)?);
        }
    }
    Ok(runs)
}

fn compare(args: &Args, world: &World, views: &Views, progress: &Progress) -> Vec<ModeComparison> {
    let cameras: Vec<Camera> = views.spawns.iter().chain(&views.path).copied().collect();
    let compared = sizes(args).iter().map(|&size| {
        let stage = format!("modes, {} × {}", size.0, size.1);
        let hear = &mut |share| progress.show(&stage, share);
        ModeComparison::of(&world.octree, &cameras, size, hear)
    });
    compared.collect()
}

/// Of a part of the path about a time.
fn shimmer(
    world: &World,
    way: DrawMethod,
    path: &CameraPath,
    middle_s: f64,
    progress: &Progress,
) -> Shimmer {
    let mut renderer = Renderer::default();
    way.prepare(&mut renderer);
    Shimmer::of(SHIMMER_FRAMES, SHIMMER_SIZE, |i, frame| {
        let pose = path.at(middle_s + i as f64 * SHIMMER_S);
        renderer.draw(&world.octree, &Camera::at(&pose), frame);
        progress.show("shimmer", (i + 1) as f32 / SHIMMER_FRAMES as f32);
    })
}

/// From every spawn point.
fn depths(
    world: &World,
    rays: Option<&RayCaster>,
    way: DrawMethod,
    views: &Views,
    (width, height): (usize, usize),
    progress: &Progress,
) -> Vec<DepthAgreement> {
    let Some(rays) = rays else { return Vec::new() };
    let mut renderer = Renderer::default();
    way.prepare(&mut renderer);
    let mut frame = sightline_renderer::Frame::new(width, height);
    let agreement = |(i, camera): (usize, &Camera)| {
        renderer.draw(&world.octree, camera, &mut frame);
        progress.show("depths", (i + 1) as f32 / views.spawns.len() as f32);
        DepthAgreement::of(&frame, camera, rays, world.octree.voxel()).0
    };
    views.spawns.iter().enumerate().map(agreement).collect()
}
