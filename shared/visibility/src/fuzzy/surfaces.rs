//! Surfaces: patches that share edges, prepared for projection.

use std::ops::Range;

use glam::{DVec3, Vec3};
use rustc_hash::FxHashMap;
use sightline_world::{geometry::Aabb, tolerance::ON_PLANE_F32_M};

use super::{
    facets::{self, PlanarFacet},
    patches::{PatchMesh, SurfaceError, SurfacePatch, weld},
};

/// The most patches of a surface that are tested for convexity, since the test takes time quadratic
/// in their number.
const CONVEX_PATCHES_MAX: usize = 512;
/// The number of patches, or of such runs, in one box of the next level.
pub(super) const RUN: usize = 8;

/// Opaque surfaces made of patches, prepared for projection.
#[derive(Clone, Debug)]
pub struct Surfaces {
    pub(super) mesh: PatchMesh,
    facets: Vec<PlanarFacet>,
    /// Boxes around each patch, around each run of [`RUN`] such boxes, and so on, up to a few in
    /// all.
    runs: Vec<Vec<Aabb>>,
    surfaces: Vec<PatchSurface>,
}

/// A surface.
#[derive(Clone, Debug)]
pub(super) struct PatchSurface {
    pub(super) bounds: Aabb,
    /// The indices of its facets.
    pub(super) facets: Range<usize>,
}

impl Surfaces {
    /// Surfaces of polygons. Each polygon has the number of its surface and the indices of its
    /// corners in order. Corners at the same place count as one. Polygons without an area hide
    /// nothing.
    ///
    /// # Errors
    /// A polygon is not flat and convex, or a corner of it is missing or not finite.
    pub fn new(corners: &[Vec3], polygons: &[(u32, Vec<u32>)]) -> Result<Self, SurfaceError> {
        let count: usize = polygons.iter().map(|(_, indices)| indices.len()).sum();
        if u32::try_from(count.max(corners.len())).is_err() {
            return Err(SurfaceError::Many);
        }
        let welded = weld(corners);
        let mut surfaces = Self {
            mesh: PatchMesh {
                corners: corners.iter().map(|corner| corner.as_dvec3()).collect(),
                indices: Vec::with_capacity(count),
                patches: Vec::with_capacity(polygons.len()),
            },
            facets: Vec::new(),
            runs: Vec::new(),
            surfaces: Vec::new(),
        };
        let mut group = 0;
        for (patch, (_, indices)) in polygons.iter().enumerate() {
            let is_sound = |&i: &u32| corners.get(i as usize).is_some_and(|at| at.is_finite());
            if !indices.iter().all(is_sound) {
                return Err(SurfaceError::Corner { patch });
            }
            surfaces.mesh.add(patch, indices.iter().map(|i| welded[*i as usize]))?;
        }
        for patches in by_surface(polygons) {
            let start = surfaces.facets.len();
            let found = facets::find(&surfaces.mesh, &patches, start);
            surfaces.facets.extend(found);
            let around =
                |all: Aabb, patch: &u32| all.union(&surfaces.mesh.patch(*patch as usize).bounds);
            let bounds = patches.iter().fold(Aabb::EMPTY, around);
            surfaces.surfaces.push(PatchSurface { bounds, facets: start..surfaces.facets.len() });
            surfaces.find_groups(&patches, &mut group);
        }
        let mut level: Vec<Aabb> = surfaces.mesh.patches.iter().map(|patch| patch.bounds).collect();
        while level.len() > RUN {
            let around = |run: &[Aabb]| run.iter().fold(Aabb::EMPTY, |all, one| all.union(one));
            let next = level.chunks(RUN).map(around).collect();
            surfaces.runs.push(std::mem::replace(&mut level, next));
        }
        surfaces.runs.push(level);
        debug_assert_eq!(surfaces.len(), polygons.len());
        Ok(surfaces)
    }

    /// The number of patches.
    pub fn len(&self) -> usize {
        self.mesh.patches.len()
    }

    /// Whether there are no patches.
    pub fn is_empty(&self) -> bool {
        self.mesh.patches.is_empty()
    }

    pub(super) fn surfaces(&self) -> &[PatchSurface] {
        &self.surfaces
    }

    /// Boxes around each patch, around each run of [`RUN`] such boxes, and so on.
    pub(super) fn runs(&self) -> &[Vec<Aabb>] {
        &self.runs
    }

    pub(super) fn facet(&self, facet: usize) -> &PlanarFacet {
        &self.facets[facet]
    }

    /// The number of facets of all surfaces.
    pub(super) fn facets(&self) -> usize {
        self.facets.len()
    }

    /// Numbers groups of patches that do not hide each other. A surface that is convex, seen from
    /// outside or inside, is one group. Any other surface has a group for each plane.
    fn find_groups(&mut self, patches: &[u32], group: &mut u32) {
        let mut planes: FxHashMap<[i64; 4], u32> = FxHashMap::default();
        let is_one = self.does_not_hide_itself(patches);
        for &patch in patches {
            let SurfacePatch { normal, offset, .. } = self.mesh.patches[patch as usize];
            let key = normal.extend(offset).to_array().map(|part| (part * 1e4).round() as i64);
            let number = *planes.entry(if is_one { [0; 4] } else { key }).or_insert_with(|| {
                *group += 1;
                *group - 1
            });
            self.mesh.patches[patch as usize].group = number;
        }
    }

    /// Whether all corners of some patches lie on the same side of all their planes. Too many
    /// patches count as hiding each other.
    fn does_not_hide_itself(&self, patches: &[u32]) -> bool {
        if patches.len() > CONVEX_PATCHES_MAX {
            return false;
        }
        let corners: Vec<DVec3> =
            patches.iter().flat_map(|patch| self.mesh.corners(*patch as usize)).collect();
        [1.0, -1.0].into_iter().any(|side| {
            patches.iter().all(|patch| {
                let SurfacePatch { normal, offset, .. } = &self.mesh.patches[*patch as usize];
                corners.iter().all(|corner| side * (normal.dot(*corner) - offset) <= ON_PLANE_F32_M)
            })
        })
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
