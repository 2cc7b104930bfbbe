//! The oracle: visibility by rays against the original triangles.
//!
//! It knows nothing of cells, portals or the PVS, so it can prove them wrong. An [`Oracle`] is made
//! from the [`Mesh`] of a world. It says whether two points see each other, whether some sampled
//! point of a box is in sight, and how far a ray goes. Rays are in single precision: a miss that it
//! reports near an edge must be confirmed in double precision.
//!
//! ```
//! use glam::Vec3;
//! use sightline_oracle::Oracle;
//! use sightline_world::Mesh;
//!
//! let wall = Mesh {
//!     positions: vec![Vec3::new(-9.0, 0.0, 0.0), Vec3::new(9.0, 0.0, 0.0), Vec3::new(0.0, 9.0, 0.0)],
//!     triangles: vec![[0, 1, 2]],
//! };
//! let oracle = Oracle::new(&wall);
//! let (before, behind) = (Vec3::new(0.0, 1.6, 4.0), Vec3::new(0.0, 1.6, -4.0));
//! assert!(!oracle.between(before, behind), "the wall is between them");
//! assert!(oracle.between(before, before + Vec3::X));
//! let distance = oracle.distance(before, Vec3::NEG_Z).expect("the wall is ahead");
//! assert!((distance - 4.0).abs() < 1e-5);
//! ```

use std::time::Duration;

use glam::Vec3;
use obvhs::{
    BvhBuildParams,
    bvh2::{Bvh2, builder::build_bvh2_from_tris},
    ray::Ray,
    triangle::Triangle,
};
use sightline_world::{
    Mesh,
    geometry::Aabb,
    tolerance::{BESIDE_RAY_M, POINT_M2},
};

/// The opaque triangles of a building in a bounding volume hierarchy.
pub struct Oracle {
    bvh: Bvh2,
    triangles: Vec<Triangle>,
}

/// Where a ray meets a triangle first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The distance, in metres.
    pub distance: f32,
    /// The triangle, as an index into the triangles of the mesh.
    pub triangle: u32,
    /// Whether the ray meets the front of the triangle, where its corners run anticlockwise.
    pub is_front: bool,
}

impl Oracle {
    /// Builds the hierarchy over a mesh.
    pub fn new(mesh: &Mesh) -> Self {
        let triangle = |[a, b, c]: [Vec3; 3]| Triangle { v0: a.into(), v1: b.into(), v2: c.into() };
        let triangles: Vec<Triangle> = mesh.corners().map(triangle).collect();
        let bvh = build_bvh2_from_tris(
            &triangles,
            BvhBuildParams::medium_build(),
            &mut Duration::default(),
        );
        assert!(bvh.primitive_indices.len() >= triangles.len(), "a triangle is missing");
        Self { bvh, triangles }
    }

    /// Whether two points see each other: no triangle meets the open segment between them.
    pub fn between(&self, from: Vec3, to: Vec3) -> bool {
        debug_assert!(from.is_finite() && to.is_finite(), "no segment from {from} to {to}");
        let along = to - from;
        if along.length_squared() < POINT_M2 {
            return true;
        }
        if self.blocked(from, along) {
            return false;
        }
        let (u, v) = along.normalize().any_orthonormal_pair();
        [u, -u, v, -v].into_iter().all(|beside| !self.blocked(from + beside * BESIDE_RAY_M, along))
    }

    /// Whether some sampled point of a box is in sight of an eye. The samples form a regular grid,
    /// `samples` along each axis (at least two), corners included.
    pub fn of_box(&self, eye: Vec3, target: &Aabb, samples: u32) -> bool {
        box_samples(target, samples).any(|point| self.between(eye, point))
    }

    /// The distance to the first triangle along a direction of unit length, in metres. `None` when
    /// there is none.
    pub fn distance(&self, from: Vec3, direction: Vec3) -> Option<f32> {
        debug_assert!(direction.is_normalized(), "{direction} is not of unit length");
        let ray = Ray::new_inf(from.into(), direction.into());
        let mut hit = obvhs::ray::RayHit::none();
        self.bvh
            .ray_traverse(ray, &mut hit, |ray, id| self.triangle(id).intersect(ray))
            .then_some(hit.t)
    }

    /// The first triangle along a direction of unit length. `None` when there is none.
    pub fn first_hit(&self, from: Vec3, direction: Vec3) -> Option<Hit> {
        debug_assert!(direction.is_normalized(), "{direction} is not of unit length");
        let ray = Ray::new_inf(from.into(), direction.into());
        let mut hit = obvhs::ray::RayHit::none();
        self.bvh.ray_traverse(ray, &mut hit, |ray, id| self.triangle(id).intersect(ray)).then(
            || {
                let triangle = self.bvh.primitive_indices[hit.primitive_id as usize];
                let Triangle { v0, v1, v2 } = self.triangles[triangle as usize];
                let normal = Vec3::from((v1 - v0).cross(v2 - v0));
                Hit { distance: hit.t, triangle, is_front: normal.dot(direction) < 0.0 }
            },
        )
    }

    /// Whether a triangle meets the segment `along` from a point.
    fn blocked(&self, from: Vec3, along: Vec3) -> bool {
        let ray = Ray::new(from.into(), along.into(), 0.0, 1.0);
        !self.bvh.ray_traverse_miss(ray, |ray, id| self.triangle(id).intersect(ray))
    }

    /// The triangle at a place in the hierarchy.
    fn triangle(&self, id: usize) -> &Triangle {
        &self.triangles[self.bvh.primitive_indices[id] as usize]
    }
}

/// The points of a regular grid in a box, `samples` along each axis (at least two), corners
/// included.
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

    /// A square wall at z = 0 from (-1, -1) to (1, 1).
    fn wall() -> Oracle {
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
        let oracle = wall();
        let (near, far) = (Vec3::new(0.1, 0.2, 3.0), Vec3::new(-0.3, 0.1, -3.0));
        assert!(!oracle.between(near, far));
        assert!(!oracle.between(far, near));
        assert!(oracle.between(near, near + Vec3::X));
        assert!(oracle.between(near + Vec3::X * 2.0, far + Vec3::X * 2.0));
        assert!((oracle.distance(near, -Vec3::Z).unwrap() - 3.0).abs() < 1e-5);
        assert_eq!(oracle.distance(near, Vec3::Z), None);
    }

    #[test]
    fn a_hit_tells_the_triangle_and_its_side() {
        let oracle = wall();
        for (from, direction, is_front) in [(3.0, -Vec3::Z, true), (-3.0, Vec3::Z, false)] {
            for (x, y, triangle) in [(0.5, -0.5, 0), (-0.5, 0.5, 1)] {
                let hit = oracle.first_hit(Vec3::new(x, y, from), direction).unwrap();
                assert_eq!((hit.triangle, hit.is_front), (triangle, is_front));
                assert!((hit.distance - 3.0).abs() < 1e-5);
            }
        }
        assert_eq!(oracle.first_hit(Vec3::Z, Vec3::Z), None);
    }

    #[test]
    fn the_edge_between_two_triangles_lets_nothing_through() {
        let oracle = wall();
        for i in 0..10_000 {
            let t = i as f32 / 10_000.0 * 1.9 - 0.95;
            assert!(!oracle.between(Vec3::new(t, t, 1.0), Vec3::new(t, t, -1.0)));
        }
    }

    #[test]
    fn a_box_is_in_sight_when_one_of_its_corners_is() {
        let oracle = wall();
        let eye = Vec3::new(0.0, 0.0, 1.0);
        let behind = Aabb::around(Vec3::new(0.0, 0.0, -1.0), 0.5);
        assert!(!oracle.of_box(eye, &behind, 3));
        let out = Aabb::new(behind.min, behind.max + Vec3::X * 3.0);
        assert!(oracle.of_box(eye, &out, 3));
    }
}
