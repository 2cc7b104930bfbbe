//! Where a body can walk: a grid over the floors that it can reach, found from the octree alone.

use std::{
    cmp::Reverse,
    collections::{BinaryHeap, HashMap, VecDeque},
};

use glam::Vec3;
use rand::{Rng, rngs::SmallRng};
use sightline_world::{World, geometry::Aabb};

/// Steps are taken to be so much higher than they are, in metres, so that none is a near miss.
const STEP_SLACK: f32 = 0.02;
/// A fall that it takes, in metres.
const DROP: f32 = 4.0;
/// Floors at one place are at least so far apart, in metres: closer ones are the same.
const STOREY: f32 = 1.0;
/// Beside the body there is so much space, in metres, so that it does not scrape along walls.
const CLEARANCE: f32 = 0.04;
/// Half the width of the space in which a roof is looked for, in metres.
const ROOF_PROBE: f32 = 0.05;
/// No grid has more places; each costs about 100 bytes.
const PLACES_MAX: usize = 200_000;
/// A search for a way looks at no more places.
const SEARCH_MAX: usize = 60_000;

/// The places where a body can stand and from which it can come back, and the ways between them.
/// The default has none.
#[derive(Clone, Debug, Default)]
pub struct Navigation {
    /// The distance between neighbouring places, in metres.
    pitch: f32,
    /// From the soles to the eye, in metres.
    eye_height: f32,
    places: Vec<Place>,
    columns: HashMap<[i32; 2], Vec<u32>>,
    /// Those that can all be reached from each other, ascending.
    home: Vec<u32>,
    /// Those of home that are worth going to.
    goals: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Place {
    column: [i32; 2],
    /// The height of the soles, in metres.
    sole: f32,
    /// Where a step east, south, west and north leads to.
    next: [Option<u32>; 4],
}

const DIRECTIONS: [[i32; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

impl Navigation {
    /// Looks at all floors that can be reached from the world's spawn points. Takes a second for a
    /// large building.
    pub fn new(world: &World) -> Self {
        let mut navigation = Self {
            pitch: (world.body.half_width * 1.25).clamp(0.2, 0.3),
            eye_height: world.body.below_eye,
            places: Vec::new(),
            columns: HashMap::new(),
            home: Vec::new(),
            goals: Vec::new(),
        };
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
        while let Some(place) = open.pop_front() {
            let Place { column: [x, z], sole, .. } = navigation.places[place as usize];
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
        navigation.home = navigation.largest_component();
        navigation.goals = navigation.indoors(world);
        navigation
    }

    /// How many places a body can go to and come back from.
    pub fn len(&self) -> usize {
        self.home.len()
    }

    /// Whether a body can go nowhere.
    pub fn is_empty(&self) -> bool {
        self.home.is_empty()
    }

    /// Some place to go to, as an eye; `None` when there is none. It has a roof, where much of the
    /// floor has one: visitors come for the building, not for the lawn.
    pub fn random(&self, random: &mut SmallRng) -> Option<Vec3> {
        if self.goals.is_empty() {
            return None;
        }
        let place = self.goals[random.random_range(0..self.goals.len())];
        Some(self.eye(place))
    }

    /// The places of home that have a roof; all of them when few have.
    fn indoors(&self, world: &World) -> Vec<u32> {
        let top = world.bounds().max.y;
        let has_roof = |&place: &u32| {
            let eye = self.eye(place);
            let above = Vec3::new(eye.x, top, eye.z);
            world.octree.solid_in(&Aabb::new(eye, above).grown(ROOF_PROBE))
        };
        let roofed: Vec<u32> = self.home.iter().copied().filter(has_roof).collect();
        if roofed.len() * 4 < self.home.len() { self.home.clone() } else { roofed }
    }

    /// A short way from one eye to another, as eyes to walk to one after the other in straight
    /// lines. `None` when either is no place to stand or the way is too long to find.
    pub fn path(&self, from: Vec3, to: Vec3) -> Option<Vec<Vec3>> {
        let (from, to) = (self.nearest(from)?, self.nearest(to)?);
        let places = self.search(from, to)?;
        let mut way = Vec::new();
        let mut at = 0;
        while at + 1 < places.len() {
            // As far ahead as a straight line leads.
            let mut far = at + 1;
            while far + 1 < places.len()
                && far < at + 32
                && self.is_straight(places[at], places[far + 1])
            {
                far += 1;
            }
            way.push(self.eye(places[far]));
            at = far;
        }
        Some(way)
    }

    fn column(&self, point: Vec3) -> [i32; 2] {
        [(point.x / self.pitch).round() as i32, (point.z / self.pitch).round() as i32]
    }

    fn point(&self, [x, z]: [i32; 2], sole: f32) -> Vec3 {
        Vec3::new(x as f32 * self.pitch, sole, z as f32 * self.pitch)
    }

    fn eye(&self, place: u32) -> Vec3 {
        let Place { column, sole, .. } = self.places[place as usize];
        self.point(column, sole + self.eye_height)
    }

    fn find(&self, column: [i32; 2], sole: f32) -> Option<u32> {
        let storeys = self.columns.get(&column)?;
        let is_it = |place: &u32| (self.places[*place as usize].sole - sole).abs() < STOREY * 0.5;
        storeys.iter().copied().find(is_it)
    }

    fn add(&mut self, column: [i32; 2], sole: f32) -> Option<u32> {
        if self.places.len() >= PLACES_MAX || self.find(column, sole).is_some() {
            return None;
        }
        let place = self.places.len() as u32;
        self.places.push(Place { column, sole, next: [None; 4] });
        self.columns.entry(column).or_default().push(place);
        Some(place)
    }

    /// The place that an eye is at, or next to.
    fn nearest(&self, eye: Vec3) -> Option<u32> {
        let ([x, z], sole) = (self.column(eye), eye.y - self.eye_height);
        let around = (-2..=2).flat_map(|dx| (-2..=2).map(move |dz| [x + dx, z + dz]));
        around
            .filter_map(|column| self.columns.get(&column))
            .flatten()
            .copied()
            .filter(|place| (self.places[*place as usize].sole - sole).abs() < STOREY)
            .min_by(|a, b| {
                let distance = |place: u32| self.eye(place).distance_squared(eye);
                distance(*a).total_cmp(&distance(*b))
            })
    }

    /// A* (Hart, Nilsson and Raphael 1968), in tenths of a step.
    fn search(&self, from: u32, to: u32) -> Option<Vec<u32>> {
        let goal = self.places[to as usize].column;
        let estimate = |place: u32| {
            let [x, z] = self.places[place as usize].column;
            let (dx, dz) = (x.abs_diff(goal[0]), z.abs_diff(goal[1]));
            10 * (dx + dz) - 6 * dx.min(dz)
        };
        let mut known: HashMap<u32, (u32, u32)> = HashMap::from([(from, (0, from))]);
        let mut open = BinaryHeap::from([Reverse((estimate(from), from))]);
        while let Some(Reverse((_, place))) = open.pop() {
            if place == to {
                return Some(trace(&known, from, to));
            }
            if known.len() > SEARCH_MAX {
                return None;
            }
            let (cost, _) = known[&place];
            for (step, next) in self.steps(place) {
                let cost = cost + step;
                if known.get(&next).is_none_or(|(before, _)| cost < *before) {
                    known.insert(next, (cost, place));
                    open.push(Reverse((cost + estimate(next), next)));
                }
            }
        }
        None
    }

    /// Straight steps, and slanted ones where both ways round the corner lead to the same place.
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

    /// Whether all places under a straight line follow each other and go neither up nor down much.
    fn is_straight(&self, from: u32, to: u32) -> bool {
        let (a, b) = (self.places[from as usize], self.places[to as usize]);
        let way = [b.column[0] - a.column[0], b.column[1] - a.column[1]];
        let parts = 2 * way[0].abs().max(way[1].abs());
        let mut at = a.column;
        let mut place = from;
        for part in 1..=parts {
            let along = |axis: usize| {
                let exact = way[axis] as f32 * part as f32 / parts as f32;
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
            if (self.places[found as usize].sole - self.places[place as usize].sole).abs() > 0.1 {
                return false;
            }
            (at, place) = (next, found);
        }
        place == to
    }

    fn side(&self, place: u32, step: [i32; 2]) -> Option<u32> {
        let side = DIRECTIONS.iter().position(|direction| *direction == step)?;
        self.places[place as usize].next[side]
    }

    /// The largest set of places that can all be reached from each other: what can be reached from
    /// a place and leads back to it, for the place with the largest such set among the first few.
    fn largest_component(&self) -> Vec<u32> {
        let mut back: Vec<Vec<u32>> = vec![Vec::new(); self.places.len()];
        for (place, from) in self.places.iter().zip(0u32..) {
            place.next.iter().flatten().for_each(|to| back[*to as usize].push(from));
        }
        let mut seen = vec![false; self.places.len()];
        let mut largest = Vec::new();
        // Spawn points come first, so that a few tries find all but pits.
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

/// Which places can be reached from one.
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

fn trace(known: &HashMap<u32, (u32, u32)>, from: u32, to: u32) -> Vec<u32> {
    let mut way = vec![to];
    let mut at = to;
    while at != from {
        at = known[&at].1;
        way.push(at);
    }
    way.reverse();
    way
}

/// Feels for floors.
struct Probe<'a> {
    world: &'a World,
    half_width: f32,
    height: f32,
    step_up: f32,
}

impl<'a> Probe<'a> {
    fn new(world: &'a World) -> Self {
        let body = world.body;
        let half_width = body.half_width + CLEARANCE;
        let step_up = body.step_height() - STEP_SLACK;
        Self { world, half_width, height: body.below_eye + body.above_eye, step_up }
    }

    /// Whether the body's box between two heights above a point is inside the building and free.
    fn is_free(&self, point: Vec3, from: f32, to: f32) -> bool {
        let region = self.region(point, from, to);
        self.world.confines().contains_box(&region) && !self.world.octree.solid_in(&region)
    }

    fn region(&self, point: Vec3, from: f32, to: f32) -> Aabb {
        let side = Vec3::new(self.half_width, 0.0, self.half_width);
        let (low, high) = (point.with_y(point.y + from), point.with_y(point.y + to));
        Aabb::new(low - side, high + side)
    }

    /// The floor under a body in the air: how high its soles are when it has fallen, if it fits
    /// and does not fall too deep.
    fn land(&self, sole: Vec3) -> Option<f32> {
        if !self.is_free(sole, 0.0, self.height) {
            // The place may be a little too low.
            return (self.is_free(sole, self.step_up, self.step_up + self.height))
                .then(|| self.fall(sole + Vec3::Y * self.step_up))?;
        }
        self.fall(sole)
    }

    fn fall(&self, sole: Vec3) -> Option<f32> {
        let is_solid = |depth: f32| self.world.octree.solid_in(&self.region(sole, -depth, 0.0));
        let deepest = DROP + self.step_up;
        if !is_solid(deepest) {
            return None;
        }
        let (mut free, mut solid) = (0.0, deepest);
        while solid - free > 0.01 {
            let middle = 0.5 * (free + solid);
            if is_solid(middle) { solid = middle } else { free = middle }
        }
        Some(sole.y - free)
    }

    /// The height of the soles after a step to a neighbouring place.
    fn step(&self, from: Vec3, to: Vec3) -> Option<f32> {
        // Where the way is free at the height at which the body stands, it does not climb.
        let lift = 0.02;
        if self.is_free(to, lift, lift + self.height) {
            return self.fall(to + Vec3::Y * lift);
        }
        let (up, over) = (from + Vec3::Y * self.step_up, to + Vec3::Y * self.step_up);
        (self.is_free(up, 0.0, self.height) && self.is_free(over, 0.0, self.height))
            .then(|| self.fall(over))?
    }
}

#[cfg(test)]
mod tests;
