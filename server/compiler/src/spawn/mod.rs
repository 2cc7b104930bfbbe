//! Spawn points: those of the author, put right where a body does not fit, or else places that are
//! found.
//!
//! * `floors`: where a body can stand and walk, from the octree.
//! * `rating`: what is a room, and what is a roof, a plenum or a void.
//! * `choice`: scattered places of the best area, facing the longest view.

mod choice;
mod floors;
mod rating;
#[cfg(test)]
mod tests;

use std::ops::ControlFlow;

use glam::Vec3;
use sightline_world::{Spawn, World, geometry::Aabb};

use crate::model::Model;
use floors::Floors;
use rating::Sight;

/// A spawn point without room for a body is moved at most this far, in metres.
const MOVED_MAX_M: f32 = 3.0;

/// Feet that are this far and a voxel below the top of a floor still stand on it, in metres.
const LIFT_M: f32 = 0.02;

/// The spawn points of a world, and what its author should know of them.
pub(crate) struct SpawnPoints {
    pub(crate) spawns: Vec<Spawn>,
    pub(crate) warnings: Vec<String>,
}

/// The spawn points of a world: those of the model and of its rooms, or, when there are none, some
/// that are found. `drawn` is the box around what is drawn. `None` when `progress` breaks.
pub(crate) fn spawn_points(
    model: &Model,
    world: &World,
    drawn: &Aabb,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Option<SpawnPoints> {
    let rooms = world.rooms.list().iter().filter_map(|room| room.spawn);
    let authored: Vec<Spawn> = model.spawns.iter().copied().chain(rooms).collect();
    // The spawn points of a Quake map are those of a game that was played.
    let is_good = |spawn: &Spawn| world.origin.is_some() || has_room(world, spawn.eye);
    if !authored.is_empty() && authored.iter().all(is_good) {
        return Some(SpawnPoints { spawns: authored, warnings: Vec::new() });
    }
    let floors = Floors::find(world, drawn, progress)?;
    let mut found = SpawnPoints { spawns: Vec::new(), warnings: Vec::new() };
    for spawn in authored {
        if is_good(&spawn) {
            found.spawns.push(spawn);
        } else {
            found.put_right(spawn, &floors);
        }
    }
    if found.spawns.is_empty() {
        found.spawns = choice::choose(&floors, &Sight::new(model));
    }
    if found.spawns.is_empty() {
        let above = drawn.centre().with_y(drawn.max.y + world.body.below_eye);
        found.spawns.push(Spawn { eye: world.confines().clamp(above), yaw: 0.0 });
        found.warnings.push(
            "no floor has room for a body: visitors begin above the model; check its size, or \
             give --spawn X,Y,Z"
                .to_owned(),
        );
    }
    assert!(!found.spawns.is_empty(), "a world has a spawn point");
    Some(found)
}

impl SpawnPoints {
    /// Adds the place nearest to a spawn point that has no room.
    fn put_right(&mut self, spawn: Spawn, floors: &Floors) {
        let said = shown(spawn.eye);
        match floors.nearest(spawn.eye, MOVED_MAX_M) {
            Some(place) => {
                let eye = floors.eye(place);
                let warning = format!(
                    "the spawn point at {said} has no room for a body: moved to {}",
                    shown(eye)
                );
                self.warnings.push(warning);
                self.spawns.push(Spawn { eye, ..spawn });
            }
            None => self.warnings.push(format!(
                "the spawn point at {said} is left out: no floor within {MOVED_MAX_M} m has room \
                 for a body"
            )),
        }
    }
}

/// Whether a body has room with its eye at a point of the building. Authors put feet on the floor,
/// and the voxels of the floor reach a little higher.
fn has_room(world: &World, eye: Vec3) -> bool {
    let lift = Vec3::Y * (world.octree.voxel() + LIFT_M);
    let is_free = |eye: Vec3| !world.octree.solid_in(&world.body.around(eye));
    world.confines().contains(eye)
        && world.cells.at(eye).is_some()
        && (is_free(eye) || is_free(eye + lift))
}

/// A point as a person types it.
fn shown(at: Vec3) -> String {
    format!("{:.2},{:.2},{:.2}", at.x, at.y, at.z)
}
