//! The cost of moving an object in the dynamic octree: method B compared with the naive method N,
//! on the two test scenes of Sudarsky and Gotsman, *Output-Sensitive Visibility Algorithms for
//! Dynamic Scenes with Applications to Virtual Reality* (1996), section 4.1.
//!
//! ```text
//! cargo bench -p sightline-tests --bench occupants
//! ```
//!
//! Both methods move the same boxes through the same tree with the same code. They differ in where
//! they start and in what they delete. The counts of nodes do not depend on the machine.

mod table;

use std::time::{Duration, Instant};

use clap::Parser;
use glam::Vec3;
use serde::Serialize;
use sightline_tests::bench_flags::BenchFlags;
use sightline_world::{
    geometry::Aabb,
    octree::{
        DEPTH_MAX,
        occupants::{OccupantId, Occupants},
    },
};

/// Moves cubes in two scenes, and prints the cost.
#[derive(Parser)]
struct Args {
    /// The time for each method in each scene, in milliseconds.
    #[arg(long, default_value_t = 300)]
    budget_ms: u64,
    #[command(flatten)]
    flags: BenchFlags,
}

/// What a step costs by both methods: N is the naive one, B is ours.
#[derive(Serialize)]
struct StepRow {
    /// The small cube: its share of the large one as a power of two, or its edge.
    cube: String,
    depth: u8,
    naive_ns: f64,
    ours_ns: f64,
    speed_up: f64,
    /// The naive method's visited nodes over ours.
    nodes_ratio: f64,
    /// The share of steps in which the cube changes nodes.
    changing: Option<f64>,
    /// The speed-up of these steps alone.
    changing_speed_up: Option<f64>,
}

/// The line through the speed-ups of scene 1, over the binary logarithm of the cubes' ratio.
#[derive(Serialize)]
struct SpeedUpLine {
    base: f64,
    slope: f64,
    correlation: f64,
}

#[derive(Serialize)]
struct OccupantFigures {
    scene_1: Vec<StepRow>,
    scene_1_line: SpeedUpLine,
    scene_2: Vec<StepRow>,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let budget = Duration::from_millis(if args.flags.bench { args.budget_ms } else { 1 });
    let (scene_1, scene_1_line) = scene_1(budget);
    let scene_2 = scene_2(budget);
    args.flags.write(&OccupantFigures { scene_1, scene_1_line, scene_2 })
}

/// A small cube in a large one, in steps of half its side. Its distance from the large cube's edge
/// is its own width.
fn scene_1(budget: Duration) -> (Vec<StepRow>, SpeedUpLine) {
    println!("\nTest scene 1: a small cube along an edge of a large one.\n");
    println!("log2 of ratio  depth  N ns  B ns  speed-up  nodes visited");
    let (mut speed_ups, mut rows) = (Vec::new(), Vec::new());
    for bits in 3..=12 {
        let side = (1u32 << bits) as f32;
        let track: Vec<Vec3> = (2..)
            .map(|i| Vec3::new(i as f32 * 0.5, 1.0, 1.0))
            .take_while(|at| at.x <= side - 2.0)
            .collect();
        // The alignment of the cubes with the nodes is arbitrary, so four alignments are averaged.
        let regions = [(0.013, 1.037), (0.05, 1.31), (0.21, 1.57), (0.37, 1.93)];
        let results = regions.map(|(before, whole)| {
            let mut scene = Occupants::new(Vec3::splat(-before * side), whole * side, DEPTH_MAX);
            insert_cube(&mut scene, Vec3::ZERO, side);
            compare(scene, &track, 1.0, budget / 4)
        });
        let mean = |of: fn(&MethodComparison) -> f64| results.iter().map(of).sum::<f64>() / 4.0;
        let (naive_ns, ours_ns) = (mean(|r| r.naive.ns), mean(|r| r.ours.ns));
        let visited = mean(|r| r.naive.visited) / mean(|r| r.ours.visited);
        println!(
            "{bits:>13}  {:>5}  {naive_ns:>4.0}  {ours_ns:>4.0}  {:>8.2}  {visited:>13.2}",
            results[0].depth,
            naive_ns / ours_ns,
        );
        speed_ups.push((f64::from(bits), naive_ns / ours_ns));
        rows.push(StepRow {
            cube: format!("1/{}", 1u32 << bits),
            depth: results[0].depth,
            naive_ns,
            ours_ns,
            speed_up: naive_ns / ours_ns,
            nodes_ratio: visited,
            changing: None,
            changing_speed_up: None,
        });
    }
    let (slope, base, correlation) = line_through(&speed_ups);
    println!("speed-up = {base:.2} + {slope:.3} log2(ratio), r = {correlation:.3}");
    (rows, SpeedUpLine { base, slope, correlation })
}

/// A table for four. A small cube circles one of the candlesticks in steps of a degree.
fn scene_2(budget: Duration) -> Vec<StepRow> {
    let polygons = table::polygons();
    let region = Aabb::from_points(polygons.iter().flat_map(|b| [b.min, b.max]));
    let edge = region.size().max_element() * 1.001;
    let mut scene = Occupants::new(region.centre() - edge * 0.5, edge, DEPTH_MAX);
    for polygon in &polygons {
        scene.insert(&[*polygon]).expect("finite");
    }
    println!(
        "\nTest scene 2: a table for four, {} polygons, {} nodes.\n",
        polygons.len(),
        scene.node_count()
    );
    println!(
        "cube cm  depth  N ns  B ns  speed-up  nodes visited  | steps to other nodes: %  speed-up"
    );
    let mut rows = Vec::new();
    for side in [0.005, 0.01, 0.02, 0.04, 0.08] {
        let track = circle(side);
        let result = compare(scene.clone(), &track, side, budget);
        let changing = steps_that_change(scene.clone(), &track, side);
        let share = changing.len() as f64 / track.len() as f64;
        let of_these = compare(scene.clone(), &changing, side, budget);
        println!(
            "{:>7.1}  {:>5}  {:>4.0}  {:>4.0}  {:>8.2}  {:>13.2}  | {:>23.0}  {:>8.2}",
            side * 100.0,
            result.depth,
            result.naive.ns,
            result.ours.ns,
            result.speed_up(),
            result.naive.visited / result.ours.visited,
            share * 100.0,
            of_these.speed_up(),
        );
        rows.push(StepRow {
            cube: format!("{:.1} cm", side * 100.0),
            depth: result.depth,
            naive_ns: result.naive.ns,
            ours_ns: result.ours.ns,
            speed_up: result.speed_up(),
            nodes_ratio: result.naive.visited / result.ours.visited,
            changing: Some(share),
            changing_speed_up: Some(of_these.speed_up()),
        });
    }
    rows
}

/// The least corners of a cube around a candlestick, one degree apart.
fn circle(side: f32) -> Vec<Vec3> {
    let centre = table::CANDLESTICK + Vec3::Y * 0.1;
    let place = |degrees: u16| {
        let (sine, cosine) = f32::from(degrees).to_radians().sin_cos();
        centre + Vec3::new(cosine, 0.0, sine) * (0.07 + side) - side * 0.5
    };
    (0..360).map(place).collect()
}

/// The six faces of a cube, each a box without thickness.
fn cube(min: Vec3, side: f32) -> [Aabb; 6] {
    std::array::from_fn(|face| {
        let mut bounds = Aabb::new(min, min + side);
        let axis = face / 2;
        if face % 2 == 0 {
            bounds.max[axis] = min[axis];
        } else {
            bounds.min[axis] = bounds.max[axis];
        }
        bounds
    })
}

fn insert_cube(scene: &mut Occupants, min: Vec3, side: f32) -> OccupantId {
    scene.insert(&cube(min, side)).expect("finite")
}

/// The places of a track where an object changes nodes since the place before.
fn steps_that_change(mut scene: Occupants, track: &[Vec3], side: f32) -> Vec<Vec3> {
    let id = insert_cube(&mut scene, track[track.len() - 1], side);
    let mut changing = Vec::new();
    for &at in track {
        let before = scene.counters();
        scene.move_to(id, &cube(at, side)).expect("finite");
        if scene.counters() != before {
            changing.push(at);
        }
    }
    changing
}

/// The mean cost of a step.
struct Cost {
    ns: f64,
    /// The number of visited nodes.
    visited: f64,
}

struct MethodComparison {
    naive: Cost,
    ours: Cost,
    depth: u8,
}

impl MethodComparison {
    fn speed_up(&self) -> f64 {
        self.naive.ns / self.ours.ns
    }
}

/// Moves a cube along a track by both methods, and checks that both trees have the same size.
fn compare(mut scene: Occupants, track: &[Vec3], side: f32, budget: Duration) -> MethodComparison {
    let id = insert_cube(&mut scene, track[0], side);
    let boxes: Vec<[Aabb; 6]> = track.iter().map(|&at| cube(at, side)).collect();
    let (mut ours, mut naive) = (scene.clone(), scene);
    let depth = ours.depth();
    for boxes in &boxes {
        ours.move_to(id, boxes).expect("finite");
        naive.move_naively(id, boxes).expect("finite");
        assert_eq!(ours.node_count(), naive.node_count());
    }
    // Back and forth, without a jump from the end to the start.
    let there_and_back: Vec<[Aabb; 6]> = boxes.iter().chain(boxes.iter().rev()).copied().collect();
    let naive =
        cost(naive, &there_and_back, budget, |scene, boxes| scene.move_naively(id, boxes).is_ok());
    let ours = cost(ours, &there_and_back, budget, |scene, boxes| scene.move_to(id, boxes).is_ok());
    MethodComparison { naive, ours, depth }
}

/// The cost of a step in the fastest of many rounds.
fn cost(
    mut scene: Occupants,
    steps: &[[Aabb; 6]],
    budget: Duration,
    step: impl Fn(&mut Occupants, &[Aabb]) -> bool,
) -> Cost {
    let (start, before) = (Instant::now(), scene.counters());
    let (mut rounds, mut fastest) = (0u32, f64::INFINITY);
    while rounds < 3 || start.elapsed() < budget {
        let round = Instant::now();
        for boxes in steps {
            assert!(step(&mut scene, boxes));
        }
        fastest = fastest.min(round.elapsed().as_secs_f64());
        rounds += 1;
    }
    let count = f64::from(rounds) * steps.len() as f64;
    let visited = scene.counters().visited - before.visited;
    Cost { ns: fastest * 1e9 / steps.len() as f64, visited: visited as f64 / count }
}

/// The least-squares line through points: its slope, its height at zero, and the coefficient of
/// correlation.
fn line_through(points: &[(f64, f64)]) -> (f64, f64, f64) {
    let count = points.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
    let xy = mean(&|p| (p.0 - x) * (p.1 - y));
    let (xx, yy) = (mean(&|p| (p.0 - x).powi(2)), mean(&|p| (p.1 - y).powi(2)));
    (xy / xx, y - xy / xx * x, xy / (xx * yy).sqrt())
}
