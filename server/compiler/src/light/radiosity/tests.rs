use std::{f32::consts::PI, ops::ControlFlow};

use glam::Vec3;
use sightline_world::{Cell, CellId, Cells, Node, geometry::Aabb};

use super::*;
use crate::{
    light::Light,
    model::{LampSource, Model, SurfaceMaterial},
    palette::Shade,
};

const WHITE: [u8; 3] = [225; 3];

fn quad(a: Vec3, u: Vec3, v: Vec3) -> [[Vec3; 3]; 2] {
    [[a, a + u, a + u + v], [a, a + u + v, a + v]]
}

/// The six sides of a box, which face inwards: the floor, the ceiling, and the walls across z and
/// x.
fn sides(low: Vec3, size: Vec3) -> [[[Vec3; 3]; 2]; 6] {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * size);
    [
        quad(low, z, x),
        quad(low + y, x, z),
        quad(low, x, y),
        quad(low + z, y, x),
        quad(low, y, z),
        quad(low + x, z, y),
    ]
}

/// A block whose sides face outwards.
fn block(low: Vec3, size: Vec3) -> Vec<[Vec3; 3]> {
    sides(low, size).concat().into_iter().map(|[a, b, c]| [a, c, b]).collect()
}

fn model(surfaces: Vec<Surface>) -> Model {
    let opaque = surfaces.iter().filter(|surface| !surface.material.glass);
    let opaque = opaque.flat_map(Surface::corners).collect();
    Model { surfaces, opaque, has_sky: false, ..Model::empty("test") }
}

fn white(triangles: &[[Vec3; 3]]) -> Surface {
    Surface::of_triangles(triangles, SurfaceMaterial::opaque(WHITE))
}

fn emissive(triangles: &[[Vec3; 3]], emission: f32) -> Surface {
    let material = SurfaceMaterial { emission: [emission; 3], ..SurfaceMaterial::opaque(WHITE) };
    Surface::of_triangles(triangles, material)
}

fn go_on(_: f32) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// The model in radiosity, and its figures.
fn lit(model: &Model, quality: LightQuality) -> (Light, Solved) {
    Light::solved(model, Vec3::X, 0.05, quality, &go_on).expect("not broken off")
}

/// The exposed light at a point on one of a surface's first two triangles from `triangle` on.
fn at(light: &Light, surface: usize, triangle: usize, point: Vec3) -> Vec3 {
    let patch = light.of_triangle[surface][triangle] as usize;
    light.patches[patch].at(point, &light.shell)
}

/// The form factors between the sides of a closed box.
fn factors_of_box(size: Vec3) -> [[f32; 6]; 6] {
    let model = model(sides(Vec3::ZERO, size).iter().map(|side| white(side)).collect());
    let light = Light::new(&model.surfaces, &model.opaque, Vec3::X, 0.05, &go_on).expect("lit");
    let scene = Scene::new(&model.surfaces, &light.of_triangle);
    let nodes = Nodes::new(&light.patches, |_| true);
    let emitters = Emitters { has_sky: false, lamps: Vec::new(), areas: EmitterGroups::default() };
    let around = Surroundings {
        scene: &scene,
        emitters: &emitters,
        nodes: &nodes,
        patches: &light.patches,
        shell: &light.shell,
        is_opaque: &[true; 6],
    };
    let factors = FormFactors::new(&around, 1_024, &|_| true).expect("not broken off");
    let mut all = [[0.0; 6]; 6];
    for (index, node) in nodes.list.iter().enumerate() {
        let from = node.patch as usize;
        let share = node.area / light.patches[from].area;
        if node.area == 0.0 {
            continue;
        }
        let row: f32 = factors.row(index).iter().map(|(_, share)| share.x).sum();
        assert!((row - 1.0).abs() < 1.0e-3, "all rays of a closed box meet something: {row}");
        for (seen, factor) in factors.row(index) {
            all[from][nodes.list[*seen as usize].patch as usize] += share * factor.x;
        }
    }
    all
}

#[test]
fn form_factors_of_a_box_are_the_known_ones() {
    let (x, y, z) = (9.0f32, 6.0f32, 7.2f32);
    let all = factors_of_box(Vec3::new(x, y, z));
    // Parallel rectangles a × b at a distance c (Howell's C-11).
    let parallel = |a: f32, b: f32, c: f32| {
        let (x, y) = (a / c, b / c);
        let (xx, yy) = (1.0 + x * x, 1.0 + y * y);
        let logarithm = (xx * yy / (1.0 + x * x + y * y)).sqrt().ln();
        2.0 / (PI * x * y)
            * (logarithm
                + x * yy.sqrt() * (x / yy.sqrt()).atan()
                + y * xx.sqrt() * (y / xx.sqrt()).atan()
                - x * x.atan()
                - y * y.atan())
    };
    // Rectangles with a common edge of length l: from one of width w to one of height h (C-14).
    let perpendicular = |w: f32, h: f32, l: f32| {
        let (h, w) = (h / l, w / l);
        let (hh, ww, both) = (h * h, w * w, h * h + w * w);
        let logarithm = ((1.0 + ww) * (1.0 + hh) / (1.0 + both)).ln()
            + ww * (ww * (1.0 + both) / ((1.0 + ww) * both)).ln()
            + hh * (hh * (1.0 + both) / ((1.0 + hh) * both)).ln();
        (w * w.recip().atan() + h * h.recip().atan() - both.sqrt() * both.sqrt().recip().atan()
            + 0.25 * logarithm)
            / (PI * w)
    };
    for (from, to, known) in [
        (0, 1, parallel(x, z, y)),
        (2, 3, parallel(x, y, z)),
        (4, 5, parallel(y, z, x)),
        (0, 2, perpendicular(z, y, x)),
        (2, 0, perpendicular(y, z, x)),
        (0, 5, perpendicular(x, y, z)),
    ] {
        let found = all[from][to];
        assert!((found - known).abs() < 0.02 * known, "{from} {to}: {found}, not {known}");
    }
    let areas = [x * z, x * z, x * y, x * y, y * z, y * z];
    for from in 0..6 {
        for to in 0..6 {
            let (there, back) = (areas[from] * all[from][to], areas[to] * all[to][from]);
            assert!((there - back).abs() <= 0.04 * there.max(back), "{from} {to}: {there} {back}");
        }
    }
}

#[test]
fn a_glowing_room_is_as_bright_as_the_sum_of_all_reflections() {
    let room = sides(Vec3::ZERO, Vec3::new(6.0, 3.0, 6.0));
    let model = model(vec![emissive(&room.concat(), 0.2)]);
    let (light, solved) = lit(&model, LightQuality::Fast);
    let reflectance = solved.reflectance[0].x;
    let known = PI * 0.2 / (1.0 - reflectance) * solved.figures.exposure;
    for point in [Vec3::new(3.0, 0.0, 3.0), Vec3::new(0.1, 0.0, 5.0), Vec3::new(5.9, 0.0, 0.05)] {
        let found = at(&light, 0, 0, point).x;
        assert!((found - known).abs() < 0.01 * known, "{point}: {found}, not {known}");
    }
    assert!(solved.figures.energy_error < 0.01, "{:?}", solved.figures);
    // Light from all around is the same on all sides of what moves.
    let known = PI * 0.2 / (1.0 - reflectance);
    let inside = [Vec3::new(1.0, 0.9, 1.0), Vec3::new(5.5, 0.5, 3.0), Vec3::new(3.0, 1.4, 5.9)];
    for place in inside {
        let found = solved.baked.at(place, &cells()).expect("there are probes in the room");
        for side in found.sides {
            assert!((side - known).abs() < 0.05 * known, "{place}: {side}, not {known}");
        }
        assert!((found.tint - 1.0).abs().max_element() < 0.01, "{}", found.tint);
    }
}

/// Two spaces that meet in the wall of [`two_rooms`].
fn cells() -> Cells {
    let mut cells = Cells::whole(Aabb::around(Vec3::ZERO, 50.0));
    let bounds = cells.bounds;
    cells.spaces = vec![cells.spaces[0].clone(); 2];
    cells.tree = vec![
        Node::Axial { axis: 0, at: 3.05, sides: [1, 2] },
        Node::Leaf(CellId(0)),
        Node::Leaf(CellId(1)),
    ];
    cells.cells =
        vec![0, 1].into_iter().map(|space| Cell { bounds, space, portals: vec![] }).collect();
    cells
}

#[test]
fn a_probe_has_the_light_of_a_surface_at_its_place() {
    // A shelf just above a point of the grid, in the lit room, which hides the lamp from it.
    let point = Vec3::new(2.37, 1.41, 1.61);
    let mut model = two_rooms();
    let low = point + Vec3::new(-0.2, 0.01, -0.2);
    let shelf = quad(low, Vec3::X * 0.4, Vec3::Z * 0.4);
    model.surfaces.push(white(&shelf));
    model.opaque.extend(shelf);
    let (light, solved) = lit(&model, LightQuality::Good);
    let grid = &solved.baked.grid;
    let probe = |at: Vec3| {
        let is_there = |place: &u32| grid.point(grid.coordinates(*place)).distance(at) < 1.0e-3;
        grid.places.iter().position(is_there).map(|index| grid.probes[index])
    };
    assert!(probe(point).is_some(), "{:?}", grid.origin);
    let below = solved.baked.at(point + 1.0e-3, &cells()).expect("there is a probe").sides[2];
    let known = at(&light, 2, 0, point).x / solved.figures.exposure;
    assert!((below - known).abs() < 0.08 * known, "{below}, not {known}");
    // None in the wall between the rooms, and none above the heads of people.
    for place in &grid.places {
        let at = grid.point(grid.coordinates(*place));
        assert!((at.x < 3.0 || at.x > 3.1) && (0.0..2.5).contains(&at.y), "{at}");
    }
}

#[test]
fn who_stands_in_a_dark_room_is_dark() {
    let (_, solved) = lit(&two_rooms(), LightQuality::Fast);
    let at = |x: f32| solved.baked.at(Vec3::new(x, 0.85, 1.2), &cells()).expect("probes").sides;
    for (x, y) in [(2.5, 3.5), (1.0, 5.0), (2.9, 3.2)] {
        let (lit, dark) = (at(x), at(y));
        for side in 0..6 {
            assert!(lit[side] > 0.1 && dark[side] < 0.01 * lit[side], "{x}: {lit:?} {dark:?}");
        }
    }
    // Below the lamp most light comes from above.
    let below = at(1.5);
    assert!(below[3] > 1.5 * below[0] && below[3] > 2.0 * below[2], "{below:?}");
    assert_eq!(solved.baked.sky, None, "the model has no sky");
}

#[test]
fn probes_that_are_far_apart_have_a_coarse_grid() {
    let mut model = two_rooms();
    let far = quad(Vec3::new(9.0e6, 0.0, 9.0e6), Vec3::Z * 2.0, Vec3::X * 2.0);
    model.surfaces.push(white(&far));
    model.opaque.extend(far);
    let (_, solved) = lit(&model, LightQuality::Fast);
    let size = solved.baked.grid.size.as_u64vec3().element_product();
    assert!(size < 1 << 32, "{size}");
}

/// The width of the box, in metres.
const CORNELL_M: f32 = 5.5;

/// A white box with a red and a green wall, a lamp below the ceiling, and two blocks.
fn cornell_box() -> Model {
    let of = |x: f32, y: f32, z: f32| Vec3::new(x, y, z) * CORNELL_M;
    let all = sides(Vec3::ZERO, Vec3::splat(CORNELL_M));
    let coloured = |side: usize, colour: [u8; 3]| {
        Surface::of_triangles(&all[side], SurfaceMaterial::opaque(colour))
    };
    let lamp = quad(of(0.38, 0.99, 0.38), of(0.24, 0.0, 0.0), of(0.0, 0.0, 0.24));
    let blocks = [
        block(of(0.15, 0.0, 0.15), of(0.3, 0.6, 0.3)),
        block(of(0.55, 0.0, 0.5), of(0.3, 0.3, 0.3)),
    ];
    model(vec![
        white(&[all[0], all[1], all[2], all[3]].concat()),
        coloured(4, [190, 30, 30]),
        coloured(5, [40, 170, 50]),
        emissive(&lamp, 10.0),
        white(&blocks.concat()),
    ])
}

#[test]
fn a_cornell_box_is_lit_as_paths_of_light_say() {
    let model = cornell_box();
    let reference =
        Reference::new(&model, Vec3::X, 0.05, LightQuality::Good, &go_on).expect("not broken off");
    assert!(reference.figures().energy_error < 0.01, "{:?}", reference.figures());
    let (mut sums, mut bleeds) = ([Vec3::ZERO; 2], [Vec3::ZERO; 2]);
    for i in 0..24 * 24 {
        let (x, y) = ((i % 24) as f32 / 24.0 - 0.48, (i / 24) as f32 / 24.0 - 0.48);
        let along = Vec3::new(x, y, -0.55).normalize();
        // A ray may slip through an edge.
        let Some(pair) = reference.along(Vec3::new(0.5, 0.5, 0.98) * CORNELL_M, along, 64, i)
        else {
            continue;
        };
        let [radiosity, truth] = [pair.radiosity, pair.reference].map(|light| light * pair.colour);
        sums[0] += radiosity;
        sums[1] += truth;
        bleeds[usize::from(x > 0.0)] += radiosity;
    }
    let ratio = sums[0] / sums[1];
    assert!((ratio - 1.0).abs().max_element() < 0.02, "{ratio}");
    assert!(bleeds[0].x > bleeds[0].y && bleeds[1].y > bleeds[1].x, "walls colour the light");
}

/// Two closed rooms side by side, on one floor, with a lamp in the first.
fn two_rooms() -> Model {
    let size = Vec3::new(3.0, 2.5, 3.0);
    let floor = quad(Vec3::ZERO, Vec3::Z * 3.0, Vec3::X * 6.1);
    let walls = [Vec3::ZERO, Vec3::X * 3.1].map(|low| sides(low, size)[1..].concat());
    let mut model = model(vec![white(&floor), white(&walls.concat())]);
    model
        .lamps
        .push(Lamp { source: LampSource::Point(Vec3::new(1.5, 2.0, 1.5)), intensity: [300.0; 3] });
    model
}

#[test]
fn no_light_passes_through_a_wall() {
    let model = two_rooms();
    let (light, solved) = lit(&model, LightQuality::Fast);
    let floor = |x: f32, z: f32| at(&light, 0, 0, Vec3::new(x, 0.0, z)).x;
    for z in 1..29 {
        let z = z as f32 / 10.0;
        assert!(floor(2.95, z) > 0.01, "lit at {z}");
        let (near, far) = (floor(3.15, z), floor(4.5, z));
        assert!(near < 0.04 && far < 2.0e-3, "dark at {z}: {near} {far}");
    }
    // Below the lamp: direct light from 2 m, and what white walls of 48 m² pass on.
    let (intensity, reflectance) = (300.0 / 250.0, solved.reflectance[0].x);
    let passed_on = 4.0 * PI * intensity / 48.0 * reflectance / (1.0 - reflectance);
    let known = intensity / 4.0 + passed_on;
    let below = floor(1.5, 1.5) / solved.figures.exposure;
    assert!((below - known).abs() < 0.1 * known, "{below}, not {known}");
}

#[test]
fn the_sun_comes_through_a_window_and_takes_its_colour() {
    // A room with a window in its roof, whose pane is red.
    let room = sides(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0));
    let (low, high) = (Vec3::new(1.5, 3.0, 1.5), Vec3::new(2.5, 3.0, 2.5));
    let roof = [
        quad(Vec3::Y * 3.0, Vec3::X * 4.0, Vec3::Z * low.z),
        quad(high.with_x(0.0), Vec3::X * 4.0, Vec3::Z * 1.5),
        quad(low.with_x(0.0), Vec3::X * 1.5, Vec3::Z),
        quad(low.with_x(2.5), Vec3::X * 1.5, Vec3::Z),
    ];
    let walls = [room[0].as_slice(), &room[2..].concat(), &roof.concat()].concat();
    let lights = [[255, 30, 30], [255; 3]].map(|colour| {
        let material = SurfaceMaterial { glass: true, ..SurfaceMaterial::opaque(colour) };
        let pane = Surface::of_triangles(&quad(low, Vec3::X, Vec3::Z), material);
        let mut model = model(vec![white(&walls), pane]);
        model.has_sky = true;
        // The sun passes the middle of the window and meets the floor, or a wall, here.
        let (light, solved) = lit(&model, LightQuality::Fast);
        let spot = Vec3::new(2.0, 3.0, 2.0) - emitters::SUN * (3.0 / emitters::SUN.y);
        let [spot, shade] = [spot, Vec3::new(3.5, 0.0, 3.5)]
            .map(|point| at(&light, 0, 0, point.with_y(0.0)) / solved.figures.exposure);
        assert!(spot.x > 4.0 * shade.x && spot.x > 2.5, "{spot} {shade}");
        spot
    });
    assert!(lights[0].x > 2.5 * lights[0].y, "red light: {}", lights[0]);
    assert!((lights[1].x / lights[1].y) < 1.3, "the sun's own colour: {}", lights[1]);
}

#[test]
fn threads_do_not_matter() {
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let (light, _) = pool.install(|| lit(&two_rooms(), LightQuality::Fast));
        let bits = |i: usize| {
            let point = Vec3::new(0.05 * i as f32, 0.0, 1.3);
            match light.of(0, 0).expect("it has an area").at(point) {
                Shade::Linear(light) => light.to_array().map(f32::to_bits),
                Shade::Factor(_) => panic!("radiosity is linear"),
            }
        };
        (0..120).map(bits).collect::<Vec<_>>()
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn light_that_is_broken_off_ends() {
    for limit in [0.0, 0.1, 0.5] {
        let progress = |share| match share >= limit {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        let found = Light::solved(&two_rooms(), Vec3::X, 0.05, LightQuality::Good, &progress);
        assert!(found.is_none(), "{limit}");
    }
}
