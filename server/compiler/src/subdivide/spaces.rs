//! The first step: spaces, and the gates between them.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use sightline_world::tolerance::SLIVER_M;
use sightline_world::{
    Polygon,
    geometry::{Aabb, Axes},
};

use super::{
    SubdivisionInput,
    bsp_tree::{BspTree, SharedFace},
    polygon::polygon,
    region::{Region, WALL_MAX, part},
    solids, surfaces,
};
use crate::{
    occluders::{OccluderPlane, PlaneRect, uncovered},
    split_plane::SplitPlane,
};

/// A building split along its occluders into spaces.
pub(crate) struct Spaces {
    pub(super) bounds: Aabb,
    pub(super) axes: Axes,
    pub(super) tree: BspTree,
    /// Which leaves of the tree are spaces.
    pub(super) kept: Vec<bool>,
    pub(super) gates: Vec<(SharedFace, Polygon)>,
}

impl Spaces {
    /// Splits a region, which is given in the building's own axes.
    pub(crate) fn new(bounds: &Aabb, axes: Axes, occluders: &SubdivisionInput<'_>) -> Self {
        let tree = if occluders.solids.is_empty() {
            surfaces::split(bounds, occluders.planes)
        } else {
            solids::split(bounds, occluders.solids)
        };
        let faces = tree.shared_faces(0, &Region::new(*bounds));
        let gates: Vec<(SharedFace, Polygon)> = faces
            .into_par_iter()
            .flat_map_iter(|face| open_parts(face, occluders.planes))
            .collect();
        let kept = kept(&tree, &gates, occluders);
        assert_eq!(kept.len(), tree.leaves.len(), "each leaf is kept or not");
        Self { bounds: *bounds, axes, tree, kept, gates }
    }
}

/// The open parts of the boundary between two spaces: the gates.
fn open_parts(face: SharedFace, planes: &[OccluderPlane]) -> Vec<(SharedFace, Polygon)> {
    let Some(plane) = face.plane else {
        let polygon = polygon(&face.cut, &face.polygon);
        return polygon.map(|polygon| (face, polygon)).into_iter().collect();
    };
    let plane = &planes[plane as usize];
    let flat: Vec<DVec2> = face.polygon.iter().map(|&corner| face.cut.flat(corner)).collect();
    let around = PlaneRect {
        min: flat.iter().fold(DVec2::INFINITY, |a, &b| a.min(b)),
        max: flat.iter().fold(DVec2::NEG_INFINITY, |a, &b| a.max(b)),
    };
    uncovered(&around, &plane.overlapping(&around))
        .into_iter()
        .filter_map(|free| {
            let corners = within(&face, &free);
            let polygon = polygon(&face.cut, &corners)?;
            let SharedFace { leaves, cut, plane, .. } = face;
            Some((SharedFace { leaves, cut, plane, polygon: corners }, polygon))
        })
        .collect()
}

/// The common part of a shared face and a rectangle in its plane.
fn within(face: &SharedFace, free: &PlaneRect) -> Vec<DVec3> {
    let corners = free.corners().map(|corner| face.cut.upright(corner));
    let normal = face.cut.normal();
    let centre = face.polygon.iter().sum::<DVec3>() / face.polygon.len() as f64;
    let mut kept = corners.to_vec();
    for (i, &from) in face.polygon.iter().enumerate() {
        let along = face.polygon[(i + 1) % face.polygon.len()] - from;
        let Some(inwards) = normal.cross(along).try_normalize() else { continue };
        let inwards = if inwards.dot(centre - from) < 0.0 { -inwards } else { inwards };
        let edge = SplitPlane::Plane { normal: inwards, distance: inwards.dot(from) - SLIVER_M };
        kept = part(&kept, &edge, true);
    }
    kept
}

/// Which leaves of the tree are spaces.
fn kept(
    tree: &BspTree,
    gates: &[(SharedFace, Polygon)],
    occluders: &SubdivisionInput<'_>,
) -> Vec<bool> {
    let mut next = vec![Vec::new(); tree.leaves.len()];
    for (SharedFace { leaves: [a, b], .. }, _) in gates {
        next[*a as usize].push(*b);
        next[*b as usize].push(*a);
    }
    if occluders.solids.is_empty() {
        // A thin leaf without a gate is the inside of a wall or slab.
        let is_wall = |leaf: &Region| leaf.bounds.size().min_element() <= WALL_MAX;
        return (0..)
            .zip(&tree.leaves)
            .map(|(i, leaf)| {
                let i: usize = i;
                !(next[i].is_empty() && is_wall(leaf))
            })
            .collect();
    }
    let mut reached = vec![false; tree.leaves.len()];
    let starts = occluders.eyes.iter().filter_map(|eye| tree.leaf_at(eye.as_dvec3()));
    let mut open: Vec<u32> = starts.collect();
    if open.is_empty() {
        return vec![true; tree.leaves.len()];
    }
    while let Some(leaf) = open.pop() {
        if !std::mem::replace(&mut reached[leaf as usize], true) {
            open.extend(&next[leaf as usize]);
        }
    }
    reached
}
