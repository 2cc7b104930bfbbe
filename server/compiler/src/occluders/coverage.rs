//! The parts of a rectangle that triangles leave uncovered.

use glam::DVec2;
use sightline_world::tolerance::SLIVER_M;

use super::rectangle::{PlaneRect, PlaneTriangle};

/// The parts of a rectangle that no triangle covers, as rectangles that do not overlap. A part with
/// a slanted edge is rounded up to rectangles: never too small.
pub(crate) fn uncovered(rect: &PlaneRect, triangles: &[&PlaneTriangle]) -> Vec<PlaneRect> {
    if triangles.is_empty() {
        return vec![*rect];
    }
    if covers(triangles, rect) {
        return Vec::new();
    }
    let grid = Grid::new(rect, triangles);
    let parts = grid.merged(&grid.free(triangles));
    debug_assert!(
        parts.iter().all(|part| part.intersection(rect) == *part),
        "uncovered parts lie in the rectangle"
    );
    parts
}

/// A rectangle cut along the corners of the triangles in it.
struct Grid {
    us: Vec<f64>,
    vs: Vec<f64>,
}

/// Triangles with a smaller bounding rectangle than this, in square metres, cut no lines. A hole
/// between them is rounded up to the lines of larger triangles.
const CUTTING_AREA_MIN: f64 = 0.01;

impl Grid {
    fn new(rect: &PlaneRect, triangles: &[&PlaneTriangle]) -> Self {
        let corners = || {
            let large = |t: &&&PlaneTriangle| PlaneRect::around(t).area() >= CUTTING_AREA_MIN;
            triangles.iter().filter(large).flat_map(|t| t.iter())
        };
        Self {
            us: lines(rect.min.x, rect.max.x, corners().map(|c| c.x)),
            vs: lines(rect.min.y, rect.max.y, corners().map(|c| c.y)),
        }
    }

    fn cell(&self, u: usize, v: usize) -> PlaneRect {
        PlaneRect {
            min: DVec2::new(self.us[u], self.vs[v]),
            max: DVec2::new(self.us[u + 1], self.vs[v + 1]),
        }
    }

    /// For each row of cells, which cells are not covered.
    fn free(&self, triangles: &[&PlaneTriangle]) -> Vec<Vec<bool>> {
        let mut near = Vec::new();
        (0..self.vs.len() - 1)
            .map(|v| {
                (0..self.us.len() - 1)
                    .map(|u| {
                        let cell = self.cell(u, v);
                        near.clear();
                        near.extend(
                            triangles
                                .iter()
                                .filter(|t| !PlaneRect::around(t).intersection(&cell).is_flat()),
                        );
                        !covers(&near, &cell)
                    })
                    .collect()
            })
            .collect()
    }

    /// Joins free cells to rectangles: along rows, then equal runs of neighbouring rows.
    fn merged(&self, free: &[Vec<bool>]) -> Vec<PlaneRect> {
        let mut done = Vec::new();
        let mut open: Vec<(usize, usize, usize)> = Vec::new();
        for (v, row) in free.iter().enumerate() {
            let runs = runs(row);
            let (kept, closed): (Vec<_>, Vec<_>) =
                open.drain(..).partition(|&(from, to, _)| runs.contains(&(from, to)));
            done.extend(closed.into_iter().map(|(from, to, start)| (from, to, start, v)));
            open = kept;
            for (from, to) in runs {
                if !open.iter().any(|&(f, t, _)| (f, t) == (from, to)) {
                    open.push((from, to, v));
                }
            }
        }
        done.extend(open.into_iter().map(|(from, to, start)| (from, to, start, free.len())));
        done.into_iter()
            .map(|(u0, u1, v0, v1)| PlaneRect {
                min: DVec2::new(self.us[u0], self.vs[v0]),
                max: DVec2::new(self.us[u1], self.vs[v1]),
            })
            .collect()
    }
}

/// The cutting lines between two ends, ascending.
fn lines(min: f64, max: f64, cuts: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut lines: Vec<f64> = cuts.filter(|&c| c > min && c < max).collect();
    lines.push(min);
    lines.push(max);
    lines.sort_unstable_by(f64::total_cmp);
    lines.dedup();
    lines
}

/// The runs of true values, as half-open ranges.
fn runs(row: &[bool]) -> Vec<(usize, usize)> {
    let mut runs = Vec::new();
    let mut start = None;
    for (i, free) in row.iter().copied().chain([false]).enumerate() {
        match (free, start) {
            (true, None) => start = Some(i),
            (false, Some(from)) => {
                runs.push((from, i));
                start = None;
            }
            _ => {}
        }
    }
    runs
}

/// When more pieces than this are left, the rectangle counts as uncovered.
const PIECES_MAX: usize = 512;

/// Whether the union of triangles covers a rectangle, to within rounding.
fn covers(triangles: &[&PlaneTriangle], rect: &PlaneRect) -> bool {
    let mut pieces: Vec<Vec<DVec2>> = vec![rect.corners().to_vec()];
    for triangle in triangles {
        pieces = pieces.into_iter().flat_map(|piece| without(piece, triangle)).collect();
        if pieces.is_empty() {
            return true;
        }
        if pieces.len() > PIECES_MAX {
            return false;
        }
    }
    false
}

/// The parts of a convex polygon outside a triangle.
fn without(piece: Vec<DVec2>, triangle: &PlaneTriangle) -> Vec<Vec<DVec2>> {
    let mut outside = Vec::new();
    let mut inside = piece.clone();
    for i in 0..3 {
        let (from, to) = (triangle[i], triangle[(i + 1) % 3]);
        let (left, right) = cut(&inside, from, to);
        outside.extend(right);
        match left {
            Some(left) => inside = left,
            // The polygon and the triangle are apart.
            None => return vec![piece],
        }
    }
    outside
}

/// The parts of a convex polygon on the left and on the right of a line. Slivers are dropped.
fn cut(polygon: &[DVec2], from: DVec2, to: DVec2) -> (Option<Vec<DVec2>>, Option<Vec<DVec2>>) {
    let along = (to - from).normalize();
    let sides: Vec<f64> = polygon.iter().map(|&p| along.perp_dot(p - from)).collect();
    let (low, high) = sides
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &s| (low.min(s), high.max(s)));
    if low >= -SLIVER_M {
        return (Some(polygon.to_vec()), None);
    }
    if high <= SLIVER_M {
        return (None, Some(polygon.to_vec()));
    }
    let (mut left, mut right) = (Vec::new(), Vec::new());
    for i in 0..polygon.len() {
        let j = (i + 1) % polygon.len();
        if sides[i] >= 0.0 {
            left.push(polygon[i]);
        }
        if sides[i] <= 0.0 {
            right.push(polygon[i]);
        }
        if sides[i] * sides[j] < 0.0 {
            let crossing = polygon[i].lerp(polygon[j], sides[i] / (sides[i] - sides[j]));
            left.push(crossing);
            right.push(crossing);
        }
    }
    (Some(left), Some(right))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::occluders::rectangle::anticlockwise;

    fn rect(u0: f64, v0: f64, u1: f64, v1: f64) -> PlaneRect {
        PlaneRect { min: DVec2::new(u0, v0), max: DVec2::new(u1, v1) }
    }

    fn halves(r: &PlaneRect) -> [PlaneTriangle; 2] {
        let [a, b, c, d] = r.corners();
        [[a, b, c], [a, c, d]]
    }

    fn check(whole: PlaneRect, opaque: &[PlaneRect], expected: &[PlaneRect]) {
        let triangles: Vec<PlaneTriangle> = opaque.iter().flat_map(halves).collect();
        assert_eq!(uncovered(&whole, &triangles.iter().collect::<Vec<_>>()), expected);
    }

    #[test]
    fn a_wall_with_a_door_leaves_the_door() {
        let door = rect(2.0, 0.0, 3.0, 2.0);
        let wall = [rect(0.0, 0.0, 2.0, 3.0), rect(3.0, 0.0, 9.0, 3.0), rect(2.0, 2.0, 3.0, 3.0)];
        check(rect(0.0, 0.0, 5.0, 3.0), &wall, &[door]);
        check(rect(0.0, 0.0, 2.0, 3.0), &wall, &[]);
        check(rect(0.0, 3.0, 5.0, 4.0), &wall, &[rect(0.0, 3.0, 5.0, 4.0)]);
    }

    #[test]
    fn a_slanted_hole_is_rounded_up() {
        let triangle = [DVec2::ZERO, DVec2::new(4.0, 0.0), DVec2::new(0.0, 4.0)];
        let whole = rect(0.0, 0.0, 4.0, 4.0);
        assert_eq!(uncovered(&whole, &[&triangle]), vec![whole]);
    }

    proptest! {
        /// Every point that no triangle covers lies in an uncovered rectangle.
        #[test]
        fn nothing_uncovered_is_lost(
            opaque in prop::collection::vec(
                ((0u8..8, 0u8..8), (0u8..8, 0u8..8), (0u8..8, 0u8..8)), 0..12),
            points in prop::collection::vec((0.0..7.0f64, 0.0..7.0f64), 50),
        ) {
            let corner = |(u, v): (u8, u8)| DVec2::new(u.into(), v.into());
            let triangles: Vec<PlaneTriangle> = opaque.into_iter()
                .filter_map(|(a, b, c)| anticlockwise([corner(a), corner(b), corner(c)]))
                .collect();
            let whole = rect(0.0, 0.0, 7.0, 7.0);
            let free = uncovered(&whole, &triangles.iter().collect::<Vec<_>>());
            for (u, v) in points {
                let p = DVec2::new(u, v);
                let inside = |t: &PlaneTriangle| (0..3).all(|i| {
                    (t[(i + 1) % 3] - t[i]).perp_dot(p - t[i]) >= 0.0
                });
                let covered = triangles.iter().any(inside);
                let open = free.iter()
                    .filter(|r| r.min.cmple(p).all() && p.cmple(r.max).all()).count();
                prop_assert!(covered || open > 0, "{p} is lost");
                prop_assert!(open <= 1, "{p} is in {open} rectangles");
            }
        }

        /// Rectangles are not rounded: a covered point is never called free.
        #[test]
        fn rectangles_are_exact(
            opaque in prop::collection::vec(((0u8..7, 1u8..4), (0u8..7, 1u8..4)), 0..10),
            points in prop::collection::vec((0.0..7.0f64, 0.0..7.0f64), 50),
        ) {
            let opaque: Vec<PlaneRect> = opaque.into_iter()
                .map(|((u, w), (v, h))| rect(u.into(), v.into(), (u + w).into(), (v + h).into()))
                .collect();
            let triangles: Vec<PlaneTriangle> = opaque.iter().flat_map(halves).collect();
            let free = uncovered(&rect(0.0, 0.0, 7.0, 7.0), &triangles.iter().collect::<Vec<_>>());
            for (u, v) in points {
                let p = DVec2::new(u, v);
                let within = |r: &PlaneRect| r.min.cmplt(p).all() && p.cmplt(r.max).all();
                prop_assert_eq!(opaque.iter().any(within), !free.iter().any(within));
            }
        }
    }
}
