//! Topology of a triangle soup: which corners are one point, and which edges are shared.

use std::{
    collections::HashMap,
    hash::{BuildHasherDefault, Hasher},
};

use glam::{DVec3, I64Vec3};
use rayon::prelude::*;
use sightline_world::tolerance::WELD_M;

/// The tolerances for a model of some size, in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tolerance {
    /// Corners this near are one point. A point this near an edge lies on the edge.
    pub weld: f64,
    /// A point this near a plane lies in the plane.
    pub plane: f64,
}

impl Tolerance {
    /// The tolerances for triangles. Far from the origin, single precision is coarser.
    pub(super) fn of(triangles: &[[DVec3; 3]]) -> Self {
        let farthest =
            triangles.as_flattened().iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let weld = WELD_M.max(farthest * 0.5f64.powi(22));
        Self { weld, plane: 4.0 * weld }
    }
}

/// Welded points and the edges of triangles between them. An edge is split where another corner
/// lies on it, so that overlapping edges are shared in spite of T-junctions.
pub(super) struct Topology {
    pub points: Vec<DVec3>,
    /// Sorted by [`Half::key`]. Triangles without area have none.
    pub halves: Vec<Half>,
    /// Whether a triangle is no wider than the tolerance.
    pub degenerate: Vec<bool>,
}

/// A half-edge: an edge as one triangle has it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Half {
    low: u32,
    high: u32,
    /// The triangle.
    pub triangle: u32,
    /// Whether it runs from the lower point to the higher.
    pub forward: bool,
}

impl Half {
    fn new([from, to]: [u32; 2], triangle: u32) -> Self {
        Self { low: from.min(to), high: from.max(to), triangle, forward: from < to }
    }

    /// The key of the edge, the same for all of its halves.
    pub(super) fn key(&self) -> u64 {
        edge_key(self.low, self.high)
    }

    /// The points that it joins, the lower index first.
    pub(super) fn ends(&self) -> [u32; 2] {
        [self.low, self.high]
    }
}

/// The key of an edge between two points.
fn edge_key(low: u32, high: u32) -> u64 {
    u64::from(low) << 32 | u64::from(high)
}

impl Topology {
    /// Welds corners and splits edges. Time and memory are about linear in the number of triangles.
    pub(super) fn new(triangles: &[[DVec3; 3]], tolerance: Tolerance) -> Self {
        let (points, corners) = weld(triangles.as_flattened(), tolerance.weld);
        let corners: Vec<[u32; 3]> = corners.as_chunks().0.to_vec();
        let degenerate: Vec<bool> = corners
            .par_iter()
            .map(|c| is_degenerate(c.map(|i| points[i as usize]), tolerance))
            .collect();
        let splits = splits(&points, &corners, tolerance.weld);
        let mut halves = Vec::with_capacity(corners.len() * 3);
        for (triangle, &[a, b, c]) in (0..).zip(&corners) {
            if degenerate[triangle as usize] {
                continue;
            }
            for [from, to] in [[a, b], [b, c], [c, a]] {
                match splits.get(&edge_key(from.min(to), from.max(to))) {
                    None => halves.push(Half::new([from, to], triangle)),
                    Some(between) => push_split(&mut halves, [from, to], between, triangle),
                }
            }
        }
        halves.par_sort_unstable_by_key(|half| (half.key(), half.triangle, half.forward));
        debug_assert!(
            halves.iter().all(|half| half.ends().iter().all(|&end| (end as usize) < points.len())),
            "edges join known points"
        );
        Self { points, halves, degenerate }
    }
}

/// Adds the parts of an edge. `between` are the points on it, from the lower end to the higher.
fn push_split(halves: &mut Vec<Half>, [from, to]: [u32; 2], between: &[u32], triangle: u32) {
    let mut last = from;
    let mut push = |next: u32| {
        halves.push(Half::new([last, next], triangle));
        last = next;
    };
    if from < to {
        between.iter().for_each(|&point| push(point));
    } else {
        between.iter().rev().for_each(|&point| push(point));
    }
    push(to);
}

/// Whether a triangle is no wider than the tolerance.
fn is_degenerate([a, b, c]: [DVec3; 3], tolerance: Tolerance) -> bool {
    let longest = (b - a).length().max((c - b).length()).max((a - c).length());
    (b - a).cross(c - a).length() <= longest * tolerance.weld
}

/// Welds corners that are near each other: the points, and the point of each corner.
fn weld(corners: &[DVec3], near: f64) -> (Vec<DVec3>, Vec<u32>) {
    // Cells are so wide that few corners are near a side, where the next cell must be searched too.
    // The offset keeps round coordinates off the sides.
    let (cell, offset) = (near * 64.0, near * 23.7);
    let mut first_of: FastMap<I64Vec3, u32> = FastMap::default();
    let (mut points, mut next): (Vec<DVec3>, Vec<u32>) = (Vec::new(), Vec::new());
    let welded = corners.iter().map(|&corner| {
        let at = |by: f64| ((corner + by + offset) / cell).floor().as_i64vec3();
        for key in cells_between(at(-near), at(near)) {
            let mut index = first_of.get(&key).copied();
            while let Some(i) = index {
                if points[i as usize].distance_squared(corner) <= near * near {
                    return i;
                }
                index = (next[i as usize] != u32::MAX).then_some(next[i as usize]);
            }
        }
        let index = points.len() as u32;
        points.push(corner);
        next.push(first_of.insert(at(0.0), index).unwrap_or(u32::MAX));
        index
    });
    let welded = welded.collect();
    (points, welded)
}

/// All cells of a box of cells.
fn cells_between(low: I64Vec3, high: I64Vec3) -> impl Iterator<Item = I64Vec3> {
    (low.x..=high.x).flat_map(move |x| {
        (low.y..=high.y).flat_map(move |y| (low.z..=high.z).map(move |z| I64Vec3::new(x, y, z)))
    })
}

/// Points on an axial edge through more cells than this are sought along the line of the edge.
const LONG: f64 = 4.0;

/// For each edge with other points on it, these points, from the lower end to the higher.
fn splits(points: &[DVec3], corners: &[[u32; 3]], near: f64) -> FastMap<u64, Vec<u32>> {
    let ends = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
    let keys = corners.par_iter().flat_map_iter(|c| ends(c).into_iter().filter(|[a, b]| a != b));
    let mut keys: Vec<u64> = keys.map(|[a, b]| edge_key(a.min(b), a.max(b))).collect();
    keys.par_sort_unstable();
    keys.dedup();
    let segment = |key: u64| [(key >> 32) as u32, key as u32].map(|i| points[i as usize]);
    let axis_of = |key: u64| {
        let [from, to] = segment(key);
        let along = (to - from).abs();
        (0..3).find(|&axis| (0..3).all(|other| other == axis || along[other] <= near))
    };
    let edge = |&key: &u64| {
        let [from, to] = segment(key);
        (from.distance(to), axis_of(key).is_some())
    };
    let cell = cell_for(keys.par_iter().map(edge).collect(), near);
    let grid = Grid::new(points, cell, near);
    let lines = [0, 1, 2].map(|axis| Lines::new(points, axis, near));
    keys.par_iter()
        .filter_map(|&key| {
            let [from, to] = segment(key);
            let candidates = match axis_of(key) {
                Some(axis) if from.distance(to) > cell * LONG => lines[axis].beside(from, to),
                _ => grid.beside(from, to),
            };
            let on_it = on_segment(points, candidates, from, to, near);
            (!on_it.is_empty()).then_some((key, on_it))
        })
        .collect::<Vec<_>>()
        .into_iter()
        .collect()
}

/// The width of a cell: the median length of edges, so that most edges run through few cells; and
/// at least so wide that slanted edges, which are always walked cell by cell, run through few on
/// average. Each edge is its length and whether it is axial.
fn cell_for(mut edges: Vec<(f64, bool)>, near: f64) -> f64 {
    let slanted = || edges.iter().filter(|(_, is_axial)| !is_axial).map(|(length, _)| length);
    let slanted_mean = slanted().sum::<f64>() / slanted().count().max(1) as f64;
    let middle = edges.len() / 2;
    let median = match edges.get(middle) {
        Some(_) => edges.select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0)).1.0,
        None => 0.0,
    };
    median.max(slanted_mean / 8.0).max(near * 64.0)
}

/// Points by cell. A point near a side is in both cells.
struct Grid {
    cell: f64,
    first: FastMap<I64Vec3, u32>,
    /// Cells and points. Points of one cell follow each other.
    entries: Vec<(I64Vec3, u32)>,
}

impl Grid {
    fn new(points: &[DVec3], cell: f64, near: f64) -> Self {
        let margin = near * 4.0;
        let mut entries: Vec<(I64Vec3, u32)> = points
            .par_iter()
            .enumerate()
            .flat_map_iter(|(i, &point)| {
                let at = |by: f64| ((point + by) / cell).floor().as_i64vec3();
                cells_between(at(-margin), at(margin)).map(move |key| (key, i as u32))
            })
            .collect();
        entries.par_sort_unstable_by_key(|(key, i)| (key.x, key.y, key.z, *i));
        let mut first = FastMap::default();
        for (i, pair) in entries.iter().enumerate() {
            first.entry(pair.0).or_insert(i as u32);
        }
        Self { cell, first, entries }
    }

    /// The points in the cells that a segment runs through.
    fn beside(&self, from: DVec3, to: DVec3) -> Vec<u32> {
        let mut found = Vec::new();
        walk(from / self.cell, to / self.cell, |cell| {
            let Some(&first) = self.first.get(&cell) else { return };
            let here = self.entries[first as usize..].iter().take_while(|(c, _)| *c == cell);
            found.extend(here.map(|(_, i)| i));
        });
        found
    }
}

/// Points by the axial line that they lie on, in order along it. Most edges of a building are
/// axial, and many are long: this finds the points on them without all points near them.
struct Lines {
    axis: usize,
    cell: f64,
    /// The two other coordinates in cells, the coordinate along the axis, and the point.
    entries: Vec<([i64; 2], f64, u32)>,
}

impl Lines {
    fn new(points: &[DVec3], axis: usize, near: f64) -> Self {
        let mut lines = Self { axis, cell: near * 64.0, entries: Vec::new() };
        let margin = near * 4.0;
        lines.entries = points
            .par_iter()
            .enumerate()
            .flat_map_iter(|(i, &point)| {
                let ([u, v], [p, q]) =
                    (lines.cell_of(point - margin), lines.cell_of(point + margin));
                let cells = (u..=p).flat_map(move |u| (v..=q).map(move |v| [u, v]));
                cells.map(move |cell| (cell, point[axis], i as u32))
            })
            .collect();
        lines.entries.par_sort_unstable_by(|a, b| {
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2))
        });
        lines
    }

    /// The cell of a point in the other two axes. The offset keeps round coordinates off the sides.
    fn cell_of(&self, point: DVec3) -> [i64; 2] {
        let (u, v) = ((self.axis + 1) % 3, (self.axis + 2) % 3);
        [point[u], point[v]].map(|at| (at / self.cell + 0.37).floor() as i64)
    }

    /// The points that lie nearly on an axial segment, between its ends.
    fn beside(&self, from: DVec3, to: DVec3) -> Vec<u32> {
        let cell = self.cell_of((from + to) * 0.5);
        let (low, high) = (from[self.axis].min(to[self.axis]), from[self.axis].max(to[self.axis]));
        let first = self.entries.partition_point(|(c, at, _)| (*c, *at) < (cell, low));
        let on_it = self.entries[first..].iter();
        on_it.take_while(|(c, at, _)| *c == cell && *at <= high).map(|(.., i)| *i).collect()
    }
}

/// The candidates that lie on a segment between its ends, in order along it.
fn on_segment(
    points: &[DVec3],
    candidates: Vec<u32>,
    from: DVec3,
    to: DVec3,
    near: f64,
) -> Vec<u32> {
    let length = from.distance(to);
    let direction = (to - from) / length;
    let place = |i: u32| {
        let offset = points[i as usize] - from;
        let along = direction.dot(offset);
        let aside = offset - direction * along;
        let is_on_it =
            along > near && along < length - near && aside.length_squared() <= near * near;
        is_on_it.then_some((along, i))
    };
    let mut found: Vec<(f64, u32)> = candidates.into_iter().filter_map(place).collect();
    found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.dedup();
    found.into_iter().map(|(_, i)| i).collect()
}

/// Calls `visit` for every unit cell on the way between two points.
fn walk(from: DVec3, to: DVec3, mut visit: impl FnMut(I64Vec3)) {
    let (mut cell, last) = (from.floor().as_i64vec3(), to.floor().as_i64vec3());
    let along = to - from;
    let steps = (last - cell).abs().element_sum();
    visit(cell);
    for _ in 0..steps {
        // When the segment leaves the cell along each axis; never past the last cell.
        let leaving = |axis: usize| {
            if cell[axis] == last[axis] {
                return f64::INFINITY;
            }
            let side = cell[axis] as f64 + if along[axis] > 0.0 { 1.0 } else { 0.0 };
            (side - from[axis]) / along[axis]
        };
        let axis = (0..3).min_by(|a, b| leaving(*a).total_cmp(&leaving(*b))).unwrap_or(0);
        cell[axis] += if along[axis] > 0.0 { 1 } else { -1 };
        visit(cell);
    }
}

/// A map for keys that no adversary chooses.
pub(super) type FastMap<K, V> = HashMap<K, V, BuildHasherDefault<FastHasher>>;

/// A hasher for a few integers, several times as fast as the standard one: multiplies and folds.
#[derive(Default)]
pub(super) struct FastHasher(u64);

impl Hasher for FastHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_u64(byte.into());
        }
    }

    fn write_u32(&mut self, value: u32) {
        self.write_u64(value.into());
    }

    fn write_i64(&mut self, value: i64) {
        self.write_u64(value as u64);
    }

    fn write_u64(&mut self, value: u64) {
        let product = u128::from(self.0 ^ value ^ 0x9e37_79b9_7f4a_7c15)
            * u128::from(0xd6e8_feb8_6659_fd93_u64);
        self.0 = (product >> 64) as u64 ^ product as u64;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// The points found on each edge are those that a search through all points finds, for
        /// axial and slanted edges, coordinates a little off, and cells of any size.
        #[test]
        fn edges_are_split_where_a_point_is_on_them(
            corners in prop::collection::vec((-3..4i8, -3..4i8, -3..4i8, 0u8..8), 3..40),
            scale in 0.01..40.0f64,
        ) {
            let near = WELD_M;
            let triangles: Vec<[DVec3; 3]> = corners
                .iter()
                .map(|&(x, y, z, off)| {
                    let stray = |bit: u8| if off & bit == 0 { 0.0 } else { near * 0.4 };
                    let at = DVec3::new(x.into(), y.into(), z.into()) * scale;
                    at + DVec3::new(stray(1), stray(2), stray(4))
                })
                .collect::<Vec<_>>()
                .as_chunks()
                .0
                .to_vec();
            let (points, corners) = weld(triangles.as_flattened(), near);
            let corners: Vec<[u32; 3]> = corners.as_chunks().0.to_vec();
            let found = splits(&points, &corners, near);
            let all: Vec<u32> = (0..points.len() as u32).collect();
            for [a, b, c] in corners {
                for (a, b) in [(a, b), (b, c), (c, a)].into_iter().filter(|(a, b)| a != b) {
                    let (low, high) = (a.min(b), a.max(b));
                    let [from, to] = [low, high].map(|i| points[i as usize]);
                    let expected = on_segment(&points, all.clone(), from, to, near);
                    let found = found.get(&edge_key(low, high)).cloned().unwrap_or_default();
                    prop_assert_eq!(found, expected);
                }
            }
        }
    }
}
