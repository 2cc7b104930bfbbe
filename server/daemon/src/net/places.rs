//! Room for a body near a place.

use glam::Vec3;
use sightline_world::World;

/// How far a body may be moved to where it has room, in metres. The voxels of a quick compilation
/// are up to that thick.
const MOVED_M: f32 = 0.6;
/// The distance between places that are tried, in metres.
const STEP_M: f32 = 0.1;

/// The place nearest to another one at which a body has room; `None` when there is none near by.
pub fn room_near(world: &World, eye: Vec3) -> Option<Vec3> {
    let steps = (MOVED_M / STEP_M) as i32;
    let axis = || (-steps..=steps).map(|step| step as f32 * STEP_M);
    let mut moves: Vec<Vec3> = axis()
        .flat_map(|x| axis().flat_map(move |y| axis().map(move |z| Vec3::new(x, y, z))))
        .filter(|by| by.length() <= MOVED_M)
        .collect();
    moves.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let confines = world.confines();
    let has_room = |eye: &Vec3| {
        confines.contains(*eye)
            && world.cells.at(*eye).is_some()
            && !world.octree.solid_in(&world.body.around(*eye))
    };
    moves.into_iter().map(|by| eye + by).find(has_room)
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor;

    use super::*;

    #[test]
    fn a_body_in_the_floor_is_lifted_and_one_deep_below_has_no_room() {
        let world = voxel_floor::world(&[]);
        let free = world.spawns[0].eye;
        assert_eq!(room_near(&world, free), Some(free));
        let floor = free.y - world.body.below_eye;
        let sunk = Vec3::new(free.x, floor + world.body.below_eye - 0.25, free.z);
        let lifted = room_near(&world, sunk).expect("there is room above");
        assert!(lifted.y > sunk.y && lifted.distance(sunk) <= MOVED_M, "{lifted}");
        assert_eq!(room_near(&world, Vec3::splat(1.0e6)), None, "outside");
    }
}
