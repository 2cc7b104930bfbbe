//! Patches: flat, convex polygons that share corners.

use std::ops::Range;

use glam::{DVec3, Vec3};
use rustc_hash::FxHashMap;
use sightline_world::{
    geometry::Aabb,
    tolerance::{NEAR_PLANE_M, ON_PLANE_F32_M},
};

/// Patches, in the order in which they were added.
#[derive(Clone, Debug, Default)]
pub(super) struct PatchMesh {
    pub(super) corners: Vec<DVec3>,
    /// The corners of all patches, patch by patch, as indices. Each begins an edge.
    pub(super) indices: Vec<u32>,
    pub(super) patches: Vec<SurfacePatch>,
}

/// A flat, convex polygon of a surface.
#[derive(Clone, Debug)]
pub(super) struct SurfacePatch {
    /// The first of its edges.
    start: u32,
    /// The end of its edges.
    end: u32,
    /// The unit normal; zero if the patch has no area.
    pub(super) normal: DVec3,
    /// The distance of its plane from the origin along the normal, in metres.
    pub(super) offset: f64,
    pub(super) bounds: Aabb,
    /// The number of a group of patches. Patches of one group that face the eyes do not hide each
    /// other.
    pub(super) group: u32,
}

/// Why polygons cannot be the patches of surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// A corner is not in the list of corners, or is not finite.
    #[error("patch {patch} has a corner that is missing or not finite")]
    Corner {
        /// The number of the patch.
        patch: usize,
    },
    /// A polygon has fewer than three corners.
    #[error("patch {patch} has fewer than three corners")]
    Few {
        /// The number of the patch.
        patch: usize,
    },
    /// The corners are not in one plane, or do not form a convex polygon in their order.
    #[error("patch {patch} is not flat and convex: divide it into triangles")]
    Shape {
        /// The number of the patch.
        patch: usize,
    },
    /// There are more than 2^32 corners or edges.
    #[error("there are too many patches")]
    Many,
}

impl PatchMesh {
    pub(super) fn patch(&self, patch: usize) -> &SurfacePatch {
        &self.patches[patch]
    }

    /// The corners of a patch, in order.
    pub(super) fn corners(&self, patch: usize) -> impl Iterator<Item = DVec3> + Clone + '_ {
        self.edges(patch).map(|edge| self.corners[self.indices[edge] as usize])
    }

    /// The edges of a patch. Each leads from a corner to the next.
    pub(super) fn edges(&self, patch: usize) -> Range<usize> {
        self.patches[patch].start as usize..self.patches[patch].end as usize
    }

    /// The two corners of an edge, as indices.
    pub(super) fn ends(&self, patch: usize, edge: usize) -> [u32; 2] {
        let edges = self.edges(patch);
        let next = if edge + 1 == edges.end { edges.start } else { edge + 1 };
        [edge, next].map(|at| self.indices[at])
    }

    /// The place of a corner.
    pub(super) fn corner(&self, corner: u32) -> DVec3 {
        self.corners[corner as usize]
    }

    /// On which side of a patch's plane all eyes are, as in [`side`].
    pub(super) fn side(&self, patch: usize, eyes: &[DVec3; 8]) -> i8 {
        let SurfacePatch { normal, offset, .. } = self.patches[patch];
        side(normal, offset, eyes)
    }

    /// Adds a patch with the given number.
    pub(super) fn add(
        &mut self,
        patch: usize,
        indices: impl Iterator<Item = u32>,
    ) -> Result<(), SurfaceError> {
        let start = self.indices.len();
        self.indices.extend(indices);
        let corners: Vec<DVec3> =
            self.indices[start..].iter().map(|i| self.corners[*i as usize]).collect();
        if corners.len() < 3 {
            return Err(SurfaceError::Few { patch });
        }
        let sum: DVec3 = (0..corners.len())
            .map(|i| (corners[i] - corners[0]).cross(corners[(i + 1) % corners.len()] - corners[0]))
            .sum();
        let normal = sum.normalize_or_zero();
        let offset = corners.iter().map(|corner| normal.dot(*corner)).sum::<f64>();
        let offset = offset / corners.len() as f64;
        if normal != DVec3::ZERO && !is_convex(&corners, normal, offset) {
            return Err(SurfaceError::Shape { patch });
        }
        let bounds = Aabb::from_points(corners.iter().map(|corner| corner.as_vec3()));
        let (start, end) = (start as u32, self.indices.len() as u32);
        self.patches.push(SurfacePatch { start, end, normal, offset, bounds, group: 0 });
        Ok(())
    }
}

/// On which side of a plane all eyes are: 1 where the normal points, -1 on the other side, and 0 if
/// eyes are on both sides or too near. `eyes` are the corners of the box of eyes.
pub(super) fn side(normal: DVec3, offset: f64, eyes: &[DVec3; 8]) -> i8 {
    // The first corner and the last are opposite each other.
    let middle = normal.dot(eyes[0] + eyes[7]) * 0.5 - offset;
    let reach = normal.abs().dot(eyes[7] - eyes[0]) * 0.5;
    if middle - reach > NEAR_PLANE_M {
        1
    } else if middle + reach < -NEAR_PLANE_M {
        -1
    } else {
        0
    }
}

/// For each corner the first one at the same place.
pub(super) fn weld(corners: &[Vec3]) -> Vec<u32> {
    let mut first: FxHashMap<[u32; 3], u32> = FxHashMap::default();
    let key = |corner: &Vec3| corner.to_array().map(|part| (part + 0.0).to_bits());
    (0..).zip(corners).map(|(i, corner)| *first.entry(key(corner)).or_insert(i)).collect()
}

/// Whether corners form a flat, convex polygon in their order.
fn is_convex(corners: &[DVec3], normal: DVec3, offset: f64) -> bool {
    let count = corners.len();
    let is_flat =
        corners.iter().all(|corner| (normal.dot(*corner) - offset).abs() <= ON_PLANE_F32_M);
    let ahead = |i: usize| corners[(i + 1) % count] - corners[i];
    // All corners lie to the left of all edges. Those of a star do not.
    is_flat
        && (0..count).all(|i| {
            let left = normal.cross(ahead(i)).normalize_or_zero();
            corners.iter().all(|corner| left.dot(*corner - corners[i]) >= -ON_PLANE_F32_M)
        })
}
