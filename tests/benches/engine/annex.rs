//! Closed rooms beside a building: one for each hidden avatar.

use std::sync::Arc;

use glam::Vec3;
use sightline_world::{Cell, CellId, Cells, Node, Space, World, geometry::Aabb};

/// From one room to the next, in metres.
const PITCH_M: f32 = 4.0;
/// Between two rooms, in metres.
const WALL_M: f32 = 0.6;
/// The height of a room, in metres.
const HEIGHT_M: f32 = 3.0;
/// Between the building and the first rooms, in metres.
const APART_M: f32 = 10.0;

/// The world with a number of closed rooms, and where they are. Nothing sees into them or out of
/// them, and no door leads there. Only the engine can use this world: the rooms are not drawn.
pub fn with_annex(world: &World, rooms: usize) -> (Arc<World>, Vec<Aabb>) {
    let mut world = world.clone();
    let whole = world.cells.bounds;
    let side = (rooms as f32).sqrt().ceil() as usize;
    let corner = Vec3::new(whole.max.x + APART_M, whole.min.y, whole.min.z);
    let size = Vec3::new(PITCH_M - WALL_M, HEIGHT_M, PITCH_M - WALL_M);
    let places: Vec<Aabb> = (0..rooms)
        .map(|i| {
            let place = Vec3::new((i / side) as f32, 0.0, (i % side) as f32);
            let min = corner + place * PITCH_M + Vec3::new(WALL_M, 0.0, WALL_M) * 0.5;
            Aabb::new(min, min + size)
        })
        .collect();
    let first = world.cells.cells.len() as u32;
    let numbered: Vec<(CellId, Aabb)> =
        places.iter().zip(first..).map(|(room, id)| (CellId(id), *room)).collect();
    add_rooms(&mut world.cells, &numbered);
    (Arc::new(world), places)
}

fn add_rooms(cells: &mut Cells, rooms: &[(CellId, Aabb)]) {
    let Some((_, one)) = rooms.first() else { return };
    let parting = one.min.x - APART_M * 0.5;
    let building = std::mem::take(&mut cells.tree);
    let annex = 1 + building.len() as u32;
    cells.tree.push(Node::Axial { axis: 0, at: parting, sides: [1, annex] });
    cells.tree.extend(building.into_iter().map(moved));
    divide(&mut cells.tree, rooms);
    for (id, bounds) in rooms {
        let space = cells.spaces.len() as u32;
        cells.cells.push(Cell { bounds: *bounds, space, portals: Vec::new() });
        cells.spaces.push(Space { bounds: *bounds, cells: id.0..id.0 + 1, gates: Vec::new() });
        cells.pvs.push([id.0].into_iter().collect());
        cells.bounds = cells.bounds.union(bounds);
    }
}

/// The node of a tree to which another root is prepended.
fn moved(node: Node) -> Node {
    let next = |sides: [u32; 2]| sides.map(|side| side + 1);
    match node {
        Node::Axial { axis, at, sides } => Node::Axial { axis, at, sides: next(sides) },
        Node::Plane { normal, distance, sides } => {
            Node::Plane { normal, distance, sides: next(sides) }
        }
        leaf => leaf,
    }
}

/// Appends a tree over rooms in a grid, given column by column.
fn divide(tree: &mut Vec<Node>, rooms: &[(CellId, Aabb)]) {
    let (Some((first, room)), Some((_, last))) = (rooms.first(), rooms.last()) else {
        tree.push(Node::Solid);
        return;
    };
    if rooms.len() == 1 {
        return wall_off(tree, *first, room);
    }
    let axis = if room.min.x == last.min.x { 2 } else { 0 };
    let middle = rooms[rooms.len() / 2].1.min[axis];
    let before = |at: f32| rooms.partition_point(|(_, room)| room.min[axis] < at);
    let half = match before(middle) {
        0 => rooms.partition_point(|(_, other)| other.min[axis] <= room.min[axis]),
        half => half,
    };
    let at = rooms[half].1.min[axis] - WALL_M * 0.5;
    let node = tree.len();
    tree.push(Node::Solid);
    let lesser = tree.len() as u32;
    divide(tree, &rooms[..half]);
    let greater = tree.len() as u32;
    divide(tree, &rooms[half..]);
    tree[node] = Node::Axial { axis: axis as u8, at, sides: [lesser, greater] };
}

/// Appends a room with walls around it.
fn wall_off(tree: &mut Vec<Node>, id: CellId, room: &Aabb) {
    for axis in 0..3 {
        for (at, inside) in [(room.min[axis], 1), (room.max[axis], 0)] {
            let next = tree.len() as u32;
            let mut sides = [next + 1; 2];
            sides[inside] = next + 2;
            tree.push(Node::Axial { axis: axis as u8, at, sides });
            tree.push(Node::Solid);
        }
    }
    tree.push(Node::Leaf(id));
}

/// Checks that an eye in a room is in that room's cell, and in no other.
pub fn check(world: &World, rooms: &[Aabb]) {
    let first = world.cells.cells.len() - rooms.len();
    for (i, room) in rooms.iter().enumerate() {
        let cell = CellId((first + i) as u32);
        assert_eq!(world.cells.at(room.centre()), Some(cell));
        let mut found = Vec::new();
        world.cells.overlapping(&room.grown(WALL_M * 0.25), &mut found);
        assert_eq!(found, [cell]);
    }
}
