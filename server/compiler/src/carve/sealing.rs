//! Whether a cap certainly lies inside a solid.
//!
//! The surfaces of a model that are closed 2-manifolds give every point a winding number: how often
//! they go around it. It is at least 1 inside a solid and 0 outside, also where a solid has a
//! cavity or solids overlap. It changes only where such a surface is crossed. So a line of sight
//! between two points outside all solids, through a point with a positive winding number, crosses
//! such a surface on the way. It was blocked before anything was carved.
//!
//! A cap is sealed when the winding number is positive just behind it, at one point of each convex
//! part, and no closed surface crosses that part. Then the number is positive everywhere on it.

use std::{cell::OnceCell, collections::HashSet, time::Duration};

use glam::{DVec3, Vec3A};
use obvhs::{
    BvhBuildParams,
    aabb::Aabb,
    bvh2::{Bvh2, builder::build_bvh2_from_tris},
    ray::Ray,
};

use super::{
    polygons::Polygons,
    union::Union,
    volume::{Triangle, Volume},
};

/// The directions of rays, along no axis and no symmetry. Both must find the point inside.
const DIRECTIONS: [DVec3; 2] =
    [DVec3::new(0.309_61, 0.871_37, 0.380_93), DVec3::new(-0.713_1, 0.218_9, 0.666_01)];
/// Points are tested this many tolerances behind a cap.
const BEHIND: f64 = 4.0;

/// The closed surfaces of a model.
pub(super) struct Sealing<'a> {
    triangles: &'a [Triangle],
    polygons: &'a Polygons,
    /// Whether each polygon belongs to a closed surface.
    is_closed: Vec<bool>,
    /// Made when first needed: few models have a closed surface that is carved.
    index: OnceCell<Index>,
}

/// A BVH of the closed surfaces.
struct Index {
    /// The triangles of closed surfaces, each with its polygon.
    members: Vec<(u32, u32)>,
    bvh: Bvh2,
}

impl<'a> Sealing<'a> {
    pub(super) fn new(triangles: &'a [Triangle], polygons: &'a Polygons) -> Self {
        let is_closed = closed(polygons);
        Self { triangles, polygons, is_closed, index: OnceCell::new() }
    }

    /// Whether a polygon belongs to a closed surface: every edge is used once in each direction.
    pub(super) fn is_closed(&self, polygon: u32) -> bool {
        self.is_closed[polygon as usize]
    }

    /// Whether the parts of a cap lie inside a solid. `cut` are the polygons that the volume cut.
    pub(super) fn holds(&self, parts: &[Triangle], normal: DVec3, cut: &HashSet<u32>) -> bool {
        let behind = normal * -BEHIND * self.polygons.tolerance.plane;
        parts.iter().all(|part| {
            let centre = part.iter().sum::<DVec3>() / 3.0 + behind;
            DIRECTIONS.iter().all(|&towards| self.winding(centre, towards) > 0)
                && !self.is_crossed(part, normal, cut)
        })
    }

    /// The winding number of the closed surfaces about a point, by a ray.
    fn winding(&self, from: DVec3, towards: DVec3) -> i32 {
        let index = self.index();
        let ray = Ray::new_inf(Vec3A::from(from.as_vec3()), Vec3A::from(towards.as_vec3()));
        let mut number = 0;
        index.bvh.ray_traverse_anyhit(ray, |_, id| {
            let (triangle, _) = index.members[index.bvh.primitive_indices[id] as usize];
            number += crossing(&self.triangles[triangle as usize], from, towards);
        });
        number
    }

    /// Whether a closed surface enters the box around a part. Polygons that were cut do not count:
    /// they end at the edges of the part, or lie in its plane and are replaced by it.
    fn is_crossed(&self, part: &Triangle, normal: DVec3, cut: &HashSet<u32>) -> bool {
        let near = self.polygons.tolerance.plane;
        let grow = DVec3::splat(-2.0 * near) + normal.abs() * 3.0 * near;
        let [a, b, c] = *part;
        let (min, max) = (a.min(b).min(c) - grow, a.max(b).max(c) + grow);
        if min.cmpgt(max).any() {
            return false;
        }
        let volume = Volume { min, max, near: 0.0 };
        let index = self.index();
        let bounds = Aabb::new(
            Vec3A::from(min.as_vec3()) - near as f32,
            Vec3A::from(max.as_vec3()) + near as f32,
        );
        let mut is_crossed = false;
        index.bvh.aabb_traverse(bounds, |bvh, node| {
            let node = &bvh.nodes[node as usize];
            for id in node.first_index..node.first_index + node.prim_count {
                let (triangle, polygon) =
                    index.members[bvh.primitive_indices[id as usize] as usize];
                if !cut.contains(&polygon) {
                    let (mut outside, mut inside) = (Vec::new(), Vec::new());
                    let triangle = &self.triangles[triangle as usize];
                    volume.split(triangle, &mut outside, &mut inside);
                    is_crossed |= !inside.is_empty();
                }
            }
            !is_crossed
        });
        is_crossed
    }

    fn index(&self) -> &Index {
        self.index.get_or_init(|| {
            let of = |polygon: u32| {
                let triangles = &self.polygons.triangles[polygon as usize];
                triangles.iter().map(move |&triangle| (triangle, polygon))
            };
            let closed = (0..self.polygons.len() as u32).filter(|&p| self.is_closed(p));
            let members: Vec<(u32, u32)> = closed.flat_map(of).collect();
            let flat = |&(triangle, _): &(u32, u32)| {
                let [v0, v1, v2] =
                    self.triangles[triangle as usize].map(|p| Vec3A::from(p.as_vec3()));
                obvhs::triangle::Triangle { v0, v1, v2 }
            };
            let triangles: Vec<_> = members.iter().map(flat).collect();
            let params = BvhBuildParams::medium_build();
            let bvh = build_bvh2_from_tris(&triangles, params, &mut Duration::default());
            Index { members, bvh }
        })
    }
}

/// 1 when a ray leaves through the front of a triangle, -1 when it enters, 0 when it misses.
fn crossing(triangle: &Triangle, from: DVec3, towards: DVec3) -> i32 {
    let [a, b, c] = triangle.map(|p| p - from);
    let signs = [(a, b), (b, c), (c, a)].map(|(p, q)| towards.dot(p.cross(q)));
    let is_ahead = |facing: f64| a.dot((b - a).cross(c - a)) * facing > 0.0;
    if signs.iter().all(|&s| s > 0.0) && is_ahead(1.0) {
        1
    } else if signs.iter().all(|&s| s < 0.0) && is_ahead(-1.0) {
        -1
    } else {
        0
    }
}

/// Whether each polygon belongs to a closed surface.
fn closed(polygons: &Polygons) -> Vec<bool> {
    let mut surfaces = Union::new(polygons.len());
    for edge in polygons.edges() {
        edge.windows(2).for_each(|pair| surfaces.join(pair[0].polygon, pair[1].polygon));
    }
    let mut is_closed = vec![true; polygons.len()];
    for edge in polygons.edges() {
        let is_shared =
            edge.len() == 2 && edge[0].sense + edge[1].sense == 0 && edge[0].sense.abs() == 1;
        if !is_shared {
            is_closed[surfaces.root(edge[0].polygon) as usize] = false;
        }
    }
    (0..polygons.len() as u32).map(|polygon| is_closed[surfaces.root(polygon) as usize]).collect()
}
