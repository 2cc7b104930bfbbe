//! Floors: where a body can stand, and which of these places it can walk between.
//!
//! The building is probed in columns, as wide as a body, on a grid. Each stretch of a column in
//! which a body fits above something solid is a *place*. Places of neighbouring columns are joined
//! when a body can step from one to the other and back. Joined places make an *area*.

use std::{
    collections::HashMap,
    ops::{ControlFlow, Range},
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use glam::Vec3;
use rayon::prelude::*;
use sightline_world::{World, geometry::Aabb, motion::Body};

/// The free space beside a body, in metres, so that it does not scrape along walls.
const BESIDE_M: f32 = 0.03;
/// Steps count as this much higher than they are, in metres, so that no way depends on a near miss.
const STEP_SLACK_M: f32 = 0.02;
/// Heights of floors and ceilings are found to this precision, in metres.
const PRECISION_M: f32 = 0.01;
/// Higher ceilings are not found exactly, in metres.
const HEADROOM_M: f32 = 2.5;
/// How many columns make one side of a block. What is free in a whole block is tested once.
const BLOCK: u32 = 8;
/// The most columns. Larger buildings are probed on a coarser grid.
const COLUMNS_MAX: f32 = 1.0e6;
/// The most probes of all columns, before they are made: tall buildings get a coarser grid too.
const PROBES_MAX: f32 = 64.0e6;

/// A place where a body can stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    /// The column, as an index into the grid.
    pub(super) column: u32,
    /// The height of the soles, in metres.
    pub(super) sole: f32,
    /// How high the column is free above the soles, in metres. Infinite under the open sky.
    pub(super) headroom: f32,
    /// The area that the place belongs to.
    pub(super) area: u32,
}

/// All places of a building, and the areas that they make.
pub(super) struct Floors {
    min: Vec3,
    /// The distance between neighbouring columns, in metres.
    pitch: f32,
    /// How many columns there are along x and along z.
    size: [u32; 2],
    /// The places, column by column, in each from the lowest to the highest.
    pub(super) places: Vec<Place>,
    /// The range of places of each column.
    starts: Vec<u32>,
    body: Body,
}

impl Floors {
    /// Finds all places in the box around what is drawn. `None` when `progress` breaks.
    pub(super) fn find(
        world: &World,
        drawn: &Aabb,
        progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
    ) -> Option<Self> {
        let prober = Prober::new(world, drawn);
        let pitch = pitch(&world.body, drawn, prober.step);
        let count = |size: f32| (size / pitch).floor().max(0.0) as u32 + 1;
        let size = [count(drawn.size().x), count(drawn.size().z)];
        let mut floors = Self {
            min: drawn.min,
            pitch,
            size,
            places: Vec::new(),
            starts: vec![0],
            body: world.body,
        };
        let (blocks, done) = (size.map(|count| count.div_ceil(BLOCK)), AtomicU32::new(0));
        let found: Option<Vec<Vec<Place>>> = (0..blocks[0] * blocks[1])
            .into_par_iter()
            .map(|block| {
                let share = done.fetch_add(1, Relaxed) as f32 / (blocks[0] * blocks[1]) as f32;
                let [x, z] = [block % blocks[0], block / blocks[0]].map(|index| index * BLOCK);
                progress(share).is_continue().then(|| floors.block(&prober, x, z))
            })
            .collect();
        floors.places = found?.into_iter().flatten().collect();
        // Stable, so that the places of a column stay in order.
        floors.places.sort_by_key(|place| place.column);
        let mut at = 0;
        for column in 0..size[0] * size[1] {
            at += floors.places[at..].iter().take_while(|place| place.column == column).count();
            floors.starts.push(at as u32);
        }
        floors.join(&prober);
        Some(floors)
    }

    /// The eye of a body that stands at a place.
    pub(super) fn eye(&self, place: &Place) -> Vec3 {
        self.at(place.column).with_y(place.sole + self.body.below_eye)
    }

    /// The area of floor that a place stands for, in square metres.
    pub(super) fn place_m2(&self) -> f32 {
        self.pitch * self.pitch
    }

    /// The number of areas.
    pub(super) fn area_count(&self) -> usize {
        self.places.iter().map(|place| place.area as usize + 1).max().unwrap_or(0)
    }

    /// The places of a place's own column.
    pub(super) fn column_of(&self, place: &Place) -> &[Place] {
        &self.places[self.range(place.column)]
    }

    /// The share of the disc about a place, of a radius in metres, that is floor of the same area
    /// and on the same level.
    pub(super) fn level_share(&self, place: &Place, radius: f32) -> f32 {
        const LEVEL_M: f32 = 0.08;
        let reach = (radius / self.pitch) as i32;
        let [x, z] = self.coordinates(place.column);
        let (mut all, mut level) = (0, 0);
        for (dx, dz) in (-reach..=reach).flat_map(|dx| (-reach..=reach).map(move |dz| (dx, dz))) {
            if dx * dx + dz * dz > reach * reach {
                continue;
            }
            all += 1;
            let Some(column) = self.column(x as i32 + dx, z as i32 + dz) else { continue };
            let same = |other: &&Place| {
                other.area == place.area && (other.sole - place.sole).abs() <= LEVEL_M
            };
            level += usize::from(self.places[self.range(column)].iter().any(|p| same(&p)));
        }
        level as f32 / all as f32
    }

    /// The place nearest to an eye, within a distance in metres.
    pub(super) fn nearest(&self, eye: Vec3, within: f32) -> Option<&Place> {
        let away = |place: &&Place| self.eye(place).distance_squared(eye);
        let found = self.places.iter().min_by(|a, b| away(a).total_cmp(&away(b)))?;
        (away(&found) <= within * within).then_some(found)
    }

    /// The middle of a column, at height 0.
    fn at(&self, column: u32) -> Vec3 {
        let [x, z] = self.coordinates(column).map(|index| index as f32 * self.pitch);
        Vec3::new(self.min.x + x, 0.0, self.min.z + z)
    }

    fn coordinates(&self, column: u32) -> [u32; 2] {
        [column % self.size[0], column / self.size[0]]
    }

    fn column(&self, x: i32, z: i32) -> Option<u32> {
        let [x, z] = [u32::try_from(x).ok()?, u32::try_from(z).ok()?];
        (x < self.size[0] && z < self.size[1]).then_some(z * self.size[0] + x)
    }

    fn range(&self, column: u32) -> Range<usize> {
        let column = column as usize;
        self.starts[column] as usize..self.starts[column + 1] as usize
    }

    /// The places of a block of columns.
    fn block(&self, prober: &Prober<'_>, x: u32, z: u32) -> Vec<Place> {
        let [x_end, z_end] =
            [(x, self.size[0]), (z, self.size[1])].map(|(start, size)| (start + BLOCK).min(size));
        let column = |x, z| z * self.size[0] + x;
        let corners = [column(x, z), column(x_end - 1, z_end - 1)].map(|column| self.at(column));
        let is_free = prober.free_steps(corners);
        if is_free.iter().all(|&free| free) {
            return Vec::new();
        }
        let columns = (z..z_end).flat_map(|z| (x..x_end).map(move |x| column(x, z)));
        columns.flat_map(|column| prober.places(column, self.at(column), &is_free)).collect()
    }

    /// Joins places into areas, and numbers the areas.
    fn join(&mut self, prober: &Prober<'_>) {
        let links: Vec<Vec<[u32; 2]>> = (0..self.size[1])
            .into_par_iter()
            .map(|z| {
                let mut links = Vec::new();
                for x in 0..self.size[0] {
                    for (x1, z1) in [(x + 1, z), (x, z + 1)] {
                        let Some(beside) = self.column(x1 as i32, z1 as i32) else { continue };
                        self.links(prober, z * self.size[0] + x, beside, &mut links);
                    }
                }
                links
            })
            .collect();
        let mut sets = Sets::new(self.places.len());
        for [a, b] in links.into_iter().flatten() {
            sets.join(a, b);
        }
        let mut numbers = HashMap::new();
        for index in 0..self.places.len() {
            let next = numbers.len() as u32;
            self.places[index].area = *numbers.entry(sets.root(index as u32)).or_insert(next);
        }
    }

    /// Appends the pairs of places of two neighbouring columns that a body can walk between.
    fn links(&self, prober: &Prober<'_>, one: u32, other: u32, links: &mut Vec<[u32; 2]>) {
        for a in self.range(one) {
            for b in self.range(other) {
                let [from, to] = [a, b].map(|place| &self.places[place]);
                if (from.sole - to.sole).abs() > prober.step_up {
                    continue;
                }
                let sole = from.sole.max(to.sole);
                let top = (from.sole + from.headroom).min(to.sole + to.headroom);
                let is_wide = self.pitch <= 2.0 * prober.half_width;
                let passes = || prober.is_free_between(self.at(one), self.at(other), sole);
                if top - sole >= prober.height && (is_wide || passes()) {
                    links.push([a as u32, b as u32]);
                }
            }
        }
    }
}

/// Tests boxes as wide as a body against the octree.
struct Prober<'a> {
    world: &'a World,
    half_width: f32,
    height: f32,
    step_up: f32,
    /// Each place is free for at least one whole step of this height, in metres.
    step: f32,
    /// The heights between which columns are probed.
    heights: Range<f32>,
}

impl<'a> Prober<'a> {
    fn new(world: &'a World, drawn: &Aabb) -> Self {
        let body = &world.body;
        let height = body.above_eye + body.below_eye;
        let top = drawn.max.y + height + world.octree.voxel();
        Self {
            world,
            half_width: body.half_width + BESIDE_M,
            height,
            step_up: body.step_height() - STEP_SLACK_M,
            step: 0.45 * height,
            heights: drawn.min.y - world.octree.voxel()..top,
        }
    }

    fn is_free(&self, at: Vec3, low: f32, high: f32) -> bool {
        !self.world.octree.solid_in(&self.region(at, at, low, high))
    }

    /// Whether a body that stands at a height is free on its way between two columns.
    fn is_free_between(&self, from: Vec3, to: Vec3, sole: f32) -> bool {
        let region = self.region(from, to, sole + PRECISION_M, sole + self.height);
        !self.world.octree.solid_in(&region)
    }

    fn region(&self, from: Vec3, to: Vec3, low: f32, high: f32) -> Aabb {
        let aside = Vec3::new(self.half_width, 0.0, self.half_width);
        let (min, max) = (from.min(to) - aside, from.max(to) + aside);
        Aabb::new(min.with_y(low), max.with_y(high))
    }

    /// The height at which a step begins.
    fn level(&self, step: usize) -> f32 {
        self.heights.start + step as f32 * self.step
    }

    /// Which steps are free in all columns between two.
    fn free_steps(&self, [from, to]: [Vec3; 2]) -> Vec<bool> {
        let steps = ((self.heights.end - self.heights.start) / self.step).ceil() as usize;
        let region = |step| self.region(from, to, self.level(step), self.level(step + 1));
        (0..steps).map(|step| !self.world.octree.solid_in(&region(step))).collect()
    }

    /// The places of a column, from the lowest to the highest. Some steps are known to be free.
    fn places(&self, column: u32, at: Vec3, known_free: &[bool]) -> Vec<Place> {
        let mut places = Vec::new();
        let steps = known_free.len();
        let level = |step| self.level(step);
        let mut from = None;
        // The end of the column closes what is free there.
        for (step, known) in known_free.iter().map(Some).chain([None]).enumerate() {
            let is_free = || self.is_free(at, level(step), level(step + 1));
            let is_free = known.is_some_and(|&known| known || is_free());
            match (from, is_free) {
                (None, true) => from = Some(step),
                (Some(first), false) => {
                    from = None;
                    // What is free down to the lowest height has no floor.
                    if first > 0 {
                        let sole = self.lowest(at, level(first));
                        let headroom = self.headroom(at, sole, step, steps);
                        if headroom >= self.height {
                            places.push(Place { column, sole, headroom, area: 0 });
                        }
                    }
                }
                _ => {}
            }
        }
        places.retain(|place| self.is_in_building(at.with_y(place.sole)));
        places
    }

    /// How far down from a height the column is free, within one step.
    fn lowest(&self, at: Vec3, from: f32) -> f32 {
        let (mut free, mut solid) = (from, from - self.step);
        while free - solid > PRECISION_M {
            let middle = free.midpoint(solid);
            *if self.is_free(at, middle, from) { &mut free } else { &mut solid } = middle;
        }
        free
    }

    /// How high a column is free above the soles, up to a step that is not. Exact only where it is
    /// low.
    fn headroom(&self, at: Vec3, sole: f32, step: usize, steps: usize) -> f32 {
        if step == steps {
            return f32::INFINITY;
        }
        let from = self.level(step);
        if from - sole >= HEADROOM_M {
            return from - sole;
        }
        let (mut free, mut solid) = (from, from + self.step);
        while solid - free > PRECISION_M {
            let middle = free.midpoint(solid);
            *if self.is_free(at, from, middle) { &mut free } else { &mut solid } = middle;
        }
        free - sole
    }

    /// Whether the eye of a body that stands at a point is in a cell.
    fn is_in_building(&self, sole: Vec3) -> bool {
        let eye = sole + Vec3::Y * self.world.body.below_eye;
        let confines = self.world.confines();
        confines.contains(eye) && crate::storeys::cell_at(self.world, eye).is_some()
    }
}

/// The distance between columns: half a body or more, and less than a doorway.
fn pitch(body: &Body, drawn: &Aabb, step: f32) -> f32 {
    let size = drawn.size();
    let ground = size.x * size.z;
    let least = (body.half_width * 1.25).clamp(0.1, 0.4);
    let for_columns = (ground / COLUMNS_MAX).sqrt();
    let for_probes = (ground * (size.y / step).max(1.0) / PROBES_MAX).sqrt();
    least.max(for_columns).max(for_probes)
}

/// Disjoint sets (Tarjan 1975), with path halving.
struct Sets(Vec<u32>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn root(&mut self, mut item: u32) -> u32 {
        while self.0[item as usize] != item {
            let above = self.0[self.0[item as usize] as usize];
            self.0[item as usize] = above;
            item = above;
        }
        item
    }

    /// The lesser root stays one, so that the result does not depend on the order of joins.
    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
