use glam::Vec3;
use sightline_world::{
    geometry::{Aabb, Axes},
    motion::Body,
    octree::Octree,
    rooms::Rooms,
    *,
};

/// Two rooms of 6 × 6 m beside each other, and a door of a metre at one end of the wall between. A host
/// reads its world from the file that `sightline-server compile` makes, by [`World::read`]; one this
/// small can be written down.
pub fn two_rooms() -> World {
    let part = |x: [f32; 2], top: f32, z: [f32; 2]| {
        Aabb::new(Vec3::new(x[0], 0.0, z[0]), Vec3::new(x[1], top, z[1]))
    };
    let rooms = [part([0.0, 6.0], 3.0, [0.0, 6.0]), part([6.0, 12.0], 3.0, [0.0, 6.0])];
    let door = Polygon::Rectangle { axis: 0, bounds: part([6.0, 6.0], 2.1, [0.0, 1.0]) };
    let cell = |i: usize| Cell { bounds: rooms[i], space: i as u32, portals: vec![0] };
    let space =
        |i: usize| Space { bounds: rooms[i], cells: i as u32..i as u32 + 1, gates: vec![0] };
    let bounds = rooms[0].union(&rooms[1]);
    World {
        title: "two rooms".to_owned(),
        cells: Cells {
            axes: Axes::WORLD,
            bounds,
            tree: vec![
                Node::Axial { axis: 0, at: 6.0, sides: [1, 2] },
                Node::Leaf(CellId(0)),
                Node::Leaf(CellId(1)),
            ],
            cells: vec![cell(0), cell(1)],
            portals: vec![Portal { cells: [CellId(0), CellId(1)], polygon: door.clone() }],
            spaces: vec![space(0), space(1)],
            gates: vec![Gate { spaces: [0, 1], polygon: door }],
            // From somewhere in each room one sees into the other. The rest is for the engine to find.
            pvs: vec![[0, 1].into_iter().collect(); 2],
        },
        spawns: vec![Spawn { eye: Vec3::new(3.0, 1.6, 3.0), yaw: 0.0 }],
        body: Body::PERSON,
        speed_max: 2.0,
        // What is drawn, and what rays are shot at: the engine looks at neither.
        octree: Octree::empty(bounds.min, 12.0, 1),
        mesh: Mesh::default(),
        movers: Vec::new(),
        rooms: Rooms::default(),
        origin: None,
    }
}
