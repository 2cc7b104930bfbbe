use glam::DAffine3;
use proptest::prelude::*;
use sightline_world::{
    Mesh,
    motion::trajectory::{Joint, Playback, Trajectory},
    octree::Octree,
    rooms::{Object, ObjectSet, Room, RoomVisibility, Rooms, Shape, Window},
};

use super::*;

const VOXEL: f32 = 0.25;
/// Where voxels begin: not where the rooms do.
const SHIFT: Vec3 = Vec3::new(0.1, 0.05, 0.1);
const EYE: Vec3 = Vec3::new(1.0, 1.5, 3.0);
const CHEST: Aabb = Aabb { min: Vec3::new(2.0, 0.0, 2.0), max: Vec3::new(3.0, 1.0, 3.0) };
/// A door far thinner than a voxel, in the second room.
const DOOR: Aabb = Aabb { min: Vec3::new(9.0, 0.0, 2.0), max: Vec3::new(9.04, 2.0, 3.0) };

fn door(bounds: &Aabb) -> Mover {
    let positions = bounds.corners().to_vec();
    let joint = Joint::still(DAffine3::IDENTITY);
    let trajectory = Trajectory::new(vec![joint], 1.0, Playback::Loop).unwrap();
    let mesh = Mesh { positions, triangles: vec![[0, 1, 7]] };
    Mover::new("door".into(), mesh, vec![[9; 3]], trajectory).unwrap()
}

/// Two rooms of 6 m side by side, with a visible set, a hidden set or a window. There are two
/// objects: a chest, and a door that moves.
fn world(sees: RoomVisibility, has_window: bool) -> World {
    let mut world = sightline_fixtures::two_rooms::world();
    world.octree = Octree::empty(Vec3::ZERO, 64.0 * VOXEL, 6);
    let region = |x: f32| Aabb::new(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 6.0, 3.0, 6.0));
    let room = |name: &str, x: f32| Room {
        name: name.into(),
        shapes: vec![Shape::Box(region(x))],
        ..Room::default()
    };
    let corner = |y: f32, z: f32| Vec3::new(6.0, y, z);
    let corners = vec![corner(1.0, 2.0), corner(2.0, 2.0), corner(2.0, 4.0), corner(1.0, 4.0)];
    let window = Window { name: "w".into(), corners, behind: None };
    let windows = if has_window { vec![window] } else { Vec::new() };
    let first = Room { sees, windows, ..room("first", 0.0) };
    let object = |name: &str, bounds, mover| Object { name: name.into(), bounds, mover };
    let objects = vec![object("chest", CHEST, None), object("door", DOOR, Some(0))];
    world.movers = vec![door(&DOOR)];
    world.rooms = Rooms::new(vec![first, room("second", 6.0)], objects).unwrap();
    world
}

fn sight(world: &World, eye: Vec3) -> Option<BuildingSight> {
    BuildingSight::of(world, &RoomIndex::new(world), eye)
}

fn set(rooms: &[u16], objects: &[u32]) -> ObjectSet {
    let rooms = rooms.iter().copied().map(RoomId).collect();
    ObjectSet { rooms, objects: objects.to_vec(), ..ObjectSet::default() }
}

fn only(rooms: &[u16], objects: &[u32]) -> RoomVisibility {
    RoomVisibility::Only(set(rooms, objects))
}

fn all_but(rooms: &[u16], objects: &[u32]) -> RoomVisibility {
    RoomVisibility::AllBut(set(rooms, objects))
}

fn voxel(x: f32, y: f32, z: f32) -> Aabb {
    let low = (Vec3::new(x, y, z) / VOXEL).floor() * VOXEL + SHIFT;
    Aabb::new(low, low + VOXEL)
}

#[test]
fn a_room_without_a_set_and_an_eye_outside_are_shown_everything() {
    assert!(sight(&world(RoomVisibility::Unspecified, false), EYE).is_none());
    assert!(sight(&world(only(&[], &[]), true), Vec3::new(9.0, 1.5, 3.0)).is_none());
}

#[test]
fn a_visible_set_shows_its_walls_and_what_a_window_shows() {
    for (has_window, seen) in [(false, false), (true, true)] {
        let sight = sight(&world(only(&[], &[]), has_window), EYE).unwrap();
        assert!(sight.shows(&voxel(5.9, 1.5, 3.0)), "the wall, which reaches out of the room");
        assert!(!sight.shows(&voxel(6.3, 1.5, 0.5)), "behind the wall");
        assert_eq!(sight.shows(&voxel(9.0, 1.6, 3.0)), seen, "behind the window");
    }
}

#[test]
fn a_hidden_room_keeps_its_wall_and_a_hidden_object_the_floor_below() {
    let sight = sight(&world(all_but(&[1], &[0]), false), EYE).unwrap();
    assert!(sight.shows(&voxel(5.9, 1.5, 3.0)), "the wall to the hidden room");
    assert!(!sight.shows(&voxel(9.0, 1.5, 3.0)), "in the hidden room");
    assert!(!sight.shows(&voxel(2.9, 0.9, 2.9)), "the chest reaches out of its box");
    assert!(sight.shows(&voxel(2.5, -0.1, 2.5)), "the floor below the chest");
}

#[test]
fn a_mover_is_shown_or_hidden_for_itself_and_however_thin_it_is() {
    for (sees, is_shown, shows_around) in [
        (only(&[], &[]), false, false),
        (only(&[], &[1]), true, false),
        (only(&[1], &[]), true, true),
        (all_but(&[], &[0]), true, true),
        (all_but(&[], &[1]), false, true),
        (all_but(&[1], &[]), false, false),
    ] {
        let world = world(sees.clone(), false);
        let sight = sight(&world, EYE).unwrap();
        assert_eq!(sight.may_show(&world.movers[0]), is_shown, "{sees:?}");
        assert_eq!(sight.shows(&voxel(9.0, 1.0, 2.5)), shows_around, "{sees:?}");
    }
    let behind_the_window = world(only(&[], &[]), true);
    assert!(sight(&behind_the_window, EYE).unwrap().may_show(&behind_the_window.movers[0]));
}

/// An opaque room in the second room, with a window towards the first one.
const SCREEN: Aabb = Aabb { min: Vec3::new(7.0, 0.0, 1.0), max: Vec3::new(8.0, 2.2, 5.0) };
const SLIT: Aabb = Aabb { min: Vec3::new(7.0, 1.0, 2.5), max: Vec3::new(7.0, 2.0, 3.5) };

fn with_screen(mut world: World) -> World {
    let [low, high] = [SLIT.min, SLIT.max];
    let corners = [[low.y, low.z], [high.y, low.z], [high.y, high.z], [low.y, high.z]];
    let corners = corners.map(|[y, z]| Vec3::new(low.x, y, z)).to_vec();
    let screen = Room {
        name: "screen".into(),
        shapes: vec![Shape::Box(SCREEN)],
        windows: vec![Window { name: "slit".into(), corners, behind: None }],
        opaque: true,
        ..Room::default()
    };
    let rooms = world.rooms.list().iter().cloned().chain([screen]).collect();
    world.rooms = Rooms::new(rooms, world.rooms.objects().to_vec()).unwrap();
    world
}

/// Whether the screen stops a line of sight that begins outside.
fn is_stopped(eye: Vec3, point: Vec3) -> bool {
    let way = point - eye;
    let at_slit = eye + way * ((SLIT.min.x - eye.x) / way.x);
    let [near, far] = [SCREEN.min, SCREEN.max].map(|corner| (corner - eye) / way);
    let enters = near.min(far).max_element();
    let leaves = near.max(far).min_element();
    enters < leaves && leaves < 1.0 && !SLIT.grown(1.0e-3).contains(at_slit)
}

#[test]
fn an_opaque_room_hides_what_is_behind_it_and_not_itself() {
    let world = with_screen(world(RoomVisibility::Unspecified, false));
    let (mut hidden, mut loose) = (0, 0);
    for eye in [Vec3::new(3.0, 1.5, 3.1), Vec3::new(5.5, 2.5, 0.7), Vec3::new(6.5, 1.1, 4.2)] {
        let sight = sight(&world, eye).unwrap();
        for i in 0..24 * 12 * 24 {
            let [x, y, z] = [i % 24, i / 24 % 12, i / 288].map(|at| at as f32 * VOXEL);
            let voxel = voxel(x + 6.0, y, z);
            let points: Vec<Vec3> = voxel.corners().into_iter().chain([voxel.centre()]).collect();
            let is_all = points.iter().all(|point| is_stopped(eye, *point));
            let is_wall = SCREEN.grown(WALL_M).intersects(&voxel);
            if sight.shows(&voxel) {
                loose += u32::from(is_all && !is_wall);
            } else {
                assert!(is_all && !is_wall, "{eye} sees some of {voxel:?}");
                hidden += 1;
            }
        }
    }
    assert!(hidden > 2_000 && loose * 50 < hidden, "{hidden} hidden, {loose} shown in vain");
    assert!(sight(&world, Vec3::new(7.5, 1.5, 3.0)).is_some(), "its window restricts it");
    let mut closed = world;
    let rooms = closed.rooms.list().iter().map(|room| Room { windows: vec![], ..room.clone() });
    closed.rooms = Rooms::new(rooms.collect(), closed.rooms.objects().to_vec()).unwrap();
    assert!(sight(&closed, Vec3::new(7.5, 1.5, 3.0)).is_none(), "from inside it hides nothing");
    assert!(!sight(&closed, EYE).unwrap().may_show(&closed.movers[0]), "the door behind it");
}

proptest! {
    /// What is said of a box is true of each voxel in it.
    #[test]
    fn a_box_is_judged_as_its_voxels_are(
        low in prop::array::uniform3(-4i32..40),
        log in 0u32..4,
        which in 0usize..4,
        has_window: bool,
        is_turned: bool,
        has_screen: bool,
    ) {
        let sets = [only(&[], &[]), only(&[1], &[0]), all_but(&[1], &[0]), all_but(&[], &[0])];
        let mut world = world(sets[which].clone(), has_window);
        if is_turned {
            world.cells.axes = Axes::turned(0.3);
        }
        if has_screen {
            world = with_screen(world);
        }
        let sight = sight(&world, EYE).unwrap();
        let at = |x: i32, y: i32, z: i32| {
            let low = Vec3::from(low.map(|at| at as f32)) + Vec3::new(x as f32, y as f32, z as f32);
            Aabb::new(low * VOXEL + SHIFT, (low + 1.0) * VOXEL + SHIFT)
        };
        let side = 1 << log;
        let places = (0..side * side * side).map(|i| (i / side / side, i / side % side, i % side));
        let shown: Vec<bool> = places.map(|(x, y, z)| sight.shows(&at(x, y, z))).collect();
        let whole = at(0, 0, 0).union(&at(side - 1, side - 1, side - 1));
        match sight.containment(&whole) {
            Containment::Inside => prop_assert!(shown.iter().all(|shown| *shown)),
            Containment::Outside => prop_assert!(!shown.contains(&true)),
            Containment::Partial => {}
        }
    }
}
