use glam::Vec3;
use sightline_fixtures::voxel_floor;
use sightline_world::{
    WorldHead,
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
    Scene::new(ArrivingWorld::whole(Arc::new(world)), None, pose)
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

#[test]
fn a_scene_that_arrives_shows_nothing_at_first_and_in_the_end_what_a_whole_one_shows() {
    let mut whole = scene(false);
    let expected = drawn(&mut whole, 1).unwrap();
    let cut = sightline_visibility::streaming::pieces_of(whole.building.world(), &[]);
    let building = ArrivingWorld::from_head(WorldHead::read(&cut.head).unwrap());
    let pose = Pose { eye: voxel_floor::SPAWN.eye, ..Pose::default() };
    let mut scene = Scene::new(building, Some(PieceId::of(&cut.head)), pose);
    scene.set_full_size(SIZE);
    let nothing = drawn(&mut scene, 1).unwrap();
    assert!(nothing.iter().all(|pixel| *pixel == nothing[0]) && !scene.is_open());
    let asked = scene.next_pieces(1);
    assert!(scene.next_pieces(1).is_empty(), "it is under way");
    scene.give_pieces(&asked, None, &[]).unwrap();
    assert_eq!(scene.next_pieces(1), asked, "it could not be had");
    scene.give_pieces(&asked, None, &[]).unwrap();
    assert!(scene.give_pieces(&asked, Some(&[1, 2]), &[]).is_err(), "too short");
    scene.give_pieces(&asked, None, &[]).unwrap();
    let start = scene.walk.pose();
    let mut last = Vec::new();
    for second in 2.. {
        if !scene.is_open() {
            let ways = [1.0, 0.0, 0.0];
            scene.step(Duration::from_secs(second), ways, false, false, false);
            assert_eq!(scene.walk.pose().eye, start.eye, "a body waits");
        }
        let asked = scene.next_pieces(4_096);
        if asked.is_empty() {
            break;
        }
        let bytes: Vec<u8> =
            asked.iter().flat_map(|number| cut.pieces[*number].iter().copied()).collect();
        scene.give_pieces(&asked, Some(&bytes), &[]).unwrap();
        scene.take_pieces().unwrap();
        last = drawn(&mut scene, second).unwrap_or(last);
    }
    assert!(last == expected);
}

#[test]
fn what_the_server_refuses_is_not_in_its_answer_and_waits() {
    let whole = scene(false);
    let cut = sightline_visibility::streaming::pieces_of(whole.building.world(), &[]);
    let building = ArrivingWorld::from_head(WorldHead::read(&cut.head).unwrap());
    let pose = Pose { eye: voxel_floor::SPAWN.eye, ..Pose::default() };
    let mut scene = Scene::new(building, Some(PieceId::of(&cut.head)), pose);
    scene.set_full_size(SIZE);
    let asked = scene.next_pieces(1 << 20);
    let (refused, given) = asked.split_at(1);
    let bytes = given.iter().flat_map(|number| cut.pieces[*number].iter().copied());
    scene.give_pieces(&asked, Some(&bytes.collect::<Vec<_>>()), refused).unwrap();
    scene.take_pieces().unwrap();
    assert_eq!(scene.building.taken(), given.len() as u64);
    assert!(!given.is_empty() && !scene.next_pieces(1 << 20).contains(&refused[0]));
}

#[test]
fn the_plan_of_a_scene_that_arrives_is_a_piece_and_asks_for_no_other() {
    let whole = scene(false);
    let cut = sightline_visibility::streaming::pieces_of(whole.building.world(), &[0.125]);
    let fetched = |wants_plan: bool| {
        let building = ArrivingWorld::from_head(WorldHead::read(&cut.head).unwrap());
        let pose = Pose { eye: voxel_floor::SPAWN.eye, ..Pose::default() };
        let mut scene = Scene::new(building, Some(PieceId::of(&cut.head)), pose);
        scene.set_full_size(SIZE);
        let mut fetched = Vec::new();
        for second in 1.. {
            drawn(&mut scene, second);
            if wants_plan && scene.make_plan(1) {
                assert!(scene.building.complete().is_none() && !scene.make_plan(1), "once");
            }
            let asked = scene.next_pieces(4_096);
            if asked.is_empty() {
                break;
            }
            let pieces = asked.iter().flat_map(|number| cut.pieces[*number].iter().copied());
            scene.give_pieces(&asked, Some(&pieces.collect::<Vec<_>>()), &[]).unwrap();
            scene.take_pieces().unwrap();
            fetched.extend(asked);
        }
        fetched.sort_unstable();
        (fetched, scene)
    };
    let (without, bare) = fetched(false);
    let (with, scene) = fetched(true);
    let plan = cut.pieces.len() - 1;
    assert_eq!(with, [without.as_slice(), &[plan]].concat());
    assert!(with.len() < cut.pieces.len() && bare.plan_place().is_none());
    let expected = Plan::new(whole.building.world(), 0.125);
    let place = scene.plan_place().unwrap();
    assert_eq!([place.columns, place.rows], expected.size());
    assert_eq!(scene.plan_pixels().len(), 4 * place.columns * place.rows);
}
