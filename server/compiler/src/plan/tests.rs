use std::sync::OnceLock;

use super::*;
use crate::{
    drawing::heat,
    import::glb,
    storeys::{FLOOR_DEPTH, area, storeys_within},
};

fn building() -> World {
    static BUILDING: OnceLock<World> = OnceLock::new();
    BUILDING.get_or_init(compiled).clone()
}

fn compiled() -> World {
    let model = glb::read_slice(&sightline_demo_building::glb(12, 1), None, "demo").unwrap();
    let options = crate::CompileOptions {
        voxel: Some(0.125),
        cell: Some(3.0),
        light: crate::LightMethod::None,
        ..crate::CompileOptions::default()
    };
    let go_on = |_, _| std::ops::ControlFlow::Continue(());
    crate::compile(&model, &options, &go_on).unwrap().0
}

fn count(picture: &Picture, colour: [u8; 3]) -> usize {
    picture.pixels().iter().filter(|pixel| **pixel == colour).count()
}

#[test]
fn every_floor_is_on_a_picture_however_few_the_spawn_points() {
    let mut world = building();
    let all = storeys_within(&world, &area(&world));
    assert!(all.len() >= 2, "the building has storeys: {all:?}");
    world.spawns.truncate(1);
    let found = storeys_within(&world, &area(&world));
    for storey in all {
        let nearest = found.iter().map(|at| (at - storey).abs()).fold(f32::MAX, f32::min);
        assert!(nearest < FLOOR_DEPTH, "{storey} is not in {found:?}");
    }
    assert!(found.is_sorted(), "{found:?}");
}

#[test]
fn every_overlay_changes_the_picture() {
    let world = building();
    let red = [255, 0, 0];
    let eye = world.spawns[0].eye;
    let mark = Mark { eye, forward: None, colour: red, filled: true, number: None };
    let plain = draw(&world, &Overlay::default());
    let marked = draw(&world, &Overlay { marks: vec![mark.clone()], ..Overlay::default() });
    assert_eq!(plain.dimensions(), marked.dimensions());
    assert_eq!(count(&plain, red), 0);
    assert!(count(&marked, red) > 10);

    let numbered = Mark { number: Some(8), ..mark.clone() };
    let numbered = draw(&world, &Overlay { marks: vec![numbered], ..Overlay::default() });
    assert!(count(&numbered, red) > count(&marked, red) + 10);
    let with_grid = draw(&world, &Overlay { grid: true, ..Overlay::default() });
    assert_eq!(plain.dimensions(), with_grid.dimensions());
    assert!(with_grid.pixels().iter().zip(plain.pixels()).filter(|(a, b)| a != b).count() > 1_000);

    let with_cells = draw(&world, &Overlay { cells: true, ..Overlay::default() });
    assert_ne!(plain, with_cells);
    let dense = draw(&world, &Overlay { density: true, ..Overlay::default() });
    assert!(dense.width() > plain.width() || dense.height() > plain.height());

    let seen = world.cells.pvs[world.cells.cells.len() / 2].clone();
    let dim = draw(&world, &Overlay { visible: Some(seen), ..Overlay::default() });
    assert_ne!(plain, dim);
    let legend = Some(vec![("mark", mark)]);
    let legend =
        draw(&world, &Overlay { legend, cells: true, density: true, ..Overlay::default() });
    assert!(legend.height() > dense.height() && count(&legend, red) > 10);
}

#[test]
fn colours_of_density_darken_all_the_way() {
    let light = |share| heat(share).iter().map(|&c| u32::from(c)).sum::<u32>();
    assert!((0..50).all(|i| light(i as f32 / 50.0) > light((i + 1) as f32 / 50.0)));
}

#[test]
fn plans_by_storey_say_where_places_are() {
    let world = building();
    let plans = by_storey(&world);
    assert_eq!(plans.first().map(|plan| plan.feet.start), Some(f32::NEG_INFINITY));
    assert_eq!(plans.last().map(|plan| plan.feet.end), Some(f32::INFINITY));
    for spawn in &world.spawns {
        let feet = spawn.eye.y - world.body.below_eye;
        let on: Vec<_> = plans.iter().filter(|plan| plan.feet.contains(&feet)).collect();
        let [plan] = on[..] else { panic!("{feet} m is on {} storeys", on.len()) };
        let place = [spawn.eye.x - plan.corner[0], spawn.eye.z - plan.corner[1]];
        let [x, y] = place.map(|m| (m * plan.px_per_m) as u32);
        let pixel = plan.picture.pixels()[(y * plan.picture.width() + x) as usize];
        let nothing = [crate::drawing::PAPER, crate::drawing::INK];
        assert!(!nothing.contains(&pixel), "there is floor at {}: {pixel:?}", spawn.eye);
    }
}
