//! The storeys of a building: heights of floors such that a level cut above each of them shows
//! every floor.

use glam::Vec3;
use rayon::prelude::*;
use sightline_world::{CellId, World, geometry::Aabb};

/// A storey is cut this far above its floor, in metres: above tables, below lintels.
pub(crate) const CUT_HEIGHT: f32 = 1.3;

/// A floor this far below the feet of a storey still shows on it, in metres.
pub(crate) const FLOOR_DEPTH: f32 = 1.0;
/// The margin around the building, in metres.
const MARGIN: f32 = 1.0;

/// Feet whose heights differ by less stand on one storey, in metres.
const STOREY_APART: f32 = 2.0;
/// The most storeys.
const STOREYS_MAX: usize = 24;
/// The distance between the columns in which floors are sought, in metres; more where that would
/// give more than [`COLUMNS_MAX`] along one side.
const COLUMN_M: f32 = 0.5;
const COLUMNS_MAX: f32 = 250.0;
/// A storey is added when it shows this much floor that no other storey shows, in square metres …
const FLOOR_MIN_M2: f32 = 8.0;
/// … and this share of all floors.
const FLOOR_MIN_SHARE: f32 = 0.02;
/// Heights of floors are rounded to this, in metres.
const BIN_M: f32 = 0.25;

/// The heights of the storeys' floors, in metres, ascending: a level cut above each of them shows
/// every floor.
pub fn storeys(world: &World) -> Vec<f32> {
    storeys_within(world, &area(world))
}

/// The heights of the floors of the storeys in an area, ascending: those of spawn points, and those
/// of other floors that are large enough.
pub(crate) fn storeys_within(world: &World, area: &Aabb) -> Vec<f32> {
    let feet = world.spawns.iter().map(|spawn| spawn.eye.y - world.body.below_eye);
    let mut storeys: Vec<f32> = feet.collect();
    storeys.sort_unstable_by(f32::total_cmp);
    storeys.dedup_by(|a, b| *a - *b < STOREY_APART);
    storeys.truncate(STOREYS_MAX);
    let column = COLUMN_M.max(area.size().x.max(area.size().z) / COLUMNS_MAX);
    let mut floors = floors(world, area, column);
    let enough = (FLOOR_MIN_M2 / (column * column)).max(floors.len() as f32 * FLOOR_MIN_SHARE);
    // Whether the picture of one storey shows a floor.
    let shows =
        |feet: f32, floor: f32| (feet - FLOOR_DEPTH..feet + CUT_HEIGHT - BIN_M).contains(&floor);
    floors.retain(|&floor| !storeys.iter().any(|&feet| shows(feet, floor)));
    while storeys.len() < STOREYS_MAX && !floors.is_empty() {
        // Where most of the floor is, so that the cut is above its tables and below its ceiling.
        let (best, _) = floors
            .chunk_by(|a, b| a == b)
            .map(|level| (level[0], level.len()))
            .fold((0.0, 0), |best, level| if level.1 > best.1 { level } else { best });
        if (floors.iter().filter(|&&floor| shows(best, floor)).count() as f32) < enough {
            break;
        }
        storeys.push(best);
        floors.retain(|&floor| !shows(best, floor));
    }
    storeys.sort_unstable_by(f32::total_cmp);
    assert!(storeys.len() <= STOREYS_MAX, "a picture has room for every storey");
    storeys
}

/// The heights at which a body could stand, one for each floor of each column, ascending.
fn floors(world: &World, area: &Aabb, column: f32) -> Vec<f32> {
    let count = |size: f32| (size / column).ceil().max(1.0) as u32;
    let (columns, rows) = (count(area.size().x), count(area.size().z));
    let mut found: Vec<f32> = (0..rows)
        .into_par_iter()
        .flat_map_iter(|row| (0..columns).map(move |at| (at, row)))
        .flat_map_iter(|(x, z)| {
            let at = Vec3::new(x as f32 + 0.5, 0.0, z as f32 + 0.5) * column;
            floors_below(world, area.min + at, area.max.y)
        })
        .collect();
    found.sort_unstable_by(f32::total_cmp);
    found
}

/// The floors of a column that have a roof. Under the open sky there is only the roof itself, or
/// the ground outside. Quake maps are closed all around, and their skies are not drawn: there every
/// floor counts.
pub(crate) fn floors_below(world: &World, foot: Vec3, top: f32) -> Vec<f32> {
    let (octree, body) = (&world.octree, &world.body);
    let tall = body.above_eye + body.below_eye;
    let mut floors = Vec::new();
    let (mut at, mut ceiling) = (foot.with_y(top), None);
    while let Some((floor, _)) = octree.first_below(at, foot.y) {
        let free = ceiling.unwrap_or(top) - floor;
        let is_closed = ceiling.is_some() || world.origin.is_some();
        let head = at.with_y(floor + tall * 0.9);
        if free > tall && is_closed && cell_at(world, head).is_some() {
            floors.push((floor / BIN_M).round() * BIN_M);
        }
        ceiling = Some(floor);
        // The middle of the voxel below this one.
        at.y = floor - octree.voxel() * 1.5;
    }
    floors
}

/// The part of the world that is drawn: all opaque triangles, and a margin around them.
pub(crate) fn area(world: &World) -> Aabb {
    let opaque = Aabb::from_points(world.mesh.positions.iter().copied());
    let whole = if opaque.is_empty() { world.octree.bounds() } else { opaque };
    let area = whole.grown(MARGIN).intersection(&world.bounds());
    if area.is_empty() { world.bounds() } else { area }
}

/// The cell of a point. None outside of all cells, and where a Quake map has no cluster.
pub(crate) fn cell_at(world: &World, point: Vec3) -> Option<CellId> {
    let leaf = world.origin.as_ref().and_then(|origin| {
        let leaf = origin.leaf_at(point.as_dvec3())?;
        origin.tree.as_ref()?.leafs.get(leaf as usize)
    });
    let is_void = leaf.is_some_and(|leaf| leaf.cluster.is_none());
    if is_void { None } else { world.cells.at(point) }
}
