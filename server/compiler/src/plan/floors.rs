//! At which heights to cut a building, so that every floor is on some picture.

use rayon::prelude::*;
use sightline_world::{World, geometry::Aabb};

use super::{CUT_HEIGHT, FLOOR_DEPTH, cell_at};

/// Feet whose heights differ by less stand on one storey, in metres.
const STOREY_APART: f32 = 2.0;
/// No picture has more storeys.
const STOREYS_MAX: usize = 24;
/// Floors are looked for in columns this far apart, in metres, or fewer of them.
const COLUMN_M: f32 = 0.5;
const COLUMNS_MAX: f32 = 250.0;
/// A storey is added when it shows floor that no other does: at least so much, in square metres …
const FLOOR_MIN_M2: f32 = 8.0;
/// … and this part of all floors.
const FLOOR_MIN_SHARE: f32 = 0.02;
/// Heights are told apart to this, in metres.
const BIN_M: f32 = 0.25;

/// The heights of the storeys' floors, ascending: where somebody may begin, and whatever other
/// floors are worth a picture.
pub(super) fn storeys(world: &World, area: &Aabb) -> Vec<f32> {
    let feet = world.spawns.iter().map(|spawn| spawn.eye.y - world.body.below_eye);
    let mut storeys: Vec<f32> = feet.collect();
    storeys.sort_unstable_by(f32::total_cmp);
    storeys.dedup_by(|a, b| *a - *b < STOREY_APART);
    storeys.truncate(STOREYS_MAX);
    let column = COLUMN_M.max(area.size().x.max(area.size().z) / COLUMNS_MAX);
    let mut floors = floors(world, area, column);
    let enough = (FLOOR_MIN_M2 / (column * column)).max(floors.len() as f32 * FLOOR_MIN_SHARE);
    // What one picture shows.
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
    storeys
}

/// The heights at which somebody could stand, one for each floor of each column, ascending.
fn floors(world: &World, area: &Aabb, column: f32) -> Vec<f32> {
    let count = |size: f32| (size / column).ceil().max(1.0) as u32;
    let (columns, rows) = (count(area.size().x), count(area.size().z));
    let mut found: Vec<f32> = (0..rows)
        .into_par_iter()
        .flat_map_iter(|row| (0..columns).map(move |at| (at, row)))
        .flat_map_iter(|(x, z)| {
            let at = glam::Vec3::new(x as f32 + 0.5, 0.0, z as f32 + 0.5) * column;
            floors_below(world, area.min + at, area.max.y)
        })
        .collect();
    found.sort_unstable_by(f32::total_cmp);
    found
}

/// The floors of a column, under a roof: what is under the open sky is the roof or the ground
/// outside. Maps made for Quake are closed all around, and their skies are not drawn.
fn floors_below(world: &World, foot: glam::Vec3, top: f32) -> Vec<f32> {
    let (octree, body) = (&world.octree, &world.body);
    let tall = body.above_eye + body.below_eye;
    let mut floors = Vec::new();
    let (mut at, mut ceiling) = (foot.with_y(top), None);
    while at.y > foot.y {
        if octree.leaf_at(at).is_some() {
            let free = ceiling.unwrap_or(top) - at.y;
            let is_closed = ceiling.is_some() || world.origin.is_some();
            let head = at + glam::Vec3::Y * tall * 0.9;
            if free > tall && is_closed && cell_at(world, head).is_some() {
                floors.push((at.y / BIN_M).round() * BIN_M);
            }
            ceiling = Some(at.y);
        }
        at.y -= octree.voxel();
    }
    floors
}
