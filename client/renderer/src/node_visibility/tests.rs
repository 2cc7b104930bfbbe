use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_fixtures::voxel_floor::world;

use super::*;
use crate::{Camera, Frame, Mode, Renderer};

/// Walls with a gap, thin and thick, and glass.
const HOUSE: [([u32; 3], [u32; 3], u8); 6] = [
    ([20, 1, 0], [21, 40, 30], 0),
    ([20, 1, 34], [21, 40, 64], 0),
    ([40, 1, 10], [44, 64, 60], 0),
    ([0, 40, 0], [64, 41, 64], 0),
    ([30, 1, 0], [31, 20, 64], sightline_world::octree::Material::GLASS),
    ([50, 5, 20], [53, 9, 29], 0),
];

fn house() -> Octree {
    world(&HOUSE).octree
}

#[test]
fn pictures_are_the_same_without_what_is_hidden() {
    let octree = house();
    let occluders = VoxelOccluders::new(&octree).unwrap();
    let random = &mut SmallRng::seed_from_u64(4);
    let (mut renderer, mut left_out, mut saved, mut untested) = (Renderer::default(), 0, 0, 0);
    let [mut whole, mut less] = [(); 2].map(|()| Frame::new(96, 72));
    for turn in 0..60 {
        let edge = random.random_range(0.05..1.0);
        let min = Vec3::from([0; 3].map(|_| random.random_range(0.0..8.0)));
        let hidden = Arc::new(NodeVisibility::new(&occluders, Aabb::new(min, min + edge), 40.0));
        left_out += hidden.counts().hidden;
        for _ in 0..20 {
            let mut within = |low: f32, high: f32| random.random_range(low..high);
            let eye = min + Vec3::new(within(0.0, edge), within(0.0, edge), within(0.0, edge));
            let camera =
                Camera { eye, yaw: within(-3.2, 3.2), pitch: within(-1.2, 1.2), fov_y: 1.1 };
            renderer.mode = Mode::ALL[turn % Mode::ALL.len()];
            renderer.node_visibility = None;
            renderer.draw(&octree, &camera, &mut whole);
            let nodes = renderer.counters().nodes;
            renderer.node_visibility = Some(Arc::clone(&hidden));
            renderer.draw(&octree, &camera, &mut less);
            assert!(whole == less, "{:?} from {camera:?}, {edge}", renderer.mode);
            let tests = renderer.counters().mask_tests;
            renderer.node_visibility =
                Some(Arc::new(NodeVisibility::clone(&hidden).without_unoccluded()));
            renderer.draw(&octree, &camera, &mut less);
            assert!(whole == less, "{:?} from {camera:?}, {edge}, all tested", renderer.mode);
            saved += nodes - renderer.counters().nodes;
            untested += renderer.counters().mask_tests - tests;
        }
    }
    assert!(left_out > 1_000 && saved > 1_000, "{left_out} nodes, {saved} nodes visited less");
    assert!(untested > 1_000, "{untested} tests");
}

/// Where a line from an eye to a point first meets a box of the house, or its floor: the share of
/// the line before it.
fn meets(octree: &Octree, eye: Vec3, point: Vec3) -> f32 {
    let boxes = HOUSE.iter().map(|(min, max, _)| (*min, *max)).chain([([0; 3], [64, 1, 64])]);
    let enters = boxes.filter_map(|(min, max)| {
        let [min, max] = [min, max].map(|at| Vec3::from(at.map(|at| at as f32)) * octree.voxel());
        let (a, b) = ((min - eye) / (point - eye), (max - eye) / (point - eye));
        let enters = a.min(b).max_element();
        (enters <= a.max(b).min_element() && enters > 0.0).then_some(enters)
    });
    enters.fold(f32::INFINITY, f32::min)
}

#[test]
fn what_is_seen_whole_is_never_covered() {
    let octree = house();
    let occluders = VoxelOccluders::new(&octree).unwrap();
    let random = &mut SmallRng::seed_from_u64(5);
    let (mut visible, mut all, mut lines) = (0, 0, 0);
    for _ in 0..60 {
        let edge = random.random_range(0.05..1.0);
        let min = Vec3::from([0; 3].map(|_| random.random_range(0.0..7.0)));
        let hidden = NodeVisibility::new(&occluders, Aabb::new(min, min + edge), 40.0);
        (visible, all) = (visible + hidden.counts().visible, all + hidden.counts().all);
        let is_clear = |node: &&OccluderNode| {
            hidden.unoccluded[node.index as usize / 64] >> (node.index % 64) & 1 == 1
        };
        for node in occluders.nodes.iter().filter(is_clear) {
            let eye = min + edge * Vec3::from([0; 3].map(|_| random.random_range(0.0..=1.0)));
            let (mut point, size) = (node.cube.min, node.cube.size());
            point += size * Vec3::from([0; 3].map(|_| random.random_range(0.0..1.0)));
            let (axis, voxels) = (node.layer.unwrap(), node.voxels);
            point[axis] = voxels.centre()[axis];
            if octree.leaf_at(point).is_some() {
                let near = if eye[axis] > point[axis] { voxels.max } else { voxels.min };
                point[axis] = near[axis];
                lines += 1;
                let met = meets(&octree, eye, point);
                assert!((met - 1.0).abs() < 1e-4, "{eye} sees {point} behind {met}");
            }
        }
    }
    assert!(visible > 1_000 && lines > 1_000, "{visible} of {all}, {lines} lines");
}

#[test]
fn results_for_other_boxes_pictures_and_octrees_are_not_used() {
    let octree = house();
    let eyes = Aabb::around(Vec3::new(1.0, 1.7, 1.0), 0.2);
    let hidden = NodeVisibility::new(&VoxelOccluders::new(&octree).unwrap(), eyes, 100.0);
    let holds = |eye: Vec3, focal: f32| hidden.classes(&octree, eye, focal).is_some();
    assert!(holds(eyes.centre(), 100.0) && hidden.counts().hidden > 0);
    assert!(!holds(eyes.centre() + Vec3::X, 100.0) && !holds(eyes.centre(), 99.0));
    let other = Octree::empty(Vec3::ZERO, 0.1, 3);
    assert!(hidden.classes(&other, eyes.centre(), 100.0).is_none());
    assert!(VoxelOccluders::new(&other).unwrap().is_empty());
}

#[test]
fn boxes_are_there_before_the_eye() {
    let ahead = VisibilityPrefetcher::new(&house()).unwrap();
    let (mut eye, velocity) = (Vec3::new(1.1, 1.7, 1.1), Vec3::X);
    assert!(ahead.at(eye, velocity, 50.0).is_none(), "nobody waits");
    let end = Instant::now() + Duration::from_secs(30);
    let wait = |eye: Vec3| {
        while ahead.at(eye, velocity, 50.0).is_none() {
            assert!(Instant::now() < end, "no box of {eye}");
            std::thread::sleep(Duration::from_millis(2));
        }
    };
    wait(eye);
    eye.x += 0.4;
    wait(eye);
    assert!(boxes_ahead(eye, velocity)[1].contains(eye + velocity * 0.5));
    assert!(
        ahead.at(eye, velocity, 60.0).is_some(),
        "what holds for small pictures holds for large ones"
    );
    assert!(ahead.at(eye, velocity, 40.0).is_none(), "but not the other way round");
}
