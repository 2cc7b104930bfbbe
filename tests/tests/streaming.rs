//! A world that arrives in pieces: what may be seen from a space is never too little, the picture
//! is that of the whole world once it is sharp, and before that it has no hole.

use std::{ops::ControlFlow, sync::OnceLock, time::Duration};

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_client::camera_path::CameraPath;
use sightline_compiler::{
    CompileOptions, LightMethod, compile,
    import::{self, glb},
    model::Model,
};
use sightline_fixtures::shared_files::shared_file;
use sightline_renderer::{Camera, Frame, Renderer};
use sightline_tests::streaming::{SimulatedLink, StreamedVisit};
use sightline_visibility::streaming::pieces_of;
use sightline_world::{
    World, WorldHead, WorldPieces,
    geometry::Aabb,
    motion::Pose,
    octree::{Octree, pieces::PartialOctree},
};

/// The number of boxes of eyes. Where the environment variable asks for more, there are more
/// worlds.
const BOXES: &str = "SIGHTLINE_BOXES";
const BOXES_LEAST: usize = 12;
/// The eyes in each box, and the lines from each.
const EYES: usize = 4;
const LINES: usize = 200;
const SIZE: (usize, usize) = (160, 90);

fn office() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| {
        let glb = sightline_demo_building::glb(12, 4);
        compiled(&glb::read_slice(&glb, None, "office").unwrap(), 0.15)
    })
}

fn compiled(model: &Model, voxel: f32) -> World {
    let options = CompileOptions {
        voxel: Some(voxel),
        cell: Some(3.0),
        light: LightMethod::None,
        ..CompileOptions::default()
    };
    compile(model, &options, &|_, _| ControlFlow::Continue(())).unwrap().0
}

fn boxes() -> Option<usize> {
    std::env::var(BOXES).ok()?.parse().ok()
}

/// Where a line from an eye meets the first voxel, found by short steps through empty nodes.
fn first_voxel(octree: &Octree, eye: Vec3, along: Vec3) -> Option<Vec3> {
    let step = octree.voxel() * 0.2;
    let bounds = octree.bounds();
    let mut point = eye;
    while bounds.contains(point) {
        if octree.leaf_at(point).is_some() {
            return Some(point);
        }
        point += along * step;
    }
    None
}

fn direction(random: &mut SmallRng) -> Vec3 {
    loop {
        let way = Vec3::from([0; 3].map(|_| random.random_range(-1.0f32..=1.0)));
        if (0.01..=1.0).contains(&way.length_squared()) {
            return way.normalize();
        }
    }
}

/// Checks by dense eyes that what they see is in the set of their space. Returns the share of the
/// branches that is ruled out, and prints that of the cells beside it.
fn check_sets(name: &str, world: &World) -> f64 {
    let head = WorldHead::read(&pieces_of(world, &[]).head).unwrap();
    let random = &mut SmallRng::seed_from_u64(3);
    let boxes = boxes().unwrap_or(BOXES_LEAST);
    let (mut lines, mut seen_share, mut cells_share, mut eyes_in) = (0, 0.0, 0.0, 0);
    let count = world.cells.cells.len() as f64;
    let spaces = &world.cells.spaces;
    for _ in 0..boxes {
        let bounds = spaces[random.random_range(0..spaces.len())].bounds;
        let inside = |low: f32, high: f32, random: &mut SmallRng| random.random_range(low..=high);
        let at = Vec3::from([0, 1, 2].map(|a| inside(bounds.min[a], bounds.max[a], random)));
        let eyes = Aabb::around(at, 0.5).intersection(&bounds);
        for _ in 0..EYES {
            let own = Vec3::from([0, 1, 2].map(|a| inside(eyes.min[a], eyes.max[a], random)));
            let eye = world.cells.axes.world(own);
            let Some(cell) = world.cells.at(eye) else { continue };
            if world.octree.leaf_at(eye).is_some() {
                continue;
            }
            let seen = head.seen_from(eye).expect("a space is a viewpoint");
            seen_share += seen.len() as f64 / head.octree.branches() as f64;
            cells_share += world.cells.pvs[cell.0 as usize].len() as f64 / count;
            eyes_in += 1;
            for _ in 0..LINES {
                let along = direction(random);
                let Some(point) = first_voxel(&world.octree, eye, along) else { continue };
                let branch = head.octree.branch_at(point).expect("it has a voxel");
                lines += 1;
                assert!(seen.contains(branch as u32), "{name}: {point} from {eye}");
            }
        }
    }
    assert!(lines > boxes * LINES / 4, "{name}: {lines} lines");
    let [ruled_out, cells] = [seen_share, cells_share].map(|seen| 1.0 - seen / f64::from(eyes_in));
    println!(
        "{name}: {boxes} boxes, {lines} lines, {:.1} % of branches and {:.1} % of cells ruled out",
        ruled_out * 100.0,
        cells * 100.0
    );
    ruled_out
}

#[test]
fn what_some_eye_sees_is_in_the_set_of_its_space() {
    assert!(check_sets("office", office()) > 0.3);
    // Compiling maps takes longer than the rest of this.
    let is_thorough = boxes().is_some_and(|boxes| boxes > BOXES_LEAST);
    let maps: &[&str] = if is_thorough { &["delta", "oa_dm2", "oa_dm4", "aggressor"] } else { &[] };
    for map in maps {
        let Some(path) = shared_file(&format!("maps/{map}.bsp")) else { return };
        check_sets(map, &compiled(&import::read(&path, &[]).unwrap(), 0.2));
    }
}

#[test]
fn a_sharp_picture_is_that_of_the_whole_world_and_earlier_ones_have_no_hole() {
    let world = office();
    let pieces = pieces_of(world, &[]);
    let link = SimulatedLink { bits_per_s: 4e6, delay: Duration::from_millis(50) };
    for spawn in world.spawns.iter().take(2) {
        let camera = Camera::at(&Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() });
        let mut whole = Frame::new(SIZE.0, SIZE.1);
        Renderer::default().draw(&world.octree, &camera, &mut whole);
        let mut visit = StreamedVisit::new(&pieces, link, SIZE).unwrap();
        let mut coarse = 0;
        loop {
            let moment = visit.step(&camera, Vec3::ZERO).unwrap();
            assert!(moment.at < Duration::from_secs(60), "it is never sharp");
            if !moment.is_open {
                continue;
            }
            // A depth is that of the middle of a voxel, or of a node as large as a pixel.
            let spare = |depth: f32| world.octree.voxel() * 1.8 + depth * 0.02;
            let depths = whole.depth.iter().zip(&visit.frame.depth);
            let holes = depths.filter(|(all, part)| **part > **all + spare(**all)).count();
            assert_eq!(holes, 0, "after {:?}", moment.at);
            if moment.is_sharp {
                assert!(whole.colour == visit.frame.colour && whole.depth == visit.frame.depth);
                break;
            }
            coarse += usize::from(whole.colour != visit.frame.colour);
        }
        assert!(coarse > 0, "no picture is drawn before all is there");
        let all: usize = pieces.pieces.iter().map(Vec::len).sum();
        assert!(visit.bytes < pieces.head.len() + all * 3 / 4, "{} of {all} bytes", visit.bytes);
    }
}

#[test]
fn a_walk_with_little_memory_shows_the_same_pictures() {
    let world = office();
    let pieces = pieces_of(world, &[]);
    let whole = complete(&pieces).bytes();
    let memory = whole / 3;
    let link = SimulatedLink { bits_per_s: 1e9, delay: Duration::ZERO };
    let mut visit = StreamedVisit::new(&pieces, link, SIZE).unwrap();
    visit.fetcher.set_memory(memory);
    let path = CameraPath::wandering(world, 3, 90.0);
    let (mut renderer, mut expected) = (Renderer::default(), Frame::new(SIZE.0, SIZE.1));
    let mut let_go = 0;
    for (_, pose) in path.frames(24) {
        let camera = Camera::at(&pose);
        let mut steps = 0;
        loop {
            let here = visit.fetcher.octree().bytes();
            let moment = visit.step(&camera, Vec3::ZERO).unwrap();
            // What arrives in a frame's time may come on top.
            assert!(visit.fetcher.octree().bytes() <= memory + whole / 8);
            let_go += usize::from(visit.fetcher.octree().bytes() < here);
            if moment.is_sharp {
                break;
            }
            steps += 1;
            assert!(steps < 1_000, "it is never sharp");
        }
        renderer.draw(&world.octree, &camera, &mut expected);
        assert!(expected.colour == visit.frame.colour, "from {}", pose.eye);
    }
    assert!(let_go > 0, "nothing was let go of {whole} bytes");
}

/// A tree with all pieces.
fn complete(pieces: &WorldPieces) -> PartialOctree {
    let mut octree = WorldHead::read(&pieces.head).unwrap().octree;
    let grades = usize::from(octree.grades());
    for (number, piece) in pieces.pieces.iter().enumerate() {
        octree.grow(number / grades, piece).unwrap();
    }
    octree
}

#[test]
fn everything_arrives_in_the_end_where_it_is_wanted() {
    let world = office();
    let pieces = pieces_of(world, &[]);
    let link = SimulatedLink { bits_per_s: 1e9, delay: Duration::ZERO };
    let mut visit = StreamedVisit::new(&pieces, link, SIZE).unwrap();
    visit.all = true;
    let spawn = world.spawns[0];
    let camera = Camera::at(&Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() });
    let mut steps = 0;
    while !visit.fetcher.octree().is_complete() {
        visit.step(&camera, Vec3::ZERO).unwrap();
        steps += 1;
        assert!(steps < 10_000, "it never ends");
    }
    let bytes: usize = pieces.pieces.iter().map(|piece| piece.len() + 8).sum();
    assert_eq!(visit.bytes, pieces.head.len() + bytes, "each piece came once");
}
