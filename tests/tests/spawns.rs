//! Where visitors begin in buildings that do not say so: on a floor from which most of what can be
//! walked on is reached. The client's navigation judges, which shares nothing with the compiler.

use std::ops::ControlFlow;

use glam::Vec3;
use sightline_client_core::navigation::Navigation;
use sightline_compiler::{CompileOptions, LightMethod, compile, import, model::Model};
use sightline_fixtures::{
    shared_files::{shared_file, some_of},
    voxel_floor,
};
use sightline_world::{Spawn, World, geometry::Aabb};

/// The distance between the places from which walkable areas are looked for, in metres.
const SEEDS_M: f32 = 2.0;

/// Compiles a building without the spawn points that it may have.
fn compiled(mut model: Model) -> World {
    model.spawns.clear();
    let options = CompileOptions {
        voxel: Some(0.1),
        cell: Some(50.0),
        light: LightMethod::None,
        ..Default::default()
    };
    let (world, report) = compile(&model, &options, &|_, _| ControlFlow::Continue(())).unwrap();
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    world
}

/// How many places a body gets to from an eye, and back.
fn reached(world: &World, eye: Vec3) -> usize {
    let mut world = world.clone();
    world.spawns = vec![Spawn { eye, yaw: 0.0 }];
    Navigation::new(&world).len()
}

/// Whether something is above an eye.
fn has_roof(world: &World, eye: Vec3) -> bool {
    let top = world.bounds().max.y.max(eye.y);
    world.octree.solid_in(&Aabb::new(eye, eye.with_y(top)).grown(0.05))
}

/// The most places that a body gets to from anywhere in the part of a building where visitors
/// begin. Where they begin below a roof, what is on the roof does not count.
fn most_reached(world: &World, around: &Aabb) -> usize {
    let begins_indoors = world.spawns.iter().all(|spawn| has_roof(world, spawn.eye));
    let size = around.size();
    let steps = (size / SEEDS_M).ceil().as_uvec3().max(glam::UVec3::ONE);
    let mut seeds = world.clone();
    seeds.spawns.clear();
    for x in 0..steps.x {
        for z in 0..steps.z {
            for y in 0..2 * steps.y {
                let at = Vec3::new(x as f32 + 0.5, y as f32 * 0.5, z as f32 + 0.5) * SEEDS_M;
                let eye = around.min + at;
                if !begins_indoors || has_roof(world, eye) {
                    seeds.spawns.push(Spawn { eye, yaw: 0.0 });
                }
            }
        }
    }
    Navigation::new(&seeds).len()
}

/// Each spawn point is free, and reaches half of the largest walkable area about it.
fn check(name: &str, world: &World) {
    let eyes = || world.spawns.iter().map(|spawn| spawn.eye);
    let most = most_reached(world, &Aabb::from_points(eyes()).grown(4.0));
    assert!(most > 0, "{name}");
    for eye in eyes() {
        assert!(!world.octree.solid_in(&world.body.around(eye)), "{name}: {eye} is not free");
        assert!(world.cells.at(eye).is_some(), "{name}: {eye} is in no cell");
        let reached = reached(world, eye);
        assert!(2 * reached >= most, "{name}: {eye} reaches {reached} of {most} places");
    }
    println!("{name}: {} spawn points, {most} places", world.spawns.len());
}

#[test]
fn hand_made_worlds_and_the_demo_building() {
    check("voxel floor", &voxel_floor::world(&[([20, 1, 20], [24, 20, 24], 0)]));
    for (rooms, seed) in [(2, 1), (12, 3)] {
        let glb = sightline_demo_building::glb(rooms, seed);
        let world = compiled(import::glb::read_slice(&glb, None, "demo").unwrap());
        check(&format!("demo building of {rooms} rooms"), &world);
    }
}

#[test]
fn scenes_made_by_others() {
    let scenes = [
        "three-storeys.glb",
        "hall.glb",
        "garage/garage.gltf",
        "living_room.glb",
        "museum_b/museum_b.glb",
    ];
    for scene in some_of(&scenes) {
        let Some(path) = shared_file(&format!("scenes/{scene}")) else { continue };
        check(scene, &compiled(import::read(&path, &[]).unwrap()));
    }
}

#[test]
fn maps_made_by_others() {
    for map in some_of(&["aggressor", "oa_dm2", "oa_dm4"]) {
        let Some(path) = shared_file(&format!("maps/{map}.bsp")) else { continue };
        let model = import::read(&path, &[]).unwrap();
        // A map closes its inside by the points of its entities.
        let places = model.spawns.iter().map(|spawn| spawn.eye).chain(model.places.clone());
        check(map, &compiled(Model { places: places.collect(), ..model.clone() }));
    }
}
