//! Which facets of a surface hide things together: a change from one to the next is no border.

use glam::DVec3;
use rustc_hash::FxHashMap;

use super::{
    Surfaces, ViewpointBox,
    facets::PlanarFacet,
    scan::FaceRows,
    surfaces::{PatchSurface, side},
};
use sightline_world::geometry::Aabb;

/// Interconnected facets that all face all eyes.
pub(super) struct SubSurface {
    pub(super) bounds: Aabb,
    pub(super) facets: Vec<usize>,
    /// Its border.
    pub(super) border: Vec<[DVec3; 2]>,
}

/// Interconnected patches of a surface that all face all eyes, on either side, found when they are needed.
pub(super) struct SubSurfaces<'a> {
    pub(super) surfaces: &'a Surfaces,
    pub(super) eyes: [DVec3; 8],
    pub(super) width_m: f32,
    /// By the first facet of a surface.
    pub(super) found: FxHashMap<usize, Vec<SubSurface>>,
    /// Of each facet, where the eyes are.
    pub(super) sides: Vec<i8>,
    pub(super) is_done: Vec<bool>,
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

    pub(super) fn take(&mut self, group: &PatchSurface) -> Vec<SubSurface> {
        if let Some(found) = self.found.remove(&group.facets.start) {
            return found;
        }
        for facet in group.facets.clone() {
            let PlanarFacet { normal, offset, .. } = self.surfaces.facet(facet);
            self.sides[facet] = side(*normal, *offset, &self.eyes);
        }
        let mut sheets = Vec::new();
        for facet in group.facets.clone() {
            if self.sides[facet] != 0 && !std::mem::replace(&mut self.is_done[facet], true) {
                sheets.push(self.grow(facet));
            }
        }
        sheets
    }

    /// All that is joined to a facet and faces the eyes as it does.
    pub(super) fn grow(&mut self, first: usize) -> SubSurface {
        let mut sheet = SubSurface { bounds: Aabb::EMPTY, facets: vec![first], border: Vec::new() };
        let mut next = 0;
        while let Some(&number) = sheet.facets.get(next) {
            next += 1;
            let facet = self.surfaces.facet(number);
            sheet.bounds = sheet.bounds.union(&facet.bounds);
            for edge in &facet.edges {
                let joined = edge.join.filter(|(other, same_way)| {
                    let other = self.sides[*other as usize];
                    other != 0 && (other == self.sides[number]) == *same_way
                });
                match joined {
                    None => sheet.border.push(edge.ends),
                    Some((other, _)) => {
                        if !std::mem::replace(&mut self.is_done[other as usize], true) {
                            sheet.facets.push(other as usize);
                        }
                    }
                }
            }
        }
        sheet
    }
}
