//! What orthogonal mode costs, as a share of what perspective mode costs, in many buildings with
//! coarse and fine voxels.
//!
//! The demo building is always measured; maps, buildings and scenes beside the repository where
//! they are there. Modes take turns picture by picture, and the least CPU time of several counts. A
//! share is that of the medians.
//!
//! `cargo bench -p sightline-tests --bench modes`

use std::ops::ControlFlow;

use anyhow::Context;
use clap::Parser;
use cpu_time::ThreadTime;
use serde::Serialize;
use sightline_client::{
    bench::{Spread, Views},
    camera_path::CameraPath,
};
use sightline_compiler::{
    CompileOptions, Quality, compile,
    import::{self, glb},
    model::Model,
    voxelise,
};
use sightline_fixtures::shared_files::shared_file;
use sightline_renderer::{Camera, Frame, Mode, Renderer};
use sightline_tests::bench_flags::BenchFlags;
use sightline_world::World;

/// Compares what the renderer's modes cost.
#[derive(Parser)]
struct Args {
    /// Measure only buildings with this in their names.
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
    /// Columns and rows of the pictures.
    #[arg(long, value_name = "PIXELS", num_args = 2, default_values_t = [1280, 720])]
    size: Vec<usize>,
    /// The most spawn points, and as many frames of a walk.
    #[arg(long, value_name = "N", default_value_t = 16)]
    views: usize,
    /// How often each picture is drawn in each mode.
    #[arg(long, value_name = "N", default_value_t = 5)]
    repeats: usize,
    #[command(flatten)]
    flags: BenchFlags,
}

/// A building, and the edges of its voxels in metres, finest first.
struct Building {
    name: &'static str,
    /// Its file in the data folder; none for the demo building.
    file: Option<&'static str>,
    voxels: &'static [f32],
}

const fn building(
    name: &'static str,
    file: Option<&'static str>,
    voxels: &'static [f32],
) -> Building {
    Building { name, file, voxels }
}

const MAP_VOXELS: &[f32] = &[0.018, 0.031, 0.1];
const SCENE_VOXELS: &[f32] = &[0.02, 0.05, 0.15];
const BUILDINGS: &[Building] = &[
    building("demo", None, &[0.03, 0.06, 0.1]),
    building("rooms400", Some("traces/rooms400.glb"), &[0.1, 0.25, 0.4]),
    building("oa_dm2", Some("maps/oa_dm2.bsp"), MAP_VOXELS),
    building("oa_dm4", Some("maps/oa_dm4.bsp"), MAP_VOXELS),
    building("aggressor", Some("maps/aggressor.bsp"), MAP_VOXELS),
    building("delta", Some("maps/delta.bsp"), MAP_VOXELS),
    building("garage", Some("scenes/garage/garage.gltf"), SCENE_VOXELS),
    building("museum_b", Some("scenes/museum_b/museum_b.glb"), SCENE_VOXELS),
    building("hall", Some("scenes/hall.glb"), &[0.05, 0.1, 0.2]),
    building("living_room", Some("scenes/living_room.glb"), SCENE_VOXELS),
    building("three-storeys", Some("scenes/three-storeys.glb"), SCENE_VOXELS),
];

/// The figures for one building with voxels of one size.
#[derive(Serialize)]
struct ModeRow {
    building: &'static str,
    voxel_m: f32,
    /// CPU milliseconds of a picture from the spawn points: the median.
    perspective_ms: f64,
    orthogonal_ms: f64,
    /// With form patterns wherever they can be used.
    forms_ms: f64,
    /// Orthogonal mode as a share of perspective mode, from the spawn points and along the walk.
    spawns: f64,
    walk: f64,
    /// The same with form patterns wherever they can be used.
    forms_spawns: f64,
}

#[derive(Serialize)]
struct ModeFigures {
    rows: Vec<ModeRow>,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    // Thread time counts one thread only, so everything is drawn on this one.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build()?;
    let mut figures = ModeFigures { rows: Vec::new() };
    println!(
        "{:<14} {:>8} {:>12} {:>12} {:>12} {:>8} {:>8}",
        "", "voxel m", "perspective", "orthogonal", "forms only", "spawns", "walk"
    );
    // To show that the bench works, the demo building is enough.
    let is_wanted = |building: &&Building| {
        building.name.contains(&args.only) && (args.flags.bench || building.file.is_none())
    };
    for building in BUILDINGS.iter().filter(is_wanted) {
        let Some(model) = building.model()? else { continue };
        let voxels = if args.flags.bench { building.voxels } else { &building.voxels[2..] };
        let mut world = world(&model, voxels[0]).context(building.name)?;
        let views = views(&world, if args.flags.bench { args.views } else { 1 });
        for &voxel in voxels {
            if voxel != voxels[0] {
                let bounds = model.bounds().context("the model is empty")?;
                let go_on = |_| ControlFlow::Continue(());
                world.octree = voxelise::voxelise(&model.surfaces, &bounds, voxel, &go_on)?;
            }
            let row = pool.install(|| measure(building.name, &world, &views, &args));
            row.print();
            figures.rows.push(row);
        }
    }
    args.flags.write(&figures)
}

impl Building {
    /// The model; `None` when its file is not there.
    fn model(&self) -> anyhow::Result<Option<Model>> {
        let Some(file) = self.file else {
            return Ok(Some(glb::read_slice(&sightline_demo_building::glb(60, 1), None, "demo")?));
        };
        let Some(path) = shared_file(file) else { return Ok(None) };
        Ok(Some(import::read(&path, &[])?))
    }
}

/// A world without light.
fn world(model: &Model, voxel: f32) -> anyhow::Result<World> {
    let options =
        CompileOptions { voxel: Some(voxel), quality: Quality::Quick, ..Default::default() };
    Ok(compile(model, &options, &|_, _| ControlFlow::Continue(()))?.0)
}

/// At most `count` spawn points, evenly taken from all, and as many frames of a walk.
fn views(world: &World, count: usize) -> Views {
    let mut views = Views::new(world, &CameraPath::through(world), count);
    let all = std::mem::take(&mut views.spawns);
    let step = all.len().div_ceil(count).max(1);
    views.spawns = all.into_iter().step_by(step).collect();
    views
}

fn measure(name: &'static str, world: &World, views: &Views, args: &Args) -> ModeRow {
    let mut frame = Frame::new(args.size[0], args.size[1]);
    let mut renderer = Renderer::default();
    let mut medians = |cameras: &[Camera]| {
        let mut times = Mode::ALL.map(|_| Vec::new());
        for camera in cameras {
            let mut least = Mode::ALL.map(|_| f64::INFINITY);
            for _ in 0..args.repeats.max(1) {
                for (mode, least) in Mode::ALL.into_iter().zip(&mut least) {
                    renderer.mode = mode;
                    let start = ThreadTime::now();
                    renderer.draw(&world.octree, camera, &mut frame);
                    *least = least.min(start.elapsed().as_secs_f64() * 1.0e3);
                }
            }
            times.iter_mut().zip(least).for_each(|(times, least)| times.push(least));
        }
        times.map(|times| Spread::of(&times).median)
    };
    let [perspective_ms, forms_ms, orthogonal_ms] = medians(&views.spawns);
    let [perspective_walk, _, orthogonal_walk] = medians(&views.path);
    ModeRow {
        building: name,
        voxel_m: world.octree.voxel(),
        perspective_ms,
        orthogonal_ms,
        forms_ms,
        spawns: orthogonal_ms / perspective_ms,
        walk: orthogonal_walk / perspective_walk,
        forms_spawns: forms_ms / perspective_ms,
    }
}

impl ModeRow {
    fn print(&self) {
        println!(
            "{:<14} {:>8.3} {:>12.2} {:>12.2} {:>12.2} {:>8.2} {:>8.2}",
            self.building,
            self.voxel_m,
            self.perspective_ms,
            self.orthogonal_ms,
            self.forms_ms,
            self.spawns,
            self.walk
        );
    }
}
