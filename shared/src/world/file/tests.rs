use std::time::Duration;

use glam::{DAffine3, Quat, UVec3};
use roaring::RoaringBitmap;

use super::*;
use crate::{
    motion::trajectory::{Course, Joint, Track, Trajectory},
    octree::{Look, Voxel, morton},
    world::{
        Axes, Cell, CellId, Cells, Gate, Mover, Node, Origin, OriginLeaf, OriginNode, OriginPlane,
        OriginSide, OriginTree, Polygon, Portal, Solid, Space,
    },
};

/// Two rooms with a portal between them, and a handful of voxels.
fn small_world() -> World {
    let bounds = Aabb::new(Vec3::ZERO, Vec3::new(8.0, 4.0, 4.0));
    let (left, right) = (Vec3::new(4.0, 4.0, 4.0), Vec3::new(4.0, 0.0, 0.0));
    let all = RoaringBitmap::from_iter([0, 1]);
    let corner = |y: f32, z: f32| Vec3::new(4.0, y, z);
    let corners = [corner(0.0, 1.0), corner(2.0, 1.0), corner(0.0, 2.0)];
    let door = Polygon::Other { normal: DVec3::X, corners: corners.into() };
    let voxel = |x, flags| Voxel {
        key: morton(UVec3::new(x, 0, 0)),
        colour: [200, 100, 50],
        normal: [0, 127, 0],
        flags,
    };
    World {
        title: "two rooms".into(),
        octree: Octree::from_voxels(
            Vec3::ZERO,
            2.0,
            2,
            vec![voxel(0, 0), voxel(1, Look::GLASS), voxel(3, 0)],
        )
        .expect("small"),
        cells: Cells {
            bounds,
            axes: Axes::turned(0.5),
            tree: vec![
                Node::Axial { axis: 0, at: 4.0, sides: [1, 2] },
                Node::Leaf(CellId(0)),
                Node::Plane { normal: DVec3::X, distance: 8.0, sides: [3, 4] },
                Node::Leaf(CellId(1)),
                Node::Solid,
            ],
            cells: vec![
                Cell { bounds: Aabb::new(bounds.min, left), space: 0, portals: vec![0] },
                Cell { bounds: Aabb::new(right, bounds.max), space: 1, portals: vec![0] },
            ],
            portals: vec![Portal { cells: [CellId(0), CellId(1)], polygon: door.clone() }],
            spaces: vec![
                Space { bounds: Aabb::new(bounds.min, left), cells: 0..1, gates: vec![0] },
                Space { bounds: Aabb::new(right, bounds.max), cells: 1..2, gates: vec![0] },
            ],
            gates: vec![Gate { spaces: [0, 1], polygon: door }],
            pvs: vec![all.clone(), all],
        },
        mesh: Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]] },
        movers: vec![swing_door()],
        spawns: vec![Spawn { eye: Vec3::new(1.0, 1.6, 1.0), yaw: 0.5 }],
        body: Body::PERSON,
        speed_max: 5.0,
        origin: Some(original()),
    }
}

/// Swings to and fro on a lift.
fn swing_door() -> Mover {
    let mut lift = Joint::still(DAffine3::from_translation(DVec3::new(4.0, 0.0, 1.0)));
    lift.translation = Track::linear(vec![(0.5, Vec3::ZERO), (1.5, Vec3::Y)]);
    let mut hinge = Joint::still(DAffine3::IDENTITY);
    let turned = |angle: f32| Quat::from_rotation_y(angle);
    hinge.rotation = Track::steps(vec![(0.0, turned(0.0)), (1.0, turned(1.0)), (2.0, turned(0.0))]);
    let trajectory = Trajectory::new(vec![lift, hinge], 2.0, Course::Loop).unwrap();
    let mesh =
        Mesh { positions: vec![Vec3::ZERO, Vec3::Y * 2.0, Vec3::X], triangles: vec![[0, 1, 2]] };
    Mover::new("door".into(), mesh, vec![[90, 60, 30]], trajectory).unwrap()
}

/// A brush between two clusters, of which one sees the other.
fn original() -> Origin {
    let plane = |normal, distance| OriginPlane { normal, distance };
    let leaf = |min, max, cluster| OriginLeaf {
        bounds: Aabb::new(Vec3::splat(min), Vec3::splat(max)),
        cluster,
    };
    Origin {
        planes: vec![plane(Vec3::X, 5.0), plane(Vec3::NEG_X, -4.0)],
        solids: vec![Solid {
            bounds: Aabb::new(Vec3::X * 4.0, Vec3::new(5.0, 4.0, 4.0)),
            sides: vec![0, 1],
        }],
        tree: Some(OriginTree {
            nodes: vec![
                OriginNode { plane: 0, sides: [OriginSide::Leaf(0), OriginSide::Node(1)] },
                OriginNode { plane: 1, sides: [OriginSide::Leaf(2), OriginSide::Leaf(1)] },
            ],
            leafs: vec![leaf(5.0, 8.0, Some(1)), leaf(4.0, 5.0, None), leaf(0.0, 4.0, Some(0))],
            clusters: 2,
            visible: vec![0b11, 0b10],
        }),
    }
}

#[test]
fn the_original_tells_where_a_point_is_and_what_it_sees() {
    let origin = original();
    let cluster = |x: f64| {
        let tree = origin.tree.as_ref().unwrap();
        tree.leafs[origin.leaf_at(DVec3::X * x).unwrap() as usize].cluster
    };
    assert_eq!([1.0, 4.5, 6.0].map(cluster), [Some(0), None, Some(1)]);
    let sees = |a, b| origin.tree.as_ref().unwrap().sees(a, b);
    assert_eq!([sees(0, 0), sees(0, 1), sees(1, 0), sees(1, 1)], [true, true, false, true]);
}

#[test]
fn what_is_written_is_read() {
    let world = small_world();
    assert_eq!(World::from_bytes(&world.to_bytes()).unwrap(), world);
    let without = World { origin: None, movers: Vec::new(), ..small_world() };
    assert_eq!(World::from_bytes(&without.to_bytes()).unwrap(), without);
    let folder = std::env::temp_dir().join(format!("slw-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let path = folder.join("w.slw");
    world.write(&path).unwrap();
    assert_eq!(World::read(&path).unwrap(), world);
    assert!(write_whole(&folder, b"").is_err(), "a folder is no file");
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1, "no partial file stays");
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn every_flipped_bit_and_every_cut_is_noticed() {
    let file = small_world().to_bytes();
    for i in 0..file.len() {
        for bit in 0..8 {
            let mut flipped = file.clone();
            flipped[i] ^= 1 << bit;
            assert!(World::from_bytes(&flipped).is_err(), "bit {bit} of byte {i}");
        }
        assert!(World::from_bytes(&file[..i]).is_err(), "cut at {i}");
    }
}

/// The content id is no help against whoever can compute it: the sections are checked too.
#[test]
fn hostile_sections_are_refused_or_give_a_valid_world() {
    let world = small_world();
    let file = world.to_bytes();
    let length = u64::from_le_bytes(file[40..48].try_into().unwrap());
    let sections = unpack(&file[48..], length).unwrap();
    let mut refused = 0;
    for i in 0..sections.len() {
        for value in [0, 1, 0x7f, 0x80, 0xff, sections[i] ^ 4] {
            let mut changed = sections.clone();
            changed[i] = value;
            let mut input = Input(&changed);
            match read_sections(&mut input) {
                Err(_) => refused += 1,
                // Whatever is accepted can be used and written again.
                Ok(world) => {
                    world.cells.at(Vec3::ONE);
                    world.cells.visible_from(&world.bounds());
                    for mover in &world.movers {
                        let place = mover.trajectory.at(Duration::from_millis(700));
                        assert!(place.is_finite(), "byte {i}");
                        mover.everywhere();
                    }
                    if let Some(origin) = &world.origin {
                        origin.leaf_at(DVec3::ONE);
                    }
                    assert!(World::from_bytes(&world.to_bytes()).is_ok(), "byte {i}");
                }
            }
        }
    }
    assert!(refused > sections.len(), "only {refused} refused");
}

#[test]
fn a_file_that_unpacks_to_more_than_it_says_is_refused() {
    let bomb = zstd::bulk::compress(&vec![0u8; 1 << 24], 3).unwrap();
    assert!(unpack(&bomb, 1 << 10).is_err());
    assert!(unpack(&bomb, u64::MAX).is_err());
}

#[test]
fn errors_say_what_to_do() {
    let check = |bytes: &[u8], expected: &str| {
        assert_eq!(World::from_bytes(bytes).unwrap_err().to_string(), expected);
    };
    check(b"", "this is not a Sightline world (.slw)");
    check(b"glTF and more", "this is not a Sightline world (.slw)");
    let mut file = small_world().to_bytes();
    file[4] = 9;
    check(&file, "world file version 9, but this program reads version 5; compile again");
}
