//! Films drawn with culling are the same as films of everything: with visibility sets, and with
//! bounding volumes.

use std::{ops::ControlFlow, time::Duration};

use sightline_client::{bench::SimulatedPeople, camera_path::CameraPath};
use sightline_client_core::replica::AvatarSource;
use sightline_compiler::{
    CompileOptions, compile,
    import::glb,
    rooms::{self, RoomScope, text},
    suggest,
};
use sightline_renderer::{
    Camera, Frame, Renderer,
    mover_visibility::MoverVisibility,
    movers,
    moving::{Culling, MovingRenderer},
};
use sightline_visibility::rooms::RoomIndex;
use sightline_world::{World, motion::Pose, rooms::Rooms};

/// A building with moving doors and a lift, and the rooms suggested for it.
fn building() -> World {
    let model = glb::read_slice(&sightline_demo_building::glb(20, 4), None, "office").unwrap();
    let options = CompileOptions { voxel: Some(0.1), cell: Some(3.0), ..CompileOptions::default() };
    let go_on = |_, _| ControlFlow::Continue(());
    let mut world = compile(&model, &options, &go_on).unwrap().0;
    let suggested = suggest::suggest(&world, &mut |_| ControlFlow::Continue(())).unwrap();
    let declared = text::read(&suggest::to_toml(&world, &suggested), "rooms.toml").unwrap();
    let known = RoomScope { cells: &world.cells, movers: &model.movers, nodes: &model.nodes };
    world.rooms = rooms::resolve(&declared, &known).unwrap();
    world
}

#[test]
fn movers_outside_the_visibility_sets_are_not_in_the_picture() {
    let mut world = building();
    let plain = Rooms::default();
    let mut shares = Vec::new();
    for with_rooms in [true, false] {
        if !with_rooms {
            world.rooms = plain.clone();
        }
        let index = RoomIndex::new(&world);
        let size = (160, 90);
        let mut mover_visibility = MoverVisibility::new(size, Camera::FOV_Y);
        let mut renderer = Renderer::default();
        let (mut drawn, mut all) = (0, 0);
        for (seconds, pose) in CameraPath::through(&world).frames(120) {
            let camera = Camera::at(&pose);
            let mut frame = Frame::new(size.0, size.1);
            renderer.draw(&world.octree, &camera, &mut frame);
            let mut some = frame.clone();
            let now = Duration::from_secs_f64(seconds);
            movers::draw(&mut frame, &camera, &world.movers, now);
            let those = mover_visibility.movers(&world, &index, &pose);
            movers::draw_selected(&mut some, &camera, &those, now);
            assert_eq!(frame, some, "at {seconds} s, with rooms: {with_rooms}");
            drawn += those.len();
            all += world.movers.len();
        }
        let share = drawn as f64 / all as f64;
        println!("{:.1} % of the movers by {} sets", share * 100.0, mover_visibility.sets_made());
        shares.push(share);
    }
    assert!(shares[0] > 0.0 && shares[0] <= shares[1] && shares[1] < 0.5, "{shares:?}");
}

/// The number of people: they walk along the same path, far apart.
const PEOPLE: usize = 15;

fn walker(path: &CameraPath, avatar: usize, now: Duration) -> Pose {
    let share = avatar as f64 / PEOPLE as f64;
    let at = share * path.duration_s() + now.as_secs_f64();
    let at = [0.0, 1e-2].map(|later| path.at((at + later) % path.duration_s()));
    Pose { velocity: ((at[1].eye - at[0].eye) * 100.0).clamp_length_max(4.0), ..at[0] }
}

#[test]
fn things_replaced_by_bounding_volumes_are_not_in_the_picture() {
    let world = building();
    let path = CameraPath::through(&world);
    let mut ways =
        Culling::ALL.map(|way| (MovingRenderer::new(&world, way), SimulatedPeople::new(PEOPLE)));
    let mut renderer = Renderer::default();
    let (mut placed, mut seen) = ([0; 3], 0);
    for (i, (seconds, pose)) in path.frames_between(20.0, 60.0, 800).enumerate() {
        let (camera, now) = (Camera::at(&pose), Duration::from_secs_f64(seconds));
        let mut building = Frame::new(160, 90);
        renderer.draw(&world.octree, &camera, &mut building);
        let pictures = ways.each_mut().map(|(moving, crowd)| {
            crowd.advance(now, |avatar, time| walker(&path, avatar, time));
            // Now and then a person vanishes and appears again.
            if i % 10 == 0 {
                let avatar = i / 10 % PEOPLE;
                crowd.reappear(avatar, now, &walker(&path, avatar, now));
            }
            let mut frame = building.clone();
            let time = crowd.replica().server_time(now);
            let told = Some(crowd.replica() as &mut dyn AvatarSource);
            let seen = moving.draw(&mut frame, &camera, &world, told, time);
            (frame, seen)
        });
        assert!(pictures[0] == pictures[1], "hierarchical Z, at {seconds} s");
        assert!(pictures[0] == pictures[2], "bounding volumes, at {seconds} s");
        seen += pictures[0].1.len();
        for ((moving, _), placed) in ways.iter().zip(&mut placed) {
            *placed += moving.counters().placed;
        }
    }
    println!("people in view {seen} times; placed: {placed:?}");
    assert!(seen > 100 && 2 * placed[2] < placed[1], "{seen} {placed:?}");
}
