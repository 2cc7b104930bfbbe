//! Pictures in which rooms hide something, compared with rays.

use glam::{UVec3, Vec3};
use sightline_visibility::rooms::{BuildingSight, RoomIndex};
use sightline_world::{
    World,
    geometry::Aabb,
    octree::{Material, Octree, Voxel, morton},
    rooms::{Object, ObjectSet, Room, RoomId, RoomVisibility, Rooms, Shape, Window},
};

use super::{VOXEL, cast};
use crate::{Camera, Frame, Mode, Renderer, view::View};

const ORIGIN: Vec3 = Vec3::splat(-1.0);
const DEPTH: u8 = 6;
const SIZE: (usize, usize) = (64, 48);
const ROOMS: [Aabb; 2] = [
    Aabb { min: Vec3::ZERO, max: Vec3::new(6.0, 3.0, 6.0) },
    Aabb { min: Vec3::new(6.25, 0.0, 0.0), max: Vec3::new(12.0, 3.0, 6.0) },
];
/// The window in the wall between the rooms.
const WINDOW: Aabb = Aabb { min: Vec3::new(6.0, 1.0, 1.0), max: Vec3::new(6.0, 2.0, 3.0) };
/// The walls around a room that are visible with it, in metres.
const WALL_M: f32 = 0.301;
const CHEST: Aabb = Aabb { min: Vec3::new(3.0, 0.0, 2.0), max: Vec3::new(4.0, 1.0, 3.0) };

/// Two rooms with walls, the window and a door between them, and a chest.
fn building() -> Octree {
    let grid = |at: f32| ((at + 1.0) / VOXEL).floor() as u32;
    let mut places = Vec::new();
    let mut fill = |low: [f32; 3], high: [f32; 3]| {
        let [a, b] = [low, high].map(|corner| corner.map(grid));
        for x in a[0]..b[0] {
            for y in a[1]..b[1] {
                places.extend((a[2]..b[2]).map(|z| UVec3::new(x, y, z)));
            }
        }
    };
    fill([0.0, -0.25, 0.0], [12.0, 0.0, 6.0]);
    fill([12.0, 0.0, 0.0], [12.25, 3.0, 6.0]);
    fill([0.0, 0.0, -0.25], [12.0, 3.0, 0.0]);
    fill([0.0, 0.0, 6.0], [12.0, 3.0, 6.25]);
    fill(CHEST.min.to_array(), CHEST.max.to_array());
    for (low, high) in [
        ([0.0, 0.0], [1.0, 5.0]),
        ([2.0, 0.0], [3.0, 6.0]),
        ([1.0, 0.0], [2.0, 1.0]),
        ([1.0, 3.0], [2.0, 5.0]),
    ] {
        fill([6.0, low[0], low[1]], [6.25, high[0], high[1]]);
    }
    octree_at(places)
}

/// An octree of some voxels, given with their lower corners.
fn octree_of(voxels: &[(Material, Vec3)]) -> Octree {
    let place = |(_, corner): &(Material, Vec3)| ((*corner - ORIGIN) / VOXEL).round().as_uvec3();
    octree_at(voxels.iter().map(place).collect())
}

fn octree_at(places: Vec<UVec3>) -> Octree {
    let voxel = |at: UVec3| Voxel {
        key: morton(at),
        colour: [at.x as u8 * 4, at.y as u8 * 12, at.z as u8 * 9],
        ..Voxel::default()
    };
    let mut voxels: Vec<Voxel> = places.into_iter().map(voxel).collect();
    voxels.sort_by_key(|voxel| voxel.key);
    voxels.dedup_by_key(|voxel| voxel.key);
    Octree::from_voxels(ORIGIN, VOXEL, DEPTH, voxels).expect("small")
}

/// All voxels with their lower corners, found by looking at every place.
fn voxels(octree: &Octree) -> Vec<(Material, Vec3)> {
    let side = 0..1u32 << DEPTH;
    let places = side.clone().flat_map(|x| {
        let side = side.clone();
        side.clone().flat_map(move |y| side.clone().map(move |z| UVec3::new(x, y, z)))
    });
    let corner = |at: UVec3| ORIGIN + at.as_vec3() * VOXEL;
    let leaf = |at| Some((*octree.leaf_at(corner(at) + VOXEL * 0.5)?, corner(at)));
    places.filter_map(leaf).collect()
}

fn world(octree: &Octree, sees: RoomVisibility, has_window: bool) -> World {
    let mut world = sightline_fixtures::two_rooms::world();
    world.octree = octree.clone();
    let room = |name: &str, region| Room {
        name: name.into(),
        shapes: vec![Shape::Box(region)],
        ..Room::default()
    };
    let [low, high] = [WINDOW.min, WINDOW.max];
    let corners = [[low.y, low.z], [high.y, low.z], [high.y, high.z], [low.y, high.z]];
    let corners = corners.map(|[y, z]| Vec3::new(low.x, y, z)).to_vec();
    let window = Window { name: "w".into(), corners, behind: None };
    let windows = if has_window { vec![window] } else { Vec::new() };
    let first = Room { sees, windows, ..room("first", ROOMS[0]) };
    let chest = Object { name: "chest".into(), bounds: CHEST, mover: None };
    world.rooms = Rooms::new(vec![first, room("second", ROOMS[1])], vec![chest]).unwrap();
    world
}

fn set(rooms: &[u16], objects: &[u32]) -> ObjectSet {
    let rooms = rooms.iter().copied().map(RoomId).collect();
    ObjectSet { rooms, objects: objects.to_vec(), ..ObjectSet::default() }
}

/// Whether the author shows a voxel to a line of sight.
fn is_shown(sees: &RoomVisibility, has_window: bool, eye: Vec3, ray: Vec3, corner: Vec3) -> bool {
    let voxel = Aabb::new(corner, corner + VOXEL);
    let in_set = match sees {
        RoomVisibility::Unspecified => true,
        RoomVisibility::Only(named) => {
            let others = named.rooms.iter().map(|id| ROOMS[usize::from(id.0)]);
            others.chain([ROOMS[0]]).any(|room| room.grown(WALL_M).contains_box(&voxel))
        }
        RoomVisibility::AllBut(named) => {
            let mut rooms = named.rooms.iter().map(|id| ROOMS[usize::from(id.0)]);
            let is_chest = !named.objects.is_empty() && CHEST.contains(voxel.centre());
            !is_chest && !rooms.any(|room| room.grown(1.0e-3).contains_box(&voxel))
        }
    };
    let share = (WINDOW.min.x - eye.x) / ray.x;
    let at = eye + ray * share;
    let through = share > 0.0 && WINDOW.grown(1.0e-3).contains(at) && voxel.max.x > WINDOW.min.x;
    in_set || has_window && through
}

/// Each pixel shows the first voxel on its line of sight that is in the set, or is seen through a
/// window. A voxel behind the frame of a window is shown as a whole, so pixels there may differ.
#[test]
fn pixels_show_what_is_in_the_set_or_behind_a_window() {
    let octree = building();
    let voxels = voxels(&octree);
    let eye = Vec3::new(1.1, 1.6, 3.2);
    let sets = [
        RoomVisibility::Only(set(&[], &[])),
        RoomVisibility::Only(set(&[1], &[])),
        RoomVisibility::AllBut(set(&[1], &[0])),
        RoomVisibility::AllBut(set(&[], &[0])),
    ];
    let mut hides = 0;
    for (sees, has_window) in sets.iter().flat_map(|sees| [(sees, false), (sees, true)]) {
        let world = world(&octree, sees.clone(), has_window);
        let sight = BuildingSight::of(&world, &RoomIndex::new(&world), eye);
        for target in [Vec3::new(6.0, 1.4, 2.5), Vec3::new(6.0, 1.0, 5.0)] {
            let camera = Camera::looking_at(eye, target);
            let view = View::new(&camera, SIZE.0, SIZE.1);
            let forward = view.ray((SIZE.0 - 1) as f32 * 0.5, (SIZE.1 - 1) as f32 * 0.5);
            let expected: Vec<(f32, f32)> = (0..SIZE.0 * SIZE.1)
                .map(|i| {
                    let ray = view.ray((i % SIZE.0) as f32, (i / SIZE.0) as f32);
                    let seen = |(_, corner): &&(Material, Vec3)| {
                        is_shown(sees, has_window, eye, ray, *corner)
                    };
                    let shown: Vec<_> = voxels.iter().filter(seen).copied().collect();
                    let depth = cast(&shown, eye, ray, forward).1;
                    (depth, cast(&voxels, eye, ray, forward).1)
                })
                .collect();
            hides += expected.iter().filter(|(shown, all)| shown != all).count();
            for mode in Mode::ALL {
                let mut renderer = Renderer::default();
                renderer.mode = mode;
                renderer.building_sight = sight.clone();
                let mut frame = Frame::new(SIZE.0, SIZE.1);
                renderer.draw(&octree, &camera, &mut frame);
                let differs = |(drawn, (shown, _)): (&f32, &(f32, f32))| {
                    !(drawn == shown || (drawn - shown).abs() < 0.01)
                };
                let count = frame.depth.iter().zip(&expected).filter(|it| differs(*it)).count();
                let most = if has_window { 30 } else { 12 };
                assert!(count <= most, "{count} pixels, {sees:?}, {has_window}, {mode:?}");
            }
        }
    }
    assert!(hides > 500, "rooms hide something: {hides}");
}

/// An opaque room stands before the second room. Each pixel shows the first voxel on its line of
/// sight that the opaque room does not hide.
#[test]
fn pixels_show_nothing_behind_an_opaque_room() {
    let octree = building();
    let mut world = world(&octree, RoomVisibility::Unspecified, false);
    let screen = Aabb::new(Vec3::new(4.5, 0.0, 1.5), Vec3::new(5.0, 2.0, 4.5));
    let screen = Room {
        name: "screen".into(),
        shapes: vec![Shape::Box(screen)],
        opaque: true,
        ..Room::default()
    };
    world.rooms = Rooms::new(vec![screen], Vec::new()).unwrap();
    let eye = Vec3::new(1.1, 1.6, 3.2);
    let camera = Camera::looking_at(eye, Vec3::new(6.0, 1.4, 2.5));
    let sight = BuildingSight::of(&world, &RoomIndex::new(&world), eye);
    let shows = |corner: &Vec3| sight.as_ref().unwrap().shows(&Aabb::new(*corner, *corner + VOXEL));
    let all = voxels(&octree);
    let shown: Vec<_> = all.iter().filter(|(_, corner)| shows(corner)).copied().collect();
    assert!(shown.len() + 300 < all.len(), "{} of {} voxels are shown", shown.len(), all.len());
    for mode in Mode::ALL {
        let [drawn, expected] =
            [(&octree, sight.clone()), (&octree_of(&shown), None)].map(|(octree, sight)| {
                let mut renderer = Renderer::default();
                renderer.mode = mode;
                renderer.building_sight = sight;
                let mut frame = Frame::new(SIZE.0, SIZE.1);
                renderer.draw(octree, &camera, &mut frame);
                frame
            });
        let differs = |(a, b): &(&f32, &f32)| !(a == b || (*a - *b).abs() < 0.01);
        let differ = drawn.depth.iter().zip(&expected.depth).filter(differs).count();
        assert!(differ <= 12, "{differ} pixels, {mode:?}");
    }
}
