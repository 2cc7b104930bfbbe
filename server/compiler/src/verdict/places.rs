//! Standing places, which of them see each other, and what no opening leads to.

use glam::Vec3;
use rayon::prelude::*;
use sightline_world::{World, geometry::Aabb};

use crate::storeys::{self, cell_at};

/// The most columns along one side in which floors are sought.
const COLUMNS_MAX: f32 = 120.0;
/// Columns are at least this far apart, in metres.
const COLUMN_M: f32 = 0.6;
/// The most places of which all pairs are looked at.
const PAIRED_MAX: usize = 1_000;
/// An opening lets people through when it is at least this wide and high, in metres.
const OPENING_M: f32 = 0.5;
/// A closed place is told from this much floor on, in square metres.
const ROOM_MIN_M2: f32 = 3.0;
/// What is higher above the lowest point than this is a roof, in metres.
const ROOF_M: f32 = 1.9;
/// A floor is no higher above the lowest point than this, in metres.
const FLOOR_M: f32 = 1.2;
/// Below this share, missing floors are courtyards and eaves.
pub(super) const FLOORLESS_MIN: f32 = 0.3;
/// Fewer columns below a roof tell nothing.
const ROOFED_MIN: usize = 12;

/// Where people can stand below a roof.
pub(super) struct Places {
    /// Eyes of people, with the space of each.
    eyes: Vec<(Vec3, u32)>,
    /// The area of a column, in square metres.
    column_m2: f32,
    /// The share of the columns below a roof in which there is no floor.
    pub(super) floorless_share: f32,
}

/// What a column of the building holds.
struct Column {
    eyes: Vec<(Vec3, u32)>,
    has_roof: bool,
    has_floor: bool,
}

impl Places {
    pub(super) fn find(world: &World) -> Self {
        let area = storeys::area(world);
        let size = area.size();
        let step = COLUMN_M.max(size.x.max(size.z) / COLUMNS_MAX);
        let [across, along] =
            [size.x, size.z].map(|side| (side / step).ceil().clamp(1.0, COLUMNS_MAX + 1.0) as u32);
        let solid = Aabb::from_points(world.mesh.positions.iter().copied());
        let columns: Vec<Column> = (0..along)
            .into_par_iter()
            .flat_map_iter(|row| (0..across).map(move |at| (at, row)))
            .map(|(x, z)| {
                let at = Vec3::new(x as f32 + 0.5, 0.0, z as f32 + 0.5) * step;
                column(world, area.min + at, &solid)
            })
            .collect();
        let roofed = columns.iter().filter(|column| column.has_roof).count();
        let bare = columns.iter().filter(|column| column.has_roof && !column.has_floor).count();
        let floorless_share = if roofed < ROOFED_MIN { 0.0 } else { bare as f32 / roofed as f32 };
        let eyes = columns.into_iter().flat_map(|column| column.eyes).collect();
        Self { eyes, column_m2: step * step, floorless_share }
    }

    /// The share of pairs of places that see each other.
    pub(super) fn seen_share(&self, world: &World) -> Option<f64> {
        let step = self.eyes.len().div_ceil(PAIRED_MAX).max(1);
        let chosen = self.eyes.iter().step_by(step);
        let cells: Vec<_> = chosen.filter_map(|(eye, _)| world.cells.at(*eye)).collect();
        let pairs = cells.len() * cells.len().saturating_sub(1);
        let seen_from = |(index, from): (usize, _)| {
            let others = cells.iter().enumerate().filter(|(other, _)| *other != index);
            others.filter(|(_, to)| world.cells.sees(from, **to)).count()
        };
        let seen: usize = cells.par_iter().copied().enumerate().map(seen_from).sum();
        (pairs > 0).then(|| seen as f64 / pairs as f64)
    }

    /// Closed places: a point of each and its floor in square metres, the largest first.
    pub(super) fn unreachable(&self, world: &World) -> Vec<(Vec3, f32)> {
        let part = parts(world);
        let mut floors = std::collections::BTreeMap::<u32, (Vec3, usize)>::new();
        for (eye, space) in &self.eyes {
            floors.entry(part[*space as usize]).or_insert((*eye, 0)).1 += 1;
        }
        let begins = world.spawns.iter().filter_map(|spawn| world.cells.at(spawn.eye));
        for cell in begins {
            floors.remove(&part[world.cells.cells[cell.0 as usize].space as usize]);
        }
        let area = |(eye, count): (Vec3, usize)| (eye, count as f32 * self.column_m2);
        let closed = floors.into_values().map(area);
        let mut closed: Vec<_> = closed.filter(|(_, floor)| *floor >= ROOM_MIN_M2).collect();
        closed.sort_by(|a, b| b.1.total_cmp(&a.1));
        closed
    }
}

fn column(world: &World, foot: Vec3, solid: &Aabb) -> Column {
    let heights = storeys::floors_below(world, foot, solid.max.y + 0.1);
    let eyes = heights.into_iter().filter_map(|floor| {
        let eye = foot.with_y(floor + world.body.below_eye);
        let cell = cell_at(world, eye)?;
        Some((eye, world.cells.cells[cell.0 as usize].space))
    });
    let between = |low: f32, high: f32| {
        let half = world.octree.voxel() * 0.25;
        let [low, high] = [(low, -half), (high, half)]
            .map(|(y, side)| Vec3::new(foot.x + side, solid.min.y + y, foot.z + side));
        world.octree.solid_in(&Aabb::new(low, high))
    };
    Column {
        eyes: eyes.collect(),
        has_roof: between(ROOF_M, solid.size().y + 0.1),
        has_floor: between(-0.1, FLOOR_M),
    }
}

/// For each space a number that it shares with those that openings join it to.
fn parts(world: &World) -> Vec<u32> {
    let cells = &world.cells;
    let mut part = vec![u32::MAX; cells.spaces.len()];
    for start in 0..part.len() as u32 {
        let mut open = vec![start];
        while let Some(space) = open.pop() {
            if part[space as usize] != u32::MAX {
                continue;
            }
            part[space as usize] = start;
            for gate in cells.spaces[space as usize].gates.iter().map(|&g| &cells.gates[g as usize])
            {
                let size = gate.polygon.bounds().size();
                let mut sides = size.to_array();
                sides.sort_by(f32::total_cmp);
                let beyond = gate.spaces[usize::from(gate.spaces[0] == space)];
                if sides[1] >= OPENING_M && part[beyond as usize] == u32::MAX {
                    open.push(beyond);
                }
            }
        }
    }
    part
}
