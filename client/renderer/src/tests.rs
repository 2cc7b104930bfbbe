use glam::{UVec3, Vec3};
use proptest::prelude::*;
use sightline_world::{
    motion::Pose,
    octree::{Material, Octree, Voxel, morton},
};

use super::{mask::BLOCK, view::View, *};

mod restricted;

const ORIGIN: Vec3 = Vec3::new(-1.0, -1.0, -1.0);
const VOXEL: f32 = 0.25;
const DEPTH: u8 = 3;

/// A voxel and the corner of its cube.
type Placed = (Voxel, Vec3);

fn voxels(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Placed>> {
    let at = prop::array::uniform3(0u32..1 << DEPTH);
    let materials = (any::<[u8; 3]>(), any::<[i8; 3]>(), 0u8..4);
    prop::collection::btree_map(at, materials, count).prop_map(|voxels| {
        let place = |(at, (colour, normal, kind)): ([u32; 3], ([u8; 3], [i8; 3], u8))| {
            let at = UVec3::from(at);
            let flags = if kind == 0 { Material::GLASS } else { 0 };
            let voxel = Voxel { key: morton(at), colour, normal, flags };
            (voxel, ORIGIN + at.as_vec3() * VOXEL)
        };
        voxels.into_iter().map(place).collect()
    })
}

/// A renderer with some settings.
fn renderer(set: impl FnOnce(&mut Renderer)) -> Renderer {
    let mut renderer = Renderer::default();
    set(&mut renderer);
    renderer
}

fn octree_of(voxels: &[Placed]) -> Octree {
    let voxels = voxels.iter().map(|(voxel, _)| *voxel).collect();
    Octree::from_voxels(ORIGIN, VOXEL, DEPTH, voxels).expect("small")
}

/// The colour and the depth of what a ray meets first. Every voxel is tried.
fn cast(voxels: &[(Material, Vec3)], eye: Vec3, ray: Vec3, forward: Vec3) -> (u32, f32) {
    let mut first = (colour::sky(ray), f32::INFINITY);
    let mut first_enters = f32::INFINITY;
    let mut glass = (0, f32::INFINITY);
    for (material, corner) in voxels {
        let (low, high) = (*corner - eye, *corner + VOXEL - eye);
        let (a, b) = (low / ray, high / ray);
        let (enters, leaves) = (a.min(b).max_element(), a.max(b).min_element());
        if enters > leaves || leaves < 0.0 || low.max(-high).max_element() <= 0.0 {
            continue;
        }
        if material.is_glass() && enters < glass.1 {
            glass = (colour::of_material(material), enters);
        }
        if !material.is_glass() && enters < first_enters {
            let depth = forward.dot((low + high) * 0.5).max(margins::NEAR);
            first = (colour::hazed(colour::of_material(material), ray.length() * depth), depth);
            first_enters = enters;
        }
    }
    let tint = glass.1 < first_enters;
    (if tint { colour::through_glass(first.0, glass.0) } else { first.0 }, first.1)
}

/// The share of pixels that differ from what rays find.
fn difference(voxels: &[Placed], camera: &Camera, mode: Mode) -> f32 {
    let (width, height) = (90, 70);
    let mut frame = Frame::new(width, height);
    let octree = octree_of(voxels);
    let mut renderer = renderer(|it| it.mode = mode);
    renderer.draw(&octree, camera, &mut frame);
    let view = View::new(camera, width, height);
    let forward = view.ray((width - 1) as f32 * 0.5, (height - 1) as f32 * 0.5);
    // The palette rounds normals.
    let material = |corner: Vec3| *octree.leaf_at(corner + VOXEL * 0.5).expect("put in");
    let voxels: Vec<_> = voxels.iter().map(|&(_, corner)| (material(corner), corner)).collect();
    let differs = |i: usize| {
        let ray = view.ray((i % width) as f32, (i / width) as f32);
        let (colour, depth) = cast(&voxels, camera.eye, ray, forward);
        let near = frame.depth[i] == depth || (frame.depth[i] - depth).abs() < 0.01;
        // The air is equally thick all over a block of pixels.
        let channels = colour.to_be_bytes().into_iter().zip(frame.colour[i].to_be_bytes());
        !(near && channels.into_iter().all(|(a, b)| a.abs_diff(b) <= 2))
    };
    (0..width * height).filter(|&i| differs(i)).count() as f32 / (width * height) as f32
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn the_picture_is_what_rays_find(
        voxels in voxels(0..200),
        eye in prop::array::uniform3(-2.0f32..2.0),
        target in prop::array::uniform3(-1.0f32..1.0),
    ) {
        let camera = Camera::looking_at(Vec3::from(eye), Vec3::from(target));
        for mode in Mode::ALL {
            let difference = difference(&voxels, &camera, mode);
            prop_assert!(difference <= 0.005, "{difference} of the pixels, {mode:?}");
        }
    }
}

/// With a mirrored axis, far voxels would show through near ones in some of the eight sectors.
#[test]
fn the_order_is_right_in_every_sector() {
    let places = (0..8).flat_map(|x| (0..64).map(move |yz| UVec3::new(x, yz / 8, yz % 8)));
    let all = places.map(|at| {
        let colour = at.to_array().map(|part| part as u8 * 30);
        let voxel = Voxel { key: morton(at), colour, ..Voxel::default() };
        (voxel, ORIGIN + at.as_vec3() * VOXEL)
    });
    let all: Vec<Placed> = all.collect();
    for sector in 0..8 {
        let sign = |bit: u32| if sector >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let eye = Vec3::new(1.9 * sign(0), 2.3 * sign(1), 1.6 * sign(2));
        let camera = Camera::looking_at(eye, Vec3::ZERO);
        for mode in Mode::ALL {
            assert!(difference(&all, &camera, mode) <= 0.005, "from {eye}, {mode:?}");
        }
    }
}

#[test]
fn threads_do_not_matter() {
    let voxels =
        (0..512).step_by(3).map(|key| Voxel { key, colour: [key as u8; 3], ..Voxel::default() });
    let octree = Octree::from_voxels(ORIGIN, VOXEL, DEPTH, voxels.collect()).expect("small");
    let camera = Camera::looking_at(Vec3::new(2.0, 1.0, 0.7), Vec3::ZERO);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let mut frame = Frame::new(333, 222);
        pool.install(|| Renderer::default().draw(&octree, &camera, &mut frame));
        frame
    };
    let one = with(1);
    assert!(one.depth.iter().any(|depth| depth.is_finite()));
    assert!(one == with(2) && one == with(5));
}

#[test]
fn processors_do_not_matter() {
    let octree = landscape();
    let camera = Camera::looking_at(ORIGIN + Vec3::new(3.8, 3.2, 3.7), ORIGIN + Vec3::Y);
    let drawn = |portable| {
        let mut frame = Frame::new(333, 222);
        let mut renderer = renderer(|it| it.portable = portable);
        renderer.draw(&octree, &camera, &mut frame);
        frame
    };
    let portable = drawn(true);
    assert!(portable.depth.iter().any(|depth| depth.is_finite()));
    assert!(portable == drawn(false));
}

#[test]
fn smooth_edges_lie_between_the_colours_beside_them() {
    let octree = landscape();
    let camera = Camera::looking_at(ORIGIN + Vec3::new(3.8, 3.2, 3.7), ORIGIN + Vec3::Y);
    let drawn = |antialias, width, height| {
        let mut frame = Frame::new(width, height);
        let mut renderer = renderer(|it| it.antialias = antialias);
        renderer.draw(&octree, &camera, &mut frame);
        frame
    };
    let (smooth, fine) = (drawn(true, 90, 61), drawn(false, 180, 122));
    for (i, (&colour, &depth)) in smooth.colour.iter().zip(&smooth.depth).enumerate() {
        let corner = i / 90 * 360 + i % 90 * 2;
        let four = [0, 1, 180, 181].map(|step| corner + step);
        let channels = four.map(|at| fine.colour[at].to_be_bytes());
        for (channel, mean) in colour.to_be_bytes().into_iter().enumerate() {
            let all = channels.map(|channels| channels[channel]);
            assert!(all.iter().min() <= Some(&mean) && Some(&mean) <= all.iter().max(), "{i}");
        }
        assert_eq!(depth, four.map(|at| fine.depth[at]).into_iter().fold(f32::INFINITY, f32::min));
    }
}

#[test]
fn each_block_has_its_greatest_depth() {
    let octree = landscape();
    let eye = ORIGIN + Vec3::new(3.8, 3.2, 3.7);
    let mut frame = Frame::new(90, 301);
    let mut renderer = Renderer::default();
    // The second time, the buffers hold the depths of another picture.
    for target in [Vec3::ZERO, Vec3::Y] {
        renderer.draw(&octree, &Camera::looking_at(eye, ORIGIN + target), &mut frame);
        let mut farthest = vec![0.0f32; 12 * 38];
        for (pixel, depth) in frame.depth.iter().enumerate() {
            let farthest = &mut farthest[pixel / 90 / BLOCK * 12 + pixel % 90 / BLOCK];
            *farthest = depth.max(*farthest);
        }
        assert_eq!(frame.farthest, farthest);
        assert!(
            farthest.iter().any(|depth| depth.is_finite()) && farthest.contains(&f32::INFINITY)
        );
    }
    renderer.antialias = true;
    renderer.draw(&octree, &Camera::looking_at(eye, ORIGIN), &mut frame);
    for (pixel, depth) in frame.depth.iter().enumerate() {
        assert!(*depth <= frame.farthest[pixel / 90 / BLOCK * 12 + pixel % 90 / BLOCK]);
    }
    assert!(frame.farthest.iter().any(|depth| depth.is_finite()));
}

/// Figures are drawn after the building, and yet behind its glass.
#[test]
fn glass_is_in_front_of_figures_behind_it_alone() {
    let pane = (0..64).map(|i| UVec3::new(i % 8, i / 8, 4));
    let glass = |at| Voxel {
        key: morton(at),
        flags: Material::GLASS,
        colour: [0, 250, 0],
        ..Voxel::default()
    };
    let octree = Octree::from_voxels(ORIGIN, VOXEL, DEPTH, pane.map(glass).collect());
    let octree = octree.expect("small");
    let camera = Camera::looking_at(Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO);
    let body = sightline_world::motion::Body { half_width: 0.3, above_eye: 0.1, below_eye: 0.8 };
    let drawn = |octree: &Octree, z: f32, antialias: bool| {
        let mut frame = Frame::new(120, 301);
        let mut renderer = renderer(|it| it.antialias = antialias);
        renderer.draw(octree, &camera, &mut frame);
        let pose = Pose { eye: Vec3::new(0.0, 0.0, z), ..Pose::default() };
        avatars::draw(
            &mut frame,
            &camera,
            octree,
            &[avatars::AvatarFigure {
                pose,
                body,
                colour: [250, 60, 60],
                name: "",
                stride: 0.0,
                light: None,
            }],
        );
        frame
    };
    let nothing = Octree::empty(ORIGIN, 2.0, DEPTH);
    for (z, antialias) in [(-1.5, false), (-1.5, true), (1.5, false), (1.5, true)] {
        let (seen, bare) = (drawn(&octree, z, antialias), drawn(&nothing, z, antialias));
        let figure = (0..seen.colour.len()).filter(|&i| bare.depth[i].is_finite());
        let mut count = 0;
        for i in figure {
            let [seen, bare] = [seen.colour[i], bare.colour[i]];
            let green = |colour: u32| colour >> 8 & 0xff;
            if z < 0.0 {
                assert!(green(seen) > green(bare), "pixel {i}, {z}, {antialias}");
            } else {
                assert_eq!(seen, bare, "pixel {i}, {z}, {antialias}");
            }
            count += 1;
        }
        assert!(count > 300, "{count}");
    }
}

#[test]
fn normals_are_those_of_what_is_seen() {
    let voxels = vec![Voxel { key: 0, normal: [0, 127, 0], ..Voxel::default() }];
    let octree = Octree::from_voxels(ORIGIN, VOXEL, DEPTH, voxels).expect("small");
    let mut frame = Frame::new(64, 48);
    let camera = Camera::looking_at(ORIGIN + Vec3::new(0.5, 1.0, 0.7), ORIGIN + VOXEL * 0.5);
    Renderer::default().draw(&octree, &camera, &mut frame);
    for (pixel, depth) in frame.depth.iter().enumerate() {
        let expected = if depth.is_finite() { Vec3::Y } else { Vec3::ZERO };
        assert_eq!(frame.normal(pixel, &octree), expected);
    }
    assert!(frame.depth.iter().any(|depth| depth.is_finite()));
}

/// Bumpy ground and a ceiling, of voxels that span a few pixels and less.
fn landscape() -> Octree {
    let depth = 8;
    let height = |x: u32, z: u32| {
        let waves = (x as f32 * 0.11).sin() * 9.0 + (z as f32 * 0.07).cos() * 11.0;
        (60.0 + waves) as u32 + u32::from(x / 16 % 3 == 1 && z / 16 % 2 == 1) * 24
    };
    let at = |x: u32, z: u32| {
        let lowest = height(x.saturating_sub(1), z).min(height(x, z.saturating_sub(1)));
        let (low, top) = (lowest.min(height(x, z)), lowest.max(height(x, z)));
        (low..=top).chain([130]).map(move |y| UVec3::new(x, y, z))
    };
    let all = (0..1u32 << depth).flat_map(|x| (0..1u32 << depth).map(move |z| (x, z)));
    let voxels = all.flat_map(|(x, z)| at(x, z)).map(|at| {
        let shade = |part: u32| (128.0 + (part as f32 * 0.19).sin() * 90.0) as u8;
        let colour = [shade(at.x), shade(at.y * 3), shade(at.z)];
        Voxel { key: morton(at), colour, ..Voxel::default() }
    });
    Octree::from_voxels(ORIGIN, 0.03, depth, voxels.collect()).expect("small")
}

/// Form patterns draw what projecting each node draws, but edges may lie up to a pixel beside. So
/// does the cheaper way at each node.
#[test]
fn all_modes_agree_with_perspective() {
    let octree = landscape();
    let (width, height) = (400, 260);
    for (i, yaw) in (0..9).map(|i| (i, i as f32 * 0.785)) {
        let eye = ORIGIN + Vec3::new(3.8 + i as f32 * 0.1, 3.1, 3.7);
        let camera = Camera { eye, yaw, pitch: -0.3 + 0.1 * i as f32, fov_y: 1.1 };
        let modes = [Mode::Perspective, Mode::Forms, Mode::Orthogonal];
        let [(perspective, all), (forms, some), (mixed, _)] = modes.map(|mode| {
            let mut renderer = renderer(|it| it.mode = mode);
            let mut frame = Frame::new(width, height);
            renderer.draw(&octree, &camera, &mut frame);
            (frame, renderer.counters())
        });
        assert!(some.projections * 2 < all.projections, "{some:?}, {all:?}");
        let differs = |frame: &Frame, x: usize, y: usize| {
            let at = y * width + x;
            let around = (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| y * width + x));
            let same = |other: usize| {
                let (a, b) = (frame.depth[at], perspective.depth[other]);
                let channels = [frame.colour[at], perspective.colour[other]].map(u32::to_be_bytes);
                let close = channels[0].iter().zip(channels[1]).all(|(a, b)| a.abs_diff(b) < 12);
                close && (a == b || (a - b).abs() < 0.03 * a)
            };
            !around.into_iter().any(same)
        };
        for frame in [&forms, &mixed] {
            let inner = (1..width - 1).flat_map(|x| (1..height - 1).map(move |y| (x, y)));
            let count = inner.filter(|&(x, y)| differs(frame, x, y)).count();
            assert!(count * 100 < width * height, "{count} pixels, yaw {yaw}");
        }
    }
}

/// A floor of voxels much smaller than pixels, seen at a flat angle. A hole would show the sky.
#[test]
fn a_floor_has_no_holes_at_any_distance() {
    let depth = 8;
    let floor = (0..1 << depth).flat_map(|x| (0..1 << depth).map(move |z| UVec3::new(x, 3, z)));
    let voxels = floor.map(|at| Voxel { key: morton(at), normal: [0, 127, 0], ..Voxel::default() });
    let octree = Octree::from_voxels(Vec3::ZERO, 0.5, depth, voxels.collect()).expect("small");
    let camera = Camera { eye: Vec3::new(64.3, 3.7, 1.2), yaw: 3.0, pitch: -0.2, fov_y: 0.9 };
    let mut frame = Frame::new(320, 200);
    Renderer::default().draw(&octree, &camera, &mut frame);
    let view = View::new(&camera, 320, 200);
    for (i, &depth) in frame.depth.iter().enumerate() {
        let ray = view.ray((i % 320) as f32, (i / 320) as f32);
        let expected = (2.0 - camera.eye.y) / ray.y;
        let hit = camera.eye + ray * expected;
        if ray.y < 0.0 && Vec3::ZERO.cmplt(hit).all() && hit.cmplt(Vec3::splat(128.0)).all() {
            let tolerance = 1.0 + expected * 0.1;
            assert!((depth - expected).abs() < tolerance, "pixel {i}: {depth}, not {expected}");
        }
    }
}

#[test]
fn odd_cameras_and_sizes_are_survived() {
    let voxels = vec![Voxel { key: 9, ..Voxel::default() }];
    let octree = Octree::from_voxels(ORIGIN, VOXEL, DEPTH, voxels).expect("small");
    let empty = Octree::empty(ORIGIN, 2.0, DEPTH);
    let mut renderer = Renderer::default();
    for mode in Mode::ALL {
        renderer.mode = mode;
        for (width, height) in [(0, 0), (1, 1), (65, 64), (3, 700), (64, 63)] {
            let mut frame = Frame::new(width, height);
            for eye in [Vec3::ZERO, ORIGIN, Vec3::splat(1.0e9), Vec3::NAN] {
                for (pitch, fov_y) in [(0.0, 1.0), (9.0, 0.0), (f32::NAN, 9.0)] {
                    let camera = Camera { eye, yaw: 1.0, pitch, fov_y };
                    renderer.draw(&octree, &camera, &mut frame);
                    renderer.draw(&empty, &camera, &mut frame);
                }
            }
        }
    }
}
