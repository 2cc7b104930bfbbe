//! Which surfaces make cells: the axial occluders, plane by plane.
//!
//! A triangle is axial when its three corners agree on one coordinate. All others are left out of
//! the subdivision, which makes the PVS larger, never wrong.

use std::collections::HashMap;

use glam::{DVec2, DVec3};
use sightline_world::tolerance::{AXIAL_PLANE_M, SLIVER_M};

use super::subdivide::region::SplitPlane;

/// Buckets of the index over a plane are this wide, in metres.
const BUCKET: f64 = 4.0;

/// An opaque triangle, in a building's own axes.
#[derive(Clone, Copy, Debug)]
pub struct Opaque {
    /// In metres.
    pub corners: [DVec3; 3],
    /// Whether to split along it only when nothing else is left to split along.
    pub is_last: bool,
}

/// A triangle in the coordinates of its plane: those of the two other axes, in ascending order.
pub type Triangle2 = [DVec2; 3];

/// A rectangle in the coordinates of a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rect {
    /// The lesser corner.
    pub min: DVec2,
    /// The greater corner.
    pub max: DVec2,
}

impl Rect {
    /// The smallest rectangle around a triangle.
    pub fn around(triangle: &Triangle2) -> Self {
        let [a, b, c] = *triangle;
        Self { min: a.min(b).min(c), max: a.max(b).max(c) }
    }

    /// What both share; of negative size when they are apart.
    pub fn intersection(&self, other: &Self) -> Self {
        Self { min: self.min.max(other.min), max: self.max.min(other.max) }
    }

    /// Whether it has no area.
    pub fn is_flat(&self) -> bool {
        !self.min.cmplt(self.max).all()
    }

    /// In square metres; zero when flat.
    pub fn area(&self) -> f64 {
        if self.is_flat() { 0.0 } else { (self.max - self.min).element_product() }
    }

    /// Its corners, anticlockwise.
    pub fn corners(&self) -> [DVec2; 4] {
        let (a, b) = (self.min, self.max);
        [a, DVec2::new(b.x, a.y), b, DVec2::new(a.x, b.y)]
    }
}

/// The opaque part of one plane: axial, or vertical at any angle.
#[derive(Debug)]
pub struct OccluderPlane {
    /// Where it is.
    pub cut: SplitPlane,
    /// What is opaque, overlaps included. Corners run anticlockwise.
    pub triangles: Vec<Triangle2>,
    /// For each triangle, [`Opaque::is_last`].
    pub is_last: Vec<bool>,
    buckets: HashMap<(i64, i64), Vec<u32>>,
}

impl OccluderPlane {
    fn new(cut: SplitPlane, opaque: impl Iterator<Item = (Triangle2, bool)>) -> Self {
        let (triangles, is_last): (Vec<_>, _) = opaque.unzip();
        let mut buckets: HashMap<_, Vec<u32>> = HashMap::new();
        for (index, triangle) in triangles.iter().enumerate() {
            for bucket in buckets_of(&Rect::around(triangle)) {
                buckets.entry(bucket).or_default().push(index as u32);
            }
        }
        Self { cut, triangles, is_last, buckets }
    }

    /// The triangles whose surroundings overlap a rectangle, each once, in order.
    pub fn overlapping(&self, rect: &Rect) -> Vec<&Triangle2> {
        let mut found: Vec<u32> = buckets_of(rect)
            .filter_map(|bucket| self.buckets.get(&bucket))
            .flatten()
            .copied()
            .filter(|&i| {
                let around = Rect::around(&self.triangles[i as usize]);
                !around.intersection(rect).is_flat()
            })
            .collect();
        found.sort_unstable();
        found.dedup();
        found.into_iter().map(|i| &self.triangles[i as usize]).collect()
    }
}

fn buckets_of(rect: &Rect) -> impl Iterator<Item = (i64, i64)> + use<> {
    let low = (rect.min / BUCKET).floor().as_i64vec2();
    let high = (rect.max / BUCKET).floor().as_i64vec2();
    (low.x..=high.x).flat_map(move |x| (low.y..=high.y).map(move |y| (x, y)))
}

/// Every plane with something opaque on it, out of triangles in a building's own axes: the axial
/// ones by axis, then ascending; then those that are vertical at other angles.
///
/// Corners that lie next to an axial plane are moved onto it first, by [`AXIAL_PLANE_M`] at
/// most, so that walls that meet in the model but for rounding leave no gap.
pub fn planes(opaque: &[Opaque]) -> Vec<OccluderPlane> {
    let levels = [0, 1, 2].map(|axis| {
        let planes = planes_along(axis, opaque);
        planes.iter().map(|plane| -plane.cut.height(DVec3::ZERO)).collect::<Vec<f64>>()
    });
    let snapped = |mut corner: DVec3| {
        for (axis, levels) in levels.iter().enumerate() {
            let above = levels.partition_point(|&level| level < corner[axis]);
            let near = levels[above.saturating_sub(1)..].iter().take(2);
            let away = |level: &&f64| (**level - corner[axis]).abs();
            if let Some(&level) = near.min_by(|a, b| away(a).total_cmp(&away(b)))
                && (level - corner[axis]).abs() <= AXIAL_PLANE_M
            {
                corner[axis] = level;
            }
        }
        corner
    };
    let snapped =
        |&Opaque { corners, is_last }: &Opaque| Opaque { corners: corners.map(snapped), is_last };
    let opaque: Vec<Opaque> = opaque.iter().map(snapped).collect();
    let opaque = &opaque;
    let mut planes: Vec<_> = (0..3).flat_map(|axis| planes_along(axis, opaque)).collect();
    planes.extend(slanted(opaque));
    planes
}

/// Whether three coordinates are the same but for rounding.
fn agree(along: [f64; 3]) -> bool {
    let low = along.into_iter().fold(f64::INFINITY, f64::min);
    along.into_iter().all(|c| c - low <= AXIAL_PLANE_M)
}

fn planes_along(axis: usize, opaque: &[Opaque]) -> Vec<OccluderPlane> {
    let mut axial: Vec<(f64, (Triangle2, bool))> = opaque
        .iter()
        .filter(|opaque| agree(opaque.corners.map(|c| c[axis])))
        .filter_map(|Opaque { corners, is_last }| {
            let low = corners.iter().fold(f64::INFINITY, |low, c| low.min(c[axis]));
            Some((low, (anticlockwise(corners.map(|c| in_plane(c, axis)))?, *is_last)))
        })
        .collect();
    // A stable sort: the order of equal planes stays that of the model.
    axial.sort_by(|a, b| a.0.total_cmp(&b.0));
    axial
        .chunk_by(|a, b| b.0 - a.0 <= AXIAL_PLANE_M)
        .flat_map(|near| split_wide(near))
        .map(|near| {
            let triangles = near.iter().map(|&(_, triangle)| triangle);
            OccluderPlane::new(SplitPlane::Axial { axis, at: near[0].0 as f32 }, triangles)
        })
        .collect()
}

/// The vertical planes that are not axial, in the order of the model.
fn slanted(opaque: &[Opaque]) -> Vec<OccluderPlane> {
    /// Planes are sought among those alike in steps of a metre and of a hundredth of a radian.
    const STEP: [f64; 2] = [1.0, 0.01];
    let mut found: Vec<(SplitPlane, Vec<(Triangle2, bool)>)> = Vec::new();
    let mut alike: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
    for Opaque { corners, is_last } in opaque {
        let Some(cut) = vertical(corners) else { continue };
        let normal = cut.normal();
        let key = [-cut.height(DVec3::ZERO), normal.x.atan2(normal.z)];
        let key = [0, 1].map(|i| (key[i] / STEP[i]).floor() as i64);
        let near = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [key[0] + i, key[1] + j]));
        let fits = |&&index: &&usize| {
            let (other, _): &(SplitPlane, _) = &found[index];
            corners.iter().all(|&corner| other.height(corner).abs() <= AXIAL_PLANE_M)
        };
        let known = near.filter_map(|key| alike.get(&key)).flatten().find(fits).copied();
        let index = known.unwrap_or_else(|| {
            alike.entry(key).or_default().push(found.len());
            found.push((cut, Vec::new()));
            found.len() - 1
        });
        let (cut, triangles) = &mut found[index];
        let triangle = anticlockwise(corners.map(|corner| cut.flat(corner)));
        triangles.extend(triangle.map(|triangle| (triangle, *is_last)));
    }
    found
        .into_iter()
        .map(|(cut, triangles)| OccluderPlane::new(cut, triangles.into_iter()))
        .collect()
}

/// The vertical plane of a triangle; none when that is axial, or the triangle has no area.
fn vertical(corners: &[DVec3; 3]) -> Option<SplitPlane> {
    let [a, b, c] = *corners;
    if (0..3).any(|axis| agree(corners.map(|corner| corner[axis]))) {
        return None;
    }
    // The longest edge gives the direction with the least error.
    let edges = [b - a, c - b, a - c].map(|edge| DVec2::new(edge.x, edge.z));
    let along = edges.into_iter().max_by(|a, b| a.length().total_cmp(&b.length()))?;
    let across = DVec3::new(-along.y, 0.0, along.x).try_normalize()?;
    let across = if across.x < 0.0 { -across } else { across };
    let distance = across.dot((a + b + c) / 3.0);
    let cut = SplitPlane::Plane { normal: across, distance };
    corners.iter().all(|&corner| cut.height(corner).abs() <= AXIAL_PLANE_M).then_some(cut)
}

/// A chain of planes, each within the tolerance of the next, may be wider than the tolerance.
fn split_wide<T>(mut near: &[(f64, T)]) -> Vec<&[(f64, T)]> {
    let mut parts = Vec::new();
    while let Some(first) = near.first() {
        let end = near.partition_point(|(at, _)| at - first.0 <= AXIAL_PLANE_M);
        let (part, rest) = near.split_at(end);
        parts.push(part);
        near = rest;
    }
    parts
}

/// The two other coordinates of a point, in ascending order of axis.
pub fn in_plane(point: DVec3, axis: usize) -> DVec2 {
    let (u, v) = other_axes(axis);
    DVec2::new(point[u], point[v])
}

impl SplitPlane {
    /// A point of an axial or vertical plane in the plane's coordinates: the two other axes, or
    /// along the horizontal and up.
    pub fn flat(&self, point: DVec3) -> DVec2 {
        match *self {
            Self::Axial { axis, .. } => in_plane(point, axis),
            Self::Plane { normal, .. } => {
                DVec2::new(normal.z * point.x - normal.x * point.z, point.y)
            }
        }
    }

    /// The other way round.
    pub fn upright(&self, point: DVec2) -> DVec3 {
        match *self {
            Self::Axial { axis, at } => {
                let (u, v) = other_axes(axis);
                let mut place = DVec3::splat(f64::from(at));
                (place[u], place[v]) = (point.x, point.y);
                place
            }
            Self::Plane { normal: n, distance } => {
                DVec3::new(n.z * point.x, point.y, -n.x * point.x) + n * distance
            }
        }
    }
}

/// The axes that span the planes perpendicular to one, in ascending order.
pub fn other_axes(axis: usize) -> (usize, usize) {
    match axis {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    }
}

/// The triangle with its corners anticlockwise; none when it has no area.
fn anticlockwise([a, b, c]: Triangle2) -> Option<Triangle2> {
    let doubled = (b - a).perp_dot(c - a);
    if doubled > 0.0 {
        Some([a, b, c])
    } else if doubled < 0.0 {
        Some([a, c, b])
    } else {
        None
    }
}

/// The parts of a rectangle that no triangle covers, as rectangles that do not overlap. A part
/// that is bounded by a slanted edge is rounded up to a rectangle: never too small.
pub fn uncovered(rect: &Rect, triangles: &[&Triangle2]) -> Vec<Rect> {
    if triangles.is_empty() {
        return vec![*rect];
    }
    if covers(triangles, rect) {
        return Vec::new();
    }
    let grid = Grid::new(rect, triangles);
    grid.merged(&grid.free(triangles))
}

/// A rectangle cut along the corners of what lies in it.
struct Grid {
    us: Vec<f64>,
    vs: Vec<f64>,
}

/// Triangles whose surroundings are smaller than this, in square metres, cut no lines of their
/// own: a hole they bound is rounded up to the lines of larger ones.
const CUTTING_AREA_MIN: f64 = 0.01;

impl Grid {
    fn new(rect: &Rect, triangles: &[&Triangle2]) -> Self {
        let corners = || {
            let large = |t: &&&Triangle2| Rect::around(t).area() >= CUTTING_AREA_MIN;
            triangles.iter().filter(large).flat_map(|t| t.iter())
        };
        Self {
            us: lines(rect.min.x, rect.max.x, corners().map(|c| c.x)),
            vs: lines(rect.min.y, rect.max.y, corners().map(|c| c.y)),
        }
    }

    fn cell(&self, u: usize, v: usize) -> Rect {
        Rect {
            min: DVec2::new(self.us[u], self.vs[v]),
            max: DVec2::new(self.us[u + 1], self.vs[v + 1]),
        }
    }

    /// For each row of cells, which are not covered.
    fn free(&self, triangles: &[&Triangle2]) -> Vec<Vec<bool>> {
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
                                .filter(|t| !Rect::around(t).intersection(&cell).is_flat()),
                        );
                        !covers(&near, &cell)
                    })
                    .collect()
            })
            .collect()
    }

    /// Free cells joined to rectangles: along rows, then equal runs of neighbouring rows.
    fn merged(&self, free: &[Vec<bool>]) -> Vec<Rect> {
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
            .map(|(u0, u1, v0, v1)| Rect {
                min: DVec2::new(self.us[u0], self.vs[v0]),
                max: DVec2::new(self.us[u1], self.vs[v1]),
            })
            .collect()
    }
}

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

/// More pieces than this, and the rest is called uncovered.
const PIECES_MAX: usize = 512;

/// Whether the union of triangles covers a rectangle, to within rounding.
fn covers(triangles: &[&Triangle2], rect: &Rect) -> bool {
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
fn without(piece: Vec<DVec2>, triangle: &Triangle2) -> Vec<Vec<DVec2>> {
    let mut outside = Vec::new();
    let mut inside = piece.clone();
    for i in 0..3 {
        let (from, to) = (triangle[i], triangle[(i + 1) % 3]);
        let (left, right) = cut(&inside, from, to);
        outside.extend(right);
        match left {
            Some(left) => inside = left,
            // The polygon and the triangle are apart: nothing to cut off.
            None => return vec![piece],
        }
    }
    outside
}

/// A convex polygon's parts on the left and on the right of a line; those thinner than a sliver
/// are dropped.
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

    fn rect(u0: f64, v0: f64, u1: f64, v1: f64) -> Rect {
        Rect { min: DVec2::new(u0, v0), max: DVec2::new(u1, v1) }
    }

    fn halves(r: &Rect) -> [Triangle2; 2] {
        let [a, b, c, d] = r.corners();
        [[a, b, c], [a, c, d]]
    }

    fn check(whole: Rect, opaque: &[Rect], expected: &[Rect]) {
        let triangles: Vec<Triangle2> = opaque.iter().flat_map(halves).collect();
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

    #[test]
    fn planes_within_the_tolerance_are_one_and_others_are_not() {
        let flat = |y: f64, tilt: f64| {
            let corners =
                [DVec3::new(0.0, y, 0.0), DVec3::new(1.0, y + tilt, 0.0), DVec3::new(0.0, y, 1.0)];
            Opaque { corners, is_last: false }
        };
        let near = planes(&[flat(1.0, 0.0), flat(1.00002, 0.0), flat(1.0, 0.00002)]);
        assert_eq!(near.len(), 1);
        assert_eq!(near[0].cut, SplitPlane::Axial { axis: 1, at: 1.0 });
        assert_eq!(near[0].triangles.len(), 3);
        assert_eq!(planes(&[flat(1.0, 0.0), flat(1.001, 0.0), flat(1.0, 0.001)]).len(), 2);
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
            let triangles: Vec<Triangle2> = opaque.into_iter()
                .filter_map(|(a, b, c)| anticlockwise([corner(a), corner(b), corner(c)]))
                .collect();
            let whole = rect(0.0, 0.0, 7.0, 7.0);
            let free = uncovered(&whole, &triangles.iter().collect::<Vec<_>>());
            for (u, v) in points {
                let p = DVec2::new(u, v);
                let inside = |t: &Triangle2| (0..3).all(|i| {
                    (t[(i + 1) % 3] - t[i]).perp_dot(p - t[i]) >= 0.0
                });
                let covered = triangles.iter().any(inside);
                let open = free.iter()
                    .filter(|r| r.min.cmple(p).all() && p.cmple(r.max).all()).count();
                prop_assert!(covered || open > 0, "{p} is lost");
                prop_assert!(open <= 1, "{p} is in {open} rectangles");
            }
        }

        /// Made of rectangles alone, nothing is rounded: what is covered is not called free.
        #[test]
        fn rectangles_are_exact(
            opaque in prop::collection::vec(((0u8..7, 1u8..4), (0u8..7, 1u8..4)), 0..10),
            points in prop::collection::vec((0.0..7.0f64, 0.0..7.0f64), 50),
        ) {
            let opaque: Vec<Rect> = opaque.into_iter()
                .map(|((u, w), (v, h))| rect(u.into(), v.into(), (u + w).into(), (v + h).into()))
                .collect();
            let triangles: Vec<Triangle2> = opaque.iter().flat_map(halves).collect();
            let free = uncovered(&rect(0.0, 0.0, 7.0, 7.0), &triangles.iter().collect::<Vec<_>>());
            for (u, v) in points {
                let p = DVec2::new(u, v);
                let within = |r: &Rect| r.min.cmplt(p).all() && p.cmplt(r.max).all();
                prop_assert_eq!(opaque.iter().any(within), !free.iter().any(within));
            }
        }
    }
}
