//! Random buildings: in none of them may the PVS deny a pair in sight.

use std::ops::ControlFlow;

use glam::{DMat3, DVec3, Quat, Vec2, Vec3};
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_compiler::{
    CompileOptions, CompileReport, LightMethod, compile,
    import::glb,
    model::{ConvexFace, ConvexSolid, Model},
    verify::{self, verify},
};
use sightline_world::{Spawn, World};

use crate::box_pairs::BoxPairTally;

/// The number of buildings of each kind. Every second one is turned.
const BUILDINGS: u64 = 12;
/// The number of pairs in each of the two samples of a building.
const PAIRS: u64 = 2_000;

/// The inside of the shell, in metres. The first metre along x stays empty.
const ROOM: Vec3 = Vec3::new(9.0, 4.0, 8.0);
/// The thickness of the shell, in metres.
const WALL: f32 = 0.25;

#[test]
fn nobody_is_missed_in_offices() {
    nobody_is_missed("offices", |rng| office(rng.random_range(1..=2), rng.random()));
}

#[test]
fn nobody_is_missed_between_thin_walls() {
    nobody_is_missed("thin walls", thin_walls);
}

#[test]
fn nobody_is_missed_among_boxes() {
    nobody_is_missed("boxes", |rng| model(outlines(&boxes(rng)), Vec::new()));
}

#[test]
fn nobody_is_missed_among_slanted_walls() {
    nobody_is_missed("slanted walls", slanted_walls);
}

#[test]
fn nobody_is_missed_among_convex_solids() {
    nobody_is_missed("solids", |rng| {
        let mut solids = boxes(rng);
        solids.extend((0..rng.random_range(2..6)).map(|_| prism(rng)));
        model(outlines(&solids), solids)
    });
}

#[test]
fn a_turned_building_compiles_to_as_good_a_world() {
    let upright = office(6, 1);
    let turned = turned(&upright, 30f64.to_radians());
    let [(world, report), (turned_world, turned_report)] = [&upright, &turned].map(compiled);
    assert!((turned_report.turn.to_degrees() - 30.0).abs() < 1e-3, "{}", turned_report.turn);
    let ratio = |turned: f64, upright: f64| (turned / upright - 1.0).abs();
    let (cells, turned_cells) = (world.cells.cells.len(), turned_world.cells.cells.len());
    assert!(ratio(turned_cells as f64, cells as f64) < 0.02, "{turned_cells}, was {cells}");
    let (dense, turned_dense) = (report.pvs_density, turned_report.pvs_density);
    assert!(ratio(turned_dense, dense) < 0.02, "{turned_dense}, was {dense}");
    assert_eq!(verified(&turned_world, 10 * PAIRS).summary().misses, 0);
}

/// Compiles and verifies one building of a kind for each seed.
fn nobody_is_missed(kind: &str, build: impl Fn(&mut SmallRng) -> Model) {
    let (mut sight, mut seen, mut pairs) = (0, 0, 0);
    let mut tally = BoxPairTally::default();
    for seed in 0..BUILDINGS {
        let mut rng = SmallRng::seed_from_u64(seed);
        let mut model = build(&mut rng);
        if seed % 2 == 1 {
            model = turned(&model, rng.random_range(0.0..std::f64::consts::TAU));
        }
        let world = compiled(&model).0;
        tally.add(&world, 60, &mut rng, &format!("among {kind}, seed {seed}"));
        let report = verified(&world, PAIRS);
        let missed = [&report.by_volume, &report.by_cell].map(|pairs| &pairs.ours.first_misses);
        assert_eq!(report.summary().misses, 0, "among {kind}, seed {seed}: {missed:?}");
        // By volume, most points are outside.
        sight += report.by_cell.sight;
        seen += report.by_cell.ours.pvs;
        pairs += report.by_cell.pairs;
    }
    tally.judge(kind, 0.6);
    assert!(sight * 20 > pairs, "there is somebody to miss among {kind}: {sight} of {pairs}");
    assert!(seen * 10 < pairs * 9, "and much is hidden: {} of {pairs}", pairs - seen);
}

fn compiled(model: &Model) -> (World, CompileReport) {
    let options = CompileOptions {
        voxel: Some(2.0),
        cell: Some(3.0),
        light: LightMethod::None,
        ..Default::default()
    };
    compile(model, &options, &|_, _| ControlFlow::Continue(())).unwrap()
}

fn verified(world: &World, pairs: u64) -> verify::VerifyReport {
    let options = verify::VerifyOptions { entries: 0, ..verify::VerifyOptions::new(pairs) };
    verify(world, &options, &|_, _| ()).unwrap()
}

fn office(rooms: usize, seed: u64) -> Model {
    glb::read_slice(&sightline_demo_building::glb(rooms, seed), None, "office").unwrap()
}

/// A grid of rooms whose walls are whole, have a hole, or are missing.
fn thin_walls(rng: &mut SmallRng) -> Model {
    let mut opaque = Vec::new();
    let step = ROOM / Vec3::new(3.0, 2.0, 3.0);
    for (axis, u, v) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
        for line in 0..27 {
            let place = [line % 3, line / 3 % 3, line / 9];
            let mut panel = |[u0, u1]: [f32; 2], [v0, v1]: [f32; 2]| {
                let corner = |at_u: f32, at_v: f32| {
                    let mut p = Vec3::ZERO;
                    p[axis] = place[0] as f32 * step[axis];
                    p[u] = (place[1] as f32 + at_u) * step[u];
                    p[v] = (place[2] as f32 + at_v) * step[v];
                    p
                };
                let [a, b, c, d] =
                    [(u0, v0), (u1, v0), (u1, v1), (u0, v1)].map(|(u, v)| corner(u, v));
                opaque.extend([[a, b, c], [a, c, d]]);
            };
            let [near, far] = [0.3, 0.6].map(|at: f32| at + rng.random_range(-0.2..0.2));
            match rng.random_range(0..10) {
                0..6 => panel([0.0, 1.0], [0.0, 1.0]),
                6..9 => {
                    panel([0.0, near], [0.0, 1.0]);
                    panel([far, 1.0], [0.0, 1.0]);
                    panel([near, far], [0.0, near]);
                }
                _ => {}
            }
        }
    }
    model(opaque, Vec::new())
}

/// A closed room with upright walls in any direction, and panes in any orientation.
fn slanted_walls(rng: &mut SmallRng) -> Model {
    let mut opaque = outlines(&shell());
    for _ in 0..rng.random_range(4..12) {
        let [mut a, mut b] = [(); 2].map(|()| point(rng));
        (a.y, b.y) = (0.0, 0.0);
        let up = Vec3::Y * [ROOM.y, 2.5][rng.random_range(0..2)];
        opaque.extend([[a, b, b + up], [a, b + up, a + up]]);
    }
    opaque.extend((0..4).map(|_| [(); 3].map(|()| point(rng))));
    model(opaque, Vec::new())
}

/// A closed room with boxes, some of which overlap or reach the ceiling.
fn boxes(rng: &mut SmallRng) -> Vec<ConvexSolid> {
    let mut solids = shell();
    for _ in 0..rng.random_range(4..12) {
        let [a, b] = [(); 2].map(|()| point(rng));
        let (min, mut max) = (a.min(b), a.max(b).max(a.min(b) + 0.05));
        let axis = rng.random_range(0..3);
        // Most are thin, as walls and slabs are.
        max[axis] = max[axis].min(min[axis] + [0.3, 9.0][usize::from(rng.random_bool(0.2))]);
        let base = if rng.random_bool(0.5) { min.with_y(0.0) } else { min };
        solids.push(cuboid(base, max));
    }
    solids
}

/// An upright prism, or one that has fallen over.
fn prism(rng: &mut SmallRng) -> ConvexSolid {
    let corners = rng.random_range(3..7);
    let (width, phase) = (rng.random_range(0.2..1.5), rng.random_range(0.0..6.0));
    let base = (0..corners).map(|i| {
        width * Vec2::from_angle(phase - i as f32 / corners as f32 * std::f32::consts::TAU)
    });
    let base: Vec<Vec2> = base.collect();
    let fallen = if rng.random_bool(0.3) { rng.random_range(0.0..1.5) } else { 0.0 };
    let turn = Quat::from_rotation_x(fallen);
    let centre = Vec3::new(0.0, rng.random_range(0.0..2.0), 0.0) + point(rng).with_y(0.0);
    extruded(&base, [0.0, rng.random_range(0.3..3.0)], |p| centre + turn * p)
}

/// Floor, ceiling and four walls.
fn shell() -> Vec<ConvexSolid> {
    let (min, max) = (Vec3::splat(-WALL), ROOM + WALL);
    let walls = (0..3).flat_map(|axis| {
        let (mut inner, mut outer) = (max, min);
        (inner[axis], outer[axis]) = (0.0, ROOM[axis]);
        [cuboid(min, inner), cuboid(outer, max)]
    });
    walls.collect()
}

fn cuboid(min: Vec3, max: Vec3) -> ConvexSolid {
    let base = [[min.x, min.z], [min.x, max.z], [max.x, max.z], [max.x, min.z]].map(Vec2::from);
    extruded(&base, [min.y, max.y], |p| p)
}

/// A prism over a convex base, which is (x, z) anticlockwise from above, then moved.
fn extruded(base: &[Vec2], [low, high]: [f32; 2], moved: impl Fn(Vec3) -> Vec3) -> ConvexSolid {
    let ring = |y: f32| base.iter().map(move |p| Vec3::new(p.x, y, p.y));
    let mut faces = vec![ring(high).collect::<Vec<_>>(), ring(low).rev().collect()];
    let (lower, upper): (Vec<_>, Vec<_>) = (ring(low).collect(), ring(high).collect());
    for i in 0..base.len() {
        let next = (i + 1) % base.len();
        faces.push(vec![lower[i], lower[next], upper[next], upper[i]]);
    }
    let face = |corners: Vec<Vec3>| face(corners.into_iter().map(&moved).collect());
    ConvexSolid { faces: faces.into_iter().map(face).collect() }
}

fn face(corners: Vec<Vec3>) -> ConvexFace {
    let [a, b, c] = [0, 1, 2].map(|i| corners[i].as_dvec3());
    let normal = (b - a).cross(c - a).normalize();
    ConvexFace { normal, distance: normal.dot(a), corners }
}

/// The triangles of solids.
fn outlines(solids: &[ConvexSolid]) -> Vec<[Vec3; 3]> {
    let faces = solids.iter().flat_map(|solid| &solid.faces);
    let fan = |face: &ConvexFace| {
        let corners = face.corners.clone();
        (2..corners.len()).map(move |i| [corners[0], corners[i - 1], corners[i]])
    };
    faces.flat_map(fan).collect()
}

/// A random point of the room, not in its first metre.
fn point(rng: &mut SmallRng) -> Vec3 {
    let from = Vec3::X;
    from + (ROOM - from) * Vec3::new(rng.random(), rng.random(), rng.random())
}

fn model(opaque: Vec<[Vec3; 3]>, solids: Vec<ConvexSolid>) -> Model {
    Model {
        solids,
        spawns: vec![Spawn { eye: Vec3::new(0.43, 1.6, 4.1), yaw: 0.0 }],
        speed_max: 5.0,
        ..Model::of_triangles("random", opaque, [90, 120, 150])
    }
}

/// The building turned about the vertical as axes are, by an angle in radians.
fn turned(model: &Model, angle: f64) -> Model {
    let turn = DMat3::from_rotation_y(-angle);
    let moved = |p: Vec3| (turn * p.as_dvec3()).as_vec3();
    let mut model = model.clone();
    for surface in &mut model.surfaces {
        surface.positions.iter_mut().for_each(|p| *p = moved(*p));
    }
    model.opaque.as_flattened_mut().iter_mut().for_each(|p| *p = moved(*p));
    model.spawns.iter_mut().for_each(|spawn| spawn.eye = moved(spawn.eye));
    for face in model.solids.iter_mut().flat_map(|solid| &mut solid.faces) {
        let corners = face.corners.iter().map(|&p| moved(p)).collect();
        let normal: DVec3 = turn * face.normal;
        *face = ConvexFace { normal, distance: face.distance, corners };
    }
    model
}
