//! A film by visibility sets is the film of everything.

use std::{ops::ControlFlow, time::Duration};

use sightline_client::{
    in_sight::InSight,
    path::Path,
    render::{Camera, Frame, Renderer, movers},
};
use sightline_server::{
    compile::{
        self, Options, demo_building, glb,
        rooms::{self, Known, text},
    },
    suggest,
};
use sightline_shared::{
    rooms::{RoomIndex, Rooms},
    world::World,
};

/// A building with doors and a lift that move, and the rooms that it suggests.
fn building() -> World {
    let model = glb::read_slice(&demo_building::glb(20, 4), None, "office").unwrap();
    let options = Options { voxel: Some(0.1), cell: Some(3.0), ..Options::default() };
    let go_on = |_, _| ControlFlow::Continue(());
    let mut world = compile::compile(&model, &options, &go_on).unwrap().0;
    let suggested = suggest::suggest(&world, &mut |_| ControlFlow::Continue(())).unwrap();
    let declared = text::read(&suggest::to_toml(&world, &suggested), "rooms.toml").unwrap();
    let known = Known { cells: &world.cells, movers: &model.movers, nodes: &model.nodes };
    world.rooms = rooms::resolve(&declared, &known).unwrap();
    world
}

#[test]
fn what_sets_leave_out_is_not_in_the_picture() {
    let mut world = building();
    let plain = Rooms::default();
    let mut shares = Vec::new();
    for with_rooms in [true, false] {
        if !with_rooms {
            world.rooms = plain.clone();
        }
        let index = RoomIndex::new(&world);
        let size = (160, 90);
        let mut in_sight = InSight::new(size, Camera::FOV_Y);
        let mut renderer = Renderer::default();
        let (mut drawn, mut all) = (0, 0);
        for (seconds, pose) in Path::through(&world).frames(120) {
            let camera = Camera::at(&pose);
            let mut frame = Frame::new(size.0, size.1);
            renderer.draw(&world.octree, &camera, &mut frame);
            let mut some = frame.clone();
            let now = Duration::from_secs_f64(seconds);
            movers::draw(&mut frame, &camera, &world.movers, now);
            let those = in_sight.movers(&world, &index, &pose);
            movers::draw_those(&mut some, &camera, &those, now);
            assert_eq!(frame, some, "at {seconds} s, with rooms: {with_rooms}");
            drawn += those.len();
            all += world.movers.len();
        }
        let share = drawn as f64 / all as f64;
        println!("{:.1} % of the movers by {} sets", share * 100.0, in_sight.made());
        shares.push(share);
    }
    assert!(shares[0] > 0.0 && shares[0] <= shares[1] && shares[1] < 0.5, "{shares:?}");
}
