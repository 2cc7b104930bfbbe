//! The naive twin of [`sightline_shared::shaft`]: many random lines between two boxes, each traced
//! through the original triangles.

use glam::Vec3;
use rand::{Rng, rngs::SmallRng};
use sightline_server::sight::Sight;
use sightline_shared::{
    geometry::Aabb,
    shaft::{Line, Occluders, Outcome, Scratch},
    world::{CellId, World},
};

/// Pairs of boxes in each building, and lines in each pair.
const PAIRS: usize = 60;
const LINES: usize = 300;
const BUDGET: u32 = 20_000;
/// Nobody is inside of a wall, which is no thicker, in metres.
const WALL_MAX: f32 = 0.6;

/// What became of pairs of boxes between which no line was free.
#[derive(Default)]
pub struct Tally {
    hidden: usize,
    unknown: usize,
    visible: usize,
    seen: usize,
}

impl Tally {
    /// Tries pairs of boxes in a building.
    pub fn add(&mut self, world: &World, rng: &mut SmallRng, place: &str) {
        let (occluders, sight) = (Occluders::new(world), Sight::new(&world.mesh));
        let is_free = |line: &Line| {
            sight.between(world.cells.axes.world(line.from), world.cells.axes.world(line.to))
        };
        let open = open_cells(world);
        let mut scratch = Scratch::default();
        for _ in 0..PAIRS {
            let eyes = region(world, &open, rng, 0.7);
            let bodies = region(world, &open, rng, 1.5);
            let in_open = |eye: Vec3| world.cells.at_own(eye).is_some_and(|c| open.contains(&c));
            let free = (0..LINES).find_map(|_| {
                let line = Line { from: point(&eyes, rng), to: point(&bodies, rng) };
                (in_open(line.from) && is_free(&line)).then_some(line)
            });
            let outcome = occluders.between(&mut scratch, &eyes, &bodies, &mut { BUDGET });
            if let Outcome::Visible(line) = outcome {
                assert!(line.joins(&eyes, &bodies) && !occluders.blocks(&line), "{place}");
            }
            match (outcome, free) {
                (Outcome::Hidden, Some(line)) => {
                    panic!("{place}: {line:?} is free between {eyes:?} and {bodies:?}")
                }
                (Outcome::Hidden, None) => self.hidden += 1,
                (Outcome::Unknown, None) => self.unknown += 1,
                (Outcome::Visible(_), None) => self.visible += 1,
                (_, Some(_)) => self.seen += 1,
            }
        }
    }

    /// Whether enough was found to be hidden.
    pub fn judge(&self, kind: &str) {
        let Self { hidden, unknown, visible, seen } = *self;
        let blocked = hidden + unknown + visible;
        println!("{kind}: seen {seen}, blocked {blocked}: {unknown} unknown, {visible} free");
        assert!(seen > PAIRS && blocked > PAIRS, "among {kind}");
        assert!(hidden * 10 > blocked * 6, "among {kind}: {hidden} of {blocked}");
    }
}

/// The cells that hang together with where somebody begins, or with some that are wider than a wall.
fn open_cells(world: &World) -> Vec<CellId> {
    let cells = &world.cells;
    let is_wide = |cell: &CellId| {
        let space = &cells.spaces[cells.cells[cell.0 as usize].space as usize];
        space.bounds.size().min_element() > WALL_MAX
    };
    let mut found: Vec<CellId> =
        (0..cells.cells.len() as u32).map(CellId).filter(is_wide).collect();
    found.extend(world.spawns.iter().filter_map(|spawn| cells.at(spawn.eye)));
    let mut next = 0;
    while let Some(cell) = found.get(next) {
        for portal in &cells.cells[cell.0 as usize].portals {
            for beyond in cells.portals[*portal as usize].cells {
                if !found.contains(&beyond) {
                    found.push(beyond);
                }
            }
        }
        next += 1;
    }
    found
}

/// A box about a point of some cell, no wider than `widest` metres, that may reach out of it.
fn region(world: &World, open: &[CellId], rng: &mut SmallRng, widest: f32) -> Aabb {
    let cell = open[rng.random_range(0..open.len())];
    let centre = point(&world.cells.cells[cell.0 as usize].bounds, rng);
    let half = Vec3::new(rng.random(), rng.random(), rng.random()) * widest * 0.5;
    Aabb::new(centre - half, centre + half)
}

fn point(region: &Aabb, rng: &mut SmallRng) -> Vec3 {
    region.min + region.size() * Vec3::new(rng.random(), rng.random(), rng.random())
}
