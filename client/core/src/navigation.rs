//! Navigation: where a body can walk, as a grid over the floors that it can reach. The grid is
//! found from the octree alone.

use std::{
    cmp::Reverse,
    collections::{BinaryHeap, HashMap, VecDeque},
};

use glam::Vec3;
use rand::{Rng, rngs::SmallRng};
use sightline_world::{World, geometry::Aabb};

/// Steps count as this much higher than they are, in metres, so that no path depends on a near
/// miss.
const STEP_SLACK_M: f32 = 0.02;
/// A body that steps to a place on its own level is lifted by this much, in metres, so that it does
/// not scrape along the floor.
const LIFT_M: f32 = 0.02;
/// The deepest fall on a path, in metres.
const DROP_M: f32 = 4.0;
/// The height of a fall is found to this precision, in metres.
const FALL_PRECISION_M: f32 = 0.01;
/// The depth of a fall that is tried first, in metres.
const SHALLOW_M: f32 = 2.0 * LIFT_M;
/// Floors in one column are at least this far apart, in metres. Closer ones count as one.
const STOREY_M: f32 = 1.0;
/// The free space beside a body, in metres, so that it does not scrape along walls.
const CLEARANCE_M: f32 = 0.04;
/// Half the width of the column in which a roof is searched for, in metres.
const ROOF_PROBE_M: f32 = 0.05;
/// Places on a straight part of a path differ in height by no more than this, in metres.
const LEVEL_M: f32 = 0.1;
/// The largest number of places of a grid. Each takes about 100 bytes.
const PLACES_MAX: usize = 400_000;
/// The distance between neighbouring places, as a share of the half width of a body: that of a fine
/// grid, and of the coarse one that a large building gets. Bodies at neighbouring places of the
/// coarse one still touch, so no wall is between them.
const SPACINGS: [f32; 2] = [1.25, 2.0];
/// The largest number of places of a fine grid.
const FINE_PLACES_MAX: usize = 100_000;
/// The largest number of places that the search for a path visits.
const SEARCH_MAX: usize = 60_000;

/// The places where a body can stand and from which it can come back, and the paths between them.
/// The default has no places.
#[derive(Clone, Debug, Default)]
pub struct Navigation {
    /// The distance between neighbouring places, in metres.
    spacing_m: f32,
    /// The height of the eye above the soles, in metres.
    eye_height: f32,
    places: Vec<FloorPlace>,
    /// The places of each column of the grid.
    columns: HashMap<[i32; 2], Vec<u32>>,
    /// The indices of the places that can all be reached from each other, in ascending order.
    connected: Vec<u32>,
    /// The places of `connected` that are worth going to.
    goals: Vec<u32>,
}

/// A place on a floor where a body can stand.
#[derive(Clone, Copy, Debug)]
struct FloorPlace {
    column: [i32; 2],
    /// The height of the soles of a body that stands there, in metres.
    sole: f32,
    /// The places that a step east, south, west and north leads to.
    next: [Option<u32>; 4],
}

const DIRECTIONS: [[i32; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

impl Navigation {
    /// Finds all places that can be reached from the world's spawn points. This takes seconds for a
    /// large building, whose grid is coarser.
    pub fn new(world: &World) -> Self {
        let [fine, coarse] = SPACINGS.map(|spacing_m| (spacing_m * world.body.half_width).max(0.2));
        let navigation = Self::grid(world, fine.min(0.3), FINE_PLACES_MAX);
        let is_whole = navigation.places.len() < FINE_PLACES_MAX;
        let mut navigation =
            if is_whole { navigation } else { Self::grid(world, coarse, PLACES_MAX) };
        navigation.connected = navigation.largest_component();
        debug_assert!(navigation.connected.is_sorted(), "the places of connected ascend");
        navigation.goals = navigation.indoors(world);
        navigation
    }

    /// A grid of this distance between neighbouring places, and of this number of places at most.
    fn grid(world: &World, spacing_m: f32, places_max: usize) -> Self {
        let mut navigation =
            Self { spacing_m, eye_height: world.body.below_eye, ..Self::default() };
        let probe = Probe::new(world);
        let mut open = VecDeque::new();
        for spawn in &world.spawns {
            let ([x, z], sole) = (navigation.column(spawn.eye), spawn.eye.y - world.body.below_eye);
            let around = [[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, -1]];
            let found = around.into_iter().find_map(|[dx, dz]| {
                let column = [x + dx, z + dz];
                Some((column, probe.land(navigation.point(column, sole))?))
            });
            open.extend(found.and_then(|(column, sole)| navigation.add(column, sole)));
        }
        while let Some(place) = open.pop_front()
            && navigation.places.len() < places_max
        {
            let FloorPlace { column: [x, z], sole, .. } = navigation.places[place as usize];
            for (side, [dx, dz]) in DIRECTIONS.into_iter().enumerate() {
                let column = [x + dx, z + dz];
                let from = navigation.point([x, z], sole);
                let Some(sole) = probe.step(from, navigation.point(column, sole)) else { continue };
                let known = navigation.find(column, sole);
                let added = known.or_else(|| navigation.add(column, sole));
                navigation.places[place as usize].next[side] = added;
                if known.is_none() {
                    open.extend(added);
                }
            }
        }
        navigation
    }

    /// The number of places that a body can go to and come back from.
    pub fn len(&self) -> usize {
        self.connected.len()
    }

    /// Whether there are no places.
    pub fn is_empty(&self) -> bool {
        self.connected.is_empty()
    }

    /// A random place to go to, as an eye; `None` when there is none. Where much of the floor has a
    /// roof, so has the place: visitors come for the building and not for the lawn.
    pub fn random(&self, random: &mut SmallRng) -> Option<Vec3> {
        if self.goals.is_empty() {
            return None;
        }
        let place = self.goals[random.random_range(0..self.goals.len())];
        Some(self.eye(place))
    }

    /// The places of `connected` that have a roof; all places of `connected` when few have one.
    fn indoors(&self, world: &World) -> Vec<u32> {
        let top = world.bounds().max.y;
        let has_roof = |&place: &u32| {
            let eye = self.eye(place);
            let above = Vec3::new(eye.x, top, eye.z);
            world.octree.solid_in(&Aabb::new(eye, above).grown(ROOF_PROBE_M))
        };
        let roofed: Vec<u32> = self.connected.iter().copied().filter(has_roof).collect();
        if roofed.len() * 4 < self.connected.len() { self.connected.clone() } else { roofed }
    }

    /// A short path from one eye to another, as eyes to walk to in straight lines, one after the
    /// other. `None` when no place is near one of the two, or the path is too long to find.
    pub fn path(&self, from: Vec3, to: Vec3) -> Option<Vec<Vec3>> {
        let (from, to) = (self.nearest(from)?, self.nearest(to)?);
        let places = self.search(from, to)?;
        let mut path = Vec::new();
        let mut at = 0;
        while at + 1 < places.len() {
            // The next eye is as far ahead as a straight line leads.
            let mut far = at + 1;
            while far + 1 < places.len()
                && far < at + 32
                && self.is_straight(places[at], places[far + 1])
            {
                far += 1;
            }
            path.push(self.eye(places[far]));
            at = far;
        }
        Some(path)
    }

    /// The column of the grid that a point is in.
    fn column(&self, point: Vec3) -> [i32; 2] {
        [(point.x / self.spacing_m).round() as i32, (point.z / self.spacing_m).round() as i32]
    }

    /// The point in the middle of a column, at the height of the soles.
    fn point(&self, [x, z]: [i32; 2], sole: f32) -> Vec3 {
        Vec3::new(x as f32 * self.spacing_m, sole, z as f32 * self.spacing_m)
    }

    /// The eye of a body that stands at a place.
    fn eye(&self, place: u32) -> Vec3 {
        let FloorPlace { column, sole, .. } = self.places[place as usize];
        self.point(column, sole + self.eye_height)
    }

    /// The place of a column at this height, if it is known.
    fn find(&self, column: [i32; 2], sole: f32) -> Option<u32> {
        let storeys = self.columns.get(&column)?;
        let is_it = |place: &u32| (self.places[*place as usize].sole - sole).abs() < STOREY_M * 0.5;
        storeys.iter().copied().find(is_it)
    }

    /// Adds a place. Returns its index, or `None` when it is known.
    fn add(&mut self, column: [i32; 2], sole: f32) -> Option<u32> {
        if self.find(column, sole).is_some() {
            return None;
        }
        let place = self.places.len() as u32;
        self.places.push(FloorPlace { column, sole, next: [None; 4] });
        self.columns.entry(column).or_default().push(place);
        Some(place)
    }

    /// The place nearest to an eye, within two columns and one storey.
    fn nearest(&self, eye: Vec3) -> Option<u32> {
        let ([x, z], sole) = (self.column(eye), eye.y - self.eye_height);
        let around = (-2..=2).flat_map(|dx| (-2..=2).map(move |dz| [x + dx, z + dz]));
        around
            .filter_map(|column| self.columns.get(&column))
            .flatten()
            .copied()
            .filter(|place| (self.places[*place as usize].sole - sole).abs() < STOREY_M)
            .min_by(|a, b| {
                let distance = |place: u32| self.eye(place).distance_squared(eye);
                distance(*a).total_cmp(&distance(*b))
            })
    }

    /// The shortest path from one place to another by A* (Hart, Nilsson and Raphael 1968). Costs
    /// are in tenths of a step.
    fn search(&self, from: u32, to: u32) -> Option<Vec<u32>> {
        let goal = self.places[to as usize].column;
        let estimate = |place: u32| {
            let [x, z] = self.places[place as usize].column;
            let (dx, dz) = (x.abs_diff(goal[0]), z.abs_diff(goal[1]));
            10 * (dx + dz) - 6 * dx.min(dz)
        };
        // The pages of places that the search does not reach are never touched.
        let mut costs = vec![0u32; self.places.len()];
        // One more than the place before; zero when the search has not been there.
        let mut before = vec![0u32; self.places.len()];
        before[from as usize] = from + 1;
        // Of equal estimates the one nearer to the goal comes first.
        let mut open = BinaryHeap::from([(Reverse(estimate(from)), 0, from)]);
        let mut visited = 0;
        while let Some((_, cost, place)) = open.pop() {
            if place == to {
                return Some(trace_back(&before, from, to));
            }
            if cost > costs[place as usize] {
                continue;
            }
            visited += 1;
            if visited > SEARCH_MAX {
                return None;
            }
            for (step, next) in self.steps(place) {
                let cost = cost + step;
                let known = next as usize;
                if before[known] == 0 || cost < costs[known] {
                    (costs[known], before[known]) = (cost, place + 1);
                    open.push((Reverse(cost + estimate(next)), cost, next));
                }
            }
        }
        None
    }

    /// The steps from a place, with their costs: straight ones, and diagonal ones where both ways
    /// round the corner lead to the same place.
    fn steps(&self, place: u32) -> impl Iterator<Item = (u32, u32)> + '_ {
        let step = move |from: u32, side: usize| self.places[from as usize].next[side];
        let straight = (0..4).filter_map(move |side| Some((10, step(place, side)?)));
        let slanted = (0..4).filter_map(move |side| {
            let other = (side + 1) % 4;
            let there = step(step(place, side)?, other)?;
            (Some(there) == step(step(place, other)?, side)).then_some((14, there))
        });
        straight.chain(slanted)
    }

    /// Whether the places under a straight line between two places follow each other on nearly one
    /// level.
    fn is_straight(&self, from: u32, to: u32) -> bool {
        let (a, b) = (self.places[from as usize], self.places[to as usize]);
        let offset = [b.column[0] - a.column[0], b.column[1] - a.column[1]];
        let parts = 2 * offset[0].abs().max(offset[1].abs());
        let mut at = a.column;
        let mut place = from;
        for part in 1..=parts {
            let along = |axis: usize| {
                let exact = offset[axis] as f32 * part as f32 / parts as f32;
                a.column[axis] + exact.round() as i32
            };
            let next = [along(0), along(1)];
            let step = [next[0] - at[0], next[1] - at[1]];
            let found = match step {
                [0, 0] => continue,
                [dx, dz] if dx == 0 || dz == 0 => self.side(place, [dx, dz]),
                [dx, dz] => {
                    let one = self.side(place, [dx, 0]).and_then(|p| self.side(p, [0, dz]));
                    let other = self.side(place, [0, dz]).and_then(|p| self.side(p, [dx, 0]));
                    one.filter(|place| Some(*place) == other)
                }
            };
            let Some(found) = found else { return false };
            if (self.places[found as usize].sole - self.places[place as usize].sole).abs() > LEVEL_M
            {
                return false;
            }
            (at, place) = (next, found);
        }
        place == to
    }

    /// The place that a straight step leads to.
    fn side(&self, place: u32, step: [i32; 2]) -> Option<u32> {
        let side = DIRECTIONS.iter().position(|direction| *direction == step)?;
        self.places[place as usize].next[side]
    }

    /// The largest strongly connected set of places: all that can be reached from some place and
    /// lead back to it. Only a few places are tried.
    fn largest_component(&self) -> Vec<u32> {
        let mut back: Vec<Vec<u32>> = vec![Vec::new(); self.places.len()];
        for (place, from) in self.places.iter().zip(0u32..) {
            place.next.iter().flatten().for_each(|to| back[*to as usize].push(from));
        }
        let mut seen = vec![false; self.places.len()];
        let mut largest = Vec::new();
        // Places at spawn points come first, so a few tries are enough: the rest are pits.
        for _ in 0..8 {
            let Some(seed) = seen.iter().position(|seen| !seen) else { break };
            let forth = flood(seed as u32, self.places.len(), |place| {
                self.places[place as usize].next.iter().flatten().copied().collect()
            });
            let back = flood(seed as u32, self.places.len(), |place| back[place as usize].clone());
            let both: Vec<u32> = (0..self.places.len() as u32)
                .filter(|place| forth[*place as usize] && back[*place as usize])
                .collect();
            both.iter().for_each(|place| seen[*place as usize] = true);
            if both.len() > largest.len() {
                largest = both;
            }
        }
        largest
    }
}

/// Which places can be reached from a seed.
fn flood(seed: u32, places: usize, next: impl Fn(u32) -> Vec<u32>) -> Vec<bool> {
    let mut reached = vec![false; places];
    reached[seed as usize] = true;
    let mut open = vec![seed];
    while let Some(place) = open.pop() {
        for next in next(place) {
            if !std::mem::replace(&mut reached[next as usize], true) {
                open.push(next);
            }
        }
    }
    reached
}

/// The path that a search found. `before` has one more than the place before each.
fn trace_back(before: &[u32], from: u32, to: u32) -> Vec<u32> {
    let mut path = vec![to];
    let mut at = to;
    while at != from {
        at = before[at as usize] - 1;
        path.push(at);
    }
    path.reverse();
    path
}

/// Finds floors by testing boxes against the octree.
struct Probe<'a> {
    world: &'a World,
    half_width: f32,
    height: f32,
    step_up: f32,
}

impl<'a> Probe<'a> {
    fn new(world: &'a World) -> Self {
        let body = world.body;
        let half_width = body.half_width + CLEARANCE_M;
        let step_up = body.step_height() - STEP_SLACK_M;
        Self { world, half_width, height: body.below_eye + body.above_eye, step_up }
    }

    /// Whether the part of a body between two heights above a point is inside the building and
    /// free.
    fn is_free(&self, point: Vec3, from: f32, to: f32) -> bool {
        let region = self.region(point, from, to);
        self.world.confines().contains_box(&region) && !self.world.octree.solid_in(&region)
    }

    /// The box of the part of a body between two heights above a point.
    fn region(&self, point: Vec3, from: f32, to: f32) -> Aabb {
        let side = Vec3::new(self.half_width, 0.0, self.half_width);
        let (low, high) = (point.with_y(point.y + from), point.with_y(point.y + to));
        Aabb::new(low - side, high + side)
    }

    /// The height of the soles of a body after it has fallen from a point. `None` when it does not
    /// fit there or falls too deep.
    fn land(&self, sole: Vec3) -> Option<f32> {
        if !self.is_free(sole, 0.0, self.height) {
            // The point may be slightly too low.
            return (self.is_free(sole, self.step_up, self.step_up + self.height))
                .then(|| self.fall(sole + Vec3::Y * self.step_up))?;
        }
        self.fall(sole)
    }

    /// The height of the soles after a fall from a free point; `None` when it is deeper than
    /// [`DROP_M`].
    fn fall(&self, sole: Vec3) -> Option<f32> {
        let is_solid = |depth: f32| self.world.octree.solid_in(&self.region(sole, -depth, 0.0));
        let deepest = DROP_M + self.step_up;
        // Mostly the floor is just below.
        let [mut free, mut solid] = if is_solid(SHALLOW_M) {
            [0.0, SHALLOW_M]
        } else if is_solid(deepest) {
            [SHALLOW_M, deepest]
        } else {
            return None;
        };
        while solid - free > FALL_PRECISION_M {
            let middle = 0.5 * (free + solid);
            if is_solid(middle) { solid = middle } else { free = middle }
        }
        Some(sole.y - free)
    }

    /// The height of the soles after a step to a neighbouring point; `None` when there is no way.
    fn step(&self, from: Vec3, to: Vec3) -> Option<f32> {
        // Where there is room on the body's own level, it does not climb.
        if self.is_free(to, LIFT_M, LIFT_M + self.height) {
            return self.fall(to + Vec3::Y * LIFT_M);
        }
        let (up, over) = (from + Vec3::Y * self.step_up, to + Vec3::Y * self.step_up);
        (self.is_free(up, 0.0, self.height) && self.is_free(over, 0.0, self.height))
            .then(|| self.fall(over))?
    }
}

#[cfg(test)]
mod tests;
