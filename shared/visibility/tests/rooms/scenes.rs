//! One small scene for each use of rooms and windows, and for each claim of Menon and Rossignac
//! 1999. Their answers can be checked by hand.
//!
//! Each scene leaves a picture: the eye is red, what is visible at its height is green, windows are
//! blue. Boxes that must be visible are dark green, and those that must be hidden are grey.

use glam::Vec3;
use sightline_visibility::{
    Containment,
    rooms::{RoomIndex, depth, region::BooleanRegion, sight::Viewpoint},
};
use sightline_world::{
    CellId, World,
    geometry::{Aabb, Frustum},
    rooms::{Object, ObjectSet, Room, RoomId, RoomVisibility, Rooms, Shape, Window},
};

use crate::{
    picture::Picture,
    stage::{at, block, may_see, plan, room, seeing, window, world},
};

const AREA: [[f32; 2]; 2] = [[-10.0, -10.0], [10.0, 10.0]];

/// Checks what is visible to eyes that look all round, and draws it.
fn check(name: &str, rooms: Rooms, eyes: Aabb, targets: &[(Aabb, bool)]) {
    let world = world(rooms, 0.0);
    let index = RoomIndex::new(&world);
    let shows = |point: Vec3| may_see(&world, &index, eyes, at(point));
    Picture { rooms: &world.rooms, eyes, targets, area: AREA, shows: &shows }.save(name);
    for (target, expected) in targets {
        assert_eq!(may_see(&world, &index, eyes, *target), *expected, "{name}: {target:?}");
    }
}

fn rooms(list: Vec<Room>) -> Rooms {
    Rooms::new(list, Vec::new()).unwrap()
}

fn cube(x: f32, z: f32) -> Aabb {
    Aabb::around(Vec3::new(x, 1.5, z), 0.4)
}

fn eye(x: f32, z: f32) -> Aabb {
    at(Vec3::new(x, 1.5, z))
}

fn named(name: &str, bounds: Aabb) -> Object {
    Object { name: name.into(), bounds, mover: None }
}

fn only_rooms(ids: &[u16]) -> RoomVisibility {
    RoomVisibility::Only(ObjectSet {
        rooms: ids.iter().copied().map(RoomId).collect(),
        ..ObjectSet::default()
    })
}

fn hall() -> Shape {
    block([-3.0, 0.0, -3.0], [3.0, 3.0, 3.0])
}

/// Claims 1, 4, 9, 12 and FIG. 4: a room that is a volume, with a beam, a pipe and a pump. Only the
/// beam and the pipe are in its visible set. Members of the set need not lie in the room.
#[test]
fn a_visible_set_of_objects() {
    let [beam, pipe, pump] = [cube(-1.0, -1.0), cube(7.0, 7.0), cube(-7.0, 1.0)];
    let objects = vec![named("beam", beam), named("pipe", pipe)];
    let set = ObjectSet { objects: vec![0, 1], ..ObjectSet::default() };
    let a = seeing(room("A", vec![hall()]), RoomVisibility::Only(set), vec![]);
    let targets = [(beam, true), (pipe, true), (pump, false)];
    check("visible-set", Rooms::new(vec![a], objects).unwrap(), eye(0.0, 0.0), &targets);
}

/// Claim 1 with a hidden set: the set names what is hidden. A body is hidden only if it lies
/// entirely in a member.
#[test]
fn a_hidden_set() {
    let pump = Aabb::around(Vec3::new(-7.0, 1.5, 1.0), 1.0);
    let set = ObjectSet { objects: vec![0], ..ObjectSet::default() };
    let a = seeing(room("A", vec![hall()]), RoomVisibility::AllBut(set), vec![]);
    let targets = [(cube(7.0, 7.0), true), (cube(-7.0, 1.0), false), (cube(-6.0, 1.0), true)];
    let rooms = Rooms::new(vec![a], vec![named("pump", pump)]).unwrap();
    check("hidden-set", rooms, eye(0.0, 0.0), &targets);
}

/// A set of rooms: all of another room is visible, however far away it is.
#[test]
fn a_set_of_rooms() {
    let a = seeing(room("A", vec![hall()]), only_rooms(&[1]), vec![]);
    let b = room("B", vec![block([5.0, 0.0, 5.0], [9.0, 3.0, 9.0])]);
    let targets = [(cube(7.0, 7.0), true), (cube(5.0, 7.0), true), (cube(-7.0, 7.0), false)];
    check("set-of-rooms", rooms(vec![a, b]), eye(0.0, 0.0), &targets);
}

#[test]
fn a_set_of_cells() {
    let set = |cell| ObjectSet { cells: vec![CellId(cell)], ..ObjectSet::default() };
    let a = seeing(room("A", vec![hall()]), RoomVisibility::Only(set(0)), vec![]);
    // The one cell is the whole world.
    check("set-of-cells", rooms(vec![a]), eye(0.0, 0.0), &[(cube(7.0, 7.0), true)]);
    let b = seeing(room("A", vec![hall()]), RoomVisibility::AllBut(set(0)), vec![]);
    check("set-of-hidden-cells", rooms(vec![b]), eye(0.0, 0.0), &[(cube(7.0, 7.0), false)]);
}

/// Claims 2, 3, 10 and 11: a rectangle of the plan is a room at every height.
#[test]
fn a_rectangle_of_the_plan() {
    let corners = [[-3.0, -2.0], [3.0, -2.0], [3.0, 2.0], [-3.0, 2.0]];
    let a = seeing(room("A", vec![plan(&corners, None)]), only_rooms(&[]), vec![]);
    let rooms = rooms(vec![a]);
    for height in [-20.0, 1.5, 25.0] {
        let eyes = at(Vec3::new(0.0, height, 0.0));
        check("rectangle", rooms.clone(), eyes, &[(cube(1.0, 1.0), true), (cube(7.0, 1.0), false)]);
    }
    check("rectangle-outside", rooms, eye(0.0, 4.0), &[(cube(7.0, 1.0), true)]);
}

/// A polygon with a height need not be convex. An eye above it is not in the room.
#[test]
fn a_polygon_with_a_height() {
    let l = [[-4.0, -4.0], [4.0, -4.0], [4.0, -1.0], [-1.0, -1.0], [-1.0, 4.0], [-4.0, 4.0]];
    let a = seeing(room("L", vec![plan(&l, Some([0.0, 3.0]))]), only_rooms(&[]), vec![]);
    let rooms = rooms(vec![a]);
    let targets = [(cube(3.0, -3.0), true), (cube(2.0, 2.0), false)];
    check("polygon", rooms.clone(), eye(-3.0, 3.0), &targets);
    check("polygon-notch", rooms.clone(), eye(2.0, 2.0), &[(cube(7.0, 7.0), true)]);
    let above = at(Vec3::new(-3.0, 4.0, 3.0));
    check("polygon-above", rooms, above, &[(cube(2.0, 2.0), true)]);
}

/// A pyramid: a volume with slanted sides.
#[test]
fn a_convex_hull() {
    let base = [[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]];
    let mut points: Vec<Vec3> = base.iter().map(|[x, z]| Vec3::new(*x, 0.0, *z)).collect();
    points.push(Vec3::new(0.0, 4.0, 0.0));
    let a = seeing(room("tent", vec![Shape::Hull(points)]), only_rooms(&[]), vec![]);
    let rooms = rooms(vec![a]);
    check("hull", rooms.clone(), eye(1.0, 1.0), &[(cube(7.0, 7.0), false)]);
    // In the box around the pyramid, but beside its slope.
    check("hull-beside", rooms, eye(3.5, 3.5), &[(cube(7.0, 7.0), true)]);
}

/// A room does not affect viewers outside it, and neither do its windows.
#[test]
fn outside_a_room_it_has_no_effect() {
    let east = window("east", [[3.0, -1.0], [3.0, 1.0]], [1.0, 2.0]);
    let a = seeing(room("A", vec![hall()]), only_rooms(&[]), vec![east]);
    let targets = [(cube(0.0, 0.0), true), (cube(-7.0, 7.0), true), (cube(7.0, 7.0), true)];
    check("outside", rooms(vec![a]), eye(6.0, 0.0), &targets);
}

/// A viewer in several rooms sees what any of them shows.
#[test]
fn in_several_rooms_the_union_is_visible() {
    let a = seeing(room("A", vec![hall()]), only_rooms(&[2]), vec![]);
    let east = block([0.0, 0.0, -2.0], [6.0, 3.0, 2.0]);
    let b = seeing(room("B", vec![east]), only_rooms(&[3]), vec![]);
    let c = room("C", vec![block([-9.0, 0.0, 5.0], [-5.0, 3.0, 9.0])]);
    let d = room("D", vec![block([5.0, 0.0, 5.0], [9.0, 3.0, 9.0])]);
    let rooms = rooms(vec![a, b, c, d]);
    let [c, d, elsewhere] = [cube(-7.0, 7.0), cube(7.0, 7.0), cube(0.0, -7.0)];
    let both = [(c, true), (d, true), (elsewhere, false)];
    check("several-rooms", rooms.clone(), eye(1.0, 0.0), &both);
    check("several-rooms-a", rooms.clone(), eye(-1.0, 0.0), &[(c, true), (d, false)]);
    check("several-rooms-b", rooms, eye(5.0, 0.0), &[(c, false), (d, true)]);
}

/// Claims 5 and 13, FIG. 6A: a square window shows what lies beyond it, and no more.
#[test]
fn a_window() {
    let east = window("east", [[3.0, -1.0], [3.0, 1.0]], [0.5, 2.5]);
    let a = seeing(room("A", vec![hall()]), RoomVisibility::Unspecified, vec![east]);
    // The window is 2 m wide at a distance of 3 m, so it shows 6 m at a distance of 9 m.
    let targets = [
        (cube(1.0, -2.0), true),
        (cube(9.0, 0.0), true),
        (cube(9.0, 3.3), true),
        (cube(9.0, 3.6), false),
        (cube(9.0, -3.3), true),
        (cube(9.0, -3.6), false),
        (cube(-9.0, 0.0), false),
    ];
    check("window", rooms(vec![a.clone()]), eye(0.0, 0.0), &targets);
    // A box of eyes may see more.
    let eyes = Aabb::new(Vec3::new(-1.0, 1.0, -1.0), Vec3::new(1.0, 2.0, 1.0));
    let targets = [(cube(9.0, 7.3), true), (cube(9.0, 7.9), false), (cube(-9.0, 0.0), false)];
    check("window-eye-box", rooms(vec![a]), eyes, &targets);
}

/// A body that is partly in a room into which no window leads may be visible beyond that room.
#[test]
fn a_window_may_show_the_part_of_a_body_outside_a_room_it_does_not_lead_to() {
    let east = window("east", [[3.0, -1.0], [3.0, 1.0]], [0.5, 2.5]);
    let a = seeing(room("A", vec![hall()]), RoomVisibility::Unspecified, vec![east]);
    let shed = room("shed", vec![block([1.0, 0.0, 3.2], [2.9, 3.0, 6.0])]);
    let body = |x: f32| Aabb::new(Vec3::new(1.5, 1.1, 3.3), Vec3::new(x, 1.9, 3.7));
    // One body reaches along the wall of the shed to where the window shows it. The other does not.
    let targets = [(body(10.5), true), (body(2.8), false), (cube(2.0, 5.0), false)];
    check("window-partly", rooms(vec![a, shed]), eye(0.0, 0.0), &targets);
}

/// Claims 6, 7, 14 and 15, FIG. 6B: only the part of the window in the field of view counts, and
/// the region is a boolean combination of half-spaces.
#[test]
fn a_window_in_a_field_of_view() {
    let east = window("east", [[3.0, -3.0], [3.0, 3.0]], [0.5, 2.5]);
    let a = seeing(room("A", vec![hall()]), RoomVisibility::Unspecified, vec![east]);
    let world = world(rooms(vec![a]), 0.0);
    let index = RoomIndex::new(&world);
    let look = |yaw: f32| {
        let field = Frustum::new(yaw, 0.0, 1.0, 1.2);
        Viewpoint::looking(eye(0.0, 0.0), &field, &world.cells.axes)
    };
    // Looks south-east.
    let viewpoint = look(-2.2);
    let seen = index.seen(RoomId(0), &viewpoint);
    let targets = [(cube(8.0, 7.0), true), (cube(8.0, 0.0), false), (cube(2.0, 8.0), false)];
    let shows = |point: Vec3| seen.contains(point);
    let eyes = eye(0.0, 0.0);
    Picture { rooms: &world.rooms, eyes, targets: &targets, area: AREA, shows: &shows }
        .save("field");
    for (target, expected) in targets {
        assert_eq!(seen.meets(&target), expected, "{target:?}");
    }
    assert!(matches!(&seen, BooleanRegion::Any(parts) if parts.len() == 1), "{seen:?}");
    assert_eq!(index.windows_in_view(RoomId(0), &viewpoint), [0]);
    let away = look(std::f32::consts::FRAC_PI_2);
    assert_eq!(index.windows_in_view(RoomId(0), &away), [] as [u32; 0]);
    assert_eq!(index.seen(RoomId(0), &away), BooleanRegion::NOWHERE);
    the_simplified_region_is_larger(&seen);
}

fn the_simplified_region_is_larger(seen: &BooleanRegion) {
    for planes in 0..=seen.planes() {
        let simple = seen.simplified(planes);
        assert!(simple.planes() <= planes);
        let inside = (0..20_000u64).filter(|i| {
            let share = |step: u64| (i * step % 9973) as f32 / 9973.0 * 40.0 - 20.0;
            let point = Vec3::new(share(7919), share(104_729) * 0.3, share(1_299_709));
            assert!(!seen.contains(point) || simple.contains(point), "{planes} planes, {point}");
            seen.contains(point)
        });
        assert!(inside.count() > 500);
    }
    assert_eq!(seen.simplified(0), BooleanRegion::EVERYWHERE);
    assert_eq!(seen.simplified(99), *seen);
}

/// FIG. 9: a C-shaped room, open to the east between its two arms. From the upper arm, an eye looks
/// down through B out of the room, through C into the lower arm, and through D out of that.
fn c_shaped(tree: bool) -> Rooms {
    let outline = [
        [-8.0, -8.0],
        [8.0, -8.0],
        [8.0, -4.0],
        [-4.0, -4.0],
        [-4.0, 2.0],
        [8.0, 2.0],
        [8.0, 6.0],
        [-8.0, 6.0],
    ];
    let behind = |at: u32| tree.then_some(at);
    let a = window("A", [[8.0, -7.0], [8.0, -5.0]], [0.0, 3.0]);
    let b = window("B", [[-2.0, -4.0], [6.0, -4.0]], [0.0, 3.0]);
    let c = Window { behind: behind(1), ..window("C", [[-3.0, 2.0], [7.0, 2.0]], [0.0, 3.0]) };
    let d = Window { behind: behind(2), ..window("D", [[0.0, 6.0], [3.0, 6.0]], [0.0, 3.0]) };
    let shape = plan(&outline, Some([0.0, 3.0]));
    rooms(vec![seeing(room("R", vec![shape]), RoomVisibility::Unspecified, vec![a, b, c, d])])
}

#[test]
fn the_tree_of_windows_of_a_room_that_is_not_convex() {
    let targets = [
        // Between the arms, seen through B.
        (cube(2.0, -1.0), true),
        // In the lower arm: the room always shows itself.
        (cube(2.0, 4.0), true),
        // Beyond the lower arm, through B, C and D.
        (cube(1.4, 8.0), true),
        // Beside D, where the wall of the lower arm is.
        (cube(6.0, 9.0), false),
        (cube(-2.0, 9.0), false),
        // Through A.
        (cube(9.0, -6.0), true),
        (cube(9.0, 9.0), false),
    ];
    check("tree", c_shaped(true), eye(2.0, -6.0), &targets);
    // Without the tree, everything beyond B is visible: more, not less.
    let targets = targets.map(|(target, seen)| (target, seen || target.min.x > -3.0));
    check("tree-flat", c_shaped(false), eye(2.0, -6.0), &targets[..6]);
    let world = world(c_shaped(true), 0.0);
    let index = RoomIndex::new(&world);
    let viewpoint = Viewpoint::all_round(eye(2.0, -6.0));
    assert_eq!(index.windows_in_view(RoomId(0), &viewpoint), [1, 0], "the nearest first");
    // The region and the engine's question agree at every point.
    let seen = index.seen(RoomId(0), &viewpoint);
    let mut inside = 0;
    for i in 0..4_000 {
        let place = |step: u32| (i * step % 997) as f32 / 997.0 * 20.0 - 10.0;
        let point = Vec3::new(place(631), 1.5, place(389));
        let is_room = index.pieces(RoomId(0)).iter().any(|piece| piece.contains(point));
        let asked = may_see(&world, &index, viewpoint.eyes, at(point));
        assert_eq!(is_room || seen.contains(point), asked, "{point}");
        inside += u32::from(asked);
    }
    assert!((500..3_500).contains(&inside), "{inside}");
}

/// FIG. 7, steps 703 and 705: rooms sorted by depth, and those that a nearer one hides.
#[test]
fn rooms_in_depth() {
    let screen = |windows| Room {
        opaque: true,
        windows,
        ..room("screen", vec![block([2.0, 0.0, -3.0], [3.0, 3.0, 3.0])])
    };
    let far = room("far", vec![block([6.0, 0.5, -1.0], [8.0, 2.5, 1.0])]);
    let beside = room("beside", vec![block([6.0, 0.5, 8.0], [8.0, 2.5, 10.0])]);
    let here = room("here", vec![block([-1.0, 0.0, -1.0], [1.0, 3.0, 1.0])]);
    let order = |windows| {
        let world =
            world(rooms(vec![far.clone(), screen(windows), beside.clone(), here.clone()]), 0.0);
        let index = RoomIndex::new(&world);
        let eyes = eye(0.0, 0.0);
        let found = depth::depth_order(&index, eyes.min);
        let shows = |point: Vec3| {
            let hidden = found.iter().filter(|room| room.hidden_by.is_some());
            let mut hidden = hidden.flat_map(|room| index.pieces(room.room));
            !hidden.any(|piece| piece.contains(point))
        };
        let name = format!("depth-{}", found[2].hidden_by.is_some());
        Picture { rooms: &world.rooms, eyes, targets: &[], area: AREA, shows: &shows }.save(&name);
        found
    };
    let closed = order(vec![]);
    let names: Vec<u16> = closed.iter().map(|room| room.room.0).collect();
    assert_eq!(names, [3, 1, 0, 2]);
    assert_eq!(closed[0].distance_m, 0.0);
    assert_eq!(closed[1].distance_m, 2.0);
    let hidden: Vec<_> = closed.iter().map(|room| room.hidden_by).collect();
    assert_eq!(hidden, [None, None, Some(RoomId(1)), None]);
    // A window that faces the eye lets sight lines pass. One that does not face it changes nothing.
    let facing = order(vec![window("w", [[2.0, -1.0], [2.0, 1.0]], [0.5, 2.5])]);
    assert!(facing.iter().all(|room| room.hidden_by.is_none()), "{facing:?}");
    let back = order(vec![window("w", [[3.0, -1.0], [3.0, 1.0]], [0.5, 2.5])]);
    assert_eq!(back[2].hidden_by, Some(RoomId(1)));
}

/// Nobody outside is told about anybody inside, nor the other way round, whatever sets and windows
/// say. For a region across the wall, it is the true position that decides.
#[test]
fn a_sealed_room() {
    let glass = window("glass", [[3.0, -2.0], [3.0, 2.0]], [0.5, 2.5]);
    let sealed = Room {
        sealed: true,
        ..seeing(
            room("meeting", vec![hall()]),
            RoomVisibility::AllBut(ObjectSet::default()),
            vec![glass],
        )
    };
    let world = world(rooms(vec![sealed]), 0.0);
    let index = RoomIndex::new(&world);
    let [inside, outside] = [cube(1.0, 1.0), cube(6.0, 0.0)];
    let across = Aabb::new(Vec3::new(2.0, 1.0, 0.0), Vec3::new(4.0, 2.0, 1.0));
    let rows = [
        (inside, inside, true),
        (inside, outside, false),
        (outside, inside, false),
        (outside, cube(-7.0, 7.0), true),
        (across, inside, true),
        (across, outside, true),
        (inside, across, true),
    ];
    for (eyes, body, expected) in rows {
        assert_eq!(may_see(&world, &index, eyes, body), expected, "{eyes:?} {body:?}");
    }
    let eyes = eye(0.0, 0.0);
    let shows = |point: Vec3| may_see(&world, &index, eyes, at(point));
    let targets = [(inside, true), (outside, false)];
    Picture { rooms: &world.rooms, eyes, targets: &targets, area: AREA, shows: &shows }
        .save("sealed");
    let seal = |x: f32| index.sealed_rooms_at(Vec3::new(x, 1.5, 0.0));
    assert!(seal(2.9).agrees(&seal(-2.9)) && seal(3.1).agrees(&seal(-9.0)));
    assert!(!seal(2.9).agrees(&seal(3.1)) && !seal(3.1).agrees(&seal(2.9)));
    assert!(seal(3.1).is_open() && !seal(2.9).is_open());
}

/// Sealed rooms within each other make three kinds of places. None of them is told about another.
#[test]
fn sealed_rooms_within_each_other() {
    let sealed = |name: &str, half: f32| Room {
        sealed: true,
        ..room(name, vec![block([-half, 0.0, -half], [half, 3.0, half])])
    };
    let list: Vec<Room> = (1..=6u8).map(|i| sealed(&format!("{i}"), f32::from(i))).collect();
    let index = |list: &[Room]| RoomIndex::new(&world(rooms(list.to_vec()), 0.0));
    let three = index(&list[..3]);
    for (i, a) in [0.5, 1.5, 2.5, 3.5].into_iter().enumerate() {
        for (j, b) in [-0.5, -1.5, -2.5, -3.5].into_iter().enumerate() {
            let seal = |x: f32| three.sealed_rooms_at(Vec3::new(x, 1.5, 0.0));
            assert_eq!(seal(a).agrees(&seal(b)), i == j, "{a} {b}");
        }
    }
    // A point in too many sealed rooms agrees with none, so that no room is forgotten.
    let six = index(&list);
    let seal = |x: f32| six.sealed_rooms_at(Vec3::new(x, 1.5, 0.0));
    assert!(!seal(0.5).agrees(&seal(0.5)) && seal(5.5).agrees(&seal(-5.5)));
}

/// A room with an empty set and without windows still shows itself. One that hides itself does not.
#[test]
fn a_room_shows_itself_unless_its_set_hides_it() {
    let a = seeing(room("A", vec![hall()]), only_rooms(&[]), vec![]);
    check("itself", rooms(vec![a]), eye(0.0, 0.0), &[(cube(2.0, 2.0), true)]);
    let set = ObjectSet { rooms: vec![RoomId(0)], ..ObjectSet::default() };
    let b = seeing(room("confessional", vec![hall()]), RoomVisibility::AllBut(set), vec![]);
    let targets = [(cube(2.0, 2.0), false), (cube(2.9, 2.0), true), (cube(7.0, 2.0), true)];
    check("not-itself", rooms(vec![b]), eye(0.0, 0.0), &targets);
}

/// A room with nothing but a name restricts nothing.
#[test]
fn a_room_without_set_windows_or_seal_restricts_nothing() {
    let office = room("office", vec![block([-9.0, 0.0, -9.0], [9.0, 9.0, 9.0])]);
    let a = seeing(room("A", vec![hall()]), only_rooms(&[]), vec![]);
    let list = rooms(vec![office, a]);
    check("nothing-said", list.clone(), eye(0.0, 0.0), &[(cube(7.0, 2.0), false)]);
    check("nothing-said-outside", list.clone(), eye(5.0, 0.0), &[(cube(7.0, 2.0), true)]);
    let index = RoomIndex::new(&world(list, 0.0));
    assert_eq!(index.room_at(Vec3::new(0.0, 1.0, 0.0)), Some(RoomId(1)), "the smallest");
    assert_eq!(index.room_at(Vec3::new(5.0, 1.0, 0.0)), Some(RoomId(0)));
    assert_eq!(index.room_at(Vec3::new(15.0, 1.0, 0.0)), None);
}

/// A window that is not convex.
#[test]
fn a_window_like_an_arrow() {
    let corners = [[0.5, -2.0], [2.5, 0.0], [0.5, 2.0], [1.2, 0.0]];
    let corners = corners.iter().map(|[y, z]| Vec3::new(3.0, *y, *z)).collect();
    let arrow = Window { name: "arrow".into(), corners, behind: None };
    let a = seeing(room("A", vec![hall()]), RoomVisibility::Unspecified, vec![arrow]);
    let low = |z: f32| Aabb::around(Vec3::new(6.0, 0.7, z), 0.1);
    // Nothing is seen through the notch between the wings.
    let targets = [(cube(6.0, 0.0), true), (low(0.0), false), (low(-2.6), true), (low(2.6), true)];
    check("arrow", rooms(vec![a]), eye(0.0, 0.0), &targets);
}

/// A region says whether a box is inside, outside, or neither.
#[test]
fn boxes_are_inside_outside_or_partly_inside() {
    let world: World = world(c_shaped(true), 0.0);
    let index = RoomIndex::new(&world);
    let seen = index.seen(RoomId(0), &Viewpoint::all_round(eye(2.0, -6.0)));
    assert_eq!(seen.containment(&cube(2.0, -1.0)), Containment::Inside);
    assert_eq!(seen.containment(&cube(6.0, 9.0)), Containment::Outside);
    assert_eq!(seen.containment(&Aabb::around(Vec3::ZERO, 9.0)), Containment::Partial);
}
