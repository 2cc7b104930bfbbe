//! The plan of a storey, divided into areas.
//!
//! The plan is sampled on a grid of places. A place that a body cannot pass is closed. The distance
//! of an open place from the nearest closed one tells how wide the plan is there. A watershed
//! (Vincent and Soille 1991) takes places from the widest to the narrowest. A place next to an area
//! belongs to it. A place between two areas joins them, unless it is much narrower than both.

use glam::Vec3;
use rayon::prelude::*;
use sightline_world::{World, geometry::Aabb};

use super::enclosure::enclosure;

/// The step of the grid, in metres, or more where a building is large …
const STEP_M: f32 = 0.125;
/// … so that the grid has at most this many places along a side.
const SIDE_MAX: f32 = 2_400.0;
/// A place is closed when it is solid at all of these heights above the floor, in metres. Tables
/// are lower, and lintels higher.
const HEIGHTS_M: [f32; 3] = [1.0, 1.4, 1.8];
/// A walkable place is no farther than this below and above the floor of the storey, in metres.
const FLOOR_M: [f32; 2] = [0.4, 0.9];
/// An opening is a door when it is narrower than this share of the narrower of the areas that it
/// joins.
const NECK: f32 = 0.7;
/// A roof is at least this far above the floor, in metres.
const ROOF_M: f32 = 1.9;
/// Walls enclose a room: its places meet one in at least this share of all level directions.
const ENCLOSED_MIN: f32 = 0.6;
/// The smallest area of a room, in square metres.
const AREA_MIN_M2: f32 = 1.5;

/// The area that a place belongs to.
type Label = Option<u32>;

/// What fills most of the plan under a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ground {
    /// This area.
    Area(u32),
    /// Closed places: a wall, or furniture.
    Closed,
    /// Other places, such as the outside.
    Elsewhere,
}

/// The areas of one storey.
pub(super) struct Areas {
    from: Vec3,
    step: f32,
    columns: usize,
    rows: usize,
    open: Vec<bool>,
    walls: Vec<bool>,
    labels: Vec<Label>,
    pub(super) count: usize,
}

impl Areas {
    /// The areas of the storey whose floor is at this height.
    pub(super) fn of_storey(world: &World, feet: f32) -> Self {
        let bounds = &world.cells.bounds;
        let size = bounds.size();
        let step = STEP_M.max(size.x.max(size.z) / SIDE_MAX);
        let count = |size: f32| (size / step).ceil().max(1.0) as usize;
        let (columns, rows) = (count(size.x), count(size.z));
        let from = bounds.min.with_y(feet);
        let (open, walls, labels) = (Vec::new(), Vec::new(), Vec::new());
        let mut areas = Self { from, step, columns, rows, open, walls, labels, count: 0 };
        areas.walls =
            (0..columns * rows).into_par_iter().map(|at| areas.is_wall(world, at)).collect();
        areas.open = (0..columns * rows)
            .into_par_iter()
            .map(|at| !areas.walls[at] && areas.has_floor(world, at))
            .collect();
        let width = distances(&areas.open, columns, rows);
        assert_eq!(width.len(), areas.open.len(), "a width for each place");
        areas.labels = watershed(&width, columns, rows);
        assert_eq!(areas.labels.len(), areas.open.len(), "a label for each place");
        areas.keep_rooms(world);
        areas
    }

    fn point(&self, at: usize) -> Vec3 {
        let (x, z) = (at % self.columns, at / self.columns);
        self.from + Vec3::new(x as f32 + 0.5, 0.0, z as f32 + 0.5) * self.step
    }

    /// Whether a wall stands at a place, or no eye can be there.
    fn is_wall(&self, world: &World, at: usize) -> bool {
        let is_cell = world.cells.at_own(self.point(at) + Vec3::Y * HEIGHTS_M[1]).is_some();
        let is_solid = |height| self.is_solid(world, at, [height - 0.05, height + 0.05]);
        !is_cell || HEIGHTS_M.into_iter().all(is_solid)
    }

    /// Whether there is a floor at a place, about as high as that of the storey.
    fn has_floor(&self, world: &World, at: usize) -> bool {
        self.is_solid(world, at, [-FLOOR_M[0], FLOOR_M[1]])
    }

    /// Whether a place has something solid between two heights above the floor.
    fn is_solid(&self, world: &World, at: usize, [low, high]: [f32; 2]) -> bool {
        let middle = self.point(at) + Vec3::Y * (low + high) * 0.5;
        let middle = world.cells.axes.world(middle);
        let half = Vec3::new(self.step, high - low, self.step) * 0.5;
        world.octree.solid_in(&Aabb::new(middle - half, middle + half))
    }

    /// Whether a place has a roof. Quake maps are closed all around, and their skies are not drawn.
    fn is_roofed(&self, world: &World, at: usize) -> bool {
        let foot = world.cells.axes.world(self.point(at));
        let bounds = world.octree.bounds();
        let half = Vec3::new(0.02, 0.0, 0.02);
        let low = foot + Vec3::Y * ROOF_M;
        let column = Aabb::new(low - half, low.with_y(bounds.max.y) + half);
        world.origin.is_some() || world.octree.solid_in(&column)
    }

    /// Keeps areas that are rooms: large enough, under a roof, between walls, and not at the edge
    /// of the plan.
    fn keep_rooms(&mut self, world: &World) {
        let labels =
            self.labels.iter().flatten().map(|label| *label as usize + 1).max().unwrap_or(0);
        let roofed: Vec<bool> = (0..self.labels.len())
            .into_par_iter()
            .map(|at| self.labels[at].is_some() && self.is_roofed(world, at))
            .collect();
        let enclosure = enclosure(&self.walls, self.columns, self.rows);
        let mut sizes = vec![0usize; labels];
        let mut enclosed = vec![0.0; labels];
        let mut roofs = vec![0usize; labels];
        let mut is_outside = vec![false; labels];
        for (at, label) in self.labels.iter().enumerate() {
            let Some(label) = label else { continue };
            let (x, z) = (at % self.columns, at / self.columns);
            sizes[*label as usize] += 1;
            enclosed[*label as usize] += enclosure[at];
            roofs[*label as usize] += usize::from(roofed[at]);
            is_outside[*label as usize] |=
                x == 0 || z == 0 || x + 1 == self.columns || z + 1 == self.rows;
        }
        let enough = (AREA_MIN_M2 / (self.step * self.step)) as usize;
        let mut next = 0;
        let kept: Vec<Label> = (0..labels)
            .map(|label| {
                let is_roofed = roofs[label] * 2 >= sizes[label];
                let is_enclosed = enclosed[label] >= ENCLOSED_MIN * sizes[label] as f32;
                let is_indoors = is_roofed && is_enclosed && !is_outside[label];
                let is_room = is_indoors && sizes[label] >= enough;
                is_room.then(|| {
                    next += 1;
                    next - 1
                })
            })
            .collect();
        self.count = next as usize;
        for label in &mut self.labels {
            *label = label.and_then(|label| kept[label as usize]);
        }
    }

    /// What fills most of the plan under a box in own axes.
    pub(super) fn under(&self, region: &Aabb) -> Ground {
        let range = |min: f32, max: f32, from: f32, count: usize| {
            let at = |x: f32| (((x - from) / self.step).max(0.0) as usize).min(count);
            // The places whose middles are inside, or one place when the box is narrower than a
            // step.
            let (low, high) = (at(min + self.step * 0.5), at(max + self.step * 0.5));
            let middle = at((min + max) * 0.5);
            if low < high { low..high } else { middle..(middle + 1).min(count) }
        };
        let xs = range(region.min.x, region.max.x, self.from.x, self.columns);
        let zs = range(region.min.z, region.max.z, self.from.z, self.rows);
        let mut votes: Vec<(u32, usize)> = Vec::new();
        let (mut all, mut closed) = (0, 0);
        for at in zs.flat_map(|z| xs.clone().map(move |x| z * self.columns + x)) {
            all += 1;
            closed += usize::from(!self.open[at]);
            let Some(label) = self.labels[at] else { continue };
            match votes.iter_mut().find(|(known, _)| *known == label) {
                Some((_, count)) => *count += 1,
                None => votes.push((label, 1)),
            }
        }
        match votes.into_iter().max_by_key(|(_, count)| *count) {
            Some((label, count)) if count * 2 > all => Ground::Area(label),
            _ if closed * 2 >= all => Ground::Closed,
            _ => Ground::Elsewhere,
        }
    }
}

/// The distance of each open place from the nearest closed one, in steps. It is exact (Felzenszwalb
/// and Huttenlocher 2012).
fn distances(open: &[bool], columns: usize, rows: usize) -> Vec<f32> {
    let far = (columns + rows) as f32;
    let mut squares: Vec<f32> =
        open.iter().map(|open| if *open { far * far } else { 0.0 }).collect();
    let mut line = Vec::new();
    for x in 0..columns {
        line.clear();
        line.extend((0..rows).map(|z| squares[z * columns + x]));
        for (z, value) in lower_envelope(&line).into_iter().enumerate() {
            squares[z * columns + x] = value;
        }
    }
    for row in squares.chunks_mut(columns) {
        let found = lower_envelope(row);
        row.copy_from_slice(&found);
    }
    squares.iter().map(|square| square.sqrt()).collect()
}

/// For each place, the least of all values, each plus the square of its distance.
fn lower_envelope(values: &[f32]) -> Vec<f32> {
    let mut roots: Vec<(usize, f32)> = Vec::with_capacity(values.len());
    for (at, value) in values.iter().enumerate() {
        let height = |at: usize, value: f32| value + (at * at) as f32;
        let mut start = f32::NEG_INFINITY;
        while let Some(&(root, since)) = roots.last() {
            start = (height(at, *value) - height(root, values[root])) / (2 * (at - root)) as f32;
            if start > since {
                break;
            }
            roots.pop();
            start = f32::NEG_INFINITY;
        }
        roots.push((at, start));
    }
    let mut current = 0;
    (0..values.len())
        .map(|at| {
            while current + 1 < roots.len() && roots[current + 1].1 < at as f32 {
                current += 1;
            }
            let away = at.abs_diff(roots[current].0);
            values[roots[current].0] + (away * away) as f32
        })
        .collect()
}

/// The area of each open place.
fn watershed(width: &[f32], columns: usize, rows: usize) -> Vec<Label> {
    let mut order: Vec<usize> = (0..width.len()).filter(|at| width[*at] > 0.0).collect();
    order.sort_by(|a, b| width[*b].total_cmp(&width[*a]).then(a.cmp(b)));
    let mut labels: Vec<Label> = vec![None; width.len()];
    let mut basins = Basins::default();
    for at in order {
        let (x, z) = (at % columns, at / columns);
        let beside = [
            (x > 0).then(|| at - 1),
            (x + 1 < columns).then(|| at + 1),
            (z > 0).then(|| at.wrapping_sub(columns)),
            (z + 1 < rows).then(|| at + columns),
        ];
        let mut near: Vec<u32> = beside
            .into_iter()
            .flatten()
            .filter_map(|next| labels[next])
            .map(|label| basins.root(label))
            .collect();
        near.sort_by(|a, b| basins.peak(*b).total_cmp(&basins.peak(*a)).then(a.cmp(b)));
        near.dedup();
        let Some((first, others)) = near.split_first() else {
            labels[at] = Some(basins.add(width[at]));
            continue;
        };
        labels[at] = Some(*first);
        for other in others {
            if width[at] >= NECK * basins.peak(*other) {
                basins.join(*first, *other);
            }
        }
    }
    let root = |label: u32| basins.root(label);
    labels.into_iter().map(|label| label.map(root)).collect()
}

/// Areas that grow and join.
#[derive(Default)]
struct Basins {
    above: Vec<u32>,
    peaks: Vec<f32>,
}

impl Basins {
    fn add(&mut self, peak: f32) -> u32 {
        self.above.push(self.above.len() as u32);
        self.peaks.push(peak);
        self.above.len() as u32 - 1
    }

    fn root(&self, mut at: u32) -> u32 {
        while self.above[at as usize] != at {
            at = self.above[at as usize];
        }
        at
    }

    /// The width of an area where it is widest.
    fn peak(&self, root: u32) -> f32 {
        self.peaks[root as usize]
    }

    /// Joins two areas, of which the first has the higher peak.
    fn join(&mut self, first: u32, other: u32) {
        self.above[other as usize] = first;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_to_the_nearest_closed_place() {
        let (columns, rows) = (23, 17);
        let open: Vec<bool> = (0..columns * rows).map(|i| (i * 7919) % 31 > 1).collect();
        let found = distances(&open, columns, rows);
        for (at, found) in found.into_iter().enumerate() {
            let to = |other: usize| {
                let x = (at % columns).abs_diff(other % columns);
                let z = (at / columns).abs_diff(other / columns);
                ((x * x + z * z) as f32).sqrt()
            };
            let nearest =
                (0..columns * rows).filter(|other| !open[*other]).map(to).fold(f32::MAX, f32::min);
            assert!((found - nearest).abs() < 1e-3, "{at}: {found} {nearest}");
        }
    }

    /// Two rooms and a corridor that bends.
    #[test]
    fn a_neck_divides_and_a_bend_does_not() {
        let plan = [
            "####################",
            "#.......#..........#",
            "#.......#..........#",
            "#.......#..........#",
            "#.......#..........#",
            "#.......#..........#",
            "###..####..........#",
            "#......#####..######",
            "#......#############",
            "#......#############",
            "####################",
        ];
        let open: Vec<bool> = plan.iter().flat_map(|row| row.bytes().map(|b| b == b'.')).collect();
        let (columns, rows) = (20, plan.len());
        let labels = watershed(&distances(&open, columns, rows), columns, rows);
        let at = |x: usize, z: usize| labels[z * columns + x];
        assert!(at(2, 2).is_some() && at(2, 2) == at(7, 5));
        assert_ne!(at(2, 2), at(2, 8));
        assert_ne!(at(2, 2), at(12, 2));
        assert_eq!(at(10, 1), at(18, 5));
        assert_eq!(at(8, 3), None);
    }
}
