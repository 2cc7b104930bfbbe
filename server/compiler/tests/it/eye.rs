//! Visibility from a box of eyes, against rays.

use std::{ops::ControlFlow, time::Instant};

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use roaring::RoaringBitmap;
use sightline_compiler::{
    CompileOptions, LightMethod, compile,
    import::{self, glb},
    model::Model,
};
use sightline_fixtures::shared_files::shared_file;
use sightline_oracle::Oracle;
use sightline_visibility::portal_flow::{FlowScratch, Sightlines};
use sightline_world::{
    Cells, World,
    geometry::{Aabb, Axes, Frustum},
    motion::Pose,
};

fn compiled(model: &Model) -> World {
    let options = CompileOptions {
        voxel: Some(0.5),
        cell: Some(3.0),
        light: LightMethod::None,
        ..CompileOptions::default()
    };
    compile(model, &options, &|_, _| ControlFlow::Continue(())).unwrap().0
}

fn building(rooms: usize, seed: u64) -> Model {
    glb::read_slice(&sightline_demo_building::glb(rooms, seed), None, "demo").unwrap()
}

fn map(name: &str) -> Option<Model> {
    let path = shared_file(&format!("maps/{name}"))?;
    Some(import::read(&path, &[]).unwrap())
}

/// The model, turned about the vertical.
fn turned(mut model: Model, by: f64) -> Model {
    let axes = Axes::turned(by);
    let turn = |corner: &mut Vec3| *corner = axes.world(*corner);
    model.surfaces.iter_mut().for_each(|s| s.positions.iter_mut().for_each(turn));
    model.opaque.as_flattened_mut().iter_mut().for_each(turn);
    model.spawns.iter_mut().for_each(|spawn| turn(&mut spawn.eye));
    model
}

fn point(rng: &mut SmallRng, within: &Aabb) -> Vec3 {
    within.min + within.size() * Vec3::from_array(std::array::from_fn(|_| rng.random()))
}

/// A random place, by cell or by volume, in the world's axes.
fn place(rng: &mut SmallRng, cells: &Cells) -> Vec3 {
    let cell = &cells.cells[rng.random_range(0..cells.cells.len())].bounds;
    let within = if rng.random_bool(0.5) { cell } else { &cells.bounds };
    cells.axes.world(point(rng, within))
}

/// A random frustum, and a direction in it.
fn look(rng: &mut SmallRng) -> (Frustum, Vec3) {
    let (yaw, pitch) = (rng.random_range(-4.0..4.0f32), rng.random_range(-1.5..1.5f32));
    let (across, upright) = (rng.random_range(0.05..2.5f32), rng.random_range(0.05..2.0f32));
    let forward = Pose { yaw, pitch, ..Pose::default() }.forward();
    let right = Vec3::new(yaw.cos(), 0.0, -yaw.sin());
    let mut within = |angle: f32| (angle * 0.5).tan() * rng.random_range(-0.99..0.99);
    let direction = forward + right * within(across) + right.cross(forward) * within(upright);
    (Frustum::new(yaw, pitch, across, upright), direction.normalize())
}

/// The union of the PVS rows of the cells that a box overlaps or is near to.
fn rows(cells: &Cells, viewpoint: &Aabb) -> RoaringBitmap {
    let rows = cells.visible_from(&cells.axes.own_box(viewpoint).grown(1e-4));
    if rows.is_empty() { cells.visible_from_point(viewpoint.centre()) } else { rows }
}

/// Checks boxes of all sizes, with and without a frustum, against rays from eyes in them. Gives the
/// number of sight lines.
fn check(world: &World, seed: u64, boxes: usize) -> usize {
    let mut rng = SmallRng::seed_from_u64(seed);
    let (cells, sight) = (&world.cells, Oracle::new(&world.mesh));
    let (lines, mut scratch) = (Sightlines::new(cells), FlowScratch::default());
    let mut found = 0;
    for _ in 0..boxes {
        let half = point(&mut rng, &Aabb::new(Vec3::ZERO, Vec3::ONE));
        let half = half * [0.0, 0.01, 0.1, 1.0, 4.0][rng.random_range(0..5)];
        let centre = place(&mut rng, cells);
        let viewpoint = Aabb::new(centre - half, centre + half);
        let rows = rows(cells, &viewpoint);
        let all = lines.visible_from(&mut scratch, &viewpoint, None);
        assert!(all.is_subset(&rows), "seed {seed}: {viewpoint:?}");
        for _ in 0..3 {
            let (frustum, direction) = look(&mut rng);
            let seen = lines.visible_from(&mut scratch, &viewpoint, Some(&frustum));
            assert!(seen.is_subset(&rows), "seed {seed}: {viewpoint:?}, {frustum:?}");
            for _ in 0..10 {
                let eye = point(&mut rng, &viewpoint);
                let far = sight.distance(eye, direction).unwrap_or(100.0) * rng.random::<f32>();
                let to = eye + direction * far;
                let (Some(_), Some(cell)) = (cells.at(eye), cells.at(to)) else { continue };
                let is_in = |place| cells.bounds.contains(cells.axes.own(place));
                if is_in(eye) && is_in(to) && sight.between(eye, to) {
                    found += 1;
                    assert!(
                        seen.contains(cell.0) && all.contains(cell.0),
                        "seed {seed}: {viewpoint:?}, {frustum:?}: {eye} sees {to}"
                    );
                }
            }
        }
    }
    found
}

/// The share of its PVS row that a box of 10 cm sees on average, and the time in microseconds: all
/// around, and with the frustum of a camera.
fn figures(world: &World, boxes: usize) -> [(f64, f64); 2] {
    let mut rng = SmallRng::seed_from_u64(1);
    let cells = &world.cells;
    let (lines, mut scratch) = (Sightlines::new(cells), FlowScratch::default());
    let mut places = Vec::new();
    while places.len() < boxes {
        let eye = cells.axes.world(point(&mut rng, &cells.bounds));
        places.extend(cells.at(eye).map(|cell| (eye, cells.pvs[cell.0 as usize].len() as f64)));
    }
    [None, Some(Frustum::new(0.4, 0.0, 1.6, 1.1))].map(|frustum| {
        let start = Instant::now();
        let part = |(eye, row): &(Vec3, f64)| {
            let viewpoint = Aabb::around(*eye, 0.05);
            lines.visible_from(&mut scratch, &viewpoint, frustum.as_ref()).len() as f64 / row
        };
        let parts: f64 = places.iter().map(part).sum();
        (parts / boxes as f64, start.elapsed().as_secs_f64() * 1e6 / boxes as f64)
    })
}

/// The share of its PVS row that a whole cell sees. Boxes are a little smaller than cells, so that
/// they do not touch neighbours.
fn part_seen_by_whole_cells(world: &World, count: usize) -> f64 {
    let (lines, mut scratch) = (Sightlines::new(&world.cells), FlowScratch::default());
    let cells = world.cells.cells.iter().enumerate();
    let parts = cells.step_by(world.cells.cells.len().div_ceil(count)).map(|(cell, of)| {
        let viewpoint = of.bounds.grown(-1e-3);
        let row = &world.cells.pvs[cell];
        if viewpoint.is_empty() {
            return 1.0;
        }
        let seen = lines.visible_from(&mut scratch, &viewpoint, None);
        assert!(seen.is_subset(&rows(&world.cells, &viewpoint)));
        seen.intersection_len(row) as f64 / row.len() as f64
    });
    let parts: Vec<f64> = parts.collect();
    parts.iter().sum::<f64>() / parts.len() as f64
}

#[test]
fn a_building_from_boxes_of_eyes() {
    let world = compiled(&building(8, 2));
    assert!(check(&world, 1, 400) > 4_000);
    let [(around, around_us), (ahead, ahead_us)] = figures(&world, 300);
    println!("{around:.2} of a row in {around_us:.0} µs, ahead {ahead:.2} in {ahead_us:.0} µs");
    assert!(around < 0.95 && ahead < 0.35, "{around}, {ahead}");
    let whole = part_seen_by_whole_cells(&world, 200);
    println!("whole cells see {whole:.3} of their rows");
    assert!(whole > 0.9, "{whole}");
}

#[test]
fn random_buildings_from_boxes_of_eyes() {
    let mut found = 0;
    for seed in 0..6 {
        let model = building(1 + seed as usize % 4, seed);
        found += check(&compiled(&model), seed, 60);
        found += check(&compiled(&turned(model, 0.2 + seed as f64)), seed, 60);
    }
    assert!(found > 3_000, "{found}");
}

#[test]
fn a_map_from_boxes_of_eyes() {
    let Some(model) = map("oa_dm4.bsp") else { return };
    let world = compiled(&model);
    assert!(check(&world, 3, 300) > 3_000);
    let [(around, around_us), (ahead, ahead_us)] = figures(&world, 300);
    println!("{around:.2} of a row in {around_us:.0} µs, ahead {ahead:.2} in {ahead_us:.0} µs");
    assert!(around < 0.95 && ahead < 0.35, "{around}, {ahead}");
}

/// An eye in something solid counts as an eye beside it. Invalid and empty boxes see nothing.
#[test]
fn odd_boxes() {
    let world = compiled(&building(1, 1));
    let (lines, mut scratch) = (Sightlines::new(&world.cells), FlowScratch::default());
    let mut from = |viewpoint: Aabb| lines.visible_from(&mut scratch, &viewpoint, None);
    for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert!(from(Aabb::around(Vec3::splat(odd), 1.0)).is_empty());
    }
    assert!(from(Aabb::EMPTY).is_empty());
    // An eye out of bounds counts as an eye on the boundary.
    assert!(!from(Aabb::around(Vec3::splat(1e6), 1.0)).is_empty());
    let mut rng = SmallRng::seed_from_u64(5);
    let mut solid = 0;
    for _ in 0..20_000 {
        let eye = point(&mut rng, &world.bounds());
        if world.cells.at(eye).is_none() && world.cells.near(eye).is_some() {
            solid += 1;
            assert!(!from(Aabb::around(eye, 0.0)).is_empty(), "{eye}");
        }
    }
    println!("{solid} eyes were in something solid");
}
