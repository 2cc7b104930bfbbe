//! Films drawn with culling are the same as films of everything: with visibility sets, and with
//! bounding volumes. What moves in them is in the light of its place.

use std::{ops::ControlFlow, sync::LazyLock, time::Duration};

use glam::Vec3;
use sightline_client::{bench::SimulatedPeople, camera_path::CameraPath};
use sightline_client_core::replica::AvatarSource;
use sightline_compiler::{
    CompileOptions, LightMethod, compile,
    import::glb,
    model::{Lamp, LampSource, Model, Surface, SurfaceMaterial},
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

/// A lit building with moving doors and a lift, and the rooms suggested for it.
static BUILDING: LazyLock<World> = LazyLock::new(|| {
    let model = glb::read_slice(&sightline_demo_building::glb(20, 4), None, "office").unwrap();
    let options = CompileOptions {
        voxel: Some(0.1),
        cell: Some(3.0),
        light: LightMethod::Radiosity,
        ..CompileOptions::default()
    };
    let go_on = |_, _| ControlFlow::Continue(());
    let mut world = compile(&model, &options, &go_on).unwrap().0;
    let suggested = suggest::suggest(&world, &mut |_| ControlFlow::Continue(())).unwrap();
    let declared = text::read(&suggest::to_toml(&world, &suggested), "rooms.toml").unwrap();
    let known = RoomScope { cells: &world.cells, movers: &model.movers, nodes: &model.nodes };
    world.rooms = rooms::resolve(&declared, &known).unwrap();
    world
});

#[test]
fn movers_outside_the_visibility_sets_are_not_in_the_picture() {
    let mut world = BUILDING.clone();
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
            movers::draw(&mut frame, &camera, &world, now);
            let those = mover_visibility.movers(&world, &index, &pose);
            movers::draw_selected(&mut some, &camera, &world, &those, now);
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
    let world = &*BUILDING;
    let path = CameraPath::through(world);
    let mut ways =
        Culling::ALL.map(|way| (MovingRenderer::new(world, way), SimulatedPeople::new(PEOPLE)));
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
            let seen = moving.draw(&mut frame, &camera, world, told, time);
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

#[test]
fn light_for_what_moves_makes_a_world_file_little_larger() {
    let world = &*BUILDING;
    let light = world.light.as_ref().expect("radiosity finds light for what moves");
    let without = World { light: None, ..world.clone() }.to_bytes().len();
    let whole = world.to_bytes().len();
    println!("{} probes: {without} bytes become {whole}", light.grid.probes.len());
    assert!(light.grid.probes.len() > 500 && whole - without < without * 15 / 100);
    assert!(light.exposure > 0.05 && light.exposure < 20.0, "{}", light.exposure);
    // People are lit wherever they can be, and so are doors.
    let path = CameraPath::through(world);
    let eyes = path.frames(200).map(|(_, pose)| pose.eye);
    let dark = eyes.filter(|eye| world.light_at(world.body.middle(*eye)).is_none());
    assert_eq!(dark.collect::<Vec<_>>(), []);
    for mover in &world.movers {
        let bounds = mover.swept(Duration::ZERO, Duration::ZERO);
        assert!(world.light_around(&bounds).is_some(), "{} at {bounds:?}", mover.name);
    }
}

/// Two closed rooms of 4 m side by side along x, with a lamp in the first and hardly any light in
/// the second.
fn bright_and_dark() -> World {
    let mut triangles = Vec::new();
    for x in [0.0, 4.2] {
        let (low, high) = (Vec3::new(x, 0.0, 0.0), Vec3::new(x + 4.0, 3.0, 4.0));
        let corner = |bits: usize| {
            let pick = |axis: usize| if bits >> axis & 1 == 1 { high[axis] } else { low[axis] };
            Vec3::new(pick(0), pick(1), pick(2))
        };
        // The six sides, inwards.
        for [a, b, c, d] in
            [[0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5], [0, 2, 6, 4], [1, 5, 7, 3]]
        {
            triangles.extend([[a, b, c], [a, c, d]].map(|three| three.map(corner)));
        }
    }
    let lamp = |x: f32, intensity: f32| Lamp {
        source: LampSource::Point(Vec3::new(x, 2.7, 2.0)),
        intensity: [intensity; 3],
    };
    let surface = Surface::of_triangles(&triangles, SurfaceMaterial::opaque([200; 3]));
    let model = Model {
        surfaces: vec![surface],
        opaque: triangles,
        has_sky: false,
        lamps: vec![lamp(2.0, 300.0), lamp(6.2, 3.0)],
        ..Model::empty("two rooms")
    };
    let options = CompileOptions {
        voxel: Some(0.1),
        light: LightMethod::Radiosity,
        ..CompileOptions::default()
    };
    compile(&model, &options, &|_, _| ControlFlow::Continue(())).expect("it compiles").0
}

#[test]
fn who_stands_in_a_dark_room_is_darker() {
    let mut world = bright_and_dark();
    let shown = |world: &World, x: f32| {
        let camera = Camera::looking_at(Vec3::new(x, 1.6, 3.8), Vec3::new(x, 1.0, 1.0));
        let mut frame = Frame::new(160, 120);
        Renderer::default().draw(&world.octree, &camera, &mut frame);
        let bare = frame.depth.clone();
        let mut crowd = SimulatedPeople::new(1);
        let pose = Pose { eye: Vec3::new(x, 1.75, 1.0), ..Pose::default() };
        crowd.advance(Duration::ZERO, |_, _| pose);
        let time = crowd.replica().server_time(Duration::ZERO);
        let told = Some(crowd.replica() as &mut dyn AvatarSource);
        let mut moving = MovingRenderer::new(world, Culling::default());
        let seen = moving.draw(&mut frame, &camera, world, told, time);
        assert_eq!(seen.len(), 1);
        let figure = (0..bare.len()).filter(|pixel| frame.depth[*pixel] < bare[*pixel]);
        let levels: Vec<u32> = figure.map(|pixel| frame.colour[pixel] >> 8 & 0xff).collect();
        levels.iter().sum::<u32>() as f32 / levels.len() as f32
    };
    let (bright, dark) = (shown(&world, 2.0), shown(&world, 6.2));
    assert!(bright > 20.0 && dark < 0.3 * bright, "{bright} {dark}");
    let light = world.light.as_mut().expect("the world is lit");
    light.exposure *= 0.25;
    let dimmed = shown(&world, 2.0);
    assert!(dimmed < 0.75 * bright, "the exposure counts: {dimmed} {bright}");
}
