//! `sightline-client bench`.

mod fuzzy;
mod gallery;
mod moving;
mod table;

use std::path::PathBuf;

use anyhow::ensure;
use serde::Serialize;
use sightline_cli::{
    files::{check_output, read_world},
    output,
    progress::Progress,
};
use sightline_client::{
    bench::{
        self, BenchOptions, BenchRun, DepthAgreement, DrawMethod, ModeComparison, RayCaster,
        Shimmer, Views,
    },
    camera_path::CameraPath,
};
use sightline_renderer::{Camera, Frame, Mode, Renderer};
use sightline_world::World;

use super::{
    flags::{self, ModeFlag, PathFlags},
    picture,
};
use gallery::Gallery;

/// The number of frames of the slow path that shimmer is measured on.
const SHIMMER_FRAMES: usize = 12;
/// The time between two of these frames on the path, in seconds: a sixtieth at a fifth of the
/// speed.
const SHIMMER_S: f64 = 1.0 / 60.0 / 5.0;
/// Columns and rows of these frames.
const SHIMMER_SIZE: (usize, usize) = (640, 360);

/// The default picture sizes, and those for comparing modes.
const SIZES: [(usize, usize); 1] = [(1920, 1080)];
const SIZES_COMPARED: [(usize, usize); 2] = [(640, 480), (1920, 1080)];

/// Measures the cost of drawing a world, compared with tracing rays through its triangles.
///
/// Draws the views from all spawn points and along a path in each mode of the renderer, and with
/// smooth edges. For comparison, it traces a primary ray per pixel of the same views through the
/// world's opaque triangles with obvhs. Both of its trees are used, BVH2 and CWBVH, built with its
/// best builder. Nothing is shaded.
///
/// All methods take turns on the same threads, and the least time of several repeats counts. CPU
/// time is the sum over all threads, so other programs disturb it little. The `busiest` columns are
/// the CPU time of the thread that worked most. A ratio is the CPU time of the rays divided by that
/// of the row: the median over the spawn points.
///
/// Then part of the path is drawn very slowly. `shimmer` is how much more its pixels change than
/// those of pictures with nine samples per pixel, in levels of 255. Depths are compared with those
/// of rays: a pixel must show something within a voxel's diagonal of a triangle (a pixel's, where a
/// pixel spans more), and nothing beyond the end of the ray. In Quake maps, depths agree less: rays
/// also meet surfaces that are not drawn, and some drawn surfaces are not occluders.
#[derive(clap::Args)]
pub struct Args {
    /// The world file (.slw).
    world: PathBuf,
    /// The size of the pictures, in pixels; may be given several times. When absent, 1920x1080, and
    /// 640x480 too with --compare.
    #[arg(long, value_name = "WxH", value_parser = flags::size)]
    size: Vec<(usize, usize)>,
    /// The number of drawing threads; several numbers are measured one after the other.
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', default_value = "1",
          value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Vec<u16>,
    #[command(flatten)]
    path: PathFlags,
    /// The number of frames along the path.
    #[arg(long, value_name = "N", default_value_t = 24)]
    frames: usize,
    /// How often each frame is drawn. The least time counts.
    #[arg(long, value_name = "N", default_value_t = 3,
          value_parser = clap::value_parser!(u16).range(1..=1_000))]
    repeats: u16,
    /// Draw only octrees: trace no rays and compare no depths.
    #[arg(long)]
    no_rays: bool,
    /// Measure only this mode of the renderer, and the rays.
    #[arg(long, value_name = "MODE", value_enum, conflicts_with_all = ["compare", "pictures", "moving", "fuzzy"])]
    mode: Option<ModeFlag>,
    /// Compare the modes of the renderer with perspective mode instead, from all spawn points and
    /// along the path. Reports the shares of pixels whose colour differs by more than rounding
    /// (differing), whose colour is unlike all pixels around them in the other picture (unlike),
    /// and whose depth is shifted by more than one pixel (shifted); the largest shift; and the
    /// share of projections that the mode still needs.
    #[arg(long)]
    compare: bool,
    /// Measure moving things instead: up to this many chairs or people, first everywhere, then only
    /// where the first spawn point cannot see them. From that point the eye turns once in --frames
    /// pictures. Three methods of culling are compared: draw everything, test boxes against the
    /// hierarchical Z buffer, and stand bounding volumes in for hidden things. The pictures must be
    /// the same. A ratio is the CPU time of the picture divided by that of the building alone. The
    /// rows of hidden things correspond to Fig. 6 (c) of Sudarsky and Gotsman's paper on temporal
    /// bounding volumes. For (a) and (b), run it on buildings of several sizes: with the same N for
    /// (a), with N proportional to the rooms for (b).
    #[arg(long, value_name = "N", conflicts_with_all = ["compare", "pictures", "path", "from", "until"],
          value_parser = clap::value_parser!(u32).range(1..=16_000))]
    moving: Option<u32>,
    /// Measure instead what is saved by leaving out the nodes that no eye in a box can see. Draws
    /// --frames pictures of the path, a sixtieth of a second apart, in three methods: everything,
    /// without the nodes hidden from the box around the eye, and also without mask tests for the
    /// nodes that every eye in the box sees whole. The pictures must be the same. A separate thread
    /// prepares boxes ahead of the eye.
    #[arg(long, conflicts_with_all = ["compare", "pictures", "moving"])]
    fuzzy: bool,
    /// Write the views as PNGs into a folder. Each has panels side by side: orthogonal mode,
    /// perspective mode, their difference (eight times as strong), and in grey the pixels that
    /// disagree with rays: red where they show something too far away, blue where there is no
    /// triangle.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// Write the figures to a JSON file.
    #[arg(long, value_name = "F")]
    json: Option<PathBuf>,
}

/// The figures for machines.
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

/// The quality of the pictures of one method.
#[derive(Serialize)]
struct Quality {
    mode: &'static str,
    shimmer: Shimmer,
    /// The depths from each spawn point; empty without rays.
    depths: Vec<DepthAgreement>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    ensure!((1..=picture::FRAMES_MAX).contains(&args.frames), "--frames must be from 1 to 100000");
    args.json.as_deref().map_or(Ok(()), check_output)?;
    let world = read_world(&args.world)?;
    if let Some(most) = args.moving {
        let progress = Progress::new();
        let (text, figures) = moving::run(args, world, most as usize, &progress)?;
        progress.finish();
        return output_figures(args, &text, &figures);
    }
    if args.fuzzy {
        let progress = Progress::new();
        let (text, figures) = fuzzy::run(args, &world, &progress)?;
        progress.finish();
        return output_figures(args, &text, &figures);
    }
    let (path, from, until) = args.path.read(&world)?;
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
        let is_shown = |method: &DrawMethod| match method {
            DrawMethod::Rays(_) => false,
            method => {
                report.runs.iter().any(|run| run.rows.iter().any(|row| row.name == method.name()))
            }
        };
        let methods: Vec<DrawMethod> = DrawMethod::ALL.into_iter().filter(is_shown).collect();
        let quality = methods.into_iter().map(|method| Quality {
            mode: method.name(),
            shimmer: shimmer(&world, method, &path, middle, &progress),
            depths: depths(&world, rays.as_ref(), method, &views, sizes(args)[0], &progress),
        });
        report.quality = quality.collect();
    }
    if let Some(folder) = &args.pictures {
        let gallery = Gallery { world: &world, rays: rays.as_ref(), size: sizes(args)[0] };
        gallery.write(&views, folder, &progress)?;
    }
    progress.finish();
    output_figures(args, &table::text(&report), &report)
}

/// Prints the text, and writes the JSON file if one is named.
fn output_figures(args: &Args, text: &str, figures: &impl Serialize) -> anyhow::Result<()> {
    output::print(text)?;
    output::write_json(args.json.as_deref(), figures)
}

/// The given sizes, or the default ones.
fn sizes(args: &Args) -> &[(usize, usize)] {
    match (args.size.as_slice(), args.compare) {
        ([], true) => &SIZES_COMPARED,
        ([], false) => &SIZES,
        (named, _) => named,
    }
}

/// Measures every size with every number of threads.
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
            let options = BenchOptions {
                size,
                threads: threads.into(),
                repeats: args.repeats.into(),
                mode: args.mode.map(Mode::from),
            };
            let stage = table::stage(size, threads.into());
            let show = &mut |share| progress.show(&stage, share);
            runs.push(bench::measure(world, rays, views, &options, show)?);
        }
    }
    Ok(runs)
}

fn compare(args: &Args, world: &World, views: &Views, progress: &Progress) -> Vec<ModeComparison> {
    let cameras: Vec<Camera> = views.spawns.iter().chain(&views.path).copied().collect();
    let modes = [Mode::Orthogonal, Mode::Forms];
    let all = sizes(args).iter().flat_map(|&size| modes.map(|mode| (size, mode)));
    let compared = all.map(|(size, mode)| {
        let stage = format!("{}, {} × {}", DrawMethod::Octree(mode).name(), size.0, size.1);
        let show = &mut |share| progress.show(&stage, share);
        ModeComparison::of(mode, &world.octree, &cameras, size, show)
    });
    compared.collect()
}

/// The shimmer of a part of the path around a time.
fn shimmer(
    world: &World,
    method: DrawMethod,
    path: &CameraPath,
    middle_s: f64,
    progress: &Progress,
) -> Shimmer {
    let mut renderer = Renderer::default();
    method.configure(&mut renderer);
    Shimmer::of(SHIMMER_FRAMES, SHIMMER_SIZE, |i, frame| {
        let pose = path.at(middle_s + i as f64 * SHIMMER_S);
        renderer.draw(&world.octree, &Camera::at(&pose), frame);
        progress.show("shimmer", (i + 1) as f32 / SHIMMER_FRAMES as f32);
    })
}

/// How depths agree with rays, from every spawn point.
fn depths(
    world: &World,
    rays: Option<&RayCaster>,
    method: DrawMethod,
    views: &Views,
    size: (usize, usize),
    progress: &Progress,
) -> Vec<DepthAgreement> {
    let Some(rays) = rays else { return Vec::new() };
    let mut renderer = Renderer::default();
    method.configure(&mut renderer);
    let mut frame = Frame::new(size.0, size.1);
    let agreement = |(i, camera): (usize, &Camera)| {
        renderer.draw(&world.octree, camera, &mut frame);
        progress.show("depths", (i + 1) as f32 / views.spawns.len() as f32);
        DepthAgreement::of(&frame, camera, rays, world.octree.voxel()).0
    };
    views.spawns.iter().enumerate().map(agreement).collect()
}
