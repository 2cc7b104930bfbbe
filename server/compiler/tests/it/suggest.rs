//! Suggested rooms against the plan of the building.

use std::ops::ControlFlow;

use glam::{Vec2, Vec3};
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_compiler::{
    CompileOptions, LightMethod, compile,
    import::glb,
    model::Model,
    rooms::{self, RoomScope, text},
    suggest::{self, SuggestedRoom},
};
use sightline_demo_building::{SpaceKind, UNITS_PER_METRE};
use sightline_fixtures::shared_files::shared_file;
use sightline_oracle::Oracle;
use sightline_visibility::rooms::{RoomIndex, RoomVerdict};
use sightline_world::{World, geometry::Aabb, rooms::RoomId};

/// A room is found when a suggestion overlaps its plan by this share of their union.
const SHARED: f32 = 0.8;
/// This share of the real rooms is found.
const FOUND: f32 = 0.95;

fn compiled(model: &Model, voxel: f32) -> World {
    let options = CompileOptions {
        voxel: Some(voxel),
        cell: Some(3.0),
        light: LightMethod::None,
        ..CompileOptions::default()
    };
    compile(model, &options, &|_, _| ControlFlow::Continue(())).unwrap().0
}

fn suggested(world: &World) -> Vec<SuggestedRoom> {
    suggest::suggest(world, &mut |_| ControlFlow::Continue(())).unwrap()
}

/// The overlap of a suggested room with a rectangle of the plan at a height, as a share of their
/// union.
fn shared(world: &World, room: &SuggestedRoom, [min, max]: [Vec2; 2], height: f32) -> f32 {
    let area = |min: Vec2, max: Vec2| (max - min).max(Vec2::ZERO).element_product();
    let boxes = room.boxes.iter().map(|region| world.cells.axes.world_box(region));
    let at_height: Vec<Aabb> =
        boxes.filter(|region| region.min.y < height && height < region.max.y).collect();
    let flat = |region: &Aabb| [region.min, region.max].map(|at| Vec2::new(at.x, at.z));
    let both: f32 = at_height.iter().map(flat).map(|[a, b]| area(a.max(min), b.min(max))).sum();
    let own: f32 = at_height.iter().map(flat).map(|[a, b]| area(a, b)).sum();
    both / (own + area(min, max) - both)
}

/// Checks how many real rooms are suggested. Each is a rectangle of the plan and a height.
fn check(world: &World, real: &[([Vec2; 2], f32)], name: &str) -> Vec<SuggestedRoom> {
    let rooms = suggested(world);
    let best = |(rect, height): &([Vec2; 2], f32)| {
        rooms.iter().map(|room| shared(world, room, *rect, *height)).fold(0.0, f32::max)
    };
    let shares: Vec<f32> = real.iter().map(best).collect();
    let found = shares.iter().filter(|share| **share >= SHARED).count();
    let part = found as f32 / real.len() as f32;
    println!("{name}: {found} of {} rooms among {} suggested", real.len(), rooms.len());
    for (real, share) in real.iter().zip(&shares).filter(|(_, share)| **share < SHARED) {
        println!("  not found: {real:?}, {share:.2}");
    }
    assert!(part >= FOUND, "{name}: {found} of {}", real.len());
    rooms
}

/// Suggested rooms are read without an error, and rule out nothing that rays show.
fn is_sound(model: &Model, world: &mut World, suggested: &[SuggestedRoom]) {
    let toml = suggest::to_toml(world, suggested);
    let declared = text::read(&toml, "suggested.toml").unwrap();
    let known = RoomScope { cells: &world.cells, movers: &model.movers, nodes: &model.nodes };
    let made = rooms::resolve(&declared, &known).unwrap();
    let warnings =
        rooms::checks::warnings(&declared, &made, &world.cells, &|| Oracle::new(&world.mesh));
    assert!(warnings.is_empty(), "{warnings:?}");
    world.rooms = made;
    let index = RoomIndex::new(world);
    let count = suggested.len() as u16;
    let windows: usize = suggested.iter().map(|room| room.windows.len()).sum();
    let pairs = (0..count).flat_map(|a| (0..count).map(move |b| (a, b)));
    let never = pairs.filter(|(a, b)| index.verdict(RoomId(*a), RoomId(*b)) == RoomVerdict::Never);
    println!("  {windows} windows, {} pairs of rooms that never see each other", never.count());
    no_line_is_denied(world, &index);
}

/// Rooms never rule out what rays show.
fn no_line_is_denied(world: &World, index: &RoomIndex) {
    let sight = Oracle::new(&world.mesh);
    let mut rng = SmallRng::seed_from_u64(5);
    let bounds = &world.cells.bounds;
    let mut point = || loop {
        let mut share = || rng.random_range(0.0..1.0f32);
        let at = bounds.min + bounds.size() * Vec3::new(share(), share(), share());
        if world.cells.at_own(at).is_some() {
            return at;
        }
    };
    let (mut seen, mut denied) = (0, 0);
    for _ in 0..200_000 {
        let [eye, body] = [point(), point()];
        let place = |at: Vec3| index.overlap(&world.cells, &[Aabb::new(at, at)]);
        let may = index.may_see(&place(eye), &place(body));
        let [from, to] = [eye, body].map(|at| world.cells.axes.world(at));
        if !may {
            denied += 1;
            assert!(!sight.between(from, to), "{from} sees {to}");
        } else if sight.between(from, to) {
            seen += 1;
        }
    }
    println!("  of 200,000 lines {denied} are ruled out, and {seen} are free");
    assert!(denied > 1_000 && seen > 1_000);
}

#[test]
fn the_demo_building_has_the_rooms_that_were_planned() {
    let (rooms, seed, voxel) = (60, 1, 0.1);
    let plan = sightline_demo_building::plan(rooms, seed);
    let metres = |units: i32| units as f32 / UNITS_PER_METRE as f32;
    let real: Vec<_> = plan
        .spaces
        .iter()
        .filter(|space| space.kind == SpaceKind::Room)
        .map(|space| {
            let corner = |at: [i32; 2]| Vec2::new(metres(at[0]), metres(at[1]));
            let height = metres(plan.floor(space.storey)) + 1.3;
            ([corner(space.rect.min), corner(space.rect.max)], height)
        })
        .collect();
    assert_eq!(real.len(), rooms);
    let model = glb::read_slice(&sightline_demo_building::glb(rooms, seed), None, "demo").unwrap();
    let mut world = compiled(&model, voxel);
    let found = check(&world, &real, "demo building");
    is_sound(&model, &mut world, &found);
}

/// Rooms of a building that is turned are hulls, and as good.
#[test]
fn a_turned_building_has_its_rooms_too() {
    let mut model = glb::read_slice(&sightline_demo_building::glb(6, 3), None, "demo").unwrap();
    let (sine, cosine) = 0.4f32.sin_cos();
    let turned = |at: &mut Vec3| {
        *at = Vec3::new(cosine * at.x + sine * at.z, at.y, cosine * at.z - sine * at.x);
    };
    model.opaque.as_flattened_mut().iter_mut().for_each(turned);
    model.surfaces.iter_mut().flat_map(|surface| &mut surface.positions).for_each(turned);
    model.spawns.iter_mut().for_each(|spawn| turned(&mut spawn.eye));
    model.movers.clear();
    let mut world = compiled(&model, 0.08);
    assert!(world.cells.axes.turn().abs() > 0.1);
    let rooms = suggested(&world);
    println!("turned: {} rooms", rooms.len());
    // Six rooms and a corridor.
    assert!((6..=8).contains(&rooms.len()));
    assert!(suggest::to_toml(&world, &rooms).contains("hulls = "));
    is_sound(&model, &mut world, &rooms);
}

#[test]
fn the_outdoors_is_no_room_even_under_a_roof() {
    let slab = |min: [f32; 3], max: [f32; 3]| {
        let region = Aabb::new(Vec3::from(min), Vec3::from(max));
        let at = region.corners();
        let sides =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        sides
            .into_iter()
            .flat_map(move |[a, b, c, d]| [[at[a], at[b], at[c]], [at[a], at[c], at[d]]])
    };
    let triangles = [
        // The ground, and a roof over all of it.
        slab([0.0, -0.3, 0.0], [20.0, 0.0, 12.0]),
        slab([0.0, 3.0, 0.0], [20.0, 3.3, 12.0]),
        // The walls of one room, with a door.
        slab([1.0, 0.0, 1.0], [1.2, 3.0, 7.0]),
        slab([7.0, 0.0, 1.0], [7.2, 3.0, 7.0]),
        slab([1.2, 0.0, 1.0], [7.0, 3.0, 1.2]),
        slab([1.2, 0.0, 6.8], [3.0, 3.0, 7.0]),
        slab([4.0, 0.0, 6.8], [7.0, 3.0, 7.0]),
    ];
    let triangles = triangles.into_iter().flatten().collect();
    let model = Model::of_triangles("pavilion", triangles, [200; 3]);
    let world = compiled(&model, 0.1);
    let rooms = suggested(&world);
    let plan = [Vec2::new(1.2, 1.2), Vec2::new(7.0, 6.8)];
    let shares: Vec<f32> = rooms.iter().map(|room| shared(&world, room, plan, 1.3)).collect();
    assert!(shares.len() == 1 && shares[0] > SHARED, "{shares:?}");
}

#[test]
fn rooms400_has_four_hundred_rooms() {
    let Some(file) = shared_file("traces/rooms400.glb") else { return };
    // Twenty rows of twenty, 5 m apart; a wall of 0.2 m between them.
    let real: Vec<_> = (0..400)
        .map(|i| {
            let corner = Vec2::new((i % 20) as f32, -1.0 - (i / 20) as f32) * 5.0;
            ([corner + 0.1, corner + 4.9], 1.3)
        })
        .collect();
    let model = glb::read(&file).unwrap();
    let mut world = compiled(&model, 0.1);
    let found = check(&world, &real, "rooms400");
    is_sound(&model, &mut world, &found);
}
