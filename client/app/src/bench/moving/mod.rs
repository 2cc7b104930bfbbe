//! The cost of moving things in a picture: Fig. 6 of Sudarsky and Gotsman, *Output-Sensitive
//! Visibility Algorithms for Dynamic Scenes* (1996), with real pictures.

mod routes;
mod simulated_people;

use std::{collections::BTreeSet, io, time::Duration};

use cpu_time::ProcessTime;
use serde::Serialize;
use sightline_world::{Mover, World};
use thiserror::Error;

use self::routes::{Route, RoutePlanner};
pub use self::simulated_people::SimulatedPeople;
use sightline_client_core::replica::AvatarSource;
use sightline_renderer::{
    Camera, Frame, Renderer,
    moving::{Culling, MovingCounters, MovingRenderer},
};

use super::BenchOptions;

/// The time between two pictures.
const STEP: Duration = Duration::from_millis(33);
/// The pitch of the camera, in radians: slightly downward.
const PITCH: f32 = -0.1;
/// The divisors of the largest number of things, one for each row.
const SHARES: [usize; 4] = [8, 4, 2, 1];

/// The kind of moving thing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MovingKind {
    /// Movers of 72 triangles, each going to and fro.
    Chairs,
    /// Avatars, with poses sent at each tick. A real server would not send the hidden ones.
    People,
}

/// The cost of a number of things.
#[derive(Clone, Debug, Serialize)]
pub struct MovingRow {
    /// The kind of things.
    pub kind: MovingKind,
    /// The number of things.
    pub count: usize,
    /// Whether all of them stay in cells that the PVS hides from the eye.
    pub hidden: bool,
    /// The cost of each way of culling, in the order of [`Culling::ALL`].
    pub ways: [MovingCost; 3],
}

/// The cost of a way of culling per picture. The first picture does not count.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct MovingCost {
    /// Milliseconds of CPU time, without the building.
    pub cpu_ms: f64,
    /// The CPU time with the building, divided by that of the building alone.
    pub ratio: f64,
    /// Things drawn.
    pub drawn: f64,
    /// Things whose place was computed.
    pub placed: f64,
    /// Boxes tested against the picture.
    pub tested: f64,
}

/// All figures.
#[derive(Clone, Debug, Serialize)]
pub struct MovingRun {
    /// The mean CPU time of the building alone, in milliseconds.
    pub building_ms: f64,
    /// First chairs, then people; first everywhere, then hidden; first few, then many. Rows are
    /// missing where there are too few hidden places.
    pub rows: Vec<MovingRow>,
}

/// Why the measurement fails.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MovingError {
    /// No body can walk in the world.
    #[error("no body can walk in this world")]
    Nowhere,
    /// Two ways of culling draw different pictures.
    #[error("{0:?} culling draws a different picture")]
    Differs(Culling),
    /// The threads cannot be started, or the system does not report CPU time.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// Draws from the first spawn point, where the eye turns once in `pictures` pictures, with a
/// growing number of moving things: at most `most`. Compares the three ways of culling. Of
/// `options.repeats` rounds the cheapest counts. The world's own movers are left out. Calls
/// `progress` with the share done, from 0 to 1.
///
/// # Errors
/// See [`MovingError`].
pub fn moving(
    mut world: World,
    most: usize,
    pictures: usize,
    options: &BenchOptions,
    progress: &mut dyn FnMut(f32),
) -> Result<MovingRun, MovingError> {
    world.movers.clear();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads.max(1)).build();
    let pool = pool.map_err(io::Error::other)?;
    let mut acts = acts(&world, most)?;
    let (pictures, rounds) = (pictures.max(2), options.repeats.max(1));
    let mut stage = MovingScene::new(world, options.size);
    let mut building = vec![f64::INFINITY; pictures];
    for round in 0..rounds {
        acts.iter_mut().for_each(|act| act.begin(&mut stage.world));
        for (at, building) in building.iter_mut().enumerate() {
            let share = at as f64 / pictures as f64;
            let camera = stage.camera(share * std::f64::consts::TAU);
            *building = building.min(pool.install(|| stage.draw_building(&camera))?);
            for act in &mut acts {
                pool.install(|| stage.draw_all(act, &camera, STEP * (at as u32 + 30), at > 0))?;
            }
            progress((round as f64 + share) as f32 / rounds as f32);
        }
        acts.iter_mut().for_each(Scenario::end);
    }
    let building_ms = building[1..].iter().sum::<f64>() / (pictures - 1) as f64;
    let rows = acts.into_iter().map(|act| act.row(building_ms, pictures - 1)).collect();
    Ok(MovingRun { building_ms, rows })
}

/// The scenarios to measure.
fn acts(world: &World, most: usize) -> Result<Vec<Scenario>, MovingError> {
    let places = RoutePlanner::new(world).ok_or(MovingError::Nowhere)?;
    let counts: BTreeSet<usize> = SHARES.iter().map(|share| (most / share).max(1)).collect();
    let mut acts = Vec::new();
    for kind in [MovingKind::Chairs, MovingKind::People] {
        for hidden in [false, true] {
            let ways = places.ways(world, most, hidden);
            let there = counts.iter().filter(|count| **count <= ways.len());
            acts.extend(there.map(|&count| Scenario::new(world, kind, hidden, &ways[..count])));
        }
    }
    Ok(acts)
}

/// A number of moving things, and the cost of each way of culling.
struct Scenario {
    kind: MovingKind,
    hidden: bool,
    count: usize,
    movers: Vec<Mover>,
    ways: Vec<Route>,
    turns: Vec<CullingRun>,
    best: [MovingCost; 3],
}

/// One round of one way of culling.
struct CullingRun {
    moving: MovingRenderer,
    crowd: Option<SimulatedPeople>,
    sum: MovingCost,
}

impl Scenario {
    fn new(world: &World, kind: MovingKind, hidden: bool, ways: &[Route]) -> Self {
        let movers = match kind {
            MovingKind::Chairs => ways.iter().filter_map(|way| way.chair(&world.body)).collect(),
            MovingKind::People => Vec::new(),
        };
        let worst = MovingCost { cpu_ms: f64::INFINITY, ..MovingCost::default() };
        let (count, ways, best) = (ways.len(), ways.to_vec(), [worst; 3]);
        Self { kind, hidden, count, movers, ways, turns: Vec::new(), best }
    }

    fn begin(&mut self, world: &mut World) {
        std::mem::swap(&mut world.movers, &mut self.movers);
        self.turns = Culling::ALL
            .iter()
            .map(|culling| CullingRun {
                moving: MovingRenderer::new(world, *culling),
                crowd: (self.kind == MovingKind::People).then(|| SimulatedPeople::new(self.count)),
                sum: MovingCost::default(),
            })
            .collect();
        std::mem::swap(&mut world.movers, &mut self.movers);
    }

    fn end(&mut self) {
        for (turn, best) in self.turns.drain(..).zip(&mut self.best) {
            if turn.sum.cpu_ms < best.cpu_ms {
                *best = turn.sum;
            }
        }
    }

    fn row(self, building_ms: f64, pictures: usize) -> MovingRow {
        let ways = self.best.map(|MovingCost { cpu_ms, drawn, placed, tested, .. }| {
            let [cpu_ms, drawn, placed, tested] =
                [cpu_ms, drawn, placed, tested].map(|sum| sum / pictures as f64);
            MovingCost { cpu_ms, ratio: 1.0 + cpu_ms / building_ms, drawn, placed, tested }
        });
        MovingRow { kind: self.kind, count: self.count, hidden: self.hidden, ways }
    }
}

/// The world, and the frames that are drawn.
struct MovingScene {
    world: World,
    renderer: Renderer,
    /// The picture of the building alone.
    building: Frame,
    first: Frame,
    other: Frame,
}

impl MovingScene {
    fn new(world: World, size: (usize, usize)) -> Self {
        let [building, first, other] = [(); 3].map(|()| Frame::new(size.0, size.1));
        Self { world, renderer: Renderer::default(), building, first, other }
    }

    fn camera(&self, turn: f64) -> Camera {
        let (eye, yaw) =
            self.world.spawns.first().map_or_else(Default::default, |s| (s.eye, s.yaw));
        Camera { eye, yaw: yaw + turn as f32, pitch: PITCH, fov_y: Camera::FOV_Y }
    }

    fn draw_building(&mut self, camera: &Camera) -> io::Result<f64> {
        let start = ProcessTime::try_now()?;
        self.renderer.draw(&self.world.octree, camera, &mut self.building);
        Ok(ProcessTime::try_now()?.duration_since(start).as_secs_f64() * 1e3)
    }

    /// Draws a picture with each way of culling. All must give the same picture.
    fn draw_all(
        &mut self,
        act: &mut Scenario,
        camera: &Camera,
        now: Duration,
        counts: bool,
    ) -> Result<(), MovingError> {
        std::mem::swap(&mut self.world.movers, &mut act.movers);
        for (at, turn) in act.turns.iter_mut().enumerate() {
            let frame = if at == 0 { &mut self.first } else { &mut self.other };
            frame.clone_from(&self.building);
            if let Some(crowd) = &mut turn.crowd {
                crowd.advance(now, |avatar, time| act.ways[avatar].pose(time));
            }
            let start = ProcessTime::try_now()?;
            let told = turn.crowd.as_mut().map(|crowd| crowd.replica() as &mut dyn AvatarSource);
            turn.moving.draw(frame, camera, &self.world, told, now);
            let taken = ProcessTime::try_now()?.duration_since(start);
            if counts {
                turn.sum.add(taken, turn.moving.counters());
            }
            if at > 0 && self.first.colour != self.other.colour {
                return Err(MovingError::Differs(Culling::ALL[at]));
            }
        }
        std::mem::swap(&mut self.world.movers, &mut act.movers);
        Ok(())
    }
}

impl MovingCost {
    fn add(&mut self, taken: Duration, counters: MovingCounters) {
        self.cpu_ms += taken.as_secs_f64() * 1e3;
        self.drawn += counters.drawn as f64;
        self.placed += counters.placed as f64;
        self.tested += counters.tested as f64;
    }
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor::world;

    use super::*;

    #[test]
    fn every_scenario_is_measured_with_each_way_of_culling() {
        let world = world(&[([31, 1, 8], [33, 30, 64], 0)]);
        let options = BenchOptions { size: (64, 48), threads: 2, repeats: 2, mode: None };
        let mut told = Vec::new();
        let run = moving(world, 8, 5, &options, &mut |share| told.push(share)).unwrap();
        // The world has a single cell, which hides nothing.
        let rows: Vec<_> = run.rows.iter().map(|row| (row.kind, row.count, row.hidden)).collect();
        let all = [MovingKind::Chairs, MovingKind::People]
            .map(|kind| [1, 2, 4, 8].map(|count| (kind, count, false)));
        assert_eq!(rows, all.concat());
        for MovingRow { ways: [plain, hierarchical, _], count, .. } in &run.rows {
            assert!(plain.drawn == *count as f64 && hierarchical.placed >= plain.drawn);
            assert!(hierarchical.drawn < plain.drawn);
            assert!(plain.cpu_ms > 0.0 && plain.ratio > 1.0);
        }
        let placed = |way: usize| run.rows.iter().map(|row| row.ways[way].placed).sum::<f64>();
        assert!(placed(2) < placed(0), "volumes stand for some");
        assert_eq!(told.len(), 10);
    }
}
