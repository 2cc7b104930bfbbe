//! Random walkers in random worlds, against a reference model that tests all pairs and all cells.

use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};

use glam::Vec3;
use proptest::prelude::*;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_world::{
    CellId, Node, Polygon, World,
    geometry::Aabb,
    motion::{AvatarId, Pose, ReportingState, Tbv},
};

use super::stage::{Client, Stage, TICK, world};
use crate::{Config, Input, Margin, Validity, bit_set::BitSet, claims::Clearance};

const MARGIN: Duration = Duration::from_millis(25);

/// The random world of a seed.
pub(super) fn world_of(seed: u64) -> World {
    random_world(&mut SmallRng::seed_from_u64(seed))
}

/// A box cut at random. Some cells that touch see each other, and a few others do.
fn random_world(rng: &mut SmallRng) -> World {
    let all = Aabb::new(Vec3::ZERO, Vec3::new(120.0, 6.0, 120.0));
    let (mut tree, mut bounds) = (Vec::new(), Vec::new());
    let depth = rng.random_range(5..9);
    cut(rng, &mut tree, &mut bounds, all, depth);
    let far = rng.random_range(0.0..0.003);
    let draws: Vec<f32> = (0..bounds.len().pow(2)).map(|_| rng.random()).collect();
    let copy = bounds.clone();
    let mut made = world(tree, bounds, |a, b| {
        let (a, b) = (a as usize, b as usize);
        copy[a].intersects(&copy[b]) && draws[a * copy.len() + b] < 0.3
            || draws[a * copy.len() + b] < far
    });
    made.speed_max = rng.random_range(1.0..5.0);
    made
}

fn cut(rng: &mut SmallRng, tree: &mut Vec<Node>, cells: &mut Vec<Aabb>, region: Aabb, depth: u32) {
    let node = tree.len();
    if depth == 0 {
        tree.push(Node::Leaf(CellId(cells.len() as u32)));
        cells.push(region);
        return;
    }
    let axis = if rng.random_bool(0.2) { 1 } else { 2 * rng.random_range(0..2_usize) };
    let at = region.min[axis] + region.size()[axis] * rng.random_range(0.2..0.8_f32);
    tree.push(Node::Leaf(CellId(0)));
    let (mut lesser, mut greater) = (region, region);
    lesser.max[axis] = at;
    greater.min[axis] = at;
    let first = tree.len() as u32;
    cut(rng, tree, cells, lesser, depth - 1);
    let second = tree.len() as u32;
    cut(rng, tree, cells, greater, depth - 1);
    tree[node] = Node::Axial { axis: axis as u8, at, sides: [first, second] };
}

/// Walkers that turn now and then, join and leave, and have different round trips.
struct Crowd {
    stage: Stage,
    /// Portals that no body fits through.
    narrow: BTreeSet<u32>,
    rng: SmallRng,
    ways: BTreeMap<AvatarId, Vec3>,
    round_trips: BTreeMap<AvatarId, Duration>,
    last_report: BTreeMap<AvatarId, (Duration, Pose)>,
    next: u32,
}

impl Crowd {
    fn new(seed: u64) -> Self {
        let mut rng = SmallRng::seed_from_u64(seed);
        let world = random_world(&mut rng);
        // Which cells see each other is random in these worlds, so box visibility has no part.
        let validities = [Validity::UntilLeft, Validity::UntilLeft, Validity::Maximal];
        let validity = validities[rng.random_range(0..validities.len())];
        let margin = Margin::Fixed(MARGIN);
        let budgets = Config { sight_test_budget: 0, silence_budget: 0, ..Config::default() };
        let config = Config { validity, margin, ..budgets };
        let share = if rng.random_bool(0.5) { 0.0 } else { rng.random_range(0.0..0.6) };
        let portals = 0..world.cells.portals.len() as u32;
        let narrow: BTreeSet<u32> = portals.filter(|_| rng.random_bool(share)).collect();
        let mut stage = Stage::new(world, config);
        let mut gates = BitSet::default();
        // In these worlds each portal is a gate of the same number.
        narrow.iter().for_each(|gate| gates.insert(*gate));
        stage.engine.building.walkways.clearance = Clearance::with_narrow_gates(gates);
        let mut crowd = Self {
            stage,
            narrow,
            rng,
            ways: BTreeMap::new(),
            round_trips: BTreeMap::new(),
            last_report: BTreeMap::new(),
            next: 0,
        };
        (0..5).for_each(|_| crowd.join());
        crowd
    }

    fn join(&mut self) {
        let bounds = self.stage.engine.world().bounds();
        let part = Vec3::new(self.rng.random(), self.rng.random(), self.rng.random());
        let id = self.stage.join_at(self.next, bounds.min + bounds.size() * part);
        self.next += 1;
        let trip = Duration::from_millis(
            *[0, 40, 100, 100, 230, 600].get(self.rng.random_range(0..6_usize)).unwrap(),
        );
        self.stage.engine.handle(self.stage.now, Input::RoundTrip { avatar: id, round_trip: trip });
        self.ways.insert(id, Vec3::ZERO);
        self.round_trips.insert(id, trip);
        let pose = Pose { eye: self.stage.client(id).eye, ..Pose::default() };
        self.last_report.insert(id, (self.stage.now, pose));
    }

    fn leave(&mut self) {
        let present: Vec<AvatarId> = self.ways.keys().copied().collect();
        let id = present[self.rng.random_range(0..present.len())];
        self.stage.leave(id);
        self.ways.remove(&id);
        self.round_trips.remove(&id);
        self.last_report.remove(&id);
    }

    fn step(&mut self) {
        if self.rng.random_bool(0.02) {
            self.join();
        }
        if self.rng.random_bool(0.02) && self.ways.len() > 2 {
            self.leave();
        }
        let bounds = self.stage.engine.world().bounds();
        let speed_max = self.stage.engine.speed_max();
        let (tick_s, agility) = (TICK.as_secs_f32(), self.stage.engine.agility());
        for (id, way) in &mut self.ways {
            let client: &mut Client = self.stage.clients.get_mut(id).unwrap();
            if client.made.is_some() && self.rng.random_bool(0.05) {
                let mut part = || self.rng.random_range(-1.0..1.0_f32);
                *way = Vec3::new(part(), 0.2 * part(), part()).normalize_or_zero()
                    * if part() < 0.0 { 0.0 } else { speed_max * 0.99 };
            }
            // The walker turns as fast as bodies can.
            let velocity = (client.eye - client.before.unwrap_or(client.eye)) / tick_s;
            let velocity = velocity + (*way - velocity).clamp_length_max(5.9 * tick_s);
            let there = (client.eye + velocity * tick_s).clamp(bounds.min, bounds.max);
            let world = self.stage.engine.world();
            if can_step((world, &self.narrow), client.eye, there, speed_max * tick_s) {
                client.eye = there;
            }
            let pose = Pose { eye: client.eye, velocity: client.velocity(), ..Pose::default() };
            let stays = client.quiet.is_some_and(|tbv| tbv.holds(&pose, TICK, &agility));
            if !stays || client.asked {
                self.last_report.insert(*id, (self.stage.now, pose));
            }
        }
        self.stage.tick();
        self.check();
    }

    /// Checks, for the tick before `now`, who must be held by whom, and who may be silent.
    fn check(&self) {
        let at = self.stage.now - TICK;
        let engine = &self.stage.engine;
        for viewer in self.ways.keys() {
            let held: Vec<AvatarId> = engine.held_by(*viewer).collect();
            let told: Vec<AvatarId> = self.stage.client(*viewer).sees.keys().copied().collect();
            assert_eq!(held, told);
            let (must, may) = self.wanted(at, *viewer);
            assert!(
                must.iter().all(|id| held.contains(id)),
                "{viewer:?} at {at:?}: {held:?} {must:?}"
            );
            assert!(
                held.iter().all(|id| may.contains(id)),
                "{viewer:?} at {at:?}: {held:?} {may:?}"
            );
            if engine.state(*viewer) == Some(ReportingState::Quiet) {
                self.check_hidden(at, *viewer);
            }
        }
        let counts = engine.counts();
        assert_eq!(counts.live + counts.quiet + counts.asked, self.ways.len());
    }

    fn live(&self, avatar: AvatarId) -> bool {
        self.stage.engine.state(avatar) == Some(ReportingState::Live)
    }

    /// The avatars that a viewer must be told of, and those that it may be told of, since regions
    /// have margins.
    fn wanted(&self, at: Duration, viewer: AvatarId) -> (Vec<AvatarId>, Vec<AvatarId>) {
        if !self.live(viewer) {
            return (Vec::new(), Vec::new());
        }
        let ahead = TICK + self.trip(viewer) / 2;
        let others: Vec<AvatarId> =
            self.ways.keys().filter(|id| **id != viewer && self.live(**id)).copied().collect();
        let (eyes, far) = (self.region(at, viewer, ahead), self.ball(at, viewer, ahead));
        let must = others.iter().filter(|id| self.visible(&eyes, &self.region(at, **id, ahead)));
        let may = others.iter().filter(|id| self.visible(&far, &self.ball(at, **id, ahead)));
        (must.copied().collect(), may.copied().collect())
    }

    /// Checks that no other avatar may see into a silent one's TBV, or be seen from it.
    fn check_hidden(&self, at: Duration, hidden: AvatarId) {
        let engine = &self.stage.engine;
        let tbv = engine.tbv(hidden).unwrap();
        assert!(tbv.expiry > at + self.trip(hidden), "the client was asked in time");
        let eye = self.stage.client(hidden).eye;
        assert!(tbv.contains(eye), "the avatar is in its TBV");
        let own = self.hidden_region(hidden);
        let stays = own.iter().any(|(_, piece)| piece.grown(1e-3).contains(eye));
        assert!(stays, "the avatar is in the region of its TBV");
        let slowest = self.round_trips.keys().map(|id| self.trip(*id) / 2).max().unwrap();
        for other in self.ways.keys().filter(|id| **id != hidden) {
            let zone = match engine.tbv(*other) {
                Some(_) => self.hidden_region(*other),
                None => self.region(at, *other, 2 * TICK + self.trip(hidden) + slowest),
            };
            assert!(!self.visible(&own, &zone), "{hidden:?} may see {other:?}");
            assert!(!self.visible(&zone, &own), "{other:?} may see {hidden:?}");
        }
    }

    fn trip(&self, id: AvatarId) -> Duration {
        self.round_trips[&id].min(Config::default().horizon_max)
    }

    /// The time since the last report was made, some time after the tick at `at`.
    fn since_report(&self, at: Duration, id: AvatarId, ahead: Duration) -> Duration {
        let config = Config::default();
        let age = at - self.last_report[&id].0;
        (age + self.trip(id) / 2 + MARGIN).min(config.horizon_max) + ahead
    }

    /// Where an eye can be some time after the tick at `at`.
    fn region(&self, at: Duration, id: AvatarId, ahead: Duration) -> Pieces {
        self.able(id, self.since_report(at, id, ahead))
    }

    /// Where a silent eye can be before its TBV expires or its client says that it leaves.
    fn hidden_region(&self, id: AvatarId) -> Pieces {
        let Tbv { within, expiry, notice, .. } = self.stage.engine.tbv(id).unwrap();
        if !notice.is_zero() {
            let pose = self.last_report[&id].1;
            return reach(self.building(), pose.eye, &within, f32::INFINITY, 0.004);
        }
        let made = self.last_report[&id].0.saturating_sub(self.trip(id) / 2 + MARGIN);
        self.able(id, expiry - made)
    }

    /// Where an eye can be some time after its last report was made.
    fn able(&self, id: AvatarId, time: Duration) -> Pieces {
        let pose = self.last_report[&id].1;
        let engine = &self.stage.engine;
        let able = engine.agility().eyes(pose.eye, pose.velocity, time);
        let way_m = engine.agility().way(pose.velocity, time) + 0.01;
        reach(self.building(), pose.eye, &able.grown(0.01), way_m, 0.004)
    }

    /// A region at least as large as any that the engine had in these ticks, margins included.
    fn ball(&self, at: Duration, id: AvatarId, ahead: Duration) -> Pieces {
        let engine = &self.stage.engine;
        let slowest = Duration::from_millis(200);
        let time = self.since_report(at, id, ahead.max(TICK + slowest));
        let way_m = 2.0 * (engine.speed_max() * time.as_secs_f32() + 0.25);
        let eye = self.last_report[&id].1.eye;
        // A region may have been made when the eye was at a wall and counted as on both sides.
        reach(self.building(), eye, &Aabb::around(eye, way_m), f32::INFINITY, 0.3)
    }

    fn building(&self) -> (&World, &BTreeSet<u32>) {
        (self.stage.engine.world(), &self.narrow)
    }

    fn visible(&self, eyes: &Pieces, seen: &Pieces) -> bool {
        let world = self.stage.engine.world();
        let bodies: Vec<Aabb> = seen.iter().map(|(cell, eyes)| body(world, *cell, eyes)).collect();
        eyes.iter().any(|(from, _)| {
            world.cells.pvs[*from].iter().any(|to| {
                let to = &world.cells.cells[to as usize].bounds;
                bodies.iter().any(|body| body.intersects(to))
            })
        })
    }
}

/// Whether a body gets from one place to another while its eye stays a little off the walls.
fn can_step(building: (&World, &BTreeSet<u32>), from: Vec3, to: Vec3, step_m: f32) -> bool {
    let (world, _) = building;
    let step = reach(building, from, &Aabb::around(from, step_m + 0.02), f32::INFINITY, 0.0);
    let about = Aabb::around(to, 0.01);
    let touched = world.cells.cells.iter().enumerate().filter(|(_, c)| c.bounds.intersects(&about));
    touched.map(|(i, _)| i).all(|i| step.iter().any(|(cell, _)| *cell == i))
}

/// The box that a body can fill whose eye is in a part of a cell. On a side of the cell without a
/// portal it ends six centimetres into the wall.
fn body(world: &World, cell: usize, eyes: &Aabb) -> Aabb {
    let mut body = world.body.around_box(eyes);
    let (whole, room) = (body, &world.cells.cells[cell].bounds);
    for axis in 0..3 {
        let opens = |at: f32| {
            world.cells.portals.iter().any(|portal| {
                portal.cells.iter().any(|c| c.0 as usize == cell)
                    && matches!(portal.polygon, Polygon::Rectangle { axis: a, bounds }
                        if usize::from(a) == axis
                            && bounds.min[axis] == at
                            && bounds.intersects(&whole))
            })
        };
        if !opens(room.min[axis]) {
            body.min[axis] = body.min[axis].max(room.min[axis] - 0.06);
        }
        if !opens(room.max[axis]) {
            body.max[axis] = body.max[axis].min(room.max[axis] + 0.06);
        }
    }
    body
}

/// The parts of cells that an eye can be in.
type Pieces = Vec<(usize, Aabb)>;

/// Where an eye can get to from a place: in a box, through portals that are not too narrow, on ways
/// no longer than `way_m` from gap to gap. All portals are gone over until no way gets shorter.
fn reach(
    (world, narrow): (&World, &BTreeSet<u32>),
    from: Vec3,
    within: &Aabb,
    way_m: f32,
    rounding_m: f32,
) -> Pieces {
    let cells = &world.cells;
    let leads = |portal: &u32, within: &Aabb| {
        !narrow.contains(portal)
            && cells.portals[*portal as usize].polygon.bounds().intersects(within)
    };
    let gap = |portal: u32| cells.portals[portal as usize].polygon.bounds();
    let start = Aabb::around(from, rounding_m);
    let place = Aabb::new(from, from);
    let mut ways = vec![f32::INFINITY; cells.portals.len()];
    loop {
        let before = ways.clone();
        for cell in &cells.cells {
            let starts = cell.bounds.intersects(&start).then_some((place, 0.0));
            let come = cell.portals.iter().map(|portal| (gap(*portal), before[*portal as usize]));
            for (from, way) in come.chain(starts) {
                for to in cell.portals.iter().filter(|to| leads(to, within)) {
                    let way = way + apart(&from, &gap(*to));
                    let known = &mut ways[*to as usize];
                    *known = known.min(if way <= way_m { way } else { f32::INFINITY });
                }
            }
        }
        if ways == before {
            break;
        }
    }
    let mut pieces = Pieces::new();
    for (i, cell) in cells.cells.iter().enumerate() {
        let starts = cell.bounds.intersects(&start).then_some((place, 0.0));
        let come = cell.portals.iter().map(|portal| (gap(*portal), ways[*portal as usize]));
        let come = come.filter(|(_, way)| way.is_finite()).chain(starts);
        let piece = come.fold(Aabb::EMPTY, |all, (from, way)| {
            let reached = from.grown(way_m - way).intersection(&cell.bounds);
            all.union(&reached.intersection(within))
        });
        if !piece.is_empty() {
            pieces.push((i, piece));
        }
    }
    pieces
}

/// The least distance between two boxes.
fn apart(a: &Aabb, b: &Aabb) -> f32 {
    (b.min - a.max).max(a.min - b.max).max(Vec3::ZERO).length()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn interest_and_silence_are_those_of_the_reference_model(seed in any::<u64>()) {
        let mut crowd = Crowd::new(seed);
        (0..300).for_each(|_| crowd.step());
    }

    #[test]
    fn the_same_inputs_give_the_same_outputs(seed in any::<u64>()) {
        let run = || {
            let mut crowd = Crowd::new(seed);
            (0..60).for_each(|_| crowd.step());
            format!("{:?}", crowd.stage.log)
        };
        prop_assert_eq!(run(), run());
    }
}

/// The tests above need walks in which avatars fall silent, meet and part.
#[test]
fn the_walks_are_varied() {
    let (mut quiet, mut held, mut reveals) = (0, 0, 0);
    for seed in 0..5 {
        let mut crowd = Crowd::new(seed);
        for _ in 0..300 {
            crowd.step();
            quiet += crowd.stage.engine.counts().quiet;
            held +=
                crowd.ways.keys().map(|v| crowd.stage.engine.held_by(*v).count()).sum::<usize>();
        }
        reveals += crowd.stage.engine.stats().reveals;
    }
    assert!(quiet > 100 && held > 500 && reveals > 5, "{quiet} {held} {reveals}");
}
