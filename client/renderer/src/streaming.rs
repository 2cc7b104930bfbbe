//! Which parts of an octree that still arrives a picture shows.
//!
//! What is missing has stand-ins that fill all of its space. So nothing that a picture needs is
//! behind what it does not show: once the branches that it shows are there, it is the picture of
//! the whole octree.

use std::collections::BTreeMap;

use sightline_client_core::fetching::ShownBranch;
use sightline_world::octree::pieces::PartialOctree;

use super::{Camera, Frame, view::View};

/// The branches that a picture shows, in ascending order, as told by every `step`th pixel of every
/// `step`th row. The picture must have been drawn of this octree with this camera. Glass is not
/// looked at, but what is behind it.
pub fn shown_branches(
    frame: &Frame,
    camera: &Camera,
    octree: &PartialOctree,
    step: usize,
) -> Vec<ShownBranch> {
    let view = View::new(camera, frame.width(), frame.height());
    let voxel = octree.octree().voxel();
    let mut shown: BTreeMap<u32, f32> = BTreeMap::new();
    let step = step.max(1);
    for y in (0..frame.height()).step_by(step) {
        for x in (0..frame.width()).step_by(step) {
            let Some(&depth) = frame.depth.get(y * frame.width() + x) else { continue };
            if !depth.is_finite() {
                continue;
            }
            let ray = view.ray(x as f32, y as f32);
            // A depth is that of the middle of a voxel, or of a node as large as a pixel, beside
            // which the line of sight may pass.
            let beside = voxel.max(depth / view.focal());
            for depth in [depth - beside, depth, depth + beside] {
                if let Some(branch) = octree.branch_at(camera.eye + ray * depth) {
                    let nearest = shown.entry(branch as u32).or_insert(f32::INFINITY);
                    *nearest = nearest.min(depth);
                }
            }
        }
    }
    shown.into_iter().map(|(branch, depth)| ShownBranch { branch, depth }).collect()
}
