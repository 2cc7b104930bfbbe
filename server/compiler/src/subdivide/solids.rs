//! Spaces between convex solids: a BSP tree along their faces, as compilers of Quake maps make it.
//! Each leaf is all solid or all empty.

use std::collections::HashMap;

use glam::DVec3;
use sightline_world::geometry::Aabb;

use super::{
    bsp_tree::{BspTree, DEPTH_MAX},
    region::{Region, area, part, sides},
};
use crate::{model::ConvexSolid, split_plane::SplitPlane};

/// A solid without a face of at least this area, in square metres, is furniture and splits nothing.
/// Zero: all solids count.
const FACE_AREA_MIN: f64 = 0.0;
/// This many of the most opaque planes are compared by their cost.
const CANDIDATES: usize = 16;

/// A part of a face of a solid.
#[derive(Clone)]
struct Face {
    plane: u32,
    polygon: Vec<DVec3>,
}

/// A solid with its box.
struct Occluder<'a> {
    solid: &'a ConvexSolid,
    bounds: Aabb,
}

/// Splits a region along the faces of solids.
pub(super) fn split(bounds: &Aabb, solids: &[ConvexSolid]) -> BspTree {
    let large = |solid: &&ConvexSolid| {
        solid.faces.iter().any(|face| {
            let corners: Vec<DVec3> = face.corners.iter().map(|c| c.as_dvec3()).collect();
            area(&corners) >= FACE_AREA_MIN
        })
    };
    let occluders: Vec<_> = solids
        .iter()
        .filter(large)
        .map(|solid| Occluder { solid, bounds: solid.bounds() })
        .collect();
    let (cuts, faces) = cuts_and_faces(&occluders);
    let mut builder = Builder { cuts, occluders: &occluders, tree: BspTree::default() };
    let all = (0..occluders.len() as u32).collect();
    builder.split(Region::new(*bounds), faces, all, 0);
    builder.tree
}

/// The planes of all faces, each once, and the faces.
fn cuts_and_faces(occluders: &[Occluder<'_>]) -> (Vec<SplitPlane>, Vec<Face>) {
    let mut known: HashMap<[u64; 4], u32> = HashMap::new();
    let mut cuts = Vec::new();
    let mut faces = Vec::new();
    for face in occluders.iter().flat_map(|occluder| &occluder.solid.faces) {
        let axis = (0..3).find(|&axis| face.normal[axis].abs() == 1.0);
        // One of the two opposite normals stands for both.
        let flip = face.normal.to_array().into_iter().find(|&n| n != 0.0).is_some_and(|n| n < 0.0);
        let sign = if flip { -1.0 } else { 1.0 };
        let cut = match axis {
            Some(axis) => SplitPlane::Axial { axis, at: face.corners[0][axis] },
            None => {
                SplitPlane::Plane { normal: face.normal * sign, distance: face.distance * sign }
            }
        };
        let height = cut.height(DVec3::ZERO);
        let key = [cut.normal().x, cut.normal().y, cut.normal().z, height];
        let plane = *known.entry(key.map(|n| (n + 0.0).to_bits())).or_insert_with(|| {
            cuts.push(cut);
            cuts.len() as u32 - 1
        });
        let polygon = face.corners.iter().map(|corner| corner.as_dvec3()).collect();
        faces.push(Face { plane, polygon });
    }
    (cuts, faces)
}

struct Builder<'a> {
    cuts: Vec<SplitPlane>,
    occluders: &'a [Occluder<'a>],
    tree: BspTree,
}

impl Builder<'_> {
    fn split(&mut self, region: Region, faces: Vec<Face>, solids: Vec<u32>, depth: u16) -> u32 {
        let region = region.tightened();
        let chosen = (depth < DEPTH_MAX).then(|| self.best(&region, &faces)).flatten();
        let Some(plane) = chosen else { return self.leaf(region, &solids) };
        let cut = self.cuts[plane as usize];
        let index = self.tree.reserve();
        let (mut low, mut high) = (Vec::new(), Vec::new());
        for face in faces.into_iter().filter(|face| face.plane != plane) {
            match sides(&face.polygon, &cut) {
                [true, true] => {
                    let parts = [false, true].map(|side| part(&face.polygon, &cut, side));
                    for (polygon, into) in parts.into_iter().zip([&mut low, &mut high]) {
                        if !polygon.is_empty() {
                            into.push(Face { plane: face.plane, polygon });
                        }
                    }
                }
                [true, false] => low.push(face),
                [false, true] => high.push(face),
                [false, false] => {}
            }
        }
        let [below, above] = region.halves(&cut);
        let halves = [(below, low), (above, high)];
        let children = halves.map(|(half, faces)| {
            let meets =
                |&solid: &u32| self.occluders[solid as usize].bounds.intersects(&half.bounds);
            let near = solids.iter().copied().filter(meets).collect();
            self.split(half, faces, near, depth + 1)
        });
        self.tree.set_split(index, cut, None, children);
        index
    }

    /// Adds a leaf. A region that no face crosses lies inside a solid, or outside all solids.
    fn leaf(&mut self, region: Region, solids: &[u32]) -> u32 {
        let Some((_, inside)) = region.extent() else { return self.tree.solid() };
        let holds = |&solid: &u32| self.occluders[solid as usize].solid.contains(inside, 0.0);
        if solids.iter().any(holds) { self.tree.solid() } else { self.tree.space(region) }
    }

    /// The plane to split along: axial before vertical before others; among these, a plane whose
    /// section is mostly covered by faces and that splits few other faces.
    fn best(&self, region: &Region, faces: &[Face]) -> Option<u32> {
        let mut areas: HashMap<u32, f64> = HashMap::new();
        for face in faces {
            *areas.entry(face.plane).or_default() += area(&face.polygon);
        }
        let rank = |plane: u32| match self.cuts[plane as usize] {
            SplitPlane::Axial { .. } => 2,
            SplitPlane::Plane { normal, .. } if normal.y == 0.0 => 1,
            SplitPlane::Plane { .. } => 0,
        };
        let first = areas.keys().map(|&plane| rank(plane)).max()?;
        let mut planes: Vec<(u32, f64)> = areas
            .into_iter()
            .filter(|&(plane, _)| rank(plane) == first)
            .map(|(plane, covered)| {
                let section = area(&region.section(&self.cuts[plane as usize]));
                (plane, (covered / section.max(1e-9)).min(1.0))
            })
            .collect();
        planes.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        planes.truncate(CANDIDATES);
        planes
            .into_iter()
            .map(|(plane, share)| (plane, share - self.cost(plane, faces)))
            .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
            .map(|(plane, _)| plane)
    }

    /// The cost of a plane: the share of faces that it splits, and how unevenly it divides the
    /// others.
    fn cost(&self, plane: u32, faces: &[Face]) -> f64 {
        let cut = &self.cuts[plane as usize];
        let (mut low, mut high, mut both) = (0.0, 0.0, 0.0f64);
        for face in faces.iter().filter(|face| face.plane != plane) {
            match sides(&face.polygon, cut) {
                [true, true] => both += 1.0,
                [true, false] => low += 1.0,
                [false, true] => high += 1.0,
                [false, false] => {}
            }
        }
        let all = faces.len() as f64;
        let uneven: f64 = low - high;
        2.0 * both / all + 0.3 * uneven.abs() / all
    }
}
