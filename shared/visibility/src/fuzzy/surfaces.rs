//! Surfaces: flat patches that share edges.

use glam::{DVec3, Vec3};
use rustc_hash::FxHashMap;

use super::facets::{self, PlanarFacet};
use sightline_world::{
    geometry::Aabb,
    tolerance::{NEAR_PLANE_M, ON_PLANE_F32_M},
};

/// It is not worth finding out of more patches whether they are convex.
const SELF_MAX: usize = 512;
/// Patches are tested by so many at once before each is, and so are these.
pub(super) const RUN: usize = 8;

/// Opaque surfaces that are made of patches, ready to be projected.
#[derive(Clone, Debug)]
pub struct Surfaces {
    corners: Vec<DVec3>,
    /// Of `corners`, patch by patch; that to the next is an edge.
    indices: Vec<u32>,
    patches: Vec<SurfacePatch>,
    facets: Vec<PlanarFacet>,
    /// Around each patch, around each run of [`RUN`] of these, and so on: up to a few in all.
    runs: Vec<Vec<Aabb>>,
    groups: Vec<PatchSurface>,
}

/// A surface.
#[derive(Clone, Debug)]
pub(super) struct PatchSurface {
    pub(super) bounds: Aabb,
    /// The first and the last of its facets.
    pub(super) facets: std::ops::Range<usize>,
}

#[derive(Clone, Debug)]
pub(super) struct SurfacePatch {
    start: u32,
    end: u32,
    /// Of unit length; zero when the patch has no area.
    pub(super) normal: DVec3,
    /// Of its plane along the normal, in metres.
    pub(super) offset: f64,
    pub(super) bounds: Aabb,
    /// What does not hide itself: patches of the same number that face the eyes.
    pub(super) kin: u32,
}

/// Why polygons are no patches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// A corner is not among those given, or is no number.
    #[error("patch {patch} has a corner that is not there, or is no number")]
    Corner {
        /// The number of the patch.
        patch: usize,
    },
    /// A polygon has at least three corners.
    #[error("patch {patch} has fewer than three corners")]
    Few {
        /// The number of the patch.
        patch: usize,
    },
    /// The corners are not in one plane, or do not go round a convex polygon.
    #[error("patch {patch} is not flat and convex: divide it into triangles")]
    Shape {
        /// The number of the patch.
        patch: usize,
    },
    /// There are more than 2^32 corners or edges.
    #[error("there are too many patches")]
    Many,
}

impl Surfaces {
    /// Takes polygons, each with the number of its surface and the indices of its corners in order.
    /// Corners in the same place count as one. Polygons without an area hide nothing.
    ///
    /// # Errors
    /// When a polygon is not flat and convex, or an index or a corner is of no use.
    pub fn new(corners: &[Vec3], polygons: &[(u32, Vec<u32>)]) -> Result<Self, SurfaceError> {
        let count: usize = polygons.iter().map(|(_, indices)| indices.len()).sum();
        if u32::try_from(count.max(corners.len())).is_err() {
            return Err(SurfaceError::Many);
        }
        let welded = weld(corners);
        let mut surfaces = Self {
            corners: corners.iter().map(|corner| corner.as_dvec3()).collect(),
            indices: Vec::with_capacity(count),
            patches: Vec::with_capacity(polygons.len()),
            facets: Vec::new(),
            runs: Vec::new(),
            groups: Vec::new(),
        };
        let mut kin = 0;
        for (patch, (_, indices)) in polygons.iter().enumerate() {
            let is_sound = |&i: &u32| corners.get(i as usize).is_some_and(|at| at.is_finite());
            if !indices.iter().all(is_sound) {
                return Err(SurfaceError::Corner { patch });
            }
            surfaces.add(patch, indices.iter().map(|i| welded[*i as usize]))?;
        }
        for patches in by_surface(polygons) {
            let start = surfaces.facets.len();
            facets::find(&mut surfaces, &patches);
            let around =
                |all: Aabb, patch: &u32| all.union(&surfaces.patch(*patch as usize).bounds);
            let bounds = patches.iter().fold(Aabb::EMPTY, around);
            surfaces.groups.push(PatchSurface { bounds, facets: start..surfaces.facets.len() });
            surfaces.find_kin(&patches, &mut kin);
        }
        let mut level: Vec<Aabb> = surfaces.patches.iter().map(|patch| patch.bounds).collect();
        while level.len() > RUN {
            let around = |run: &[Aabb]| run.iter().fold(Aabb::EMPTY, |all, one| all.union(one));
            let next = level.chunks(RUN).map(around).collect();
            surfaces.runs.push(std::mem::replace(&mut level, next));
        }
        surfaces.runs.push(level);
        Ok(surfaces)
    }

    /// How many patches there are.
    pub fn len(&self) -> usize {
        self.patches.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.patches.is_empty()
    }

    /// The surfaces.
    pub(super) fn groups(&self) -> &[PatchSurface] {
        &self.groups
    }

    pub(super) fn patch(&self, patch: usize) -> &SurfacePatch {
        &self.patches[patch]
    }

    /// Boxes around each patch, around each run of [`RUN`] of these, and so on.
    pub(super) fn runs(&self) -> &[Vec<Aabb>] {
        &self.runs
    }

    /// The corners of a patch, in order.
    pub(super) fn corners(&self, patch: usize) -> impl Iterator<Item = DVec3> + Clone + '_ {
        self.edges(patch).map(|edge| self.corners[self.indices[edge] as usize])
    }

    /// The edges of a patch: each from a corner to the next.
    pub(super) fn edges(&self, patch: usize) -> std::ops::Range<usize> {
        self.patches[patch].start as usize..self.patches[patch].end as usize
    }

    /// The numbers of an edge's corners.
    pub(super) fn ends(&self, patch: usize, edge: usize) -> [u32; 2] {
        let edges = self.edges(patch);
        let next = if edge + 1 == edges.end { edges.start } else { edge + 1 };
        [edge, next].map(|at| self.indices[at])
    }

    pub(super) fn corner(&self, corner: u32) -> DVec3 {
        self.corners[corner as usize]
    }

    pub(super) fn facet(&self, facet: usize) -> &PlanarFacet {
        &self.facets[facet]
    }

    pub(super) fn facets(&self) -> usize {
        self.facets.len()
    }

    pub(super) fn push(&mut self, facet: PlanarFacet) {
        self.facets.push(facet);
    }

    /// On which side of a patch's plane all eyes are.
    pub(super) fn side(&self, patch: usize, eyes: &[DVec3; 8]) -> i8 {
        let SurfacePatch { normal, offset, .. } = self.patches[patch];
        side(normal, offset, eyes)
    }

    fn add(
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
        self.patches.push(SurfacePatch { start, end, normal, offset, bounds, kin: 0 });
        Ok(())
    }

    /// Numbers what does not hide itself: a surface that is convex, seen from outside or inside, as
    /// a whole; of others what lies in one plane.
    fn find_kin(&mut self, patches: &[u32], kin: &mut u32) {
        let mut planes: FxHashMap<[i64; 4], u32> = FxHashMap::default();
        let is_one = self.does_not_hide_itself(patches);
        for &patch in patches {
            let SurfacePatch { normal, offset, .. } = self.patches[patch as usize];
            let key = normal.extend(offset).to_array().map(|part| (part * 1e4).round() as i64);
            let number = *planes.entry(if is_one { [0; 4] } else { key }).or_insert_with(|| {
                *kin += 1;
                *kin - 1
            });
            self.patches[patch as usize].kin = number;
        }
    }

    /// Whether all corners of some patches lie on the same side of all of their planes, and nothing
    /// turns over.
    fn does_not_hide_itself(&self, patches: &[u32]) -> bool {
        if patches.len() > SELF_MAX {
            return false;
        }
        let corners: Vec<DVec3> =
            patches.iter().flat_map(|patch| self.corners(*patch as usize)).collect();
        [1.0, -1.0].into_iter().any(|side| {
            patches.iter().all(|patch| {
                let SurfacePatch { normal, offset, .. } = &self.patches[*patch as usize];
                corners.iter().all(|corner| side * (normal.dot(*corner) - offset) <= ON_PLANE_F32_M)
            })
        })
    }
}

/// On which side of a plane all eyes are: 1 where its normal points, -1 on the other, 0 when they are
/// on both, or too near.
pub(super) fn side(normal: DVec3, offset: f64, eyes: &[DVec3; 8]) -> i8 {
    // The first corner and the last are opposite ones.
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

/// The patches of each surface, ascending.
fn by_surface(polygons: &[(u32, Vec<u32>)]) -> Vec<Vec<u32>> {
    let mut places: FxHashMap<u32, usize> = FxHashMap::default();
    let mut found: Vec<Vec<u32>> = Vec::new();
    for ((surface, _), patch) in polygons.iter().zip(0..) {
        let place = *places.entry(*surface).or_insert_with(|| {
            found.push(Vec::new());
            found.len() - 1
        });
        found[place].push(patch);
    }
    found
}

/// For each corner the first in the same place.
fn weld(corners: &[Vec3]) -> Vec<u32> {
    let mut first: FxHashMap<[u32; 3], u32> = FxHashMap::default();
    let key = |corner: &Vec3| corner.to_array().map(|part| (part + 0.0).to_bits());
    (0..).zip(corners).map(|(i, corner)| *first.entry(key(corner)).or_insert(i)).collect()
}

/// Whether corners go round a flat, convex polygon.
fn is_convex(corners: &[DVec3], normal: DVec3, offset: f64) -> bool {
    let count = corners.len();
    let is_flat =
        corners.iter().all(|corner| (normal.dot(*corner) - offset).abs() <= ON_PLANE_F32_M);
    let ahead = |i: usize| corners[(i + 1) % count] - corners[i];
    // All corners lie to the left of all edges; a star would not.
    is_flat
        && (0..count).all(|i| {
            let left = normal.cross(ahead(i)).normalize_or_zero();
            corners.iter().all(|corner| left.dot(*corner - corners[i]) >= -ON_PLANE_F32_M)
        })
}
