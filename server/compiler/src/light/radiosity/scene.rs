//! What light meets: opaque triangles, and glass that tints it.

use glam::{Vec3, Vec3A};
use obvhs::{
    BvhBuildParams,
    bvh2::{Bvh2, builder::build_bvh2_from_tris},
    ray::{Ray, RayHit},
    triangle::Triangle,
};
use sightline_world::tolerance::RAY_LIFT_M;

use super::super::NO_PATCH;
use crate::{model::Surface, palette::reflectance};

/// One face of a pane lets through its linear colour to this power …
const PANE_POWER: f32 = 0.35;
/// … and no more than this share.
const PANE_CLEAR: f32 = 0.96;

/// See [`Met::before`], in metres: places in the seams of surfaces see nothing.
const BEFORE_M: f32 = 0.01;

/// All surfaces, as rays meet them.
pub(super) struct Scene {
    opaque: Option<Bvh2>,
    /// In the order of the tree's leaves, as are the patches.
    triangles: Vec<Triangle>,
    patches: Vec<u32>,
    glass: Option<Glass>,
}

/// The faces of panes.
struct Glass {
    bvh: Bvh2,
    triangles: Vec<Triangle>,
    /// How much each face lets through.
    tints: Vec<Vec3>,
}

/// What a ray meets first.
pub(super) struct Met {
    pub(super) at: Vec3,
    /// A place on the ray just before that.
    pub(super) before: Vec3,
    pub(super) distance: f32,
    /// The patch, or [`NO_PATCH`].
    pub(super) patch: usize,
    /// The unit normal of the triangle on the side that the ray meets.
    pub(super) normal: Vec3,
}

/// The end of a ray.
pub(super) struct RayEnd {
    /// How much light comes along the ray: less than one behind glass.
    pub(super) tint: Vec3,
    /// What it meets. None in the sky.
    pub(super) met: Option<Met>,
}

impl Scene {
    /// The scene of some surfaces. `of_triangle` has the patch of each triangle of each surface.
    pub(super) fn new(surfaces: &[Surface], of_triangle: &[Vec<u32>]) -> Self {
        let (mut opaque, mut patches) = (Vec::new(), Vec::new());
        let (mut panes, mut tints) = (Vec::new(), Vec::new());
        for (surface, of_triangle) in surfaces.iter().zip(of_triangle) {
            if surface.material.is_unseen() {
                continue;
            }
            let tint = reflectance(&surface.material).powf(PANE_POWER);
            let tint = tint.min(Vec3::splat(PANE_CLEAR));
            for (triangle, patch) in of_triangle.iter().enumerate() {
                let Some([a, b, c]) = surface.corners_of(triangle) else { continue };
                if *patch == NO_PATCH {
                    continue;
                }
                let triangle = Triangle { v0: a.into(), v1: b.into(), v2: c.into() };
                if surface.material.glass {
                    panes.push(triangle);
                    tints.push(tint);
                } else {
                    opaque.push(triangle);
                    patches.push(*patch);
                }
            }
        }
        let glass = tree(&panes).map(|bvh| {
            let order = |list: &[Vec3]| in_order(&bvh, list);
            let (tints, triangles) = (order(&tints), in_order(&bvh, &panes));
            Glass { tints, triangles, bvh }
        });
        let bvh = tree(&opaque);
        let (triangles, patches) = match &bvh {
            Some(bvh) => (in_order(bvh, &opaque), in_order(bvh, &patches)),
            None => (Vec::new(), Vec::new()),
        };
        Self { opaque: bvh, triangles, patches, glass }
    }

    /// Follows a ray from a point in a direction of unit length.
    pub(super) fn trace(&self, from: Vec3, along: Vec3) -> RayEnd {
        let met = self.opaque.as_ref().and_then(|bvh| {
            let ray = Ray::new_inf(from.into(), along.into());
            let mut hit = RayHit::none();
            let triangles = &self.triangles;
            bvh.ray_traverse(ray, &mut hit, |ray, id| triangles[id].intersect(ray)).then(|| {
                let Triangle { v0, v1, v2 } = triangles[hit.primitive_id as usize];
                let normal = Vec3::from((v1 - v0).cross(v2 - v0)).normalize_or(-along);
                Met {
                    at: from + along * hit.t,
                    before: from + along * (hit.t - BEFORE_M.min(hit.t * 0.5)),
                    distance: hit.t,
                    patch: self.patches[hit.primitive_id as usize] as usize,
                    normal: if normal.dot(along) > 0.0 { -normal } else { normal },
                }
            })
        });
        let until = met.as_ref().map_or(f32::INFINITY, |met| met.distance);
        RayEnd { tint: self.tint(from, along, until), met }
    }

    /// How much of the light of one point gets to another: nothing, when a surface lies between.
    pub(super) fn between(&self, from: Vec3, to: Vec3) -> Vec3 {
        let distance = from.distance(to);
        match (to - from).try_normalize() {
            Some(along) => self.arrives(from, along, distance - RAY_LIFT_M),
            None => Vec3::ONE,
        }
    }

    /// How much light gets to a point against a direction of unit length, from this far away.
    pub(super) fn arrives(&self, at: Vec3, along: Vec3, distance: f32) -> Vec3 {
        let is_open = self.opaque.as_ref().is_none_or(|bvh| {
            let ray = Ray::new(at.into(), along.into(), 0.0, distance);
            bvh.ray_traverse_miss(ray, |ray, id| self.triangles[id].intersect(ray))
        });
        if is_open { self.tint(at, along, distance) } else { Vec3::ZERO }
    }

    /// How much light the glass along a ray lets through.
    fn tint(&self, from: Vec3, along: Vec3, distance: f32) -> Vec3 {
        let Some(Glass { bvh, triangles, tints }) = &self.glass else { return Vec3::ONE };
        let ray = Ray::new(Vec3A::from(from), Vec3A::from(along), 0.0, distance);
        let mut met: Vec<usize> = Vec::new();
        bvh.ray_traverse_anyhit(ray, |ray, id| {
            if triangles[id].intersect(ray) < distance {
                met.push(id);
            }
        });
        // In one order, whatever the tree's.
        met.sort_unstable();
        met.dedup();
        met.into_iter().map(|id| tints[id]).product()
    }
}

fn tree(triangles: &[Triangle]) -> Option<Bvh2> {
    let params = BvhBuildParams::medium_build();
    (!triangles.is_empty())
        .then(|| build_bvh2_from_tris(triangles, params, &mut Default::default()))
}

/// A list in the order of a tree's leaves.
fn in_order<T: Copy>(bvh: &Bvh2, list: &[T]) -> Vec<T> {
    bvh.primitive_indices.iter().map(|&index| list[index as usize]).collect()
}
