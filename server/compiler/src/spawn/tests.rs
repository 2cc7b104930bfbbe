use std::ops::ControlFlow;

use glam::Vec3;
use sightline_fixtures::boxes::box_triangles;
use sightline_world::{Spawn, World, geometry::Aabb};

use crate::{CompileOptions, CompileReport, LightMethod, compile, model::Model};

fn slab(min: [f32; 3], max: [f32; 3]) -> Vec<[Vec3; 3]> {
    box_triangles(&Aabb::new(Vec3::from(min), Vec3::from(max)))
}

/// A house of boxes 12 m × 8 m: a floor, walls, a ceiling of 3 m, a roof of 6 m, and two rooms with
/// a door between them.
fn house() -> Vec<[Vec3; 3]> {
    [
        slab([0.0, -0.2, 0.0], [12.0, 0.0, 8.0]),
        slab([0.0, 0.0, 0.0], [12.0, 6.0, 0.2]),
        slab([0.0, 0.0, 7.8], [12.0, 6.0, 8.0]),
        slab([0.0, 0.0, 0.2], [0.2, 6.0, 7.8]),
        slab([11.8, 0.0, 0.2], [12.0, 6.0, 7.8]),
        slab([0.0, 6.0, 0.0], [12.0, 6.2, 8.0]),
        // The wall between the rooms, with a door of a metre.
        slab([5.0, 0.0, 0.2], [5.2, 3.0, 5.0]),
        slab([5.0, 0.0, 6.0], [5.2, 3.0, 7.8]),
        slab([5.0, 2.1, 5.0], [5.2, 3.0, 6.0]),
        // A suspended ceiling, and the floor above it.
        slab([0.2, 3.0, 0.2], [11.8, 3.05, 7.8]),
    ]
    .concat()
}

fn compiled(triangles: Vec<[Vec3; 3]>, spawns: &[[f32; 3]]) -> (World, CompileReport) {
    let mut model = Model::of_triangles("house", triangles, [200; 3]);
    model.spawns = spawns.iter().map(|&eye| Spawn { eye: eye.into(), yaw: 1.0 }).collect();
    let options = CompileOptions {
        voxel: Some(0.1),
        cell: Some(100.0),
        light: LightMethod::None,
        ..Default::default()
    };
    compile(&model, &options, &|_, _| ControlFlow::Continue(())).unwrap()
}

/// Where visitors begin in a building without spawn points. Bodies have room there.
fn found(triangles: Vec<[Vec3; 3]>) -> Vec<Vec3> {
    let (world, report) = compiled(triangles, &[]);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    assert_eq!(report.spawns, world.spawns.len());
    for spawn in &world.spawns {
        assert!(!world.octree.solid_in(&world.body.around(spawn.eye)), "{spawn:?} in a wall");
        assert!(world.cells.at(spawn.eye).is_some(), "{spawn:?} in no cell");
    }
    world.spawns.iter().map(|spawn| spawn.eye).collect()
}

fn all_in(places: &[Vec3], min: [f32; 3], max: [f32; 3]) -> bool {
    places.iter().all(|at| Aabb::new(Vec3::from(min), Vec3::from(max)).contains(*at))
}

#[test]
fn visitors_begin_scattered_over_the_rooms_and_not_outside_or_on_the_roof() {
    let mut scene = house();
    scene.extend(slab([-30.0, -0.4, -30.0], [40.0, -0.3, 40.0]));
    // The space over the ceiling is high enough for a body, but not for a room.
    scene.extend(slab([0.2, 4.9, 0.2], [11.8, 5.0, 7.8]));
    let eyes = found(scene);
    assert!(all_in(&eyes, [0.2, 1.5, 0.2], [11.8, 1.8, 7.8]), "{eyes:?}");
    assert!(eyes.len() >= 4, "{eyes:?}");
    for west in [true, false] {
        assert!(eyes.iter().any(|eye| (eye.x < 5.0) == west), "both rooms: {eyes:?}");
    }
    for (i, a) in eyes.iter().enumerate() {
        assert!(eyes[..i].iter().all(|b| a.distance(*b) >= 0.8), "{eyes:?}");
    }
}

#[test]
fn nobody_begins_below_a_house_on_stilts() {
    let up = |[a, b, c]: [Vec3; 3]| [a, b, c].map(|at| at + Vec3::Y * 2.6);
    let mut scene: Vec<_> = house().into_iter().map(up).collect();
    scene.extend(slab([-10.0, -0.2, -10.0], [22.0, 0.0, 18.0]));
    let eyes = found(scene);
    assert!(all_in(&eyes, [0.2, 4.1, 0.2], [11.8, 4.4, 7.8]), "{eyes:?}");
}

#[test]
fn nobody_begins_inside_what_is_solid() {
    let mut scene = house();
    // A block without windows that is larger than the house, and hollow as all models are.
    scene.extend(slab([20.0, 0.0, 0.0], [44.0, 6.0, 16.0]));
    let eyes = found(scene);
    assert!(all_in(&eyes, [0.2, 1.5, 0.2], [11.8, 1.8, 7.8]), "{eyes:?}");
}

#[test]
fn a_floor_that_steps_lead_to_belongs_to_the_same_area() {
    // Two halls on two levels; the wall between them has a door with three steps.
    let mut scene = [
        slab([0.0, -0.2, 0.0], [8.0, 0.0, 8.0]),
        slab([8.0, 0.7, 0.0], [16.0, 0.9, 8.0]),
        slab([0.0, 4.0, 0.0], [16.0, 4.2, 8.0]),
        slab([0.0, 0.0, 0.0], [16.0, 4.0, 0.2]),
        slab([0.0, 0.0, 7.8], [16.0, 4.0, 8.0]),
        slab([0.0, 0.0, 0.2], [0.2, 4.0, 7.8]),
        slab([15.8, 0.9, 0.2], [16.0, 4.0, 7.8]),
        slab([8.0, 0.0, 0.2], [8.2, 4.0, 3.0]),
        slab([8.0, 0.0, 4.2], [8.2, 4.0, 7.8]),
    ]
    .concat();
    let steps = [
        slab([6.8, 0.0, 3.0], [8.0, 0.3, 4.2]),
        slab([7.4, 0.3, 3.0], [8.0, 0.6, 4.2]),
        slab([8.0, 0.6, 3.0], [8.2, 0.9, 4.2]),
    ];
    let sides = |eyes: &[Vec3]| [true, false].map(|low| eyes.iter().any(|e| (e.x < 8.0) == low));
    assert_eq!(sides(&found(scene.clone())).iter().filter(|side| **side).count(), 1);
    scene.extend(steps.concat());
    assert_eq!(sides(&found(scene)), [true, true]);
}

#[test]
fn nobody_begins_nose_to_a_wall() {
    let (world, _) = compiled(house(), &[]);
    for Spawn { eye, yaw } in &world.spawns {
        let along = Vec3::new(-yaw.sin(), 0.0, -yaw.cos());
        let is_free = |at: Vec3| !world.octree.solid_in(&Aabb::around(at, 0.02));
        assert!((0..15).all(|i| is_free(eye + along * 0.1 * i as f32)), "{eye} faces a wall");
    }
}

#[test]
fn an_authors_spawn_point_is_kept_or_put_right_with_a_warning() {
    let (world, report) = compiled(house(), &[[2.0, 1.6, 2.0]]);
    assert_eq!(world.spawns, [Spawn { eye: Vec3::new(2.0, 1.6, 2.0), yaw: 1.0 }]);
    assert!(report.warnings.is_empty());
    // In the wall; on the floor, as feet are; and far from everything.
    let (world, report) = compiled(house(), &[[5.1, 1.6, 2.0], [3.0, 0.1, 3.0], [90.0, 1.6, 2.0]]);
    let [beside, above] = world.spawns[..] else { panic!("{:?}", world.spawns) };
    assert!(beside.eye.distance(Vec3::new(5.1, 1.6, 2.0)) < 0.6, "{beside:?}");
    assert!(above.eye.distance(Vec3::new(3.0, 1.6, 3.0)) < 0.3, "{above:?}");
    assert_eq!((beside.yaw, above.yaw), (1.0, 1.0));
    let [wall, feet, far] = &report.warnings[..] else { panic!("{:?}", report.warnings) };
    assert!(wall.starts_with("the spawn point at 5.10,1.60,2.00 has no room for a body: moved"));
    assert!(feet.contains("3.00,0.10,3.00"), "{feet}");
    assert!(far.starts_with("the spawn point at 90.00,1.60,2.00 is left out: "), "{far}");
}

#[test]
fn a_model_with_no_floor_is_warned_of() {
    let (world, report) = compiled(slab([0.0; 3], [0.3, 0.2, 0.1]), &[]);
    assert_eq!(world.spawns.len(), 1);
    let stands = !report.warnings.is_empty() || world.spawns[0].eye.y > 1.6;
    assert!(stands, "{:?} {:?}", world.spawns, report.warnings);
}
