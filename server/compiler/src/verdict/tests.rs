use std::ops::ControlFlow;

use sightline_world::geometry::Aabb;

use super::*;
use crate::{
    CompileOptions, LightMethod, compile,
    model::{Surface, SurfaceMaterial},
};

/// The six sides of a box, as triangles.
fn block(min: [f32; 3], max: [f32; 3]) -> Vec<[Vec3; 3]> {
    let corner = |i: usize| Vec3::from_array([0, 1, 2].map(|axis| [min, max][i >> axis & 1][axis]));
    let sides =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let side = |side: &[usize; 4]| {
        let [a, b, c, d] = side.map(corner);
        [[a, b, c], [a, c, d]]
    };
    sides.iter().flat_map(side).collect()
}

/// A house of 12 x 3 x 6 m with two rooms of the same size and a doorway between them.
fn house() -> Vec<[Vec3; 3]> {
    [
        block([0.0, -0.2, 0.0], [12.0, 0.0, 6.0]),
        block([0.0, 3.0, 0.0], [12.0, 3.2, 6.0]),
        block([-0.2, -0.2, -0.2], [0.0, 3.2, 6.2]),
        block([12.0, -0.2, -0.2], [12.2, 3.2, 6.2]),
        block([0.0, -0.2, -0.2], [12.0, 3.2, 0.0]),
        block([0.0, -0.2, 6.0], [12.0, 3.2, 6.2]),
        block([6.0, 0.0, 0.0], [6.2, 3.0, 2.5]),
        block([6.0, 0.0, 3.5], [6.2, 3.0, 6.0]),
        block([6.0, 2.2, 2.5], [6.2, 3.0, 3.5]),
    ]
    .concat()
}

fn verdict(model: &Model) -> Verdict {
    let options = CompileOptions {
        voxel: Some(0.1),
        cell: Some(1.5),
        light: LightMethod::None,
        ..CompileOptions::default()
    };
    let (world, _) = compile(model, &options, &|_, _| ControlFlow::Continue(())).unwrap();
    Verdict::new(model, &world)
}

fn with(more: &[[Vec3; 3]]) -> Model {
    Model::of_triangles("house", [&house(), more].concat(), [200; 3])
}

/// Whether a sentence of a verdict has a word in it.
fn says(verdict: &Verdict, word: &str) -> bool {
    verdict.sentences().iter().any(|sentence| sentence.contains(word))
}

fn area(verdict: &Verdict, reason: Reason) -> f32 {
    verdict.idle.iter().filter(|idle| idle.reason == reason).map(|idle| idle.area_m2).sum()
}

#[test]
fn a_plain_house_gets_no_complaint() {
    let verdict = verdict(&with(&[]));
    let share = verdict.seen_share.expect("there are places");
    assert!((0.5..1.0).contains(&share), "each room sees itself and some of the other: {share}");
    assert!(verdict.hiding_m2 > 100.0, "{}", verdict.hiding_m2);
    assert!(verdict.walls.iter().any(|wall| wall.hides));
    let complaints = ["tilted", "closed", "round", "small", "transparent", "opening", "floor,"];
    for word in complaints {
        assert!(!says(&verdict, word), "{word}: {:?}", verdict.sentences());
    }
    assert_eq!(verdict.floorless_share, 0.0);
}

#[test]
fn walls_that_hide_more_lower_the_share() {
    let open = verdict(&with(&[]));
    let closed = verdict(&with(&block([6.05, 0.0, 2.5], [6.15, 2.2, 3.5])));
    assert!(closed.seen_share.unwrap() < open.seen_share.unwrap() - 0.1);
    assert!((0.4..0.6).contains(&closed.seen_share.unwrap()), "{:?}", closed.seen_share);
}

#[test]
fn a_room_without_an_opening_is_named_and_so_is_its_door() {
    let door = block([6.05, 0.0, 2.5], [6.15, 2.2, 3.5]);
    let mut model = with(&door);
    let bounds = Aabb::from_points(door.as_flattened().iter().copied());
    model.nodes.push(("Door 7".into(), bounds));
    let found = verdict(&model);
    assert_eq!(found.closed_doors, ["Door 7"]);
    assert!(says(&found, "--open-doors"));
    let [(at, floor)] = found.unreachable[..] else { panic!("{:?}", found.unreachable) };
    assert!((24.0..40.0).contains(&floor) && (0.0..12.0).contains(&at.x), "{floor} {at}");
    // A door of which one can see the other side around it does not count.
    let mut open = with(&block([7.0, 0.0, 2.5], [7.1, 2.2, 3.5]));
    let aside = Aabb::new(Vec3::new(7.0, 0.0, 2.5), Vec3::new(7.1, 2.2, 3.5));
    open.nodes.push(("Door 8".into(), aside));
    let open = verdict(&open);
    assert!(open.closed_doors.is_empty() && open.unreachable.is_empty(), "{:?}", open.sentences());
}

#[test]
fn tilted_walls_are_named() {
    let [a, b] = [Vec3::new(2.0, 0.0, 1.0), Vec3::new(2.0, 0.0, 5.0)];
    let lean = Vec3::new(1.0, 2.6, 0.0);
    let tilted = [[a, b, b + lean], [a, b + lean, a + lean]];
    let verdict = verdict(&with(&tilted));
    assert!((area(&verdict, Reason::Tilted) - 4.0 * lean.length()).abs() < 0.1);
    assert!(says(&verdict, "tilted") && !says(&verdict, "round"));
}

#[test]
fn round_walls_are_named() {
    let at = |i: usize| {
        let (sine, cosine) = (i as f32 / 48.0 * std::f32::consts::TAU).sin_cos();
        Vec3::new(3.0 + cosine * 1.5, 0.2, 3.0 + sine * 1.5)
    };
    let up = Vec3::Y * 1.4;
    let strip = |i: usize| {
        let (a, b) = (at(i), at(i + 1));
        [[a, b, b + up], [a, b + up, a + up]]
    };
    let drum: Vec<_> = (0..48).flat_map(strip).collect();
    let verdict = verdict(&with(&drum));
    assert!(area(&verdict, Reason::Round) > 5.0, "{:?}", verdict.idle);
    assert!(says(&verdict, "round"));
}

#[test]
fn glass_and_small_things_are_named() {
    let mut model = with(&[]);
    let pane = SurfaceMaterial { glass: true, ..SurfaceMaterial::opaque([90; 3]) };
    let panes = block([3.0, 0.0, 1.0], [3.02, 2.0, 5.0]);
    model.surfaces.push(Surface::of_triangles(&panes, pane));
    let shelf = |i: usize| {
        let z = 0.5 + i as f32 * 0.4;
        block([9.0, 0.3, z], [9.3, 0.6, z + 0.3])
    };
    let shelves: Vec<_> = (0..12).flat_map(shelf).collect();
    model.opaque.extend(&shelves);
    let verdict = verdict(&model);
    assert!((16.0..16.5).contains(&area(&verdict, Reason::Transparent)), "{:?}", verdict.idle);
    assert!(area(&verdict, Reason::TooSmall) > 2.0, "{:?}", verdict.idle);
    assert!(says(&verdict, "transparent") && says(&verdict, "small pieces"));
}

#[test]
fn a_missing_floor_is_named() {
    let slab = block([0.0, -0.2, 0.0], [12.0, 0.0, 6.0]);
    let without: Vec<_> = house().into_iter().filter(|triangle| !slab.contains(triangle)).collect();
    let verdict = verdict(&Model::of_triangles("house", without, [200; 3]));
    assert!(verdict.floorless_share > 0.7, "{}", verdict.floorless_share);
    assert!(says(&verdict, "slab may be missing"));
}
