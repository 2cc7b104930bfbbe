use std::collections::BTreeSet;

use glam::{DVec3, Vec2};
use proptest::prelude::*;

use sightline_world::octree::Material;

use super::*;
use crate::model::SurfaceMaterial;

fn surface(triangles: &[[Vec3; 3]], colour: [u8; 3], glass: bool) -> Surface {
    Surface {
        positions: triangles.concat(),
        uvs: Vec::new(),
        colours: Vec::new(),
        triangles: (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        material: SurfaceMaterial { glass, ..SurfaceMaterial::opaque(colour) },
    }
}

fn leaves(octree: &Octree) -> BTreeSet<[u32; 3]> {
    let width = 1 << octree.depth;
    let all =
        (0..width).flat_map(|z| (0..width).flat_map(move |y| (0..width).map(move |x| [x, y, z])));
    all.filter(|&at| {
        let centre = octree.origin + (UVec3::from(at).as_vec3() + 0.5) * octree.voxel();
        octree.leaf_at(centre).is_some()
    })
    .collect()
}

/// Whether a triangle and a cube overlap, by every separating axis, in f64.
fn overlaps(triangle: [Vec3; 3], centre: Vec3, half: f64) -> bool {
    let corners = triangle.map(|corner| corner.as_dvec3() - centre.as_dvec3());
    let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
    let crossed = edges.iter().flat_map(|edge| DVec3::AXES.map(|axis| edge.cross(axis)));
    let mut axes = crossed.chain(DVec3::AXES).chain([edges[0].cross(edges[1])]);
    !axes.any(|axis| {
        let along = corners.map(|corner| corner.dot(axis));
        let reach = half * axis.abs().element_sum();
        let max = along.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let min = along.into_iter().fold(f64::INFINITY, f64::min);
        max < -reach || min > reach
    })
}

fn triangle() -> impl Strategy<Value = [Vec3; 3]> {
    let corner = prop::array::uniform3(0.0f32..3.0).prop_map(Vec3::from);
    // Some are flat along an axis, as most are in buildings.
    (prop::array::uniform3(corner), 0usize..5).prop_map(|(mut corners, flat)| {
        if flat < 3 {
            let at = corners[0][flat];
            corners.iter_mut().for_each(|corner| corner[flat] = at);
        }
        corners
    })
}

proptest! {
    #[test]
    fn the_voxels_are_those_that_a_triangle_touches(
        triangles in prop::collection::vec(triangle(), 1..4),
    ) {
        let bounds = Aabb::new(Vec3::ZERO, Vec3::splat(3.0));
        let voxel = 0.25;
        let surfaces = [surface(&triangles, [9; 3], false)];
        let octree = voxelise(&surfaces, &bounds, voxel, &|_| ControlFlow::Continue(())).expect("small");
        let found = leaves(&octree);
        for i in 0..1u32 << (3 * octree.depth) {
            let at = unmorton(u64::from(i));
            let centre = octree.origin + (at.as_vec3() + 0.5) * voxel;
            let touched = |half: f64| {
                triangles.iter().any(|&triangle| overlaps(triangle, centre, half))
            };
            // Between these two, rounding decides.
            let (surely, perhaps) = (touched(0.1249), touched(0.1254));
            let is = found.contains(&at.to_array());
            prop_assert!(is || !surely, "{at} is missing");
            prop_assert!(perhaps || !is, "{at} is touched by nothing");
        }
    }
}

/// A floor of many colours with a pane of glass on it: several blocks.
fn scene() -> (Vec<Surface>, Aabb) {
    let quad = |a: Vec3, u: Vec3, v: Vec3| [[a, a + u, a + u + v], [a, a + u + v, a + v]];
    let tiles = (0..16).map(|i| {
        let corner = Vec3::new((i % 4) as f32, 0.0, (i / 4) as f32);
        surface(&quad(corner, Vec3::Z, Vec3::X), [i as u8 * 10, 100, 200], false)
    });
    let pane = surface(&quad(Vec3::new(1.1, 0.0, 1.1), Vec3::X * 2.0, Vec3::Y), [9, 9, 9], true);
    let surfaces = tiles.chain([pane]).collect();
    (surfaces, Aabb::new(Vec3::ZERO, Vec3::new(4.0, 1.0, 4.0)))
}

#[test]
fn threads_do_not_matter() {
    let (surfaces, bounds) = scene();
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            voxelise(&surfaces, &bounds, 1.0 / 64.0, &|_| ControlFlow::Continue(())).expect("small")
        })
    };
    let one = with(1);
    assert!(one.leaves.len() > 65_000);
    assert!(one == with(2) && one == with(7));
}

#[test]
fn materials_come_from_the_surfaces_inside() {
    let (surfaces, bounds) = scene();
    let octree =
        voxelise(&surfaces, &bounds, 1.0 / 32.0, &|_| ControlFlow::Continue(())).expect("small");
    let at = |x, y, z| *octree.leaf_at(Vec3::new(x, y, z)).expect("filled");
    let floor = at(2.5, 0.0, 3.5);
    assert_eq!((floor.colour, floor.normal, floor.flags), ([140, 100, 200], [0, 127, 0], 0));
    assert_eq!(at(2.0, 0.5, 1.1).flags, Material::GLASS);
    // Where the pane stands on the floor, the floor is seen.
    let foot = at(2.0, 0.0, 1.1);
    assert_eq!((foot.colour[1], foot.flags), (100, 0));
    assert!(octree.leaf_at(Vec3::new(2.0, 0.5, 2.0)).is_none());
}

#[test]
fn a_wall_on_a_round_place_is_one_voxel_thick() {
    let wall = [[Vec3::X, Vec3::new(1.0, 2.0, 0.0), Vec3::new(1.0, 0.0, 2.0)]];
    let bounds = Aabb::new(Vec3::ZERO, Vec3::splat(2.0));
    let surfaces = [surface(&wall, [9; 3], false)];
    let octree =
        voxelise(&surfaces, &bounds, 0.125, &|_| ControlFlow::Continue(())).expect("small");
    let columns: BTreeSet<u32> = leaves(&octree).iter().map(|at| at[0]).collect();
    assert_eq!(columns.len(), 1);
}

#[test]
fn coarse_voxels_get_the_mean_of_a_texture() {
    let fine = sightline_picture::Picture::from_fn(64, 64, |x, y| [((x ^ y) & 1) as u8 * 200; 3]);
    let corners = [Vec3::ZERO, Vec3::Z * 2.0, Vec3::X * 2.0];
    let mut floor = surface(&[corners], [255; 3], false);
    floor.uvs = vec![Vec2::ZERO, Vec2::Y * 4.0, Vec2::X * 4.0];
    floor.material.texture = Some(std::sync::Arc::new(fine));
    let bounds = Aabb::new(Vec3::ZERO, Vec3::splat(2.0));
    let octree = voxelise(&[floor], &bounds, 0.125, &|_| ControlFlow::Continue(())).expect("small");
    assert!(octree.materials.iter().all(|material| material.colour == [100; 3]));
}

#[test]
fn too_many_voxels_are_refused_with_an_edge_that_fits() {
    let wide = Vec3::new(400.0, 0.0, 400.0);
    let floor = [surface(
        &[[Vec3::ZERO, wide * Vec3::Z, wide], [Vec3::ZERO, wide, wide * Vec3::X]],
        [9; 3],
        false,
    )];
    let bounds = Aabb::new(Vec3::ZERO, wide);
    let error = voxelise(&floor, &bounds, 1.0 / 64.0, &|_| ControlFlow::Continue(()))
        .expect_err("655 million");
    assert_eq!(error, VoxeliseError::TooMany { voxel: 0.015625, enough: 0.0625 });
    assert_eq!(default_voxel(&floor, &bounds), 1.0 / 8.0);
    assert_eq!(
        voxelise(&floor, &bounds, f32::NAN, &|_| ControlFlow::Continue(()))
            .map(|_| ())
            .map_err(|e| e.to_string())
            .unwrap_err(),
        "--voxel must be between 0.001 and 100 metres, not NaN"
    );
}
