//! The cost of a frame.

use std::{
    io,
    time::{Duration, Instant},
};

use cpu_time::{ProcessTime, ThreadTime};
use serde::Serialize;
use sightline_renderer::{Camera, Counters, Frame, Mode, Renderer};
use sightline_world::World;

use super::{BvhKind, RayCaster, Views};

/// A method to draw a picture, or to find its depths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawMethod {
    /// The renderer in one of its modes.
    Octree(Mode),
    /// The renderer in orthogonal mode with smooth edges: [`Renderer::antialias`].
    Smooth,
    /// A ray per pixel.
    Rays(BvhKind),
}

impl DrawMethod {
    /// All methods: first those that draw, then those for comparison.
    pub const ALL: [Self; 6] = [
        Self::Octree(Mode::Orthogonal),
        Self::Octree(Mode::Perspective),
        Self::Octree(Mode::Forms),
        Self::Smooth,
        Self::Rays(BvhKind::Bvh2),
        Self::Rays(BvhKind::Cwbvh),
    ];

    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Octree(Mode::Orthogonal) => "orthogonal",
            Self::Octree(Mode::Perspective) => "perspective",
            Self::Octree(Mode::Forms) => "forms",
            Self::Smooth => "smooth edges",
            Self::Rays(BvhKind::Bvh2) => "rays, BVH2",
            Self::Rays(BvhKind::Cwbvh) => "rays, CWBVH",
        }
    }

    /// Sets a renderer up for this method. Rays need none.
    pub fn configure(self, renderer: &mut Renderer) {
        renderer.antialias = self == Self::Smooth;
        renderer.mode = match self {
            Self::Octree(mode) => mode,
            Self::Smooth | Self::Rays(_) => Mode::default(),
        };
    }
}

/// How to measure.
#[derive(Clone, Copy, Debug)]
pub struct BenchOptions {
    /// Columns and rows of pixels.
    pub size: (usize, usize),
    /// The number of drawing threads.
    pub threads: usize,
    /// How often each frame is drawn by each method. The least time counts.
    pub repeats: usize,
    /// Only this mode of the renderer is measured; all of them when absent.
    pub mode: Option<Mode>,
}

/// The figures for one size and one number of threads.
#[derive(Clone, Debug, Serialize)]
pub struct BenchRun {
    /// Columns of pixels.
    pub width: usize,
    /// Rows of pixels.
    pub height: usize,
    /// The number of drawing threads.
    pub threads: usize,
    /// A row for each method.
    pub rows: Vec<MethodRow>,
}

/// The cost of one method.
#[derive(Clone, Debug, Serialize)]
pub struct MethodRow {
    /// See [`DrawMethod::name`].
    pub name: &'static str,
    /// CPU time of a frame, in milliseconds: the sum over all threads.
    pub cpu_ms: Timing,
    /// CPU time of the thread that worked most for a frame, in milliseconds: what a frame takes on
    /// an idle machine.
    pub busiest_ms: Timing,
    /// Wall-clock time of a frame, in milliseconds.
    pub wall_ms: Timing,
    /// Millions of pixels, or rays, per second of CPU time, from the spawn points.
    pub rays_per_us: f64,
    /// The CPU time of rays through the BVH2, divided by that of this method: the median over the
    /// spawn points. `None` without rays.
    pub ratio_bvh2: Option<f64>,
    /// The CPU time of rays through the CWBVH, divided by that of this method: the median over the
    /// spawn points. `None` without rays.
    pub ratio_cwbvh: Option<f64>,
    /// The renderer's work for a frame, the mean over the spawn points. `None` for rays.
    pub counts: Option<FrameCounts>,
    /// CPU milliseconds from each spawn point.
    pub spawns_cpu_ms: Vec<f64>,
    /// CPU milliseconds of each frame of the path.
    pub path_cpu_ms: Vec<f64>,
}

/// The renderer's mean work per frame.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct FrameCounts {
    /// Nodes projected from space to the picture.
    pub projections: f64,
    /// Nodes visited.
    pub nodes: f64,
    /// Nodes tested against the mask buffer.
    pub mask_tests: f64,
    /// Pixels written.
    pub pixels: f64,
}

impl FrameCounts {
    /// The mean over several frames.
    pub(super) fn mean(counters: &[Counters]) -> Self {
        let mean = |figure: fn(&Counters) -> u64| {
            counters.iter().map(figure).sum::<u64>() as f64 / counters.len().max(1) as f64
        };
        Self {
            projections: mean(|counters| counters.projections),
            nodes: mean(|counters| counters.nodes),
            mask_tests: mean(|counters| counters.mask_tests),
            pixels: mean(|counters| counters.pixels),
        }
    }
}

/// The times of frames.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Timing {
    /// From the spawn points.
    pub spawns: Spread,
    /// Along the path.
    pub path: Spread,
}

/// The median and the worst of several figures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// The median.
    pub median: f64,
    /// The greatest figure.
    pub worst: f64,
}

impl Spread {
    /// The spread of some figures; zero when there are none.
    pub fn of(figures: &[f64]) -> Self {
        let mut sorted = figures.to_vec();
        sorted.sort_by(f64::total_cmp);
        let middle = |i: usize| sorted.get(i).copied().unwrap_or(0.0);
        let half = sorted.len() / 2;
        let median = match sorted.len() % 2 {
            0 => 0.5 * (middle(half.saturating_sub(1)) + middle(half)),
            _ => middle(half),
        };
        Self { median, worst: sorted.last().copied().unwrap_or(0.0) }
    }
}

/// Draws all views by all methods. Calls `progress` with the share done, from 0 to 1.
///
/// # Errors
/// When the threads cannot be started, or the system does not report CPU time.
pub fn measure(
    world: &World,
    rays: Option<&RayCaster>,
    views: &Views,
    options: &BenchOptions,
    progress: &mut dyn FnMut(f32),
) -> io::Result<BenchRun> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads.max(1)).build();
    let pool = pool.map_err(io::Error::other)?;
    let (width, height) = options.size;
    let mut timer =
        FrameTimer { world, rays, renderer: Renderer::default(), frame: Frame::new(width, height) };
    let is_wanted = |method: &DrawMethod| match method {
        DrawMethod::Octree(mode) => options.mode.is_none_or(|only| only == *mode),
        DrawMethod::Smooth => options.mode.is_none_or(|only| only == Mode::default()),
        DrawMethod::Rays(_) => rays.is_some(),
    };
    let methods: Vec<DrawMethod> = DrawMethod::ALL.into_iter().filter(is_wanted).collect();
    let mut samples: Vec<Vec<FrameTime>> = vec![Vec::new(); methods.len()];
    let cameras = views.spawns.iter().chain(&views.path);
    let count = views.spawns.len() + views.path.len();
    for (i, camera) in cameras.enumerate() {
        let mut best = vec![FrameTime::WORST; methods.len()];
        for _ in 0..options.repeats.max(1) {
            for (method, best) in methods.iter().zip(&mut best) {
                *best = best.least(timer.time(&pool, *method, camera)?);
            }
        }
        samples.iter_mut().zip(best).for_each(|(samples, best)| samples.push(best));
        progress((i + 1) as f32 / count as f32);
    }
    let spawns = views.spawns.len();
    let of =
        |method| methods.iter().position(|other| *other == method).map(|i| &samples[i][..spawns]);
    let trees = [BvhKind::Bvh2, BvhKind::Cwbvh].map(|tree| of(DrawMethod::Rays(tree)));
    debug_assert!(samples.iter().all(|samples| samples.len() == count), "a sample per view");
    let row = |(method, samples): (&DrawMethod, &Vec<FrameTime>)| {
        MethodRow::new(*method, samples, spawns, (width * height) as f64, trees)
    };
    let rows = methods.iter().zip(&samples).map(row).collect();
    Ok(BenchRun { width, height, threads: options.threads.max(1), rows })
}

/// The times of a frame in milliseconds, and the work done for it.
#[derive(Clone, Copy)]
struct FrameTime {
    cpu: f64,
    busiest: f64,
    wall: f64,
    counters: Option<Counters>,
}

impl FrameTime {
    const WORST: Self =
        Self { cpu: f64::INFINITY, busiest: f64::INFINITY, wall: f64::INFINITY, counters: None };

    fn least(self, other: Self) -> Self {
        Self {
            cpu: self.cpu.min(other.cpu),
            busiest: self.busiest.min(other.busiest),
            wall: self.wall.min(other.wall),
            counters: other.counters,
        }
    }
}

struct FrameTimer<'a> {
    world: &'a World,
    rays: Option<&'a RayCaster>,
    renderer: Renderer,
    frame: Frame,
}

impl FrameTimer<'_> {
    fn time(
        &mut self,
        pool: &rayon::ThreadPool,
        method: DrawMethod,
        camera: &Camera,
    ) -> io::Result<FrameTime> {
        let threads = || {
            let times = pool.broadcast(|_| ThreadTime::try_now().map(|time| time.as_duration()));
            times.into_iter().collect::<io::Result<Vec<Duration>>>()
        };
        let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
        // Inside the pool, so that waking its threads is not part of a frame.
        pool.install(|| {
            let before = threads()?;
            let (wall, cpu) = (Instant::now(), ProcessTime::try_now()?);
            self.draw(method, camera);
            let cpu = milliseconds(ProcessTime::try_now()?.duration_since(cpu));
            let wall = milliseconds(wall.elapsed());
            let worked = threads()?.into_iter().zip(before).map(|(after, before)| after - before);
            let busiest = milliseconds(worked.max().unwrap_or_default());
            let drew = !matches!(method, DrawMethod::Rays(_));
            let counters = drew.then(|| self.renderer.counters());
            Ok(FrameTime { cpu, busiest, wall, counters })
        })
    }

    fn draw(&mut self, method: DrawMethod, camera: &Camera) {
        match (method, self.rays) {
            (DrawMethod::Octree(_) | DrawMethod::Smooth, _) => {
                method.configure(&mut self.renderer);
                self.renderer.draw(&self.world.octree, camera, &mut self.frame);
            }
            (DrawMethod::Rays(tree), Some(rays)) => {
                rays.trace(tree, camera, self.frame.width(), &mut self.frame.depth);
            }
            (DrawMethod::Rays(_), None) => {}
        }
    }
}

impl MethodRow {
    fn new(
        method: DrawMethod,
        samples: &[FrameTime],
        spawns: usize,
        pixels: f64,
        trees: [Option<&[FrameTime]>; 2],
    ) -> Self {
        let timing = |figure: fn(&FrameTime) -> f64| {
            let figures: Vec<f64> = samples.iter().map(figure).collect();
            let (spawns, path) = figures.split_at(spawns);
            Timing { spawns: Spread::of(spawns), path: Spread::of(path) }
        };
        assert!(spawns <= samples.len(), "the spawn points come first");
        let cpu: Vec<f64> = samples.iter().map(|sample| sample.cpu).collect();
        let (spawns_cpu_ms, path_cpu_ms) = cpu.split_at(spawns);
        let cpu_ms = timing(|sample| sample.cpu);
        let ratio = |tree: &[FrameTime]| {
            let ratios = tree.iter().zip(spawns_cpu_ms).map(|(tree, own)| tree.cpu / own);
            Spread::of(&ratios.collect::<Vec<_>>()).median
        };
        let counters: Vec<Counters> = samples[..spawns].iter().filter_map(|s| s.counters).collect();
        let counts = (!counters.is_empty()).then(|| FrameCounts::mean(&counters));
        let [ratio_bvh2, ratio_cwbvh] = trees.map(|tree| tree.map(ratio));
        Self {
            name: method.name(),
            rays_per_us: pixels / (cpu_ms.spawns.median * 1e3),
            busiest_ms: timing(|sample| sample.busiest),
            wall_ms: timing(|sample| sample.wall),
            cpu_ms,
            ratio_bvh2,
            ratio_cwbvh,
            counts,
            spawns_cpu_ms: spawns_cpu_ms.to_vec(),
            path_cpu_ms: path_cpu_ms.to_vec(),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sightline_fixtures::voxel_floor::world;
    use sightline_world::Mesh;

    use super::*;
    use crate::camera_path::CameraPath;

    #[test]
    fn an_even_number_of_figures_has_the_mean_of_the_middle_two_as_median() {
        assert_eq!(Spread::of(&[]), Spread::default());
        assert_eq!(Spread::of(&[3.0]), Spread { median: 3.0, worst: 3.0 });
        assert_eq!(Spread::of(&[9.0, 1.0, 2.0, 4.0]), Spread { median: 3.0, worst: 9.0 });
    }

    #[test]
    fn every_method_gets_a_row_and_rays_are_their_own_reference() {
        let mut world = world(&[([31, 1, 8], [33, 30, 64], 0)]);
        let views = Views::new(&world, &CameraPath::through(&world), 3);
        let options = BenchOptions { size: (64, 48), threads: 2, repeats: 2, mode: None };
        let run = measure(&world, None, &views, &options, &mut |_| {}).unwrap();
        assert!(run.rows.len() == 4 && run.rows[0].ratio_bvh2.is_none());
        world.mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X * 8.0, Vec3::new(8.0, 0.0, 8.0)],
            triangles: vec![[0, 1, 2]],
        };
        let rays = RayCaster::new(&world.mesh);
        let mut told = Vec::new();
        let run = measure(&world, rays.as_ref(), &views, &options, &mut |share| told.push(share))
            .unwrap();
        assert_eq!(run.rows.len(), DrawMethod::ALL.len());
        for row in &run.rows {
            assert!(row.cpu_ms.path.worst > 0.0 && row.wall_ms.spawns.median > 0.0, "{row:?}");
            assert!(row.busiest_ms.spawns.median > 0.0, "{row:?}");
            assert_eq!((row.spawns_cpu_ms.len(), row.path_cpu_ms.len()), (1, 3));
            assert_eq!(row.counts.is_some(), !row.name.starts_with("rays"));
            assert!(row.counts.is_none_or(|counts| counts.nodes > 1.0 && counts.pixels > 1.0));
        }
        let own = run.rows.iter().find(|row| row.name == "rays, BVH2").unwrap();
        assert_eq!(own.ratio_bvh2, Some(1.0));
        assert_eq!(told.len(), 4);
        assert_eq!(told.last(), Some(&1.0));
    }
}
