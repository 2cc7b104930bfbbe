//! Three ways to place octants by a form pattern, measured apart from everything else.
//!
//! Each descends a full tree of 6 levels from 64 forms, and sums the corners of the bounding boxes,
//! so that nothing is optimised away. The three ways are: offsets from the bounding box's corner,
//! shifted; four offsets from the centre, and their negatives; and floating-point offsets, scaled
//! by a power of a half and added. Prints nanoseconds per node, the least of several rounds.
//!
//! `cargo bench -p sightline-tests --bench forms`

use std::{hint::black_box, time::Instant};

use clap::Parser;
use serde::Serialize;
use sightline_tests::bench_flags::BenchFlags;

const LEVELS: u32 = 6;
const FORMS: usize = 64;
const ROUNDS: usize = 15;

/// Edges in pixels, with 16 fractional bits.
type Edges = [[i32; 2]; 3];

/// Sums the positions of all nodes below a form.
type PlacingMethod = fn(&Edges) -> i64;

/// Measures three ways to place octants.
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    flags: BenchFlags,
}

#[derive(Serialize)]
struct MethodRow {
    method: &'static str,
    ns_per_node: f64,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let rounds = if args.flags.bench { ROUNDS } else { 1 };
    let forms: Vec<Edges> = (0..FORMS as i32).map(edges).collect();
    let nodes = FORMS as f64 * (1..=LEVELS).map(|level| 8f64.powi(level as i32)).sum::<f64>();
    println!("{:<44} {:>8}", "method", "ns/node");
    let ways: [(&str, PlacingMethod); 3] = [
        ("offsets from the corner, shifted", by_corner),
        ("four offsets from the centre, and negated", by_halves),
        ("floating point, scaled and added", by_product),
    ];
    let rows = ways.map(|(method, way)| {
        let least = (0..rounds).map(|_| time_ns(&forms, way)).fold(f64::INFINITY, f64::min);
        MethodRow { method, ns_per_node: least / nodes }
    });
    for MethodRow { method, ns_per_node } in &rows {
        println!("{method:<44} {ns_per_node:>8.2}");
    }
    args.flags.write(&rows)
}

fn edges(i: i32) -> Edges {
    let part = |a: i32| (i * 7919 + a * 104_729) % 1_500_000 - 750_000;
    [[part(1), part(2)], [part(3), part(4)], [part(5), part(6)]]
}

fn time_ns(forms: &[Edges], way: PlacingMethod) -> f64 {
    let start = Instant::now();
    for form in forms {
        black_box(way(black_box(form)));
    }
    start.elapsed().as_secs_f64() * 1.0e9
}

/// The offset from the bounding box's corner to an octant's corner: half an edge on its far side.
fn corner_offset(edges: &Edges, octant: usize) -> [i32; 2] {
    [0, 1].map(|part| {
        let of = |axis: usize| {
            let (edge, far) = (edges[axis][part], octant >> axis & 1 == 1);
            if far == (edge > 0) { edge.abs() / 2 } else { 0 }
        };
        of(0) + of(1) + of(2)
    })
}

fn by_corner(edges: &Edges) -> i64 {
    fn below(offsets: &[[i32; 2]; 8], at: [i32; 2], level: u32) -> i64 {
        let place = |offset: &[i32; 2]| [0, 1].map(|part| at[part] + (offset[part] >> level));
        offsets
            .iter()
            .map(|offset| reached(place(offset), level, |at| below(offsets, at, level + 1)))
            .sum()
    }
    below(&std::array::from_fn(|octant| corner_offset(edges, octant)), [0, 0], 0)
}

fn by_halves(edges: &Edges) -> i64 {
    fn below(offsets: &[[i32; 2]; 4], half: [i32; 2], centre: [i32; 2], level: u32) -> i64 {
        let corner =
            |centre: [i32; 2]| [0, 1].map(|part| centre[part] - (half[part] >> (level + 1)));
        let both = |offset: &[i32; 2]| {
            let offset = offset.map(|part| part >> level);
            let ends = [
                [centre[0] + offset[0], centre[1] + offset[1]],
                [centre[0] - offset[0], centre[1] - offset[1]],
            ];
            ends.map(|end| reached(corner(end), level, |_| below(offsets, half, end, level + 1)))
        };
        offsets.iter().flat_map(both).sum()
    }
    let half = [0, 1].map(|part| edges.iter().map(|edge| edge[part].abs()).sum::<i32>() / 2);
    let offset = |octant: usize| {
        [0, 1].map(|part| {
            let of = |axis: usize| {
                let quarter = edges[axis][part] / 4;
                if octant >> axis & 1 == 1 { quarter } else { -quarter }
            };
            of(0) + of(1) + of(2)
        })
    };
    below(&std::array::from_fn(offset), half, half, 0)
}

fn by_product(edges: &Edges) -> i64 {
    fn below(offsets: &[[f32; 2]; 8], at: [f32; 2], level: u32, scale: f32) -> i64 {
        let place = |offset: &[f32; 2]| [0, 1].map(|part| at[part] + offset[part] * scale);
        let one = |offset| {
            let at = place(offset);
            reached(at.map(|part| part as i32), level, |_| {
                below(offsets, at, level + 1, scale * 0.5)
            })
        };
        offsets.iter().map(one).sum()
    }
    let offsets = |octant| corner_offset(edges, octant).map(|part| part as f32);
    below(&std::array::from_fn(offsets), [0.0; 2], 0, 1.0)
}

/// Adds the column and row of a position, and the sum below it.
fn reached(at: [i32; 2], level: u32, below: impl FnOnce([i32; 2]) -> i64) -> i64 {
    let here = i64::from(at[0] >> 16) + i64::from(at[1] >> 16);
    if level + 1 == LEVELS { here } else { here + below(at) }
}
