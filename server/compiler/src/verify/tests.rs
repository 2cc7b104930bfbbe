use std::io::Read;

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use roaring::RoaringBitmap;
use sightline_fixtures::shared_files::shared_file;
use sightline_oracle::Oracle;
use sightline_world::{
    Cell, CellId, Cells, Mesh, Node, Spawn, geometry::Aabb, motion::Body, octree::Octree,
};

use super::*;
use crate::{import::bsp, model};

/// Three rooms in a row, 4 m each, that fill the world. A wall without a door lies between the
/// first two, and no wall between the last two. Cell 0 sees itself; cells 1 and 2 see each other.
fn rooms() -> World {
    let bounds = Aabb::new(Vec3::ZERO, Vec3::new(12.0, 3.0, 4.0));
    let room = |i: f32| Aabb::new(Vec3::X * i * 4.0, Vec3::new(i * 4.0 + 4.0, 3.0, 4.0));
    let corners = [(-1.0, -1.0), (4.0, -1.0), (4.0, 5.0), (-1.0, 5.0)];
    let world = World {
        title: "rooms".into(),
        octree: Octree::empty(Vec3::ZERO, 16.0, 1),
        cells: cells(bounds, &[room(0.0), room(1.0), room(2.0)]),
        mesh: Mesh {
            positions: corners.map(|(y, z)| Vec3::new(4.0, y, z)).into(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        },
        spawns: vec![Spawn { eye: Vec3::ONE, yaw: 0.0 }],
        body: Body::PERSON,
        speed_max: 5.0,
        movers: Vec::new(),
        rooms: Default::default(),
        light: None,
        origin: None,
    };
    with_pvs(world, &[&[0], &[1, 2], &[1, 2]])
}

/// Cells in a row along x, without portals and PVS.
fn cells(bounds: Aabb, row: &[Aabb]) -> Cells {
    let mut tree = Vec::new();
    for (i, room) in row.iter().enumerate() {
        let next = tree.len() as u32;
        if i + 1 < row.len() {
            tree.push(Node::Axial { axis: 0, at: room.max.x, sides: [next + 1, next + 2] });
        }
        tree.push(Node::Leaf(CellId(i as u32)));
    }
    let cell = |&bounds: &Aabb| Cell { bounds, space: 0, portals: Vec::new() };
    let cells = row.iter().map(cell).collect();
    Cells { tree, cells, ..Cells::whole(bounds) }
}

fn with_pvs(mut world: World, rows: &[&[u32]]) -> World {
    world.cells.pvs = rows.iter().map(|row| RoaringBitmap::from_iter(row.iter())).collect();
    world
}

fn options(pairs: u64) -> VerifyOptions {
    VerifyOptions { entries: 100, lines: 1_000, ..VerifyOptions::new(pairs) }
}

fn verified(world: &World, options: &VerifyOptions) -> VerifyReport {
    verify(world, options, &|_, _| ()).unwrap()
}

#[test]
fn an_exact_pvs_has_no_miss_no_over_send_and_nothing_loose() {
    let report = verified(&rooms(), &options(50_000));
    for pairs in [&report.by_volume, &report.by_cell] {
        assert_eq!((pairs.pairs, pairs.ours.misses), (50_000, 0));
        assert_eq!(pairs.over_send(&pairs.ours), Some(1.0));
        // One in nine for the first room, four for the other two.
        let sight = pairs.sight as f64 / 50_000.0;
        assert!((sight - 5.0 / 9.0).abs() < 0.02, "{sight}");
    }
    assert_eq!((report.entries.entries, report.entries.loose), (100, 0));
    assert!(report.by_volume.own.is_none() && report.own_entries.is_none());
}

#[test]
fn an_entry_taken_out_is_missed_and_one_put_in_is_loose_and_sent_too_much() {
    let report = verified(&with_pvs(rooms(), &[&[0], &[1], &[1, 2]]), &options(50_000));
    for pairs in [&report.by_volume, &report.by_cell] {
        let share = pairs.ours.misses as f64 / 50_000.0;
        assert!((share - 1.0 / 9.0).abs() < 0.01, "{share}");
        assert_eq!(pairs.ours.first_misses.len(), 5);
        for miss in &pairs.ours.first_misses {
            assert_eq!(miss.places, [Some(1), Some(2)]);
            assert!((4.0..8.0).contains(&miss.from.x) && miss.to.x >= 8.0, "{miss:?}");
        }
    }
    let report = verified(&with_pvs(rooms(), &[&[0, 1], &[0, 1, 2], &[1, 2]]), &options(50_000));
    let over_send = report.by_volume.over_send(&report.by_volume.ours).unwrap();
    assert_eq!(report.summary().misses, 0);
    assert!((over_send - 7.0 / 5.0).abs() < 0.03, "{over_send}");
    // Of the four entries between two rooms, two lead through the wall.
    let share = report.entries.share().unwrap();
    assert!((share - 0.5).abs() < 0.15, "{share}");
}

#[test]
fn the_report_depends_on_the_seed_but_not_on_the_threads() {
    let world = with_pvs(rooms(), &[&[0], &[1], &[1, 2]]);
    let with = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let options = VerifyOptions { seed, ..options(20_000) };
        let report = pool.install(|| verified(&world, &options));
        (report.by_volume, report.by_cell, report.entries)
    };
    assert_eq!(with(1, 7), with(3, 7));
    assert_ne!(with(1, 7), with(1, 8));
}

/// With random walls and a wrong PVS, the verifier counts what a brute-force count of other points
/// finds.
#[test]
fn the_figures_agree_with_brute_force() {
    let mut rng = SmallRng::seed_from_u64(3);
    let mut world = rooms();
    for _ in 0..6 {
        let first = world.mesh.positions.len() as u32;
        world.mesh.positions.extend((0..3).map(|_| {
            Vec3::new(rng.random(), rng.random(), rng.random()) * world.cells.bounds.size()
        }));
        world.mesh.triangles.push([first, first + 1, first + 2]);
    }
    let world = with_pvs(world, &[&[0], &[1], &[1, 2]]);
    let (sight, mut seen, mut held, mut missed) = (Oracle::new(&world.mesh), 0.0, 0.0, 0.0);
    for _ in 0..100_000 {
        let mut point =
            || Vec3::new(rng.random(), rng.random(), rng.random()) * world.cells.bounds.size();
        let (a, b) = (point(), point());
        let in_pvs = world.cells.pvs[(a.x / 4.0) as usize].contains((b.x / 4.0) as u32);
        let in_sight = sight.between(a, b);
        seen += f64::from(in_sight) / 1e5;
        held += f64::from(in_pvs) / 1e5;
        missed += f64::from(in_sight && !in_pvs) / 1e5;
    }
    let found = verified(&world, &options(100_000)).by_volume;
    let check = |count: u64, expected: f64| {
        let share = count as f64 / 1e5;
        assert!(expected > 0.02 && (share - expected).abs() < 0.01, "{share} {expected}");
    };
    check(found.sight, seen);
    check(found.ours.pvs, held);
    check(found.ours.misses, missed);
}

#[test]
fn a_world_that_is_all_brush_is_full() {
    let mut world = rooms();
    let plane = sightline_world::OriginPlane { normal: Vec3::X, distance: 99.0 };
    let bounds = world.bounds();
    let solid = sightline_world::Solid { bounds, sides: vec![0] };
    world.origin =
        Some(sightline_world::Origin { planes: vec![plane], solids: vec![solid], tree: None });
    assert!(matches!(verify(&world, &options(10), &|_, _| ()), Err(VerifyError::Full)));
}

/// A real map in one cell, which sees itself. Our PVS can have no miss, and the vis lump of the map
/// is measured all the same.
fn uncompiled(map: &str) -> Option<World> {
    let path = shared_file(&format!("maps/{map}"))?;
    Some(in_one_cell(bsp::read(&path, &[]).unwrap()))
}

fn in_one_cell(model: model::Model) -> World {
    let model::Model { title, opaque, movers, spawns, body, speed_max, origin, .. } = model;
    let bounds = Aabb::from_points(opaque.as_flattened().iter().copied());
    let mesh = Mesh {
        positions: opaque.as_flattened().to_vec(),
        triangles: (0..opaque.len() as u32).map(|i| [0, 1, 2].map(|k| i * 3 + k)).collect(),
    };
    let octree = Octree::empty(bounds.min, 1.0, 1);
    let cells = cells(bounds, &[bounds]);
    let world = World {
        title,
        octree,
        cells,
        mesh,
        movers,
        rooms: Default::default(),
        spawns,
        body,
        speed_max,
        light: None,
        origin,
    };
    with_pvs(world, &[&[0]])
}

#[test]
fn the_vis_lumps_of_real_maps_have_no_miss_and_little_that_is_loose() {
    for map in ["oa_dm4.bsp", "aggressor.bsp"] {
        let Some(world) = uncompiled(map) else { return };
        let report = verified(&world, &VerifyOptions { entries: 200, ..options(20_000) });
        assert_eq!(report.summary().own_misses, Some(0), "{map}");
        assert_eq!(report.summary().misses, 0, "{map}");
        // A separate tracer found 2.2 for both maps, from other points.
        let by_volume = &report.by_volume;
        let over_send = by_volume.over_send(by_volume.own.as_ref().unwrap()).unwrap();
        assert!((2.0..2.4).contains(&over_send), "{map}: {over_send}");
        assert!(report.own_entries.unwrap().share().unwrap() < 0.1, "{map}");
    }
}

/// Clears bits of a vis lump, to prove that the test of real vis lumps can fail.
#[test]
fn holes_in_a_vis_lump_are_found() {
    let Some(mut world) = uncompiled("oa_dm4.bsp") else { return };
    let tree = world.origin.as_mut().and_then(|origin| origin.tree.as_mut()).unwrap();
    tree.visible.iter_mut().step_by(7).for_each(|byte| *byte &= 0b1110_1111);
    let report = verified(&world, &VerifyOptions { entries: 1, ..options(20_000) });
    assert!(report.summary().own_misses.unwrap() > 0);
    assert_eq!(report.summary().misses, 0);
}

/// Two maps of Debian's openarena-081-maps were published with a PVS that is too small.
#[test]
fn the_holes_of_published_maps_are_found() {
    let Ok(archive) = std::fs::File::open("/usr/share/games/openarena/baseoa/pak1-maps.pk3") else {
        println!("skipped: openarena-081-maps is not installed");
        return;
    };
    let mut archive = zip::ZipArchive::new(archive).unwrap();
    for (map, pairs) in [("maps/oa_dm5.bsp", 80_000), ("maps/czest2ctf.bsp", 5_000)] {
        let mut bytes = Vec::new();
        archive.by_name(map).unwrap().read_to_end(&mut bytes).unwrap();
        let world = in_one_cell(bsp::read_slice(&bytes, &[], map).unwrap());
        let report = verified(&world, &VerifyOptions { entries: 1, ..options(pairs) });
        assert!(report.summary().own_misses.unwrap() > 0, "{map}");
    }
}
