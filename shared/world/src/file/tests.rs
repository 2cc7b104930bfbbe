use std::time::Duration;

use glam::{DAffine3, DVec3, Quat, UVec3, Vec2, Vec3};
use roaring::RoaringBitmap;

use super::{meta::read_rooms, *};
use crate::{
    cells::{Cell, CellId, Cells, Gate, Node, Polygon, Portal, Space},
    geometry::{Aabb, Axes},
    light::{BakedLight, Probe, ProbeGrid},
    mesh::Mesh,
    motion::{
        Body, Spawn,
        trajectory::{Joint, KeyframeTrack, Playback, Trajectory},
    },
    mover::Mover,
    octree::{Material, Voxel, morton},
    origin::{Origin, OriginLeaf, OriginNode, OriginPlane, OriginSide, OriginTree, Solid},
    rooms::{Object, ObjectSet, Room, RoomId, RoomVisibility, Rooms, Shape, Window},
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
            vec![voxel(0, 0), voxel(1, Material::GLASS), voxel(3, 0)],
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
        rooms: meeting_room(),
        light: Some(baked_light()),
        spawns: vec![Spawn { eye: Vec3::new(1.0, 1.6, 1.0), yaw: 0.5 }],
        body: Body::PERSON,
        speed_max: 5.0,
        origin: Some(original()),
    }
}

/// Two probes, one above the other, and the sky.
fn baked_light() -> BakedLight {
    let probe = |links| Probe { levels: [9, 200, 0, 255, 80, 81], tint: [255, 200, 90], links };
    BakedLight {
        exposure: 0.4,
        brightest: 9.0,
        sky: Some(probe(0)),
        grid: ProbeGrid {
            origin: Vec3::ZERO,
            spacing: 1.0,
            size: UVec3::new(3, 2, 2),
            places: vec![1, 4],
            probes: vec![probe(2), probe(0)],
        },
    }
}

/// A room with a window, and a set with one of everything that sets can hold.
fn meeting_room() -> Rooms {
    let shape = Shape::Box(Aabb::new(Vec3::ZERO, Vec3::splat(4.0)));
    let corners = [Vec2::ZERO, Vec2::X, Vec2::Y].to_vec();
    let set = ObjectSet { rooms: vec![RoomId(1)], cells: vec![CellId(1)], objects: vec![0] };
    let window = Window {
        name: "door".into(),
        corners: vec![Vec3::X * 4.0, Vec3::new(4.0, 2.0, 0.0), Vec3::new(4.0, 0.0, 1.0)],
        behind: None,
    };
    let meeting = Room {
        name: "meeting".into(),
        title: Some("Meeting".into()),
        shapes: vec![shape],
        sees: RoomVisibility::Only(set),
        windows: vec![window],
        sealed: true,
        spawn: Some(Spawn { eye: Vec3::ONE, yaw: 1.0 }),
        capacity: Some(12),
        tag: Some("private".into()),
        ..Room::default()
    };
    let shapes = vec![Shape::Plan { corners, heights: None }];
    let other = Room { name: "other".into(), shapes, ..Room::default() };
    let bounds = Aabb::around(Vec3::ONE, 1.0);
    let door = Object { name: "door".into(), bounds, mover: Some(0) };
    Rooms::new(vec![meeting, other], vec![door]).unwrap()
}

/// A door that swings to and fro on a lift.
fn swing_door() -> Mover {
    let mut lift = Joint::still(DAffine3::from_translation(DVec3::new(4.0, 0.0, 1.0)));
    lift.translation = KeyframeTrack::linear(vec![(0.5, Vec3::ZERO), (1.5, Vec3::Y)]);
    let mut hinge = Joint::still(DAffine3::IDENTITY);
    let turned = |angle: f32| Quat::from_rotation_y(angle);
    hinge.rotation =
        KeyframeTrack::steps(vec![(0.0, turned(0.0)), (1.0, turned(1.0)), (2.0, turned(0.0))]);
    let trajectory = Trajectory::new(vec![lift, hinge], 2.0, Playback::Loop).unwrap();
    let mesh =
        Mesh { positions: vec![Vec3::ZERO, Vec3::Y * 2.0, Vec3::X], triangles: vec![[0, 1, 2]] };
    Mover::new("door".into(), mesh, vec![[90, 60, 30]], trajectory).unwrap()
}

/// A hostile file can hold rooms that refer to cells, movers or rooms that do not exist.
#[test]
fn rooms_that_refer_to_missing_things_are_refused() {
    let check = |change: &dyn Fn(&mut Room, &mut Object)| {
        let rooms = meeting_room();
        let (mut list, mut objects) = (rooms.list().to_vec(), rooms.objects().to_vec());
        change(&mut list[0], &mut objects[0]);
        // The bytes of the rooms, had nobody checked them.
        let faulty = postcard::to_stdvec(&(&list, &objects)).unwrap();
        let read = read_rooms(&SectionReader::new(&faulty), 2, 1);
        assert_eq!(read.is_ok(), list == rooms.list() && objects == rooms.objects(), "{list:?}");
    };
    check(&|_, _| ());
    check(&|room, _| room.shapes.clear());
    check(&|room, _| room.name = "other".into());
    check(&|room, _| room.name = String::new());
    check(&|room, _| room.title = Some("x".repeat(200)));
    check(&|room, _| room.windows[0].behind = Some(0));
    check(&|room, _| room.windows[0].corners.truncate(2));
    check(&|room, _| room.windows[0].corners[0].x = f32::NAN);
    check(&|room, _| room.shapes[0] = Shape::Box(Aabb::EMPTY));
    check(&|room, _| room.shapes[0] = Shape::Hull(vec![Vec3::ZERO; 33]));
    let plan = |heights| Shape::Plan { corners: vec![Vec2::ZERO; 3], heights };
    check(&|room, _| room.shapes[0] = plan(Some([2.0, 1.0])));
    check(&|room, _| room.shapes[0] = plan(Some([2.0, f32::INFINITY])));
    check(&|room, _| room.spawn = Some(Spawn { eye: Vec3::NAN, yaw: 0.0 }));
    let set = |rooms: u16, cells: u32, objects: u32| {
        let (rooms, cells) = (vec![RoomId(rooms)], vec![CellId(cells)]);
        RoomVisibility::AllBut(ObjectSet { rooms, cells, objects: vec![objects] })
    };
    check(&|room, _| room.sees = set(2, 0, 0));
    check(&|room, _| room.sees = set(0, 2, 0));
    check(&|room, _| room.sees = set(0, 0, 1));
    check(&|_, object| object.mover = Some(1));
    check(&|_, object| object.bounds = Aabb::EMPTY);
    assert!(read_rooms(&SectionReader::new(&[0xff; 40]), 2, 1).is_err());
    assert!(read_rooms(&SectionReader::new(&[0, 0, 0]), 2, 1).is_err(), "bytes after the rooms");
}

/// A hostile file can claim a grid of any size.
#[test]
fn light_that_cannot_be_is_refused() {
    let check = |change: &dyn Fn(&mut BakedLight)| {
        let mut changed = baked_light();
        change(&mut changed);
        light::read(&mut SectionReader::new(&light::to_bytes(Some(&changed)))).is_ok()
    };
    assert!(check(&|_| ()));
    assert!(!check(&|light| light.exposure = 0.0));
    assert!(!check(&|light| light.brightest = f32::INFINITY));
    assert!(!check(&|light| light.grid.spacing = -1.0));
    assert!(!check(&|light| light.grid.origin.x = f32::NAN));
    assert!(!check(&|light| light.grid.size = UVec3::new(u32::MAX, 1, 1)));
    assert!(!check(&|light| light.grid.size = UVec3::splat(1 << 20)));
    assert!(!check(&|light| light.grid.size = UVec3::new(2, 2, 1)));
    assert!(!check(&|light| light.grid.places = vec![1, 1]));
    assert!(!check(&|light| light.grid.probes[0].links = 8));
    let mut cut = light::to_bytes(Some(&baked_light()));
    cut.push(0);
    assert!(light::read(&mut SectionReader::new(&cut)).is_err(), "bytes after the probes");
}

/// A Quake map with a brush between two clusters, one of which sees the other.
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
fn a_quake_map_tells_the_leaf_of_a_point_and_what_its_cluster_sees() {
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
fn a_written_world_reads_back_equal() {
    let world = small_world();
    assert_eq!(World::from_bytes(&world.to_bytes()).unwrap(), world);
    let without = World {
        origin: None,
        movers: Vec::new(),
        rooms: Rooms::default(),
        light: None,
        ..small_world()
    };
    assert_eq!(World::from_bytes(&without.to_bytes()).unwrap(), without);
    let folder = std::env::temp_dir().join(format!("slw-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let path = folder.join("w.slw");
    world.write(&path).unwrap();
    assert_eq!(World::read(&path).unwrap(), world);
    assert!(write_whole(&folder, b"").is_err(), "a folder is not a file");
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1, "no partial file may remain");
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

/// An attacker can compute the content id, so the reader checks the sections too.
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
            let mut input = SectionReader::new(&changed);
            match read_sections(&mut input) {
                Err(_) => refused += 1,
                // An accepted world can be used, and written again.
                Ok(world) => {
                    world.cells.at(Vec3::ONE);
                    world.cells.visible_from(&world.bounds());
                    world.light_at(Vec3::new(1.2, 0.6, 0.3));
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
fn a_file_that_unpacks_to_more_than_it_claims_is_refused() {
    let bomb = packing::pack(&vec![0u8; 1 << 24], 3);
    assert!(unpack(&bomb, 1 << 10).is_err());
    assert!(unpack(&bomb, u64::MAX).is_err());
}

#[test]
fn a_small_file_that_unpacks_to_a_large_world_is_refused() {
    let zeros = vec![0u8; 1 << 26];
    let bomb = packing::pack(&zeros, 3);
    assert!(bomb.len() < 100_000);
    let error = unpack(&bomb, 1 << 26).unwrap_err().to_string();
    assert!(error.contains("unpacks to more than"), "{error}");
    // What does not pack well is taken.
    let noise: Vec<u8> =
        (0..1_u32 << 18).flat_map(|i| i.wrapping_mul(2_654_435_769).to_le_bytes()).collect();
    assert_eq!(unpack(&packing::pack(&noise, 3), noise.len() as u64).unwrap(), noise);
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
    check(&file, "world file version 9, but this program reads version 7; compile again");
}
