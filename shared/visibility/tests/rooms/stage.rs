//! Rooms in worlds without walls, and questions about points and boxes.

use glam::{Vec2, Vec3};
use sightline_visibility::rooms::RoomIndex;
use sightline_world::{
    Cells, Mesh, Spawn, World,
    geometry::{Aabb, Axes},
    motion::Body,
    octree::Octree,
    rooms::{Room, RoomVisibility, Rooms, Shape, Window},
};

/// The bounds of every world here.
pub const EVERYTHING: Aabb = Aabb::new(Vec3::splat(-30.0), Vec3::splat(30.0));

/// A room made of some shapes.
pub fn room(name: &str, shapes: Vec<Shape>) -> Room {
    Room { name: name.into(), shapes, ..Room::default() }
}

/// A box shape between two corners.
pub fn block(min: [f32; 3], max: [f32; 3]) -> Shape {
    Shape::Box(Aabb::new(min.into(), max.into()))
}

/// A polygon of the plan, given as x and z, between two heights or at every height.
pub fn plan(corners: &[[f32; 2]], heights: Option<[f32; 2]>) -> Shape {
    Shape::Plan { corners: corners.iter().copied().map(Vec2::from).collect(), heights }
}

/// A window: an upright rectangle over a line of the plan, between two heights.
pub fn window(name: &str, [from, to]: [[f32; 2]; 2], [low, high]: [f32; 2]) -> Window {
    let at = |[x, z]: [f32; 2], y: f32| Vec3::new(x, y, z);
    let corners = vec![at(from, low), at(to, low), at(to, high), at(from, high)];
    Window { name: name.into(), corners, behind: None }
}

/// A room with a set and windows.
pub fn seeing(room: Room, sees: RoomVisibility, windows: Vec<Window>) -> Room {
    Room { sees, windows, ..room }
}

/// A world of one cell, so that cells let everybody see everybody. Its own axes are turned.
pub fn world(rooms: Rooms, turn: f64) -> World {
    let cells = Cells { axes: Axes::turned(turn), ..Cells::whole(EVERYTHING) };
    World {
        title: "nothing but rooms".into(),
        octree: Octree::empty(Vec3::ZERO, 1.0, 1),
        cells,
        mesh: Mesh::default(),
        movers: Vec::new(),
        rooms,
        spawns: vec![Spawn { eye: Vec3::ZERO, yaw: 0.0 }],
        body: Body::PERSON,
        speed_max: 4.0,
        light: None,
        origin: None,
    }
}

/// Whether rooms let somebody in one box see some of another box. Boxes are in own axes.
pub fn may_see(world: &World, index: &RoomIndex, eyes: Aabb, body: Aabb) -> bool {
    let overlap = |region| index.overlap(&world.cells, &[region]);
    let asked = index.may_see(&overlap(eyes), &overlap(body));
    // The boxes can be in every cell that they overlap. So cells must not change the answer to yes.
    let in_cells = |region| {
        let mut found = Vec::new();
        world.cells.overlapping(&region, &mut found);
        index.overlap_in_cells(&world.cells, &[region], &found)
    };
    assert!(asked || !index.may_see(&in_cells(eyes), &in_cells(body)), "{eyes:?} {body:?}");
    asked
}

/// The box of a single point.
pub fn at(point: Vec3) -> Aabb {
    Aabb::new(point, point)
}
