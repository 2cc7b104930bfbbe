//! Merging: coplanar triangles of one surface become polygons. Their outlines may have holes.

use glam::DVec3;

use super::{
    plane::{Facing, Plane, is_regular},
    topology::{Half, Tolerance, Topology},
};

/// The polygon of triangles without area: none.
const NONE: u32 = u32::MAX;
/// When more triangles meet at one edge, each is compared with the next only.
const COMPARED_MAX: usize = 12;

/// The polygons of a model, and the edges that they share.
///
/// Two triangles merge across an edge when they lie in one plane, face the same way, belong to one
/// surface, and no rectangle could have the edge (see [`is_regular`]). So diagonals vanish, however
/// a wall was triangulated. What the modeller divided along the axes stays divided: the pieces of
/// wall above an arch make its elements.
pub(super) struct Polygons {
    pub tolerance: Tolerance,
    pub points: Vec<DVec3>,
    pub planes: Vec<Plane>,
    pub facings: Vec<Facing>,
    /// The triangles of each polygon.
    pub triangles: Vec<Vec<u32>>,
    /// The parts of outlines. Borders of one edge follow each other.
    pub borders: Vec<Border>,
    /// Borders by polygon; see [`Polygons::borders_of`].
    border_order: Vec<u32>,
    border_starts: Vec<u32>,
    /// Triangles without area, which belong to no polygon.
    pub degenerate: Vec<u32>,
}

/// A part of the outline of a polygon: an edge that is shared with other polygons, or open.
#[derive(Clone, Copy, Debug)]
pub(super) struct Border {
    /// The two end points, the lower index first.
    pub ends: [u32; 2],
    /// The polygon whose outline it is.
    pub polygon: u32,
    /// How many more times the outline uses the edge upwards, from the lower index, than downwards.
    /// Never 0.
    pub sense: i32,
    /// The index of the first border of this edge.
    first: u32,
}

impl Polygons {
    /// Merges triangles. `surfaces` gives the surface of each, or is empty when there is only one.
    pub(super) fn merge(triangles: &[[DVec3; 3]], surfaces: &[u32]) -> Self {
        let tolerance = Tolerance::of(triangles);
        let topology = Topology::new(triangles, tolerance);
        let seeds: Vec<Seed> = triangles.iter().map(|t| Seed::new(t, tolerance)).collect();
        let merging =
            Merging { triangles, surfaces, tolerance, topology: &topology, seeds: &seeds };
        let (polygon_of, planes) = merging.grow();
        let mut members = vec![Vec::new(); planes.len()];
        let mut degenerate = Vec::new();
        for (triangle, &polygon) in (0..).zip(&polygon_of) {
            match members.get_mut(polygon as usize) {
                Some(members) => members.push(triangle),
                None => degenerate.push(triangle),
            }
        }
        assert_eq!(
            polygon_of.len(),
            triangles.len(),
            "each triangle is in a polygon or degenerate"
        );
        let borders = borders(&topology.halves, &polygon_of);
        let (border_starts, border_order) = by_polygon(&borders, planes.len());
        Self {
            tolerance,
            facings: planes.iter().map(Facing::of).collect(),
            points: topology.points,
            planes,
            triangles: members,
            borders,
            border_order,
            border_starts,
            degenerate,
        }
    }

    /// The number of polygons.
    pub(super) fn len(&self) -> usize {
        self.planes.len()
    }

    /// The outline of a polygon, in no order.
    pub(super) fn borders_of(&self, polygon: u32) -> impl Iterator<Item = &Border> {
        let polygon = polygon as usize;
        let range = self.border_starts[polygon] as usize..self.border_starts[polygon + 1] as usize;
        self.border_order[range].iter().map(|&i| &self.borders[i as usize])
    }

    /// All borders on the edge of a border, that border included.
    pub(super) fn on_edge(&self, border: &Border) -> &[Border] {
        let from = &self.borders[border.first as usize..];
        let count = from.iter().take_while(|b| b.ends == border.ends).count();
        &from[..count]
    }

    /// All edges, each as the borders on it.
    pub(super) fn edges(&self) -> impl Iterator<Item = &[Border]> {
        self.borders.chunk_by(|a, b| a.ends == b.ends)
    }

    /// The ends of a border, in metres.
    pub(super) fn segment(&self, border: &Border) -> [DVec3; 2] {
        border.ends.map(|i| self.points[i as usize])
    }

    /// The outline as closed loops of points. Seen from the front, outer loops run anticlockwise
    /// and holes clockwise.
    #[cfg(test)]
    pub fn loops(&self, polygon: u32) -> Vec<Vec<u32>> {
        let mut next: std::collections::BTreeMap<u32, Vec<u32>> = std::collections::BTreeMap::new();
        for border in self.borders_of(polygon) {
            let [low, high] = border.ends;
            let (from, to) = if border.sense > 0 { (low, high) } else { (high, low) };
            next.entry(from).or_default().push(to);
        }
        let mut loops = Vec::new();
        while let Some((&start, _)) = next.iter().find(|(_, to)| !to.is_empty()) {
            let mut outline = vec![start];
            let mut at = start;
            while let Some(to) = next.get_mut(&at).and_then(Vec::pop) {
                if to == start {
                    break;
                }
                outline.push(to);
                at = to;
            }
            loops.push(outline);
        }
        loops
    }
}

/// The plane of a triangle, and how reliable it is.
struct Seed {
    plane: Plane,
    doubled_area: f64,
}

impl Seed {
    fn new(triangle: &[DVec3; 3], tolerance: Tolerance) -> Self {
        let [a, b, c] = *triangle;
        let cross = (b - a).cross(c - a);
        let plane = Plane::through(triangle, cross.normalize_or_zero(), tolerance.plane);
        Self { plane, doubled_area: cross.length() }
    }
}

/// Triangles that are being merged.
struct Merging<'a> {
    triangles: &'a [[DVec3; 3]],
    surfaces: &'a [u32],
    tolerance: Tolerance,
    topology: &'a Topology,
    seeds: &'a [Seed],
}

impl Merging<'_> {
    /// Grows polygons from the largest triangles. Each stays within the plane of its first
    /// triangle, so that a dome of fine triangles does not become one polygon.
    fn grow(&self) -> (Vec<u32>, Vec<Plane>) {
        let (starts, neighbours) = self.neighbours();
        let mut order: Vec<u32> = (0..self.triangles.len() as u32).collect();
        order.sort_by(|&a, &b| {
            let area = |i: u32| self.seeds[i as usize].doubled_area;
            area(b).total_cmp(&area(a))
        });
        let mut polygon_of = vec![NONE; self.triangles.len()];
        let mut planes: Vec<Plane> = Vec::new();
        let mut open = Vec::new();
        for seed in order {
            let is_free = |t: u32, polygon_of: &[u32]| polygon_of[t as usize] == NONE;
            if self.topology.degenerate[seed as usize] || !is_free(seed, &polygon_of) {
                continue;
            }
            let polygon = planes.len() as u32;
            let plane = self.seeds[seed as usize].plane;
            polygon_of[seed as usize] = polygon;
            open.push(seed);
            while let Some(triangle) = open.pop() {
                let range =
                    starts[triangle as usize] as usize..starts[triangle as usize + 1] as usize;
                for &next in &neighbours[range] {
                    if is_free(next, &polygon_of) && self.is_within(next, &plane) {
                        polygon_of[next as usize] = polygon;
                        open.push(next);
                    }
                }
            }
            planes.push(plane);
        }
        (polygon_of, planes)
    }

    /// For each triangle, the triangles that it may merge with: where its list starts, and the
    /// lists.
    fn neighbours(&self) -> (Vec<u32>, Vec<u32>) {
        let mut pairs: Vec<[u32; 2]> = Vec::new();
        for halves in self.topology.halves.chunk_by(|a, b| a.key() == b.key()) {
            let reach = if halves.len() <= COMPARED_MAX { halves.len() } else { 2 };
            for (i, a) in halves.iter().enumerate() {
                for b in halves[i + 1..].iter().take(reach - 1) {
                    if a.triangle != b.triangle && self.may_merge(a, b) {
                        pairs.push([a.triangle, b.triangle]);
                    }
                }
            }
        }
        let mut starts = vec![0u32; self.triangles.len() + 1];
        for &triangle in pairs.as_flattened() {
            starts[triangle as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut free = starts.clone();
        let mut lists = vec![0; pairs.len() * 2];
        for [a, b] in pairs {
            for (of, to) in [(a, b), (b, a)] {
                lists[free[of as usize] as usize] = to;
                free[of as usize] += 1;
            }
        }
        (starts, lists)
    }

    /// Whether two triangles merge across their shared edge.
    fn may_merge(&self, a: &Half, b: &Half) -> bool {
        let [plane, other] = [a, b].map(|half| &self.seeds[half.triangle as usize].plane);
        let surface = |half: &Half| self.surfaces.get(half.triangle as usize);
        let along = {
            let [from, to] = a.ends().map(|i| self.topology.points[i as usize]);
            to - from
        };
        // The normals of two needle-like triangles may be anything, though one lies in the plane of
        // the other.
        plane.normal.dot(other.normal) > 0.5
            && surface(a) == surface(b)
            && !is_regular(Facing::of(plane), along, self.tolerance.weld)
            && (self.is_within(a.triangle, other) || self.is_within(b.triangle, plane))
    }

    /// Whether a triangle lies in a plane and faces the same way.
    fn is_within(&self, triangle: u32, plane: &Plane) -> bool {
        let near = |p: &DVec3| plane.height(*p).abs() <= self.tolerance.plane;
        self.seeds[triangle as usize].plane.normal.dot(plane.normal) > 0.5
            && self.triangles[triangle as usize].iter().all(near)
    }
}

/// The borders: edges between two triangles of one polygon cancel out.
fn borders(halves: &[Half], polygon_of: &[u32]) -> Vec<Border> {
    let mut borders: Vec<Border> = Vec::new();
    let mut here: Vec<(u32, i32)> = Vec::new();
    for halves in halves.chunk_by(|a, b| a.key() == b.key()) {
        here.clear();
        here.extend(
            halves.iter().map(|half| {
                (polygon_of[half.triangle as usize], if half.forward { 1 } else { -1 })
            }),
        );
        here.sort_unstable();
        let first = borders.len() as u32;
        for of_one in here.chunk_by(|a, b| a.0 == b.0) {
            let sense = of_one.iter().map(|(_, sense)| sense).sum();
            if sense != 0 {
                let (ends, polygon) = (halves[0].ends(), of_one[0].0);
                borders.push(Border { ends, polygon, sense, first });
            }
        }
    }
    borders
}

/// Borders by polygon: where each list starts, and the lists.
fn by_polygon(borders: &[Border], polygons: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; polygons + 1];
    for border in borders {
        starts[border.polygon as usize + 1] += 1;
    }
    for i in 0..polygons {
        starts[i + 1] += starts[i];
    }
    let mut free = starts.clone();
    let mut order = vec![0; borders.len()];
    for (i, border) in (0..).zip(borders) {
        order[free[border.polygon as usize] as usize] = i;
        free[border.polygon as usize] += 1;
    }
    (starts, order)
}
