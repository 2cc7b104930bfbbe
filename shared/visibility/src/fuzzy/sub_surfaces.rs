//! Front-facing sub-surfaces: connected facets that hide things together (Lim 1999, FIG. 5A).

use glam::DVec3;
use rustc_hash::FxHashMap;
use sightline_world::geometry::Aabb;

use super::{
    faces::ViewpointBox,
    facets::{FacetNeighbour, PlanarFacet},
    patches::side,
    scan::FaceRows,
    surfaces::{PatchSurface, Surfaces},
};

/// Connected facets that all face all eyes, on the same side of the surface.
pub(super) struct SubSurface {
    pub(super) bounds: Aabb,
    /// The indices of the facets.
    pub(super) facets: Vec<usize>,
    /// The edges of the border.
    pub(super) border: Vec<[DVec3; 2]>,
}

/// The front-facing sub-surfaces of all surfaces, found when they are needed first.
pub(super) struct SubSurfaces<'a> {
    pub(super) surfaces: &'a Surfaces,
    /// The corners of the box of eyes.
    pub(super) eyes: [DVec3; 8],
    /// The least width of the box of eyes, in metres.
    pub(super) width_m: f32,
    /// The sub-surfaces found, by the first facet of their surface.
    pub(super) found: FxHashMap<usize, Vec<SubSurface>>,
    /// For each facet, on which side of it the eyes are, as in [`side`].
    sides: Vec<i8>,
    /// For each facet, whether it is in a sub-surface already.
    is_done: Vec<bool>,
    pub(super) rows: FaceRows,
    pub(super) spare: Vec<DVec3>,
}

impl<'a> SubSurfaces<'a> {
    pub(super) fn new(
        surfaces: &'a Surfaces,
        viewpoints: &ViewpointBox,
        width_m: f32,
        size: usize,
    ) -> Self {
        Self {
            surfaces,
            eyes: viewpoints.corners(),
            width_m,
            found: FxHashMap::default(),
            sides: vec![0; surfaces.facets()],
            is_done: vec![false; surfaces.facets()],
            rows: FaceRows::new(size),
            spare: Vec::new(),
        }
    }

    /// Takes the sub-surfaces of a surface out of those found, or finds them.
    pub(super) fn take(&mut self, surface: &PatchSurface) -> Vec<SubSurface> {
        if let Some(found) = self.found.remove(&surface.facets.start) {
            return found;
        }
        for facet in surface.facets.clone() {
            let PlanarFacet { normal, offset, .. } = self.surfaces.facet(facet);
            self.sides[facet] = side(*normal, *offset, &self.eyes);
        }
        let mut sub_surfaces = Vec::new();
        for facet in surface.facets.clone() {
            if self.sides[facet] != 0 && !std::mem::replace(&mut self.is_done[facet], true) {
                sub_surfaces.push(self.grow(facet));
            }
        }
        sub_surfaces
    }

    /// All facets that are connected to a facet and face the eyes as it does.
    fn grow(&mut self, first: usize) -> SubSurface {
        let mut sub_surface =
            SubSurface { bounds: Aabb::EMPTY, facets: vec![first], border: Vec::new() };
        let mut next = 0;
        while let Some(&number) = sub_surface.facets.get(next) {
            next += 1;
            let facet = self.surfaces.facet(number);
            sub_surface.bounds = sub_surface.bounds.union(&facet.bounds);
            for edge in &facet.edges {
                let joined = edge.neighbour.filter(|neighbour| {
                    let other = self.sides[neighbour.facet as usize];
                    other != 0 && (other == self.sides[number]) == neighbour.same_side
                });
                match joined {
                    None => sub_surface.border.push(edge.ends),
                    Some(FacetNeighbour { facet: other, .. }) => {
                        if !std::mem::replace(&mut self.is_done[other as usize], true) {
                            sub_surface.facets.push(other as usize);
                        }
                    }
                }
            }
        }
        sub_surface
    }
}
