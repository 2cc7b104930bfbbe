//! Rooms and windows as the building itself suggests them, for an author to go on from.
//!
//! 1. `areas`: the plan of each storey falls apart into areas where openings are narrower than what lies on
//!    both sides: those are doors.
//! 2. `extent`: the cells of an area make a room: boxes, each the union of whole cells.
//! 3. `openings`: portals from cells of a room to other cells become its windows, so that no line of sight
//!    leaves it elsewhere, and what such rooms rule out is never visible.
//! 4. `text`: all of it as TOML.

mod areas;
mod extent;
mod openings;
mod text;

use std::ops::ControlFlow;

use glam::Vec3;
use sightline_world::{CellId, World, geometry::Aabb, rooms::PARTS_MAX};

use crate::plan;

/// A room that is suggested.
#[derive(Clone, Debug, PartialEq)]
pub struct SuggestedRoom {
    /// Storey and number.
    pub name: String,
    /// What it takes up, in own axes.
    pub boxes: Vec<Aabb>,
    /// Where one sees out of it.
    pub windows: Vec<SuggestedWindow>,
    /// The cells that it consists of, ascending.
    pub cells: Vec<CellId>,
}

/// A window that is suggested.
#[derive(Clone, Debug, PartialEq)]
pub struct SuggestedWindow {
    /// Where it leads.
    pub name: String,
    /// In the world, in order around it.
    pub corners: Vec<Vec3>,
}

/// Suggests rooms. `hear` is told the share done, from 0 to 1; none when it breaks.
pub fn suggest(
    world: &World,
    hear: &mut dyn FnMut(f32) -> ControlFlow<()>,
) -> Option<Vec<SuggestedRoom>> {
    let storeys = plan::storeys(world);
    let mut taken = vec![None; world.cells.cells.len()];
    let mut rooms: Vec<SuggestedRoom> = Vec::new();
    for (number, feet) in storeys.iter().enumerate() {
        if hear(number as f32 / storeys.len() as f32).is_break() {
            return None;
        }
        let above = storeys.get(number + 1).copied().unwrap_or(f32::INFINITY);
        let areas = areas::Areas::of_storey(world, *feet);
        let mut found = extent::rooms(world, &areas, [*feet, above], &taken);
        // From one corner of the plan to the other, so that neighbours have numbers near each other.
        let key = |boxes: &[Aabb]| (boxes[0].min.z.round() as i32, boxes[0].min.x.round() as i32);
        found.sort_by_key(|room| key(&room.boxes));
        for (place, room) in found.into_iter().enumerate() {
            // Two areas may grow into the same cells: the first has them.
            if room.cells.iter().any(|cell| taken[cell.0 as usize].is_some()) {
                continue;
            }
            for cell in &room.cells {
                taken[cell.0 as usize] = Some(rooms.len());
            }
            let name = format!("room {number}.{}", place + 1);
            rooms.push(SuggestedRoom {
                name,
                boxes: room.boxes,
                windows: Vec::new(),
                cells: room.cells,
            });
        }
    }
    let names: Vec<String> = rooms.iter().map(|room| room.name.clone()).collect();
    for (at, room) in rooms.iter_mut().enumerate() {
        let windows = openings::windows(world, &taken, at, room, &names);
        // So open a room is none: without windows it says nothing of what can be seen.
        if windows.len() <= PARTS_MAX {
            room.windows = windows;
        }
    }
    Some(rooms)
}

/// Suggested rooms as TOML.
pub fn to_toml(world: &World, rooms: &[SuggestedRoom]) -> String {
    text::write(world, rooms)
}
