//! The points of a patch at which light is found: a square lattice, in rows.
//!
//! Lattices of parallel patches have the same directions and lie on the same lines, so that light
//! along an edge does not depend on how the patch is cut into triangles. A point of the lattice
//! that lies outside of the patch is moved to the nearest place inside.

use std::ops::RangeInclusive;

use glam::{Vec2, Vec3};

/// The offset of a lattice from whole multiples of its spacing. Authors put edges at round
/// coordinates, and no row of points is to lie on one.
const SHIFT: Vec2 = Vec2::new(0.37, 0.61);
/// Points that are moved into the patch end up this far from its edge, in metres: away from what
/// stands there.
const INSIDE_M: f32 = 0.015;
/// A normal that rises more steeply than this is that of a floor or a ceiling.
const LEVEL: f32 = 0.9;
/// Areas are found by this many samples between two points.
const SAMPLES: f32 = 4.0;
/// A lattice with more than this many times as many points as its triangles need is sparse …
const SPARSE: usize = 4;
/// … unless it has no more points than this.
const SPARSE_MIN: usize = 64;

/// The directions of a lattice.
pub(super) struct Directions {
    /// Along rows and across them, each as long as one over the spacing.
    across: [Vec3; 2],
}

impl Directions {
    /// Those on a plane, in a building whose own x axis points along `along`.
    pub(super) fn new(normal: Vec3, along: Vec3, spacing: f32) -> Self {
        let level = if normal.y.abs() > LEVEL { along } else { Vec3::Y.cross(normal) };
        let u = level.reject_from_normalized(normal).normalize_or(normal.any_orthonormal_vector());
        Self { across: [u / spacing, normal.cross(u) / spacing] }
    }

    /// The place of a point, in steps of the lattice.
    pub(super) fn place(&self, point: Vec3) -> Vec2 {
        let [u, v] = self.across.map(|across| point.dot(across));
        Vec2::new(u, v) + SHIFT
    }
}

/// A row of points.
#[derive(Clone)]
struct Row {
    columns: RangeInclusive<i32>,
    /// The index of its first point.
    start: usize,
}

/// Which points a lattice has.
pub(super) struct Lattice {
    lowest: i32,
    rows: Vec<Row>,
    len: usize,
}

/// A triangle, with its corners both in space and on the lattice.
pub(super) struct Piece {
    pub(super) corners: [Vec3; 3],
    pub(super) places: [Vec2; 3],
}

impl Lattice {
    /// The points around each place of some triangles. None when that is too wasteful: the
    /// triangles lie far apart.
    pub(super) fn around(pieces: &[Piece]) -> Option<Self> {
        let mut rows: Vec<Row> = Vec::new();
        let ends = |pick: fn(f32, f32) -> f32| {
            pieces.iter().flat_map(|piece| piece.places).map(|place| place.y).reduce(pick)
        };
        let (low, high) = (ends(f32::min)?, ends(f32::max)?);
        let (lowest, highest) = (low.floor() as i32, high.floor() as i32 + 1);
        let empty = Row { columns: RangeInclusive::new(i32::MAX, i32::MIN), start: 0 };
        rows.resize((highest - lowest + 1) as usize, empty);
        let mut needed = 0;
        for piece in pieces {
            for (row, columns) in piece.strips() {
                needed += 2 * columns.clone().count();
                for row in [row, row + 1] {
                    let known = &mut rows[(row - lowest) as usize].columns;
                    let start = *columns.start().min(known.start());
                    *known = start..=*columns.end().max(known.end());
                }
            }
        }
        let mut len = 0usize;
        for row in &mut rows {
            row.start = len;
            len = len.saturating_add(row.columns.clone().count());
        }
        (len <= SPARSE_MIN || len <= SPARSE * needed).then_some(Self { lowest, rows, len })
    }

    /// The index of a point: of the nearest one in its row when there is no such point.
    pub(super) fn index(&self, column: i32, row: i32) -> usize {
        let last = self.rows.len() as i32 - 1;
        let row = &self.rows[(row - self.lowest).clamp(0, last) as usize];
        let (first, last) = (*row.columns.start(), *row.columns.end());
        row.start + (column.clamp(first, last.max(first)) - first) as usize
    }

    /// Each point with its column and row, in the order of their indices.
    pub(super) fn points(&self) -> impl Iterator<Item = (i32, i32)> {
        let row = |(row, at): (i32, &Row)| at.columns.clone().map(move |column| (column, row));
        (self.lowest..).zip(&self.rows).flat_map(row)
    }

    /// The share of the triangles' area that is nearest to each point.
    pub(super) fn shares(&self, pieces: &[Piece]) -> Vec<f32> {
        let mut counts = vec![0u32; self.len];
        for piece in pieces {
            piece.samples(|place| {
                counts[self.index(place.x.round() as i32, place.y.round() as i32)] += 1;
            });
        }
        match counts.iter().sum::<u32>() {
            // Slivers between all samples.
            0 => vec![1.0 / self.len as f32; self.len],
            all => counts.into_iter().map(|count| count as f32 / all as f32).collect(),
        }
    }

    /// The place of each point on the triangles, in metres. None far from all of them.
    pub(super) fn places(&self, pieces: &[Piece]) -> Vec<Option<Vec3>> {
        let mut nearest: Vec<(f32, Option<Vec3>)> = vec![(f32::INFINITY, None); self.len];
        for piece in pieces {
            for (row, columns) in piece.strips() {
                for (column, row) in columns.flat_map(|column| [(column, row), (column, row + 1)]) {
                    let known = &mut nearest[self.index(column, row)];
                    if known.0 > 0.0 {
                        let (away, at) = piece.nearest(Vec2::new(column as f32, row as f32));
                        if away < known.0 {
                            *known = (away, Some(at));
                        }
                    }
                }
            }
        }
        nearest.into_iter().map(|(_, at)| at).collect()
    }
}

impl Piece {
    /// The strips between two rows that the triangle meets: the lower row, and the columns around
    /// it.
    fn strips(&self) -> impl Iterator<Item = (i32, RangeInclusive<i32>)> {
        let ys = self.places.map(|place| place.y);
        let (low, high) =
            (ys.into_iter().fold(f32::MAX, f32::min), ys.into_iter().fold(f32::MIN, f32::max));
        (low.floor() as i32..=high.floor() as i32).map(move |row| {
            let (bottom, top) = (row as f32, row as f32 + 1.0);
            let mut ends = (f32::MAX, f32::MIN);
            for i in 0..3 {
                let (from, to) = (self.places[i], self.places[(i + 1) % 3]);
                let (lower, upper) = if from.y <= to.y { (from, to) } else { (to, from) };
                if upper.y < bottom || lower.y > top {
                    continue;
                }
                let rise = upper.y - lower.y;
                let x_at = |y: f32| match rise > 0.0 {
                    true => lower.x + (upper.x - lower.x) * ((y - lower.y) / rise).clamp(0.0, 1.0),
                    false => lower.x,
                };
                let xs = [x_at(bottom.max(lower.y)), x_at(top.min(upper.y))];
                // A level edge has two ends at one height.
                let xs = if rise > 0.0 { xs } else { [lower.x, upper.x] };
                ends = (ends.0.min(xs[0]).min(xs[1]), ends.1.max(xs[0]).max(xs[1]));
            }
            (row, ends.0.floor() as i32..=ends.1.floor() as i32 + 1)
        })
    }

    /// Visits the places inside the triangle of a lattice that is [`SAMPLES`] times as fine.
    fn samples(&self, mut visit: impl FnMut(Vec2)) {
        let ys = self.places.map(|place| place.y * SAMPLES);
        let (low, high) =
            (ys.into_iter().fold(f32::MAX, f32::min), ys.into_iter().fold(f32::MIN, f32::max));
        for row in low.floor() as i32..=high.floor() as i32 {
            let y = (row as f32 + 0.5) / SAMPLES;
            let mut ends = (f32::MAX, f32::MIN);
            for i in 0..3 {
                let (from, to) = (self.places[i], self.places[(i + 1) % 3]);
                if (from.y <= y) != (to.y <= y) {
                    let x = from.x + (to.x - from.x) * ((y - from.y) / (to.y - from.y));
                    ends = (ends.0.min(x), ends.1.max(x));
                }
            }
            // Samples on an edge belong to one of the triangles that share it.
            let [first, end] =
                [ends.0, ends.1].map(|x| (x * SAMPLES - 0.5).ceil().clamp(-1.0e9, 1.0e9) as i32);
            if ends.0 <= ends.1 {
                (first..end).for_each(|column| {
                    visit(Vec2::new((column as f32 + 0.5) / SAMPLES, y));
                });
            }
        }
    }

    /// The squared distance of the nearest place of the triangle from a point of the lattice, in
    /// steps, and that place in space.
    fn nearest(&self, point: Vec2) -> (f32, Vec3) {
        let [a, b, c] = self.places;
        let whole = (b - a).perp_dot(c - a);
        let weights = [
            (c - b).perp_dot(point - b) / whole,
            (a - c).perp_dot(point - c) / whole,
            (b - a).perp_dot(point - a) / whole,
        ];
        let at = |weights: [f32; 3]| {
            let [a, b, c] = self.corners;
            a * weights[0] + b * weights[1] + c * weights[2]
        };
        if weights.iter().all(|weight| *weight >= 0.0) {
            return (0.0, at(weights));
        }
        let on_edge = |i: usize| {
            let (from, to) = (self.places[i], self.places[(i + 1) % 3]);
            let share = (point - from).dot(to - from) / from.distance_squared(to);
            let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
            let mut weights = [0.0; 3];
            (weights[i], weights[(i + 1) % 3]) = (1.0 - share, share);
            (point.distance_squared(from.lerp(to, share)), at(weights))
        };
        let [first, second, third] = [0, 1, 2].map(on_edge);
        let best = if second.0 < first.0 { second } else { first };
        let (away, edge) = if third.0 < best.0 { third } else { best };
        let inwards = at([1.0 / 3.0; 3]) - edge;
        (away, edge + inwards.clamp_length_max(INSIDE_M.min(inwards.length() * 0.5)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn piece(corners: [[f32; 2]; 3]) -> Piece {
        let places = corners.map(Vec2::from);
        Piece { corners: places.map(|place| place.extend(0.0)), places }
    }

    #[test]
    fn each_place_of_a_triangle_lies_between_four_points() {
        let pieces = [
            piece([[0.3, 0.4], [7.6, 2.2], [3.1, 9.9]]),
            piece([[-4.0, -2.5], [0.3, 0.4], [3.1, 9.9]]),
        ];
        let lattice = Lattice::around(&pieces).expect("close together");
        let places = lattice.places(&pieces);
        let at: Vec<(i32, i32)> = lattice.points().collect();
        for piece in &pieces {
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let [a, b, c] = piece.places;
                    let low = (a + (b - a) * i as f32 / 20.0 + (c - a) * j as f32 / 20.0).floor();
                    for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        let (column, row) = (low.x as i32 + x, low.y as i32 + y);
                        let index = lattice.index(column, row);
                        assert_eq!(at[index], (column, row));
                        let away = Vec2::new(column as f32, row as f32)
                            .distance(places[index].expect("near a triangle").truncate());
                        assert!(away < 1.5, "{column} {row}: {away}");
                    }
                }
            }
        }
    }

    #[test]
    fn points_share_the_area_by_how_near_they_are() {
        let pieces = [
            piece([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0]]),
            piece([[0.0, 0.0], [3.0, 2.0], [0.0, 2.0]]),
        ];
        let lattice = Lattice::around(&pieces).expect("close together");
        let shares = lattice.shares(&pieces);
        for ((column, row), share) in lattice.points().zip(&shares) {
            let width = |at: i32, end: i32| match at {
                _ if at < 0 || at > end => 0.0,
                _ if at == 0 || at == end => 0.5,
                _ => 1.0,
            };
            let known = width(column, 3) * width(row, 2) / 6.0;
            assert!((share - known).abs() < 1.0e-6, "{column} {row}: {share}, not {known}");
        }
    }

    #[test]
    fn points_outside_are_moved_inside() {
        let piece = piece([[0.5, 0.5], [0.5, 3.5], [9.5, 0.5]]);
        let (away, at) = piece.nearest(Vec2::new(4.0, 0.0));
        assert_eq!(away, 0.25);
        assert!(at.y > 0.5 && at.y < 0.52 && (at.x - 4.0).abs() < 0.02, "{at}");
        assert_eq!(piece.nearest(Vec2::new(0.5, 2.0)), (0.0, Vec3::new(0.5, 2.0, 0.0)));
    }

    #[test]
    fn slivers_that_lie_far_apart_share_no_lattice() {
        let far = 5_000.0;
        let slivers = [
            piece([[0.0, 0.0], [far, far], [0.1, 0.0]]),
            piece([[0.0, 0.0], [0.1, 0.0], [-far, far]]),
        ];
        assert!(Lattice::around(&slivers).is_none());
        let alone = Lattice::around(&slivers[..1]).expect("few points");
        assert!(alone.points().count() < 25_000);
    }
}
