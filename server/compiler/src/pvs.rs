//! The PVS: which cells see which.
//!
//! [`sightline_visibility::portal_flow`] finds sight lines, in two rounds. The first round is
//! coarse: it finds which spaces each space sees. The second round starts from each cell, goes
//! through those spaces only, and tests every cell of a space against the sight lines that enter
//! the space. Sight goes both ways, so in both rounds a pair counts only when each finds the other.

use std::{
    ops::ControlFlow,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
};

use rayon::prelude::*;
use roaring::RoaringBitmap;
use sightline_visibility::portal_flow::{DAabb, FlowScratch, Query, Sightlines};
use sightline_world::{Cells, Pvs, Space, tolerance::WIDENING_M};

use super::subdivide::CellSize;

/// For each space, the spaces that it may see, ascending.
pub type SpacesSeen = Vec<Vec<u32>>;

/// The first round: which spaces see which. `progress` hears the share that is done, from 0 to 1,
/// from any thread. When it breaks, the result is `None`.
pub fn spaces_seen(
    cells: &Cells,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Option<SpacesSeen> {
    let lines = Sightlines::new(cells);
    let from_spaces = |scratch: &mut FlowScratch, space: usize| {
        let source = DAabb::around(&cells.spaces[space].bounds, WIDENING_M);
        let query = Query { space: space as u32, source, spaces: None, frustum: &[] };
        lines.spaces(scratch, &query)
    };
    Some(mutual(sorted(each(cells.spaces.len(), from_spaces, progress)?)))
}

/// The finest cells with which about `pairs` pairs of cells see each other, but no finer than
/// `WIDTH_MIN`.
pub(crate) fn cell_size_for(pairs: f64, spaces: &[Space], seen: &SpacesSeen) -> CellSize {
    // In very large buildings cells are as wide as they must be: the PVS grows with the square of
    // their number.
    let widths = std::iter::successors(Some(WIDTH_MIN), |width| Some(width * 1.1));
    let mut sizes = widths.take_while(|&width| width < WIDTH_MAX).map(CellSize::of_width);
    sizes
        .find(|size| pairs_at(size, spaces, seen) <= pairs)
        .unwrap_or(CellSize::of_width(WIDTH_MAX))
}

/// About how many pairs of cells see each other when spaces are split into cells of a size.
pub(crate) fn pairs_at(size: &CellSize, spaces: &[Space], seen: &SpacesSeen) -> f64 {
    let count: Vec<f64> = spaces.iter().map(|space| size.cells_in(space.bounds.size())).collect();
    let visible = |row: &Vec<u32>| row.iter().map(|&to| count[to as usize]).sum::<f64>();
    count.iter().zip(seen).map(|(from, row)| from * visible(row)).sum::<f64>()
}

/// The narrowest cells, in metres: about as wide as a body. Narrower cells tell little more.
const WIDTH_MIN: f32 = 1.0;
/// No cell is wider, in metres.
const WIDTH_MAX: f32 = 100_000.0;
/// How many rows are compared with all others at once: each needs a bit for each cell.
const MUTUAL_ROWS: usize = 512;

/// The second round: the PVS of cells, given which spaces see which. `progress` hears the share
/// that is done, from 0 to 1, from any thread. When it breaks, the result is `None`.
pub fn potentially_visible(
    cells: &Cells,
    seen: &SpacesSeen,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Option<Pvs> {
    assert_eq!(seen.len(), cells.spaces.len(), "a row for each space");
    let lines = Sightlines::new(cells);
    let blocks = lines.blocks();
    let from_blocks = |scratch: &mut FlowScratch, block: usize| {
        let block = &blocks[block];
        lines.rows(scratch, block, &seen[block.space as usize])
    };
    // Blocks are in the order of their cells.
    let rows = each(blocks.len(), from_blocks, progress)?.into_iter().flatten().collect();
    let rows = mutual(sorted(rows));
    assert_eq!(rows.len(), cells.cells.len(), "blocks cover all cells");
    Some(rows.into_par_iter().map(compressed).collect())
}

fn sorted(mut rows: Vec<Vec<u32>>) -> Vec<Vec<u32>> {
    rows.par_iter_mut().for_each(|row| row.sort_unstable());
    rows
}

/// Runs a search for each of `count` sources, on all cores.
fn each<T: Default + Send>(
    count: usize,
    seen_from: impl Fn(&mut FlowScratch, usize) -> T + Sync,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Option<Vec<T>> {
    let done = AtomicUsize::new(0);
    let cancelled = AtomicBool::new(false);
    let found = (0..count)
        .into_par_iter()
        .map_init(FlowScratch::default, |scratch, index| {
            let before = done.fetch_add(1, Relaxed);
            if before.is_multiple_of(64) && progress(before as f32 / count as f32).is_break() {
                cancelled.store(true, Relaxed);
            }
            if cancelled.load(Relaxed) {
                return T::default();
            }
            seen_from(scratch, index)
        })
        .collect();
    (!cancelled.load(Relaxed)).then_some(found)
}

/// Keeps the pairs in which each has found the other.
fn mutual(seen: Vec<Vec<u32>>) -> Vec<Vec<u32>> {
    let parts = (0..seen.len().div_ceil(MUTUAL_ROWS)).into_par_iter();
    parts.flat_map_iter(|part| mutual_rows(&seen, part * MUTUAL_ROWS)).collect()
}

/// Keeps these pairs in some rows, from the first one on. A search in the other's row for each pair
/// would take longer than all sight lines.
fn mutual_rows(seen: &[Vec<u32>], first: usize) -> Vec<Vec<u32>> {
    let rows = &seen[first..seen.len().min(first + MUTUAL_ROWS)];
    // By row: a bit for each cell that has found it.
    let words = seen.len().div_ceil(64);
    let mut found_by = vec![0u64; rows.len() * words];
    for (from, row) in seen.iter().enumerate() {
        let start = row.partition_point(|to| (*to as usize) < first);
        let here = row[start..].iter().map(|to| *to as usize - first);
        for to in here.take_while(|to| *to < rows.len()) {
            found_by[to * words + from / 64] |= 1 << (from % 64);
        }
    }
    let found_by = found_by.chunks_exact(words);
    let kept = rows.iter().zip(found_by).map(|(row, found_by)| {
        let is_mutual = |to: &u32| found_by[*to as usize / 64] >> (to % 64) & 1 == 1;
        row.iter().copied().filter(is_mutual).collect()
    });
    kept.collect()
}

fn compressed(row: Vec<u32>) -> RoaringBitmap {
    let mut row = RoaringBitmap::from_sorted_iter(row).expect("rows are sorted");
    row.optimize();
    row
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use rand::{Rng, SeedableRng, rngs::SmallRng};
    use sightline_world::{
        CellId, Gate, Mesh,
        geometry::{Aabb, Axes},
    };

    use super::*;
    use crate::{
        occluders::{OccluderTriangle, planes},
        subdivide::{CellGrain, Spaces, SubdivisionInput},
    };
    use sightline_oracle::Oracle;

    #[test]
    fn only_pairs_that_have_found_each_other_are_kept() {
        let mut rng = SmallRng::seed_from_u64(3);
        let count = 2 * MUTUAL_ROWS as u32 + 70;
        let mut row = |_| (0..count).filter(|_| rng.random_bool(0.05)).collect();
        let seen: Vec<Vec<u32>> = (0..count).map(&mut row).collect();
        let both = |from: u32, to: u32| seen[to as usize].contains(&from);
        let naive: Vec<Vec<u32>> = (0..count)
            .map(|from| seen[from as usize].iter().copied().filter(|to| both(from, *to)).collect())
            .collect();
        assert!(naive.iter().map(Vec::len).sum::<usize>() > 1_000);
        assert!(mutual(seen.clone()) == naive);
    }

    /// A grid of rooms whose walls are whole, have a hole, or are missing; and a few slanted panes.
    fn random_building(rng: &mut SmallRng) -> (Aabb, Vec<[Vec3; 3]>) {
        let bounds = Aabb::new(Vec3::ZERO, Vec3::new(9.0, 6.0, 9.0));
        let mut opaque = Vec::new();
        for axis in 0..3 {
            for at in 1..=2 {
                for u in 0..3 {
                    for v in 0..3 {
                        let at =
                            at as f32 * [3.0, 2.0, 3.0][axis] + [0.0, 1e-3][rng.random_range(0..2)];
                        wall(rng, axis, at, u, v, &mut opaque);
                    }
                }
            }
        }
        for _ in 0..4 {
            opaque.push(std::array::from_fn(|_| {
                Vec3::from_array(std::array::from_fn(|i| rng.random_range(0.0..bounds.max[i])))
            }));
        }
        (bounds, opaque)
    }

    fn wall(
        rng: &mut SmallRng,
        axis: usize,
        at: f32,
        u: usize,
        v: usize,
        out: &mut Vec<[Vec3; 3]>,
    ) {
        let steps = [3.0, 2.0, 3.0];
        let (axis_u, axis_v) = crate::split_plane::other_axes(axis);
        let mut panel = |u0: f32, v0: f32, u1: f32, v1: f32| {
            let corner = |cu: f32, cv: f32| {
                let mut p = Vec3::splat(at);
                p[axis_u] = (u as f32 + cu) * steps[axis_u];
                p[axis_v] = (v as f32 + cv) * steps[axis_v];
                p
            };
            let [a, b, c, d] = [corner(u0, v0), corner(u1, v0), corner(u1, v1), corner(u0, v1)];
            out.extend([[a, b, c], [a, c, d]]);
        };
        let hole = [0.1, 0.3, 0.5, 0.9].map(|at: f32| at + rng.random_range(-0.05..0.05));
        match rng.random_range(0..10) {
            0..6 => panel(0.0, 0.0, 1.0, 1.0),
            6..9 => {
                panel(0.0, 0.0, hole[1], 1.0);
                panel(hole[2], 0.0, 1.0, 1.0);
                panel(hole[1], 0.0, hole[2], hole[0]);
                panel(hole[1], hole[3], hole[2], 1.0);
            }
            _ => {}
        }
    }

    /// Cells without a PVS.
    fn subdivided(bounds: &Aabb, all: &[[Vec3; 3]], axes: Axes) -> Cells {
        let spaces = spaces(bounds, all, axes);
        crate::subdivide::cells(&spaces, CellGrain::Even(CellSize::of_width(2.0)))
    }

    fn spaces(bounds: &Aabb, all: &[[Vec3; 3]], axes: Axes) -> Spaces {
        let own = |corner: Vec3| axes.own_exact(corner.as_dvec3());
        let opaque = |t: &[Vec3; 3]| OccluderTriangle { corners: t.map(own), is_last: false };
        let planes = planes(&all.iter().map(opaque).collect::<Vec<_>>());
        let occluders = SubdivisionInput { planes: &planes, solids: &[], eyes: &[] };
        Spaces::new(&axes.own_box(bounds), axes, &occluders)
    }

    fn compiled(bounds: &Aabb, opaque: &[[Vec3; 3]]) -> Cells {
        let mut cells = subdivided(bounds, opaque, Axes::WORLD);
        cells.pvs = seen(&cells);
        cells
    }

    fn seen(cells: &Cells) -> Pvs {
        let go_on = |_| ControlFlow::Continue(());
        potentially_visible(cells, &spaces_seen(cells, &go_on).unwrap(), &go_on).unwrap()
    }

    fn mesh(opaque: &[[Vec3; 3]]) -> Mesh {
        Mesh {
            positions: opaque.as_flattened().to_vec(),
            triangles: (0..opaque.len() as u32).map(|i| [0, 1, 2].map(|k| i * 3 + k)).collect(),
        }
    }

    fn point(rng: &mut SmallRng, within: &Aabb) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|i| rng.random_range(within.min[i]..within.max[i])))
    }

    /// Counts random sight lines, and how many of them the PVS denies.
    fn misses(rng: &mut SmallRng, cells: &Cells, sight: &Oracle, lines: usize) -> (usize, usize) {
        let (mut found, mut missed) = (0, 0);
        for i in 0..lines {
            let any = &cells.cells[rng.random_range(0..cells.cells.len())].bounds;
            // By cell, so that small ones are tried, and by volume.
            let within = if i % 2 == 0 { any } else { &cells.bounds };
            let (a, b) = (point(rng, within), point(rng, &cells.bounds));
            let (a, b) = (cells.axes.world(a), cells.axes.world(b));
            if sight.between(a, b) {
                found += 1;
                // A point in a wall lies in no cell.
                let (Some(a), Some(b)) = (cells.at(a), cells.at(b)) else { continue };
                missed += usize::from(!cells.sees(a, b));
            }
        }
        (found, missed)
    }

    #[test]
    fn no_sight_line_is_missed_in_random_buildings() {
        let (mut found, mut dense) = (0, 0.0);
        for seed in 0..60 {
            let mut rng = SmallRng::seed_from_u64(seed);
            let (bounds, opaque) = random_building(&mut rng);
            let cells = compiled(&bounds, &opaque);
            let sight = Oracle::new(&mesh(&opaque));
            let (lines, missed) = misses(&mut rng, &cells, &sight, 3_000);
            assert_eq!(missed, 0, "of {lines} sight lines in building {seed}");
            found += lines;
            dense += cells.density() / 60.0;
        }
        assert!(found > 10_000, "the buildings have sight lines to miss: {found}");
        assert!(dense < 0.6, "and much that is hidden: density {dense}");
    }

    /// Buildings are turned about the vertical, with cells in their own axes.
    #[test]
    fn no_sight_line_is_missed_in_turned_buildings() {
        let mut dense = 0.0;
        for seed in 0..20 {
            let mut rng = SmallRng::seed_from_u64(seed);
            let (bounds, opaque) = random_building(&mut rng);
            let axes = Axes::turned(rng.random_range(0.0..1.5));
            let turned: Vec<_> = opaque.iter().map(|t| t.map(|p| axes.world(p))).collect();
            let mut cells = subdivided(&axes.world_box(&bounds), &turned, axes);
            cells.pvs = seen(&cells);
            let sight = Oracle::new(&mesh(&turned));
            let (lines, missed) = misses(&mut rng, &cells, &sight, 3_000);
            assert_eq!(missed, 0, "of {lines} sight lines in building {seed}");
            dense += cells.density() / 20.0;
        }
        assert!(dense < 0.7, "walls hide: {dense}");
    }

    /// Every other space is split into cells, and the others are not.
    #[test]
    fn no_sight_line_is_missed_between_cells_and_whole_spaces() {
        let go_on = |_| ControlFlow::Continue(());
        let (mut found, mut split) = (0, 0);
        for seed in 0..30 {
            let mut rng = SmallRng::seed_from_u64(seed);
            let (bounds, opaque) = random_building(&mut rng);
            let spaces = spaces(&bounds, &opaque, Axes::WORLD);
            let whole = crate::subdivide::cells(&spaces, CellGrain::Whole);
            let seen_spaces = spaces_seen(&whole, &go_on).unwrap();
            let is_whole: Vec<bool> = (0..whole.spaces.len()).map(|i| i % 2 == 0).collect();
            let grain = CellGrain::EvenExcept(CellSize::of_width(1.0), &is_whole);
            let mut cells = crate::subdivide::cells(&spaces, grain);
            cells.pvs = potentially_visible(&cells, &seen_spaces, &go_on).unwrap();
            split += cells.cells.len() - whole.cells.len();
            let sight = Oracle::new(&mesh(&opaque));
            let (lines, missed) = misses(&mut rng, &cells, &sight, 3_000);
            assert_eq!(missed, 0, "of {lines} sight lines in building {seed}");
            found += lines;
        }
        assert!(found > 5_000 && split > 500, "{found} lines, {split} more cells than spaces");
    }

    /// Removes a gate, to prove that the tests of sight lines can fail.
    #[test]
    fn a_lost_portal_is_noticed() {
        let mut noticed = 0;
        for seed in 0..20 {
            let mut rng = SmallRng::seed_from_u64(seed);
            let (bounds, opaque) = random_building(&mut rng);
            let mut cells = subdivided(&bounds, &opaque, Axes::WORLD);
            let area = |gate: &Gate| {
                let size = gate.polygon.bounds().size();
                (size.x * size.y).max(size.y * size.z).max(size.z * size.x)
            };
            let gates = 0..cells.gates.len() as u32;
            let wider = |a: &u32, b: &u32| {
                area(&cells.gates[*a as usize]).total_cmp(&area(&cells.gates[*b as usize]))
            };
            let lost = gates.max_by(wider).unwrap();
            cells.spaces.iter_mut().for_each(|space| space.gates.retain(|&gate| gate != lost));
            cells.pvs = seen(&cells);
            let sight = Oracle::new(&mesh(&opaque));
            noticed += usize::from(misses(&mut rng, &cells, &sight, 20_000).1 > 0);
        }
        assert!(noticed >= 10, "only {noticed} of 20");
    }

    #[test]
    fn the_pvs_is_symmetric_reflexive_and_the_same_on_any_number_of_threads() {
        let mut rng = SmallRng::seed_from_u64(7);
        let (bounds, opaque) = random_building(&mut rng);
        let cells = subdivided(&bounds, &opaque, Axes::WORLD);
        let pvs = seen(&cells);
        for (cell, row) in (0u32..).zip(&pvs) {
            assert!(row.contains(cell));
            assert!(row.iter().all(|other| pvs[other as usize].contains(cell)));
        }
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(alone.install(|| seen(&cells)), pvs);
    }

    /// Four rooms in a row with three doors: the first and the last see each other only when one
    /// line goes through all doors.
    #[test]
    fn a_bend_is_not_seen_through() {
        let check = |doors: [f32; 3], expected: bool| {
            let mut opaque = Vec::new();
            for (x, door) in [4.0, 8.0, 12.0].into_iter().zip(doors) {
                for (z0, z1) in [(0.0, door), (door + 1.0, 30.0)] {
                    let c = |y: f32, z: f32| Vec3::new(x, y, z);
                    opaque.push([c(0.0, z0), c(3.0, z0), c(3.0, z1)]);
                    opaque.push([c(0.0, z0), c(3.0, z1), c(0.0, z1)]);
                }
            }
            let bounds = Aabb::new(Vec3::ZERO, Vec3::new(16.0, 3.0, 30.0));
            let cells = compiled(&bounds, &opaque);
            let rooms: Vec<Vec<u32>> = (0..4)
                .map(|i| {
                    let is_in = |place: &u32| {
                        let x = cells.cells[*place as usize].bounds.centre().x;
                        (x / 4.0) as usize == i
                    };
                    (0..cells.cells.len() as u32).filter(is_in).collect()
                })
                .collect();
            let sees = |from: usize, to: usize| {
                let pairs = rooms[from].iter().flat_map(|a| rooms[to].iter().map(move |b| (a, b)));
                pairs.into_iter().any(|(&a, &b)| cells.sees(CellId(a), CellId(b)))
            };
            assert!((0..3).all(|i| sees(i, i + 1)) && sees(0, 2) && sees(1, 3));
            assert_eq!(sees(0, 3), expected, "doors at {doors:?}");
        };
        check([1.0, 1.0, 1.0], true);
        check([1.0, 12.0, 23.0], true);
        check([1.0, 12.0, 24.9], true);
        check([1.0, 12.0, 25.1], false);
        check([1.0, 12.0, 1.0], false);
        check([12.0, 1.0, 12.0], false);
    }
}
