//! Rays from a point over one side of a surface, all at once.
//!
//! The rays of a point share their origin, so they go down the tree of triangles together: a box or
//! a triangle is tested against all of them in loops that the processor does several at a time.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3, Vec3A};
use obvhs::{
    BvhBuildParams,
    bvh2::{Bvh2, builder::build_bvh2_from_tris},
    ray::Ray,
    triangle::Triangle,
};
use sightline_world::tolerance::RAY_LIFT_M;

/// Surfaces farther away than this take no light, in metres.
const REACH: f32 = 1.6;
/// The number of rays from a point.
const RAYS: usize = 40;
/// Rays are tested in groups of this many. A group that meets nothing ends no test early.
const GROUP: usize = 8;
/// The direction towards the lamp.
const LAMP: Vec3 = Vec3::new(0.44, 0.78, 0.45);
/// How much more a ray straight towards the lamp counts.
const LAMP_SHARE: f32 = 0.45;
/// A point is inside something solid when more than this share of its rays meet backs of surfaces.
const BACKS_MAX: f32 = 0.3;
/// Barycentric weights may be this much below 0, so that no ray passes between two triangles.
const SLACK: f32 = 1.0e-5;
/// The least size of a part of a direction, so that its inverse is finite.
const PART_MIN: f32 = 1.0e-9;

/// One value for each ray.
type Rays = [f32; RAYS];

/// The surfaces that take light away.
pub(super) struct Shell {
    bvh: Option<Bvh2>,
    /// In the order of the tree's leaves.
    triangles: Vec<Triangle>,
    /// The directions of rays about the z axis.
    directions: [Vec3; RAYS],
}

/// The rays from any point of a plane, over one of its sides.
pub(super) struct Fan {
    normal: Vec3,
    /// The parts of the directions along x, y and z.
    along: [Rays; 3],
    inverse: [Rays; 3],
    weights: Rays,
    /// The sum of the weights.
    full: f32,
}

/// What the rays of a point meet.
struct Met {
    /// The distance of the first surface, or [`REACH`].
    distance: Rays,
    /// 1 where that surface shows its back, else 0.
    is_back: Rays,
    /// The greatest distance.
    farthest: f32,
}

impl Shell {
    pub(super) fn new(opaque: &[[Vec3; 3]]) -> Self {
        let triangle =
            |&[a, b, c]: &[Vec3; 3]| Triangle { v0: a.into(), v1: b.into(), v2: c.into() };
        let triangles: Vec<_> = opaque.iter().map(triangle).collect();
        let directions = std::array::from_fn(direction);
        if triangles.is_empty() {
            return Self { bvh: None, triangles, directions };
        }
        let bvh = build_bvh2_from_tris(
            &triangles,
            BvhBuildParams::medium_build(),
            &mut Default::default(),
        );
        let in_order = bvh.primitive_indices.iter().map(|&index| triangles[index as usize]);
        Self { triangles: in_order.collect(), bvh: Some(bvh), directions }
    }

    /// The rays over the side to which a unit normal points.
    pub(super) fn fan(&self, normal: Vec3) -> Fan {
        Fan::new(normal, &self.directions)
    }

    /// The share of light that reaches a point, from 0 to 1. None inside something solid.
    pub(super) fn openness(&self, at: Vec3, fan: &Fan) -> Option<f32> {
        let met = self.first(at + fan.normal * RAY_LIFT_M, fan);
        let backs: f32 = met.is_back.iter().sum();
        let open: f32 =
            met.distance.iter().zip(&fan.weights).map(|(t, weight)| t / REACH * weight).sum();
        (backs <= BACKS_MAX * RAYS as f32).then_some(open / fan.full)
    }

    /// Whether nothing lies between two points, each lifted off the surface.
    pub(super) fn is_clear(&self, from: Vec3, to: Vec3, normal: Vec3) -> bool {
        let Some(bvh) = &self.bvh else { return true };
        let Some((along, distance)) = (to - from).try_normalize().zip(Some(from.distance(to)))
        else {
            return true;
        };
        let from = from + normal * RAY_LIFT_M;
        let ray = Ray::new(from.into(), along.into(), 0.0, distance);
        bvh.ray_traverse_miss(ray, |ray, id| self.triangles[id].intersect(ray))
    }

    /// What the rays from a point meet first.
    fn first(&self, from: Vec3, fan: &Fan) -> Met {
        let mut met = Met { distance: [REACH; RAYS], is_back: [0.0; RAYS], farthest: REACH };
        let Some(bvh) = &self.bvh else { return met };
        let nodes = &bvh.nodes;
        let root = Bounds::new(nodes[0].aabb.min, nodes[0].aabb.max, from);
        let mut open = vec![(0u32, root)];
        while let Some((index, bounds)) = open.pop() {
            if bounds.nearest >= met.farthest || !fan.meets(&bounds, &met.distance) {
                continue;
            }
            let node = &nodes[index as usize];
            let first = node.first_index;
            if node.prim_count > 0 {
                for id in first..first + node.prim_count {
                    fan.meet(&self.triangles[id as usize], from, &mut met);
                }
                met.farthest = met.distance.iter().copied().fold(0.0, f32::max);
                continue;
            }
            let [a, b] = [first, first + 1].map(|index| {
                let node = &nodes[index as usize];
                (index, Bounds::new(node.aabb.min, node.aabb.max, from))
            });
            // The nearer one comes first, so that the farther one may be left out.
            open.extend(if a.1.nearest < b.1.nearest { [b, a] } else { [a, b] });
        }
        met
    }
}

/// A box, relative to the origin of rays.
struct Bounds {
    low: Vec3,
    high: Vec3,
    /// The distance of its nearest point.
    nearest: f32,
}

impl Bounds {
    fn new(min: Vec3A, max: Vec3A, from: Vec3) -> Self {
        let (low, high) = (Vec3::from(min) - from, Vec3::from(max) - from);
        Self { low, high, nearest: low.max(-high).max(Vec3::ZERO).length() }
    }
}

impl Fan {
    fn new(normal: Vec3, directions: &[Vec3; RAYS]) -> Self {
        let (u, v) = normal.any_orthonormal_pair();
        let mut fan = Self {
            normal,
            along: [[0.0; RAYS]; 3],
            inverse: [[0.0; RAYS]; 3],
            weights: [0.0; RAYS],
            full: 0.0,
        };
        for (i, direction) in directions.iter().enumerate() {
            let along = u * direction.x + v * direction.y + normal * direction.z;
            for axis in 0..3 {
                let part = along[axis];
                let part = if part.abs() < PART_MIN { PART_MIN } else { part };
                fan.along[axis][i] = part;
                fan.inverse[axis][i] = part.recip();
            }
            fan.weights[i] = 1.0 + LAMP_SHARE * along.dot(LAMP);
            fan.full += fan.weights[i];
        }
        fan
    }

    /// The unit normal of the side that the rays leave.
    pub(super) fn normal(&self) -> Vec3 {
        self.normal
    }

    /// How light a place in the open is, relative to one that half faces the lamp.
    pub(super) fn lamp(&self) -> f32 {
        1.0 + LAMP_SHARE * (self.normal.dot(LAMP) - 1.0) * 0.5
    }

    /// Whether a ray meets a box before it ends.
    fn meets(&self, bounds: &Bounds, ends: &Rays) -> bool {
        let Bounds { low, high, nearest } = bounds;
        let above = self.normal.max(Vec3::ZERO).dot(*high) + self.normal.min(Vec3::ZERO).dot(*low);
        if above < 0.0 || *nearest == 0.0 {
            return above >= 0.0;
        }
        let [x, y, z] = &self.inverse;
        (0..RAYS).step_by(GROUP).any(|group| {
            let mut any = false;
            for i in group..group + GROUP {
                let (ax, bx) = (low.x * x[i], high.x * x[i]);
                let (ay, by) = (low.y * y[i], high.y * y[i]);
                let (az, bz) = (low.z * z[i], high.z * z[i]);
                let enter = greater(greater(less(ax, bx), less(ay, by)), less(az, bz));
                let leave = less(less(greater(ax, bx), greater(ay, by)), greater(az, bz));
                any |= (enter <= leave) & (leave >= 0.0) & (enter < ends[i]);
            }
            any
        })
    }

    /// Notes where a triangle is the first that rays meet (Möller and Trumbore 1997).
    fn meet(&self, triangle: &Triangle, from: Vec3, met: &mut Met) {
        let from = Vec3A::from(from);
        let (to_b, to_c) = (triangle.v1 - triangle.v0, triangle.v2 - triangle.v0);
        let to_origin = from - triangle.v0;
        let normal = to_b.cross(to_c);
        let (over_b, over_c) = (to_c.cross(to_origin), to_origin.cross(to_b));
        let height = to_origin.dot(normal);
        let is_back = if height < 0.0 { 1.0 } else { 0.0 };
        let [x, y, z] = &self.along;
        for i in 0..RAYS {
            let dot = |part: Vec3A| part.x * x[i] + part.y * y[i] + part.z * z[i];
            let scale = -1.0 / dot(normal);
            let (b, c, distance) = (dot(over_b) * scale, dot(over_c) * scale, height * scale);
            let is_first = (b >= -SLACK)
                & (c >= -SLACK)
                & (b + c <= 1.0 + SLACK)
                & (distance >= 0.0)
                & (distance < met.distance[i]);
            met.distance[i] = if is_first { distance } else { met.distance[i] };
            met.is_back[i] = if is_first { is_back } else { met.is_back[i] };
        }
    }
}

/// The lesser of two numbers, in one instruction: neither is NaN.
fn less(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The greater of two numbers, in one instruction: neither is NaN.
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Directions about the z axis on a spiral, denser where light falls steeply.
fn direction(ray: usize) -> Vec3 {
    let golden = 0.618_034;
    let share = (ray as f32 + 0.5) / RAYS as f32;
    let flat = Vec2::from_angle((ray as f32 * golden).fract() * TAU) * share.sqrt();
    flat.extend((1.0 - share).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng, rngs::SmallRng};

    #[test]
    fn rays_together_meet_what_each_meets_alone() {
        let mut random = SmallRng::seed_from_u64(4);
        let mut point = |reach: f32| {
            Vec3::from_array(std::array::from_fn(|_| random.random_range(-reach..reach)))
        };
        let opaque: Vec<[Vec3; 3]> = (0..300)
            .map(|_| {
                let at = point(2.0);
                [at, at + point(0.5), at + point(0.5)]
            })
            .collect();
        let shell = Shell::new(&opaque);
        let bvh = shell.bvh.as_ref().expect("there are triangles");
        let mut hits = 0;
        for _ in 0..50 {
            let (from, fan) = (point(1.5), shell.fan(point(1.0).normalize()));
            let met = shell.first(from, &fan);
            for i in 0..RAYS {
                let along = Vec3A::from_array([0, 1, 2].map(|axis| fan.along[axis][i]));
                let mut hit = obvhs::ray::RayHit::none();
                let ray = Ray::new(from.into(), along, 0.0, REACH);
                bvh.ray_traverse(ray, &mut hit, |ray, id| shell.triangles[id].intersect(ray));
                assert!((met.distance[i] - hit.t.min(REACH)).abs() < 1.0e-4);
                hits += usize::from(hit.t < REACH);
            }
        }
        assert!(hits > 300, "{hits}");
    }
}
