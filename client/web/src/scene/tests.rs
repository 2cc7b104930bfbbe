use glam::Vec3;
use sightline_fixtures::voxel_floor;
use sightline_world::{
    geometry::Aabb,
    rooms::{ObjectSet, RoomVisibility, Rooms, Shape},
};

use super::*;

const SIZE: (usize, usize) = (64, 48);

/// A scene on a floor of which an eye at the beginning may see the half around it.
fn scene(has_room: bool) -> Scene {
    let mut world = voxel_floor::world(&[]);
    let half = Aabb::new(Vec3::new(0.0, 0.0, 3.0), Vec3::splat(8.0));
    let room = Room {
        name: "half".into(),
        shapes: vec![Shape::Box(half)],
        sees: RoomVisibility::Only(ObjectSet::default()),
        ..Room::default()
    };
    let rooms = if has_room { vec![room] } else { Vec::new() };
    world.rooms = Rooms::new(rooms, Vec::new()).unwrap();
    let pose = Pose { eye: voxel_floor::SPAWN.eye, ..Pose::default() };
    Scene::new(Arc::new(world), pose)
}

/// The picture at a time, if it differs from the one before.
fn drawn(scene: &mut Scene, seconds: u64) -> Option<Vec<[u8; 4]>> {
    let is_new = scene.draw(None, Duration::from_secs(seconds), SIZE);
    is_new.then(|| scene.pixels().to_vec())
}

#[test]
fn what_a_room_hides_is_drawn_when_that_is_asked_for() {
    let mut open = scene(false);
    let whole = drawn(&mut open, 1).unwrap();
    assert!(!open.toggle_hidden(), "there are no rooms");

    let mut scene = scene(true);
    let part = drawn(&mut scene, 1).unwrap();
    assert_ne!(part, whole);
    assert_eq!(drawn(&mut scene, 2), None, "nothing has changed");
    assert!(scene.toggle_hidden());
    assert_eq!(drawn(&mut scene, 3), Some(whole));
    scene.toggle_hidden();
    assert_eq!(drawn(&mut scene, 4), Some(part));
}
