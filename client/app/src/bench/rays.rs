//! Primary rays through triangles: the renderer's cost and depths are compared with them.
//!
//! Uses obvhs as its author recommends for a CPU: the slowest builder, which makes the best trees,
//! with spatial splits; triangles prepared for intersection, in the order in which the tree refers
//! to them; and rays in small blocks, so that neighbours share the cache. Nothing is shaded: only
//! depths are found.

use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::{
    BvhBuildParams,
    aabb::Aabb,
    bvh2::{Bvh2, builder::build_bvh2_from_tris},
    cwbvh::{CwBvh, builder::build_cwbvh_from_tris},
    ray::{Ray, RayHit},
    rt_triangle::RtTriangle,
    triangle::Triangle,
};
use rayon::prelude::*;
use sightline_renderer::Camera;
use sightline_world::Mesh;

/// The width and height of a block of rays, in pixels.
const BLOCK: usize = 8;
/// The height of a band that one thread traces, in pixels.
const BAND: usize = 2 * BLOCK;

/// The kind of bounding volume hierarchy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BvhKind {
    /// Two children per node.
    Bvh2,
    /// Eight children per node, compressed.
    Cwbvh,
}

/// Triangles in two bounding volume hierarchies, ready for rays.
pub struct RayCaster {
    bvh2: Bvh2,
    bvh2_triangles: Vec<RtTriangle>,
    cwbvh: CwBvh,
    cwbvh_triangles: Vec<RtTriangle>,
    count: usize,
}

impl RayCaster {
    /// Builds both trees. `None` when there is no triangle.
    pub fn new(mesh: &Mesh) -> Option<Self> {
        let triangle = |[a, b, c]: [Vec3; 3]| Triangle { v0: a.into(), v1: b.into(), v2: c.into() };
        let triangles: Vec<Triangle> = mesh.corners().map(triangle).collect();
        if triangles.is_empty() {
            return None;
        }
        let params = BvhBuildParams::very_slow_build();
        let mut time = Duration::default();
        let mut bvh2 = build_bvh2_from_tris(&triangles, params, &mut time);
        bvh2.reorder_in_stack_traversal_order();
        let cwbvh = build_cwbvh_from_tris(&triangles, params, &mut time);
        let in_order = |indices: &[u32]| {
            indices.iter().map(|&i| RtTriangle::from(&triangles[i as usize])).collect()
        };
        Some(Self {
            bvh2_triangles: in_order(&bvh2.primitive_indices),
            cwbvh_triangles: in_order(&cwbvh.primitive_indices),
            bvh2,
            cwbvh,
            count: triangles.len(),
        })
    }

    /// The number of triangles.
    pub fn triangles(&self) -> usize {
        self.count
    }

    /// Traces a ray per pixel, on all threads of the current rayon pool. Writes depths as in a
    /// [`Frame`](sightline_renderer::Frame) of this width.
    ///
    /// # Panics
    /// When `depth` does not consist of whole rows.
    pub fn trace(&self, tree: BvhKind, camera: &Camera, width: usize, depth: &mut [f32]) {
        if width == 0 {
            return;
        }
        assert!(depth.len().is_multiple_of(width), "whole rows");
        let lens = PixelRays::new(camera, width, depth.len() / width);
        match tree {
            BvhKind::Bvh2 => bands(&lens, width, depth, |ray| {
                let mut hit = RayHit::none();
                self.bvh2
                    .ray_traverse(ray, &mut hit, |ray, id| self.bvh2_triangles[id].intersect(ray));
                hit.t
            }),
            BvhKind::Cwbvh => bands(&lens, width, depth, |ray| {
                let mut hit = RayHit::none();
                self.cwbvh
                    .ray_traverse(ray, &mut hit, |ray, id| self.cwbvh_triangles[id].intersect(ray));
                hit.t
            }),
        }
    }
}

impl RayCaster {
    /// Whether a triangle is within a distance of a point, in metres.
    pub fn is_near(&self, point: Vec3, distance: f32) -> bool {
        let point = Vec3A::from(point);
        let around = Aabb::new(point - distance, point + distance);
        let mut found = false;
        self.bvh2.aabb_traverse(around, |bvh, node| {
            let node = &bvh.nodes[node as usize];
            let range = node.first_index as usize..(node.first_index + node.prim_count) as usize;
            let squared = distance * distance;
            let is_near = |t: &RtTriangle| (nearest(t, point) - point).length_squared() <= squared;
            found = found || self.bvh2_triangles[range].iter().any(is_near);
            !found
        });
        found
    }
}

/// The point of a triangle nearest to another point (Ericson 2004, section 5.1.5).
fn nearest(triangle: &RtTriangle, point: Vec3A) -> Vec3A {
    let (a, ab, ac) = (triangle.v0, -triangle.e1, triangle.e2);
    let to = |from: Vec3A| [ab.dot(point - from), ac.dot(point - from)];
    let ([d1, d2], [d3, d4], [d5, d6]) = (to(a), to(a + ab), to(a + ac));
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    // For a triangle without area one of these is zero, and the result is on an edge.
    if d1 <= 0.0 && d2 <= 0.0 {
        a
    } else if d3 >= 0.0 && d4 <= d3 {
        a + ab
    } else if d6 >= 0.0 && d5 <= d6 {
        a + ac
    } else if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        a + ab * (d1 / (d1 - d3))
    } else if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        a + ac * (d2 / (d2 - d6))
    } else if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        a + ab + (ac - ab) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))
    } else {
        a + (ab * vb + ac * vc) / (va + vb + vc)
    }
}

/// Fills the depths of all pixels with the first hits of their rays.
fn bands(lens: &PixelRays, width: usize, depth: &mut [f32], first: impl Fn(Ray) -> f32 + Sync) {
    depth.par_chunks_mut(BAND * width).enumerate().for_each(|(band, depth)| {
        let height = depth.len() / width;
        for top in (0..height).step_by(BLOCK) {
            for left in (0..width).step_by(BLOCK) {
                for y in top..height.min(top + BLOCK) {
                    for x in left..width.min(left + BLOCK) {
                        let along = lens.ray(x, band * BAND + y);
                        depth[y * width + x] = first(Ray::new_inf(lens.eye, along));
                    }
                }
            }
        }
    });
}

/// The ray of each pixel, computed independently of the renderer, so that its errors show.
pub(super) struct PixelRays {
    pub(super) eye: Vec3A,
    /// Through the centre of the first pixel, scaled to a depth of one.
    first: Vec3A,
    /// The width of a pixel at a depth of one.
    pub(super) pixel: f32,
    /// From one pixel to the next, to the right and down.
    steps: [Vec3A; 2],
}

impl PixelRays {
    pub(super) fn new(camera: &Camera, width: usize, height: usize) -> Self {
        let turn =
            glam::Quat::from_rotation_y(camera.yaw) * glam::Quat::from_rotation_x(camera.pitch);
        let [right, up, forward] =
            [Vec3::X, Vec3::Y, -Vec3::Z].map(|axis| Vec3A::from(turn * axis));
        let pixel = 2.0 * (camera.fov_y * 0.5).tan() / height as f32;
        let steps = [right * pixel, -up * pixel];
        let back = [width, height].map(|side| (side as f32 - 1.0) * 0.5);
        let first = forward - steps[0] * back[0] - steps[1] * back[1];
        Self { eye: camera.eye.into(), first, pixel, steps }
    }

    pub(super) fn ray(&self, x: usize, y: usize) -> Vec3A {
        self.first + self.steps[0] * x as f32 + self.steps[1] * y as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor 2 m below the eye, and above its far edge, ahead, a wall 5 m away.
    fn mesh() -> Mesh {
        let corner = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
        Mesh {
            positions: vec![
                corner(-99.0, -2.0, -5.0),
                corner(99.0, -2.0, -5.0),
                corner(99.0, -2.0, 99.0),
                corner(-99.0, -2.0, 99.0),
                corner(99.0, 3.0, -5.0),
                corner(-99.0, 3.0, -5.0),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3], [0, 1, 4], [0, 4, 5]],
        }
    }

    #[test]
    fn depths_are_measured_along_the_cameras_direction() {
        let rays = RayCaster::new(&mesh()).unwrap();
        let (width, height) = (61, 41);
        let camera = Camera { eye: Vec3::ZERO, yaw: 0.0, pitch: 0.0, fov_y: 1.6 };
        for tree in [BvhKind::Bvh2, BvhKind::Cwbvh] {
            let mut depth = vec![0.0; width * height];
            rays.trace(tree, &camera, width, &mut depth);
            for (y, row) in depth.chunks(width).enumerate() {
                let rise = (20.0 - y as f32) * 2.0 * 0.8f32.tan() / 41.0;
                let expected = if rise < -0.4 { 2.0 / -rise } else { 5.0 };
                let expected = if rise > 0.6 { f32::INFINITY } else { expected };
                let good = |t: &f32| *t == expected || (t - expected).abs() < 1e-4 * expected;
                assert!(row.iter().all(good), "{tree:?}, row {y}: {} {expected}", row[0]);
            }
        }
    }

    #[test]
    fn triangles_within_a_distance_are_found() {
        let rays = RayCaster::new(&mesh()).unwrap();
        let check = |point: [f32; 3], distance: f32| {
            assert!(rays.is_near(point.into(), distance * 1.01), "{point:?} within {distance}");
            assert!(!rays.is_near(point.into(), distance * 0.99), "{point:?} within {distance}");
        };
        check([7.0, 1.0, 0.0], 3.0);
        check([-31.0, 0.5, 40.0], 2.5);
        check([3.0, 7.0, -8.0], 5.0);
        check([102.0, 6.0, -1.0], 34f32.sqrt());
        check([102.0, -6.0, 50.0], 5.0);
        // Compare with points all over a triangle.
        let triangle = RtTriangle::new(Vec3A::ZERO, Vec3A::X * 2.0, Vec3A::new(0.5, 1.5, 0.3));
        for i in 0..300 {
            let point =
                Vec3A::new((i % 7) as f32 - 3.0, (i % 11) as f32 - 5.0, (i % 13) as f32 - 6.0);
            let points = (0..=40).flat_map(|u| (0..=40 - u).map(move |v| [u as f32, v as f32]));
            let distance = |[u, v]: [f32; 2]| {
                let on = triangle.v0 - triangle.e1 * (u / 40.0) + triangle.e2 * (v / 40.0);
                on.distance(point)
            };
            let naive = points.map(distance).fold(f32::INFINITY, f32::min);
            let found = nearest(&triangle, point).distance(point);
            assert!(found <= naive + 1e-4 && naive <= found + 0.06, "{point}: {found}, {naive}");
        }
    }

    #[test]
    fn no_triangles_make_no_ray_caster() {
        assert!(RayCaster::new(&Mesh::default()).is_none());
        assert_eq!(RayCaster::new(&mesh()).unwrap().triangles(), 4);
    }
}
