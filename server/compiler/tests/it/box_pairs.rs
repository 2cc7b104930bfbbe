//! The reference model of [`sightline_visibility::box_visibility`]: many random lines between two
//! boxes, each traced through the original triangles.

use std::collections::BTreeSet;

use glam::Vec3;
use rand::{Rng, rngs::SmallRng};
use sightline_oracle::Oracle;
use sightline_visibility::box_visibility::{BoxScratch, BoxVisibility, Occluders, SightLine};
use sightline_world::{CellId, World, geometry::Aabb};

/// The number of lines between each pair of boxes.
const LINES: usize = 300;
/// The budget of each question.
const BUDGET: u32 = 20_000;
/// The distance, in metres, below which pairs are sought in large buildings.
const APART_MAX: f32 = 15.0;
/// The greatest thickness of a wall, in metres. Nobody is inside one.
const WALL_MAX: f32 = 0.6;

/// The answers for pairs of boxes between which no line was free, and the number of other pairs.
#[derive(Default)]
pub struct BoxPairTally {
    hidden: usize,
    unknown: usize,
    visible: usize,
    seen: usize,
    /// The number of free lines between points in cells, and of those among them that no gates let
    /// pass.
    free: [usize; 2],
}

impl BoxPairTally {
    /// Asks about random pairs of boxes in a building.
    pub fn add(&mut self, world: &World, pairs: usize, rng: &mut SmallRng, place: &str) {
        let (occluders, sight) = (Occluders::new(world), Oracle::new(&world.mesh));
        let is_free = |line: &SightLine| {
            sight.between(world.cells.axes.world(line.from), world.cells.axes.world(line.to))
        };
        let open = open_cells(world);
        if open.is_empty() {
            println!("{place}: no cell is wide enough for anybody");
            return;
        }
        let mut scratch = BoxScratch::default();
        for _ in 0..pairs {
            let eyes = region(world, &open, rng, 0.7);
            let mut bodies = region(world, &open, rng, 1.5);
            for _ in 0..100 {
                if bodies.centre().distance(eyes.centre()) > APART_MAX {
                    bodies = region(world, &open, rng, 1.5);
                }
            }
            let in_open =
                |eye: Vec3| world.cells.at_own(eye).is_some_and(|c| open.binary_search(&c).is_ok());
            let free = (0..LINES).find_map(|_| {
                let line = SightLine { from: point(&eyes, rng), to: point(&bodies, rng) };
                (in_open(line.from) && is_free(&line)).then_some(line)
            });
            for _ in 0..LINES / 10 {
                let line = SightLine { from: point(&eyes, rng), to: point(&bodies, rng) };
                self.follow(world, &occluders, &line, is_free(&line), place);
            }
            let outcome = occluders.between(&mut scratch, &eyes, &bodies, &mut { BUDGET });
            if let BoxVisibility::Visible(line) = outcome {
                assert!(line.joins(&eyes, &bodies) && !occluders.blocks(&line), "{place}");
            }
            match (outcome, free) {
                (BoxVisibility::Hidden, Some(line)) => {
                    panic!("{place}: {line:?} is free between {eyes:?} and {bodies:?}")
                }
                (BoxVisibility::Hidden, None) => self.hidden += 1,
                (BoxVisibility::Unknown, None) => self.unknown += 1,
                (BoxVisibility::Visible(_), None) => self.visible += 1,
                (_, Some(_)) => self.seen += 1,
            }
        }
    }

    /// Follows a line through gates. They let free lines pass, except some that graze an edge.
    fn follow(
        &mut self,
        world: &World,
        occluders: &Occluders,
        line: &SightLine,
        is_free: bool,
        at: &str,
    ) {
        let space = |end: Vec3| Some(world.cells.cells[world.cells.at_own(end)?.0 as usize].space);
        let (Some(start), Some(goal)) = (space(line.from), space(line.to)) else { return };
        let is_led = occluders.is_free_through_gates(line, [start, goal]);
        assert!(!is_led || !occluders.blocks(line), "{at}: {line:?}");
        self.free[0] += usize::from(is_free);
        self.free[1] += usize::from(is_free && !is_led);
    }

    /// Checks that at least such a share of the hidden pairs was found hidden.
    pub fn judge(&self, kind: &str, share_min: f64) {
        let Self { hidden, unknown, visible, seen, free: [free, lost] } = *self;
        let blocked = hidden + unknown + visible;
        println!("{kind}: seen {seen}, blocked {blocked}: {unknown} unknown, {visible} free");
        assert!(seen > 50 && blocked > 50, "among {kind}");
        println!("{kind}: of {free} free lines {lost} are not led by gates");
        assert!(free > 100 && lost * 20 < free, "among {kind}: {lost} of {free}");
        let share = hidden as f64 / blocked as f64;
        assert!(share > share_min, "among {kind}: {hidden} of {blocked}");
    }
}

/// The cells that are connected to a spawn point, or to a cell wider than a wall.
fn open_cells(world: &World) -> Vec<CellId> {
    let cells = &world.cells;
    let is_wide = |cell: &CellId| {
        let space = &cells.spaces[cells.cells[cell.0 as usize].space as usize];
        space.bounds.size().min_element() > WALL_MAX
    };
    let mut open: Vec<CellId> = (0..cells.cells.len() as u32).map(CellId).filter(is_wide).collect();
    open.extend(world.spawns.iter().filter_map(|spawn| cells.at(spawn.eye)));
    let mut found = BTreeSet::new();
    while let Some(cell) = open.pop() {
        if found.insert(cell) {
            let portals = &cells.cells[cell.0 as usize].portals;
            open.extend(portals.iter().flat_map(|portal| cells.portals[*portal as usize].cells));
        }
    }
    found.into_iter().collect()
}

/// A box around a point of some cell, no wider than `widest` metres. It may reach out of the cell.
fn region(world: &World, open: &[CellId], rng: &mut SmallRng, widest: f32) -> Aabb {
    let cell = open[rng.random_range(0..open.len())];
    let centre = point(&world.cells.cells[cell.0 as usize].bounds, rng);
    let half = Vec3::new(rng.random(), rng.random(), rng.random()) * widest * 0.5;
    Aabb::new(centre - half, centre + half)
}

fn point(region: &Aabb, rng: &mut SmallRng) -> Vec3 {
    region.min + region.size() * Vec3::new(rng.random(), rng.random(), rng.random())
}
