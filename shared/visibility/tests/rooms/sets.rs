//! Visibility sets: one is kept for a viewpoint, and the union of two is used on the way between
//! them.

use glam::Vec3;
use sightline_visibility::rooms::{
    RoomIndex,
    sets::{ViewpointTolerance, VisibilitySet, VisibilitySets},
};
use sightline_world::{
    World,
    motion::Pose,
    rooms::{Object, ObjectSet, Room, RoomId, RoomVisibility, Rooms},
};

use crate::{
    picture::Picture,
    stage::{at, block, room, window, world},
};

/// Two rooms side by side, each with a window on its outer side, and three objects outside.
fn pair() -> World {
    let west = Room {
        windows: vec![window("w", [[-6.0, -1.0], [-6.0, 1.0]], [0.5, 2.5])],
        ..room("west", vec![block([-6.0, 0.0, -2.0], [0.0, 3.0, 2.0])])
    };
    let east = Room {
        windows: vec![window("e", [[6.0, -1.0], [6.0, 1.0]], [0.5, 2.5])],
        sees: RoomVisibility::Only(ObjectSet { rooms: vec![RoomId(0)], ..ObjectSet::default() }),
        ..room("east", vec![block([0.0, 0.0, -2.0], [6.0, 3.0, 2.0])])
    };
    let object = |name: &str, x: f32, z: f32| Object {
        name: name.into(),
        bounds: sightline_world::geometry::Aabb::around(Vec3::new(x, 1.5, z), 0.5),
        mover: None,
    };
    let objects =
        vec![object("left", -8.5, 0.0), object("right", 8.5, 0.0), object("off", 0.0, 8.0)];
    world(Rooms::new(vec![west, east], objects).unwrap(), 0.0)
}

fn pose(x: f32, yaw: f32) -> Pose {
    Pose { eye: Vec3::new(x, 1.5, 0.0), yaw, ..Pose::default() }
}

fn objects(set: &VisibilitySet) -> Vec<u32> {
    set.objects.iter().collect()
}

/// Menon and Rossignac 1999, claims 8 and 16, and FIG. 8.
#[test]
fn sets_are_kept_and_joined() {
    let world = pair();
    let index = RoomIndex::new(&world);
    let tolerance = ViewpointTolerance { eye_m: 0.25, look: 0.1 };
    let mut sets = VisibilitySets::new(tolerance, [7.0, 7.0]);
    let (first, second) = (pose(-3.0, 0.0), pose(3.0, 0.0));
    assert_eq!(objects(sets.at(&world, &index, &first)), [0]);
    assert_eq!(objects(sets.at(&world, &index, &second)), [1]);
    assert_eq!(sets.made(), 2);
    // Near the first viewpoint, looking a little aside: its set is used again.
    for near in [pose(-3.2, 0.05), pose(-2.8, 6.2), first] {
        assert_eq!(objects(sets.at(&world, &index, &near)), [0]);
    }
    assert_eq!(sets.made(), 2);
    assert_eq!(objects(sets.at(&world, &index, &pose(-2.5, 0.0))), [0]);
    assert_eq!(sets.made(), 3, "too far from the first");
    let way = sets.between(&world, &index, &first, &second);
    assert_eq!(objects(&way), [0, 1]);
    let eyes = at(first.eye);
    let shows = |point: Vec3| {
        way.objects.iter().any(|i| world.rooms.objects()[i as usize].bounds.contains(point))
    };
    let area = [[-10.0, -10.0], [10.0, 10.0]];
    Picture { rooms: &world.rooms, eyes, targets: &[], area, shows: &shows }
        .save("between-two-sets");
}

/// Whatever is visible near a viewpoint, or on the way from one to another, is in the set.
#[test]
fn a_set_is_good_for_all_viewpoints_that_share_it() {
    let world = pair();
    let index = RoomIndex::new(&world);
    let field = [1.4, 0.9];
    let mut seen = [0, 0];
    for step in 0..60 {
        let angle = step as f32 * 0.7;
        let tolerance = ViewpointTolerance { eye_m: 0.3, look: 0.08 };
        let mut sets = VisibilitySets::new(tolerance, field);
        let mut exact = VisibilitySets::new(ViewpointTolerance { eye_m: 0.0, look: 0.0 }, field);
        let from = Pose { pitch: angle.sin(), ..pose(-5.0 + step as f32 * 0.15, angle) };
        let near = Pose {
            eye: from.eye + Vec3::new(0.29, -0.29, 0.29),
            yaw: from.yaw + 0.079,
            pitch: from.pitch - 0.079,
            ..from
        };
        let kept = sets.at(&world, &index, &from).clone();
        let there = exact.at(&world, &index, &near).clone();
        assert_eq!(&kept.union(&there), &kept, "step {step}");
        let to = Pose { pitch: -0.3, ..pose(4.0, angle + 1.5) };
        let way = sets.between(&world, &index, &from, &to);
        for share in 0..=20 {
            let share = share as f32 / 20.0;
            let eye = from.eye.lerp(to.eye, share);
            let pitch = from.pitch + (to.pitch - from.pitch) * share;
            let between = Pose { eye, yaw: from.yaw + 1.5 * share, pitch, ..from };
            let there = exact.at(&world, &index, &between).clone();
            assert_eq!(&way.union(&there), &way, "step {step}, {share}");
            seen[usize::from(there.objects.is_empty())] += 1;
        }
    }
    assert!(seen.iter().all(|count| *count > 50), "{seen:?}");
}
