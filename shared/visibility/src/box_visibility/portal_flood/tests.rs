//! Rooms in a row, whose doors join two boxes or keep them apart.

use glam::Vec3;
use roaring::RoaringBitmap;
use sightline_world::{Cell, CellId, Gate, Node, Space, geometry::Axes};

use super::*;

/// Rooms in a row along x, each 10 m wide. In each wall between two of them is a door that spans
/// the given part of z.
fn row(doors: &[[f32; 2]]) -> PortalFlood {
    let room = |i: usize| {
        Aabb::new(
            Vec3::new(i as f32 * 10.0, 0.0, 0.0),
            Vec3::new(i as f32 * 10.0 + 10.0, 3.0, 10.0),
        )
    };
    let count = doors.len() + 1;
    let mut tree = Vec::new();
    for i in 0..doors.len() {
        let next = tree.len() as u32 + 1;
        tree.push(Node::Axial { axis: 0, at: i as f32 * 10.0 + 10.0, sides: [next, next + 1] });
        tree.push(Node::Leaf(CellId(i as u32)));
    }
    tree.push(Node::Leaf(CellId(doors.len() as u32)));
    let gates = doors.iter().enumerate().map(|(i, [from, to])| {
        let x = i as f32 * 10.0 + 10.0;
        let bounds = Aabb::new(Vec3::new(x, 0.0, *from), Vec3::new(x, 2.0, *to));
        let polygon = Polygon::Rectangle { axis: 0, bounds };
        Gate { spaces: [i as u32, i as u32 + 1], polygon }
    });
    let near = |i: usize| (i.saturating_sub(1)..(i + 1).min(doors.len())).map(|gate| gate as u32);
    PortalFlood::new(&Cells {
        axes: Axes::WORLD,
        bounds: room(0).union(&room(doors.len())),
        tree,
        cells: (0..count)
            .map(|i| Cell { bounds: room(i), space: i as u32, portals: Vec::new() })
            .collect(),
        portals: Vec::new(),
        spaces: (0..count)
            .map(|i| Space {
                bounds: room(i),
                cells: i as u32..i as u32 + 1,
                gates: near(i).collect(),
            })
            .collect(),
        gates: gates.collect(),
        pvs: vec![RoaringBitmap::new(); count],
    })
}

#[track_caller]
fn check(doors: &[[f32; 2]], from: [f32; 2], to: [f32; 2], expected: bool) {
    let [from, to] = [from, to].map(|[x, z]| Aabb::around(Vec3::new(x, 1.0, z), 0.5));
    let (flood, mut scratch) = (row(doors), FloodScratch::default());
    for (from, to) in [(&from, &to), (&to, &from)] {
        assert_eq!(flood.are_closed(&mut scratch, from, to, &mut 0), expected);
    }
}

#[test]
fn boxes_are_apart_unless_gates_join_them() {
    check(&[[4.0, 5.0]], [5.0, 4.5], [15.0, 4.5], false);
    check(&[[4.0, 5.0]], [5.0, 1.0], [15.0, 1.0], true);
    check(&[[4.0, 5.0]], [5.0, 1.0], [15.0, 8.0], false);
    check(&[[4.0, 5.0]], [5.0, 1.0], [5.0, 8.0], false);
    // Each door alone lets lines pass, but no line passes through both.
    check(&[[4.0, 5.0], [4.0, 5.0]], [5.0, 4.5], [25.0, 4.5], false);
    check(&[[4.0, 5.0], [8.0, 9.0]], [5.0, 4.5], [25.0, 4.5], true);
    // A box in the wall between two rooms is in both rooms.
    check(&[[4.0, 5.0]], [5.0, 1.0], [10.0, 1.0], false);
}
