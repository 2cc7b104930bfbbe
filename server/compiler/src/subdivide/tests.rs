use glam::DVec3;
use sightline_world::{
    CellId, Cells,
    geometry::{Aabb, Axes},
};

use super::*;
use crate::{
    occluders::{OccluderTriangle, PlaneRect, planes},
    split_plane::SplitPlane,
};

/// A rectangle perpendicular to an axis, as two triangles.
fn rect(axis: usize, at: f32, min: [f64; 2], max: [f64; 2]) -> [[DVec3; 3]; 2] {
    let corners = PlaneRect { min: min.into(), max: max.into() }.corners();
    let [a, b, c, d] = corners.map(|p| SplitPlane::Axial { axis, at }.upright(p));
    [[a, b, c], [a, c, d]]
}

fn bounds() -> Aabb {
    Aabb::new(Vec3::ZERO, Vec3::new(10.0, 3.0, 4.0))
}

fn split(opaque: &[[DVec3; 3]], grain: CellGrain<'_>) -> Cells {
    let opaque = opaque.iter().map(|&corners| OccluderTriangle { corners, is_last: false });
    let planes = planes(&opaque.collect::<Vec<_>>());
    let occluders = SubdivisionInput { planes: &planes, solids: &[], eyes: &[] };
    cells(&Spaces::new(&bounds(), Axes::WORLD, &occluders), grain)
}

#[test]
fn an_empty_region_is_one_cell() {
    let cells = split(&[], CellGrain::Whole);
    assert_eq!((cells.cells.len(), cells.portals.len()), (1, 0));
    assert_eq!(cells.at(Vec3::ONE), Some(CellId(0)));
}

#[test]
fn a_wall_with_a_door_makes_two_cells_and_one_portal() {
    let wall = [
        rect(0, 5.0, [0.0, 0.0], [3.0, 1.5]),
        rect(0, 5.0, [0.0, 2.5], [3.0, 4.0]),
        rect(0, 5.0, [2.0, 1.5], [3.0, 2.5]),
    ];
    let cells = split(wall.as_flattened(), CellGrain::Whole);
    assert_eq!(cells.cells.len(), 2);
    let door = Aabb::new(Vec3::new(5.0, 0.0, 1.5), Vec3::new(5.0, 2.0, 2.5));
    assert_eq!(cells.portals.iter().map(|p| p.polygon.bounds()).collect::<Vec<_>>(), vec![door]);
    assert_ne!(cells.at(Vec3::new(4.9, 1.0, 2.0)), cells.at(Vec3::new(5.1, 1.0, 2.0)));
    let mut found = Vec::new();
    cells.overlapping(&Aabb::around(Vec3::new(5.0, 1.0, 2.0), 0.1), &mut found);
    assert_eq!(found, vec![CellId(0), CellId(1)]);
}

#[test]
fn something_small_makes_no_cell() {
    let shelf = rect(1, 1.0, [1.0, 1.0], [2.0, 1.5]);
    assert_eq!(split(&shelf, CellGrain::Whole).cells.len(), 1);
}

#[test]
fn cells_lie_in_one_space_each_and_are_not_wide() {
    let wall = [rect(0, 5.0, [0.0, 0.0], [3.0, 1.5]), rect(0, 5.0, [0.0, 2.5], [3.0, 4.0])];
    let large = split(wall.as_flattened(), CellGrain::Whole);
    let small =
        split(wall.as_flattened(), CellGrain::Even(CellSize { width_max: 3.0, height_max: 4.0 }));
    assert_eq!((large.cells.len(), small.cells.len()), (2, 8));
    assert_eq!((large.spaces.len(), small.spaces.len()), (2, 2));
    for place in &small.cells {
        let around = large.at(place.bounds.centre()).unwrap();
        assert!(large.cells[around.0 as usize].bounds.contains_box(&place.bounds));
        assert!(small.spaces[place.space as usize].bounds.contains_box(&place.bounds));
        assert!(place.bounds.size().x <= 3.0 && place.bounds.size().z <= 3.0);
    }
    // Four inside each room, and the door cut in two.
    assert_eq!(small.portals.len(), 4 + 4 + 2);
}

/// Two rooms that a door joins, and a third that nothing opens into.
fn three_rooms() -> Spaces {
    let walls = [
        rect(0, 4.0, [0.0, 0.0], [3.0, 1.5]),
        rect(0, 4.0, [0.0, 2.5], [3.0, 4.0]),
        rect(0, 8.0, [0.0, 0.0], [3.0, 4.0]),
    ];
    let opaque =
        walls.as_flattened().iter().map(|&corners| OccluderTriangle { corners, is_last: false });
    let planes = planes(&opaque.collect::<Vec<_>>());
    let occluders = SubdivisionInput { planes: &planes, solids: &[], eyes: &[] };
    Spaces::new(&bounds(), Axes::WORLD, &occluders)
}

#[test]
fn only_spaces_that_see_all_they_may_see_stay_whole() {
    let spaces = three_rooms();
    let go_on = |_| std::ops::ControlFlow::Continue(());
    let seen = crate::pvs::spaces_seen(&cells(&spaces, CellGrain::Whole), &go_on).unwrap();
    let whole = see_all(&spaces, &seen);
    assert_eq!(whole, [false, false, true], "a door separates what is seen through it");
    let grain = CellGrain::EvenExcept(CellSize::of_width(1.0), &whole);
    let cells = cells(&spaces, grain);
    let counts: Vec<usize> = cells.spaces.iter().map(|space| space.cells.len()).collect();
    assert!(counts[0] > 8 && counts[1] > 8 && counts[2] == 1, "{counts:?}");
}

#[test]
fn gates_let_rays_through_and_walls_do_not() {
    let spaces = three_rooms();
    let rays = gate_rays::GateRays::new(&spaces);
    let between = |from: [f64; 3], to: [f64; 3]| rays.between(from.into(), to.into());
    assert!(between([1.0, 1.0, 2.0], [7.0, 1.0, 2.0]), "through the door");
    assert!(!between([1.0, 1.0, 0.5], [7.0, 1.0, 0.5]), "through the wall beside it");
    assert!(!between([7.0, 1.0, 2.0], [9.0, 1.0, 2.0]), "through the closed wall");
    assert!(between([1.0, 1.0, 0.5], [3.0, 2.0, 3.5]), "within a room");
}
