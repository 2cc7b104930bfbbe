//! The oracle: rays against the original triangles.
//!
//! It knows nothing of cells, portals or the PVS, so that it can prove them wrong.

use std::time::Duration;

use glam::Vec3;
use obvhs::{
    BvhBuildParams,
    bvh2::{Bvh2, builder::build_bvh2_from_tris},
    ray::Ray,
    triangle::Triangle,
};
use sightline_world::{Mesh, geometry::Aabb, tolerance::BESIDE_RAY_M};

/// A building's opaque triangles, ready for rays.
pub struct Oracle {
    bvh: Bvh2,
    triangles: Vec<Triangle>,
}

impl Oracle {
    /// Prepares the triangles of a mesh.
    pub fn new(mesh: &Mesh) -> Self {
        let triangle = |[a, b, c]: [Vec3; 3]| Triangle { v0: a.into(), v1: b.into(), v2: c.into() };
        let triangles: Vec<Triangle> = mesh.corners().map(triangle).collect();
        let bvh = build_bvh2_from_tris(
            &triangles,
            BvhBuildParams::medium_build(),
            &mut Duration::default(),
        );
        Self { bvh, triangles }
    }

    /// Whether the open segment between two points meets no triangle.
    pub fn between(&self, from: Vec3, to: Vec3) -> bool {
        let along = to - from;
        if along.length_squared() < 1e-12 {
            return true;
        }
        if self.blocked(from, along) {
            return false;
        }
        let (u, v) = along.normalize().any_orthonormal_pair();
        [u, -u, v, -v].into_iter().all(|beside| !self.blocked(from + beside * BESIDE_RAY_M, along))
    }

    /// Whether some sampled point of a box is in sight of an eye: `samples` points a side on its
    /// three axes, corners included.
    pub fn of_box(&self, eye: Vec3, target: &Aabb, samples: u32) -> bool {
        box_samples(target, samples).any(|point| self.between(eye, point))
    }

    /// How far along a direction of unit length the first triangle is, in metres.
    pub fn distance(&self, from: Vec3, direction: Vec3) -> Option<f32> {
        let ray = Ray::new_inf(from.into(), direction.into());
        let mut hit = obvhs::ray::RayHit::none();
        self.bvh
            .ray_traverse(ray, &mut hit, |ray, id| self.triangle(id).intersect(ray))
            .then_some(hit.t)
    }

    fn blocked(&self, from: Vec3, along: Vec3) -> bool {
        let ray = Ray::new(from.into(), along.into(), 0.0, 1.0);
        !self.bvh.ray_traverse_miss(ray, |ray, id| self.triangle(id).intersect(ray))
    }

    fn triangle(&self, id: usize) -> &Triangle {
        &self.triangles[self.bvh.primitive_indices[id] as usize]
    }
}

/// Points of a box on a regular grid, `samples` a side (at least 2), corners included.
fn box_samples(target: &Aabb, samples: u32) -> impl Iterator<Item = Vec3> + use<> {
    let samples = samples.max(2);
    let (min, size) = (target.min, target.size());
    (0..samples.pow(3)).map(move |i| {
        let step = Vec3::new(
            (i % samples) as f32,
            (i / samples % samples) as f32,
            (i / samples / samples) as f32,
        );
        min + size * (step / (samples - 1) as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall() -> Oracle {
        // A square at z = 0 from (-1, -1) to (1, 1).
        Oracle::new(&Mesh {
            positions: vec![
                Vec3::new(-1.0, -1.0, 0.0),
                Vec3::new(1.0, -1.0, 0.0),
                Vec3::new(1.0, 1.0, 0.0),
                Vec3::new(-1.0, 1.0, 0.0),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        })
    }

    #[test]
    fn a_wall_blocks_from_both_sides_and_only_where_it_is() {
        let sight = wall();
        let (near, far) = (Vec3::new(0.1, 0.2, 3.0), Vec3::new(-0.3, 0.1, -3.0));
        assert!(!sight.between(near, far));
        assert!(!sight.between(far, near));
        assert!(sight.between(near, near + Vec3::X));
        assert!(sight.between(near + Vec3::X * 2.0, far + Vec3::X * 2.0));
        assert!((sight.distance(near, -Vec3::Z).unwrap() - 3.0).abs() < 1e-5);
        assert_eq!(sight.distance(near, Vec3::Z), None);
    }

    #[test]
    fn the_edge_between_two_triangles_lets_nothing_through() {
        let sight = wall();
        for i in 0..10_000 {
            let t = i as f32 / 10_000.0 * 1.9 - 0.95;
            assert!(!sight.between(Vec3::new(t, t, 1.0), Vec3::new(t, t, -1.0)));
        }
    }

    #[test]
    fn a_box_is_in_sight_when_a_corner_sticks_out() {
        let sight = wall();
        let eye = Vec3::new(0.0, 0.0, 1.0);
        let behind = Aabb::around(Vec3::new(0.0, 0.0, -1.0), 0.5);
        assert!(!sight.of_box(eye, &behind, 3));
        let out = Aabb::new(behind.min, behind.max + Vec3::X * 3.0);
        assert!(sight.of_box(eye, &out, 3));
    }
}
