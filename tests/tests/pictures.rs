//! Compares pictures with rays through the original triangles. In every mode, everything drawn lies
//! on a triangle, and nothing shows through a triangle in front of it. The modes are also compared
//! with each other.

use std::{ops::ControlFlow, sync::Arc};

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_client::{
    bench::{DepthAgreement, DepthFault, ModeComparison, RayCaster, Views},
    camera_path::CameraPath,
};
use sightline_compiler::{
    import::{self, glb},
    model::Model,
    voxelise,
};
use sightline_fixtures::shared_files::{shared_file, some_of};
use sightline_renderer::{
    Camera, Frame, Mode, Renderer,
    node_visibility::{NodeVisibility, VoxelOccluders},
};
use sightline_world::{Cells, Mesh, World, geometry::Aabb};

/// The least share of pixels that agree with triangles, in every view.
const AGREEING: f64 = 0.999;
/// The largest share of pixels whose colour differs between the modes by more than rounding.
const DIFFERING: f64 = 0.005;
/// The largest share of projections that form patterns need, from spawn points.
const PROJECTIONS: f64 = 0.05;
const SIZE: (usize, usize) = (640, 360);

/// The drawn part of a world. Its cells are a single one.
fn world(model: &Model, voxel: f32) -> World {
    let bounds = model.bounds().expect("the model has triangles");
    let go_on = |_| ControlFlow::Continue(());
    let octree =
        voxelise::voxelise(&model.surfaces, &bounds, voxel, &go_on).expect("the voxels fit");
    World {
        title: model.title.clone(),
        octree,
        cells: Cells::whole(bounds.grown(1.0)),
        mesh: Mesh::default(),
        movers: Vec::new(),
        rooms: Default::default(),
        spawns: model.spawns.clone(),
        body: model.body,
        speed_max: model.speed_max,
        light: None,
        origin: None,
    }
}

/// All drawn triangles except those of glass, which depths pass through.
fn drawn(model: &Model) -> Mesh {
    let mut mesh = Mesh::default();
    for surface in model.surfaces.iter().filter(|surface| !surface.material.glass) {
        for corners in surface.corners() {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(corners);
            mesh.triangles.push([first, first + 1, first + 2]);
        }
    }
    mesh
}

/// Checks the views from every spawn point and along a walk.
fn check(name: &str, model: &Model, voxel: f32) {
    let world = world(model, voxel);
    let rays = RayCaster::new(&drawn(model)).expect("the model has drawn triangles");
    let views = Views::new(&world, &CameraPath::through(&world), 8);
    let cameras: Vec<Camera> = views.spawns.iter().chain(&views.path).copied().collect();
    let mut frame = Frame::new(SIZE.0, SIZE.1);
    for mode in Mode::ALL {
        let mut renderer = Renderer::default();
        renderer.mode = mode;
        for (i, camera) in cameras.iter().enumerate() {
            renderer.draw(&world.octree, camera, &mut frame);
            let (depths, faults) = DepthAgreement::of(&frame, camera, &rays, world.octree.voxel());
            let at = faults.first().map(|(i, fault)| (i % SIZE.0, i / SIZE.0, *fault));
            assert!(
                depths.agreeing >= AGREEING,
                "{name}, {mode:?}, view {i} of {}: {depths:?}, first at {at:?} from {camera:?}",
                cameras.len()
            );
        }
    }
    println!("{name}: {} views agree", cameras.len());
    for mode in [Mode::Orthogonal, Mode::Forms] {
        let compared = ModeComparison::of(mode, &world.octree, &cameras, SIZE, &mut |_| {});
        let ModeComparison { differing, unlike, shifted, shift_max, projections, .. } = &compared;
        println!("  {mode:?}: differing {differing:?}, unlike {unlike:?}");
        println!("  shifted {shifted:?} by {shift_max}, projections {projections:?}");
        assert!(differing.worst <= DIFFERING, "{name}: {compared:?}");
        assert!(shifted.worst == 0.0 && *shift_max <= 1, "{name}: {compared:?}");
        for view in &compared.views[..views.spawns.len()] {
            let (some, all) = (view.compared.projections, view.perspective.projections);
            assert!(mode != Mode::Forms || some <= PROJECTIONS * all, "{name}: {view:?}");
        }
    }
    check_hidden(name, &world);
}

/// The number of viewpoint boxes, and of eyes in each, for pictures with and without hidden nodes.
/// Environment variables of these names give more.
const BOXES: (&str, usize) = ("SIGHTLINE_BOXES", 24);
const EYES: (&str, usize) = ("SIGHTLINE_EYES", 8);

fn number((name, least): (&str, usize)) -> usize {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(least)
}

/// Checks pictures without hidden nodes, from boxes along a walk and elsewhere.
fn check_hidden(name: &str, world: &World) {
    let walls = VoxelOccluders::new(&world.octree).expect("few enough occluders");
    let random = &mut SmallRng::seed_from_u64(7);
    let path = CameraPath::through(world);
    let [mut whole, mut less] = [(); 2].map(|()| Frame::new(192, 108));
    let (mut renderer, mut counts, mut visited) = (Renderer::default(), [0; 2], [0; 2]);
    for turn in 0..number(BOXES) {
        let at = path.at(random.random_range(0.0..=path.duration_s())).eye;
        let aside = Vec3::from([0; 3].map(|_| random.random_range(-0.5..0.5)));
        let size = Vec3::from([0; 3].map(|_| random.random_range(0.05..1.0)));
        let eyes = Aabb::new(at + aside, at + aside + size);
        renderer.mode = Mode::ALL[turn % Mode::ALL.len()];
        // Every other pair of boxes is prepared for pictures of exactly this size, as a window
        // does.
        let focal = Camera::looking_at(at, at + aside).focal(less.height());
        let hidden =
            Arc::new(NodeVisibility::new(&walls, eyes, if turn % 4 < 2 { focal } else { 50.0 }));
        counts = [counts[0] + hidden.counts().hidden, counts[1] + hidden.counts().all];
        // Without mask tests for clear nodes, a few more nodes are visited.
        let tested = Arc::new(NodeVisibility::clone(&hidden).without_unoccluded());
        for turn in 0..number(EYES) {
            let eye = eyes.min + size * Vec3::from([0; 3].map(|_| random.random_range(0.0..1.0)));
            let (yaw, pitch) = (random.random_range(-3.2..3.2), random.random_range(-0.9..0.9));
            let camera = Camera { eye, yaw, pitch, fov_y: Camera::FOV_Y };
            renderer.node_visibility = None;
            renderer.draw(&world.octree, &camera, &mut whole);
            let nodes = renderer.counters().nodes;
            for known in [&hidden, &tested].into_iter().take(if turn == 0 { 2 } else { 1 }) {
                renderer.node_visibility = Some(Arc::clone(known));
                renderer.draw(&world.octree, &camera, &mut less);
                assert!(whole == less, "{name}, {:?}: {camera:?} in {eyes:?}", renderer.mode);
            }
            if turn == 0 {
                visited = [visited[0] + nodes, visited[1] + renderer.counters().nodes];
            }
        }
    }
    println!("  {} occluders hide {counts:?} nodes; visited {visited:?}", walls.len());
    assert!(counts[0] > 0 && visited[1] <= visited[0], "{name}: {counts:?} {visited:?}");
}

#[test]
fn the_demo_building_is_drawn_where_its_triangles_are() {
    let model = glb::read_slice(&sightline_demo_building::glb(24, 1), None, "demo")
        .expect("the generated file is a model");
    check("demo building", &model, 0.05);
}

#[test]
fn real_maps_are_drawn_where_their_triangles_are() {
    for name in some_of(&["aggressor", "delta", "oa_dm2", "oa_dm4"]) {
        let Some(path) = shared_file(&format!("maps/{name}.bsp")) else { continue };
        check(name, &import::read(&path, &[]).expect("a map"), 0.1);
    }
}

/// Checks the check: a picture with a hole, or with a ghost, fails.
#[test]
fn holes_and_ghosts_are_found() {
    let model = glb::read_slice(&sightline_demo_building::glb(6, 1), None, "demo")
        .expect("the generated file is a model");
    let world = world(&model, 0.1);
    let rays = RayCaster::new(&drawn(&model)).expect("the model has drawn triangles");
    let views = Views::new(&world, &CameraPath::through(&world), 1);
    let mut frame = Frame::new(SIZE.0, SIZE.1);
    Renderer::default().draw(&world.octree, &views.path[0], &mut frame);
    let middle = (SIZE.1 / 2 * SIZE.0) + SIZE.0 / 2;
    let shown = frame.depth[middle];
    for (depth, expected) in
        [(f32::INFINITY, DepthFault::Beyond), (shown * 0.5, DepthFault::Before)]
    {
        frame.depth[middle] = depth;
        let (_, faults) = DepthAgreement::of(&frame, &views.path[0], &rays, 0.1);
        assert!(faults.contains(&(middle, expected)), "{expected:?} at {shown}");
    }
}
