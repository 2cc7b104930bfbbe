//! `sightline-client bench`.

use std::{fmt::Write, path::PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use sightline_client::{
    bench::{self, Depths, Fault, Options, Rays, Row, Run, Shimmer, Spread, Views},
    path::Path,
    render::{Camera, Frame, Renderer},
};
use sightline_shared::world::World;

use super::{
    flags::{self, Way},
    picture,
    progress::Progress,
};

/// A slow path, for shimmer: so many frames, …
const SHIMMER_FRAMES: usize = 12;
/// … a sixtieth of a second apart, at a fifth of the path's speed, …
const SHIMMER_S: f64 = 1.0 / 60.0 / 5.0;
/// … of so many columns and rows.
const SHIMMER_SIZE: (usize, usize) = (640, 360);

/// Measures what drawing a world costs, beside rays through its triangles.
///
/// Draws the view from every spawn point, and frames of a path, in each mode of the renderer, and in the same run a primary
/// ray for every pixel of these views through the world's opaque triangles, by obvhs: its BVH2 and its CWBVH, built as well as it
/// can, without shading. Everything is drawn again and again in turn, on the same threads, and the least time counts. CPU time is
/// that of all threads together: other programs disturb it little. `ratio` is the CPU time of rays over that of the row,
/// the median over the spawn points.
///
/// Then a part of the path is drawn very slowly: `shimmer` is how much more its pixels change than those of pictures with nine
/// samples a pixel, in levels of 255. And depths are compared with those of rays: what a pixel shows must lie within a voxel's
/// diagonal of some triangle (a pixel's, where it spans more), and not beyond what the ray meets. In a Quake map rays also meet what is not drawn, and
/// some of what is drawn is no occluder, so depths agree less there.
#[derive(clap::Args)]
pub struct Args {
    /// The world (.slw).
    world: PathBuf,
    /// The size of the pictures in pixels; may be given several times.
    #[arg(long, value_name = "WxH", value_parser = flags::size, default_value = "1920x1080")]
    size: Vec<(usize, usize)>,
    /// On how many threads to draw; several numbers are measured one after the other.
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', default_value = "1",
          value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Vec<u16>,
    #[command(flatten)]
    way: Way,
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
    /// Write the views as PNGs: as drawn, and in grey with what does not agree with rays: red is too far away, blue is where no
    /// triangle is.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// Write the figures for machines.
    #[arg(long, value_name = "F")]
    json: Option<PathBuf>,
}

/// All figures.
#[derive(Serialize)]
struct Report {
    world: String,
    voxel_m: f32,
    depth: u8,
    triangles: usize,
    spawns: usize,
    frames: usize,
    path_s: f64,
    runs: Vec<Run>,
    shimmer: Shimmer,
    /// From each spawn point.
    depths: Vec<Depths>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    ensure!((1..=picture::FRAMES_MAX).contains(&args.frames), "--frames must be from 1 to 100000");
    let world = World::read(&args.world)?;
    let (path, from, until) = args.way.read(&world)?;
    let mut views = Views::new(&world, &path, 0);
    views.path =
        path.frames_between(from, until, args.frames).map(|(_, pose)| Camera::at(&pose)).collect();
    let progress = Progress::new();
    progress.tell("trees", 0.0, "");
    let rays = if args.no_rays { None } else { Rays::new(&world.mesh) };
    let mut runs = Vec::new();
    for &size in &args.size {
        for &threads in &args.threads {
            let options = Options { size, threads: threads.into(), repeats: args.repeats.into() };
            let stage = format!("{} × {}, {}", size.0, size.1, counted(threads.into(), "thread"));
            let hear = &mut |share| progress.tell(&stage, share, "");
            runs.push(bench::measure(&world, rays.as_ref(), &views, &options, hear)?);
        }
    }
    let gallery = Gallery { world: &world, rays: rays.as_ref(), size: args.size[0] };
    let depths = gallery.depths(&views, args.pictures.as_deref(), &progress)?;
    let shimmer = shimmer(&world, &path, 0.5 * (from + until), &progress);
    progress.finish();
    let report = Report {
        world: args.world.display().to_string(),
        voxel_m: world.octree.voxel(),
        depth: world.octree.depth,
        triangles: rays.as_ref().map_or(0, Rays::triangles),
        spawns: views.spawns.len(),
        frames: views.path.len(),
        path_s: until - from,
        runs,
        shimmer,
        depths,
    };
    super::print(&report.text())?;
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&report)? + "\n";
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// What is looked at besides time.
struct Gallery<'a> {
    world: &'a World,
    rays: Option<&'a Rays>,
    size: (usize, usize),
}

impl Gallery<'_> {
    /// Compares depths from every spawn point, and writes pictures of all views when there is a folder for them.
    fn depths(
        &self,
        views: &Views,
        folder: Option<&std::path::Path>,
        progress: &Progress,
    ) -> anyhow::Result<Vec<Depths>> {
        if let Some(folder) = folder {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("cannot make {}", folder.display()))?;
        }
        let shown = if folder.is_some() { views.path.len() } else { 0 };
        let count = views.spawns.len() + shown;
        let mut depths = Vec::new();
        for (i, camera) in views.spawns.iter().chain(&views.path[..shown]).enumerate() {
            let (frame, red, agreement) = self.look(camera);
            if i < views.spawns.len() {
                depths.extend(agreement);
            }
            if let Some(folder) = folder {
                let name = match i.checked_sub(views.spawns.len()) {
                    None => format!("spawn-{i:03}.png"),
                    Some(frame) => format!("path-{frame:04}.png"),
                };
                let width = frame.width();
                picture::save(&folder.join(name), &[(width, &frame.colour), (width, &red)])?;
            }
            progress.tell("pictures", (i + 1) as f32 / count as f32, "");
        }
        Ok(depths)
    }

    /// A view; the same in grey, red where depths do not agree with rays; and how far they do.
    fn look(&self, camera: &Camera) -> (Frame, Vec<u32>, Option<Depths>) {
        let (width, height) = self.size;
        let mut frame = Frame::new(width, height);
        Renderer::default().draw(&self.world.octree, camera, &mut frame);
        let mut red: Vec<u32> = frame.colour.iter().map(|&pixel| grey(pixel)).collect();
        let Some(rays) = self.rays else { return (frame, red, None) };
        let (depths, faults) = Depths::of(&frame, camera, rays, self.world.octree.voxel());
        for (i, fault) in faults {
            red[i] = if fault == Fault::Beyond { 0x00ff_2020 } else { 0x0020_80ff };
        }
        (frame, red, Some(depths))
    }
}

fn grey(pixel: u32) -> u32 {
    let sum: u32 = [16, 8, 0].iter().map(|shift| pixel >> shift & 0xff).sum();
    (sum / 4) * 0x0001_0101
}

/// Of a part of the path about a time.
fn shimmer(world: &World, path: &Path, middle_s: f64, progress: &Progress) -> Shimmer {
    let mut renderer = Renderer::default();
    Shimmer::of(SHIMMER_FRAMES, SHIMMER_SIZE, |i, frame| {
        let pose = path.at(middle_s + i as f64 * SHIMMER_S);
        renderer.draw(&world.octree, &Camera::at(&pose), frame);
        progress.tell("shimmer", (i + 1) as f32 / SHIMMER_FRAMES as f32, "");
    })
}

impl Report {
    fn text(&self) -> String {
        let mut out = format!(
            "{}: {}³ voxels of {:.1} mm, {}; {}, {} ({:.0} s)\n",
            self.world,
            1u64 << self.depth,
            self.voxel_m * 1e3,
            counted(self.triangles, "triangle"),
            counted(self.spawns, "spawn point"),
            counted(self.frames, "frame of a path"),
            self.path_s
        );
        self.runs.iter().for_each(|run| out += &table(run));
        let Shimmer { change, smooth, excess } = self.shimmer;
        // Writing to a string cannot fail.
        let _ = writeln!(
            out,
            "\nslow path: pixels change by {change:.2}, with nine samples by {smooth:.2}; shimmer {excess:.2}"
        );
        if !self.depths.is_empty() {
            let worst = |part: fn(&Depths) -> f64| self.depths.iter().map(part).fold(1.0, f64::min);
            let all: Vec<f64> = self.depths.iter().map(|depths| depths.agreeing).collect();
            let _ = writeln!(
                out,
                "depths within a voxel's diagonal: median {:.2} %, worst {:.2} % of the pixels; measured along the ray, worst {:.2} %",
                Spread::of(&all).median * 100.0,
                worst(|depths| depths.agreeing) * 100.0,
                worst(|depths| depths.along) * 100.0
            );
        }
        out
    }
}

/// A run as people read it.
fn table(run: &Run) -> String {
    let Run { width, height, threads, rows } = run;
    let mut out = format!("\n{width} × {height}, {}\n", counted(*threads, "thread"));
    out += &format!("{:14}{:>20}{:>20}{:>20}\n", "", "spawns, CPU ms", "path, CPU ms", "path, ms");
    let head =
        ["median", "worst", "median", "worst", "median", "worst", "M rays/s", "/ BVH2", "/ CWBVH"];
    out += &format!("{:14}", "");
    head.iter().for_each(|name| out += &format!("{name:>10}"));
    out.push('\n');
    rows.iter().for_each(|row| out += &line(row));
    out
}

fn line(row: &Row) -> String {
    let spreads = [row.cpu_ms.spawns, row.cpu_ms.path, row.wall_ms.path];
    let mut out = format!("{:14}", row.name);
    for Spread { median, worst } in spreads {
        out += &format!("{median:10.1}{worst:10.1}");
    }
    out += &format!("{:10.2}", row.rays_per_us);
    for ratio in [row.ratio_bvh2, row.ratio_cwbvh] {
        out += &ratio.map_or(format!("{:>10}", "-"), |ratio| format!("{ratio:10.2}"));
    }
    out.push('\n');
    out
}

fn counted(count: usize, what: &str) -> String {
    let (first, rest) = what.split_once(' ').unwrap_or((what, ""));
    let many = if count == 1 { "" } else { "s" };
    let phrase = if rest.is_empty() || rest == "point" {
        format!("{what}{many}")
    } else {
        format!("{first}{many} {rest}")
    };
    format!("{count} {phrase}")
}
