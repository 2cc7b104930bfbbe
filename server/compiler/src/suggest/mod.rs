//! Rooms and windows that the building itself suggests, for an author to edit.
//!
//! 1. `areas`: the plan of each storey is divided at doors, which are openings narrower than the
//!    areas on both sides. What lies outdoors is left out (`enclosure`).
//! 2. `extent`: the cells of an area make a room of boxes, each the union of whole cells.
//! 3. `openings`: the portals that lead out of a room become its windows. Lines of sight leave a
//!    room through windows only, so what these rooms rule out is never visible.
//! 4. `text`: the rooms as TOML.

mod areas;
mod enclosure;
mod extent;
mod openings;
mod room;
mod text;

use std::ops::ControlFlow;

use sightline_world::{World, geometry::Aabb, rooms::PARTS_MAX};

use crate::storeys::storeys;
pub use room::{SuggestedRoom, SuggestedWindow};

/// Suggests rooms. `progress` hears the share that is done, from 0 to 1; when it breaks, the result
/// is `None`.
pub fn suggest(
    world: &World,
    progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
) -> Option<Vec<SuggestedRoom>> {
    let storeys = storeys(world);
    let mut taken = vec![None; world.cells.cells.len()];
    let mut rooms: Vec<SuggestedRoom> = Vec::new();
    for (number, feet) in storeys.iter().enumerate() {
        if progress(number as f32 / storeys.len() as f32).is_break() {
            return None;
        }
        let above = storeys.get(number + 1).copied().unwrap_or(f32::INFINITY);
        let areas = areas::Areas::of_storey(world, *feet);
        let mut found = extent::rooms(world, &areas, [*feet, above], &taken);
        // In order along the plan, so that neighbouring rooms get neighbouring numbers.
        let key = |boxes: &[Aabb]| (boxes[0].min.z.round() as i32, boxes[0].min.x.round() as i32);
        found.sort_by_key(|room| key(&room.boxes));
        for (place, room) in found.into_iter().enumerate() {
            // Two areas may grow into the same cells. The first one keeps them.
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
        // A room with more openings is no room. Without windows it rules nothing out.
        if windows.len() <= PARTS_MAX {
            room.windows = windows;
        }
    }
    Some(rooms)
}

/// Suggested rooms as TOML, in the world's axes.
pub fn to_toml(world: &World, rooms: &[SuggestedRoom]) -> String {
    text::write(world, rooms)
}
