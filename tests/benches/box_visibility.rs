//! How many pairs the test of two boxes ([`sightline_visibility::box_visibility`]) excludes beyond
//! the PVS, and at what cost.
//!
//! ```text
//! cargo bench -p sightline-tests --bench box_visibility -- --pairs 2000 --budget 5000 house.glb
//! ```
//!
//! Buildings are files (.glb, .gltf, .bsp, or compiled: .slw). Without any, they are a generated
//! building and those with a trace in the folder `shared` beside the repository, or in
//! `SIGHTLINE_SHARED`. A pair is two people of a trace at one moment, or two places where a person
//! can stand. Around each is a box of eyes or bodies that ends at the walls.

use std::{
    fmt,
    ops::ControlFlow,
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::Context;
use clap::Parser;
use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use serde::Serialize;
use sightline_cli::{percentile::percentile, trace::Trace};
use sightline_compiler::{
    CompileOptions, compile,
    import::{self, glb},
    model::Model,
};
use sightline_fixtures::shared_files::shared_file;
use sightline_oracle::Oracle;
use sightline_tests::bench_flags::BenchFlags;
use sightline_visibility::box_visibility::{BoxScratch, BoxVisibility, Occluders};
use sightline_world::{World, geometry::Aabb};

/// Buildings and their traces, in the folder `shared`.
const TRACED: [[&str; 2]; 3] = [
    ["maps/oa_dm2.bsp", "traces/oa_dm2-32.csv.gz"],
    ["maps/delta.bsp", "traces/delta-60.csv.gz"],
    ["traces/rooms400.glb", "traces/rooms400-60.csv.gz"],
];
/// How far bodies may reach into walls, in metres.
const POKE: f32 = 0.06;
/// The free space on each side of a standing person, in metres.
const ROOM: f32 = 0.25;
/// The number of points along each edge of a box between which rays are traced.
const POINTS: usize = 3;

/// Measures the test of two boxes against the PVS and against rays.
#[derive(Parser)]
struct Args {
    /// The buildings: .glb, .gltf, .bsp or .slw.
    files: Vec<PathBuf>,
    /// The number of pairs for each radius.
    #[arg(long, value_name = "N", default_value_t = 1_000)]
    pairs: usize,
    /// The budget of one test, in units of work.
    #[arg(long, value_name = "UNITS", default_value_t = 20_000)]
    budget: u32,
    /// How far from their places people may be, in metres.
    #[arg(long, value_delimiter = ',', value_name = "R,R,...", default_value = "0,0.25,0.5,1,2")]
    radii: Vec<f32>,
    /// The number of rooms in the generated building.
    #[arg(long, value_name = "N", default_value_t = 100)]
    rooms: usize,
    #[command(flatten)]
    flags: BenchFlags,
}

fn main() -> anyhow::Result<()> {
    let mut args = Args::parse();
    if !args.flags.bench {
        (args.rooms, args.pairs, args.radii) = (4, 20, vec![0.5]);
    }
    let mut rows = Vec::new();
    for path in &args.files {
        rows.extend(TestBuilding::new(title(path), world(path)?, None).measure(&args)?);
    }
    if args.files.is_empty() {
        let model =
            glb::read_slice(&sightline_demo_building::glb(args.rooms, 1), None, "generated")?;
        let name = format!("{} generated rooms", args.rooms);
        rows.extend(TestBuilding::new(name, compiled(&model)?, None).measure(&args)?);
    }
    if args.files.is_empty() && args.flags.bench {
        for paths in TRACED {
            if let [Some(building), Some(trace)] = paths.map(shared_file) {
                let trace = Trace::open(&trace)?;
                let building = TestBuilding::new(title(&building), world(&building)?, Some(trace));
                rows.extend(building.measure(&args)?);
            }
        }
    }
    args.flags.write(&rows)
}

fn title(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn world(path: &Path) -> anyhow::Result<World> {
    let read = || -> anyhow::Result<World> {
        match path.extension() {
            Some(extension) if extension == "slw" => Ok(World::read(path)?),
            _ => compiled(&import::read(path, &[])?),
        }
    };
    read().with_context(|| path.display().to_string())
}

fn compiled(model: &Model) -> anyhow::Result<World> {
    let options = CompileOptions { voxel: Some(1.0), ..Default::default() };
    Ok(compile(model, &options, &|_, _| ControlFlow::Continue(()))?.0)
}

/// A building and its trace, if any.
struct TestBuilding {
    name: String,
    world: World,
    oracle: Oracle,
    trace: Option<Trace>,
}

/// The results for boxes of one size.
#[derive(Default)]
struct Tally {
    seen: usize,
    pvs: usize,
    left: usize,
    unknown: usize,
    wrong: usize,
    spent: Vec<u32>,
    micros: Vec<f64>,
}

/// The figures of boxes of one size in a building. Shares are of all pairs.
#[derive(Serialize)]
struct RadiusRow {
    building: String,
    radius_m: f32,
    pairs: usize,
    /// Pairs of which rays see each other, in percent.
    seen_percent: f64,
    /// Pairs that the PVS lets through, in percent.
    pvs_percent: f64,
    /// Pairs that the PVS and the test let through, in percent.
    both_percent: f64,
    /// What the PVS lets through over what rays see.
    pvs_over_send: Option<f64>,
    /// What the PVS and the test let through over what rays see.
    both_over_send: Option<f64>,
    /// Pairs for which the budget was too small, in percent.
    unknown_percent: f64,
    units: Quantiles<u32>,
    micros: Quantiles<f64>,
    micros_mean: f64,
}

#[derive(Serialize)]
struct Quantiles<T> {
    median: T,
    p90: T,
    p99: T,
}

impl<T: Copy + Default + PartialOrd> Quantiles<T> {
    fn of(sorted: &[T]) -> Self {
        let [median, p90, p99] =
            [50, 90, 99].map(|percent| percentile(sorted, percent).unwrap_or_default());
        Self { median, p90, p99 }
    }
}

impl TestBuilding {
    fn new(name: String, world: World, trace: Option<Trace>) -> Self {
        Self { name, oracle: Oracle::new(&world.mesh), world, trace }
    }

    fn measure(&self, args: &Args) -> anyhow::Result<Vec<RadiusRow>> {
        let start = Instant::now();
        let occluders = Occluders::new(&self.world);
        println!(
            "\n{}: {} occluders, {} kB, made in {:.2} s; budget {}",
            self.name,
            occluders.len(),
            occluders.bytes() / 1000,
            start.elapsed().as_secs_f64(),
            args.budget
        );
        println!(
            "radius  seen %   PVS %  both %   PVS/seen both/seen  unknown %  \
                  units: median     p90     p99  µs: median     p90     p99    mean"
        );
        let mut rows = Vec::new();
        for &radius in &args.radii {
            let mut rng = SmallRng::seed_from_u64(7);
            let mut tally = Tally::default();
            for _ in 0..args.pairs {
                let pair = self.pair(&mut rng).context("no pair of places was found")?;
                self.try_pair(pair, radius, &occluders, args.budget, &mut tally);
            }
            let wrong = tally.wrong;
            let row = tally.row(&self.name, radius, args.pairs);
            println!("{row}");
            anyhow::ensure!(wrong == 0, "{wrong} visible pairs were classified as hidden");
            rows.push(row);
        }
        Ok(rows)
    }

    fn try_pair(
        &self,
        [eye, other]: [Vec3; 2],
        radius: f32,
        occluders: &Occluders,
        budget: u32,
        tally: &mut Tally,
    ) {
        let cells = &self.world.cells;
        let eyes = self.free_around(eye, radius);
        let bodies =
            self.world.body.in_axes(&cells.axes).around_box(&self.free_around(other, radius));
        let bodies = bodies.intersection(&self.free_around(other, radius + 2.0).grown(POKE));
        let is_seen = self.sees(&eyes, &bodies);
        tally.seen += usize::from(is_seen);
        let visible = cells.visible_from(&eyes);
        let mut held = Vec::new();
        cells.overlapping(&bodies, &mut held);
        if !held.iter().any(|cell| visible.contains(cell.0)) {
            return;
        }
        tally.pvs += 1;
        let (mut scratch, mut left) = (BoxScratch::default(), budget);
        let start = Instant::now();
        let outcome = occluders.between(&mut scratch, &eyes, &bodies, &mut left);
        tally.micros.push(start.elapsed().as_secs_f64() * 1e6);
        tally.spent.push(budget - left);
        tally.left += usize::from(outcome != BoxVisibility::Hidden);
        tally.unknown += usize::from(outcome == BoxVisibility::Unknown);
        tally.wrong += usize::from(outcome == BoxVisibility::Hidden && is_seen);
    }

    /// Two places of eyes; `None` when no such pair is found.
    fn pair(&self, rng: &mut SmallRng) -> Option<[Vec3; 2]> {
        let Some(trace) = &self.trace else { return Some([self.stand(rng)?, self.stand(rng)?]) };
        let ids: Vec<u32> = trace.ids().collect();
        let (first, last) = trace.span();
        (0..10_000).find_map(|_| {
            let at = first + (last - first).mul_f64(rng.random());
            let [one, other] = [(); 2].map(|()| ids[rng.random_range(0..ids.len())]);
            let eye = |id| Some(trace.pose_at(id, at, self.world.speed_max)?.eye);
            if one == other { None } else { Some([eye(one)?, eye(other)?]) }
        })
    }

    /// The eye of a person who stands on a floor, under a roof, and not in a wall.
    fn stand(&self, rng: &mut SmallRng) -> Option<Vec3> {
        let World { cells, spawns, body, .. } = &self.world;
        (0..1_000_000).find_map(|_| {
            let cell = &cells.cells[rng.random_range(0..cells.cells.len())].bounds;
            let share = Vec3::new(rng.random(), 0.5, rng.random());
            let place = cells.axes.world(cell.min + cell.size() * share);
            let floor = self.oracle.distance(place, Vec3::NEG_Y)?;
            let eye = place - Vec3::Y * (floor - body.below_eye);
            let is_level = spawns.iter().any(|spawn| (spawn.eye.y - eye.y).abs() < 0.3);
            let is_free = [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z]
                .iter()
                .all(|&along| self.oracle.distance(eye, along).is_none_or(|far| far > ROOM));
            let is_inside = self.oracle.distance(eye, Vec3::Y).is_some() && cells.at(eye).is_some();
            (is_level && is_free && is_inside).then_some(eye)
        })
    }

    /// A box around a place, in the world's own axes, that ends at the nearest wall along each
    /// axis.
    fn free_around(&self, place: Vec3, radius: f32) -> Aabb {
        let axes = &self.world.cells.axes;
        let centre = axes.own(place);
        let mut around = Aabb::around(centre, radius);
        for axis in 0..3 {
            let free = |along: Vec3| {
                let far = self.oracle.distance(place, axes.world(along)).unwrap_or(f32::INFINITY);
                far.min(radius)
            };
            around.max[axis] = centre[axis] + free(Vec3::AXES[axis]);
            around.min[axis] = centre[axis] - free(-Vec3::AXES[axis]);
        }
        around
    }

    /// Whether a ray is free between points of two boxes, from a point where an eye can be.
    fn sees(&self, eyes: &Aabb, bodies: &Aabb) -> bool {
        let cells = &self.world.cells;
        let to: Vec<Vec3> = points(bodies).map(|point| cells.axes.world(point)).collect();
        let mut from = points(eyes).map(|point| cells.axes.world(point));
        from.any(|eye| {
            cells.at(eye).is_some() && to.iter().any(|&point| self.oracle.between(eye, point))
        })
    }
}

/// The points of a grid in a box, corners included.
fn points(region: &Aabb) -> impl Iterator<Item = Vec3> {
    let Aabb { min, .. } = *region;
    let size = region.size();
    (0..POINTS.pow(3)).map(move |i| {
        let step = [i % POINTS, i / POINTS % POINTS, i / POINTS / POINTS];
        min + size * Vec3::from(step.map(|i| i as f32)) / (POINTS - 1) as f32
    })
}

impl Tally {
    fn row(mut self, building: &str, radius_m: f32, pairs: usize) -> RadiusRow {
        self.spent.sort_unstable();
        self.micros.sort_unstable_by(f64::total_cmp);
        let percent = |count: usize| count as f64 * 100.0 / pairs as f64;
        let over = |count: usize| (self.seen > 0).then(|| count as f64 / self.seen as f64);
        RadiusRow {
            building: building.to_owned(),
            radius_m,
            pairs,
            seen_percent: percent(self.seen),
            pvs_percent: percent(self.pvs),
            both_percent: percent(self.left),
            pvs_over_send: over(self.pvs),
            both_over_send: over(self.left),
            unknown_percent: percent(self.unknown),
            units: Quantiles::of(&self.spent),
            micros: Quantiles::of(&self.micros),
            micros_mean: self.micros.iter().sum::<f64>() / self.micros.len().max(1) as f64,
        }
    }
}

impl fmt::Display for RadiusRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:6.2} {:7.2} {:7.2} {:7.2} {:10.3} {:9.3} {:10.2} {:14} {:7} {:7} {:11.1} {:7.1} \
             {:7.1} {:7.1}",
            self.radius_m,
            self.seen_percent,
            self.pvs_percent,
            self.both_percent,
            self.pvs_over_send.unwrap_or(f64::NAN),
            self.both_over_send.unwrap_or(f64::NAN),
            self.unknown_percent,
            self.units.median,
            self.units.p90,
            self.units.p99,
            self.micros.median,
            self.micros.p90,
            self.micros.p99,
            self.micros_mean,
        )
    }
}
