//! Which nodes every eye of a viewpoint box sees whole: flat pieces of floors, walls and ceilings
//! with nothing in front of them.
//!
//! A node of more than one layer of voxels hides a part of itself, so it is never seen whole, and
//! testing it against the mask buffer pays. The near side of a single layer is seen whole when no
//! box around other voxels meets the convex hull of that side and the viewpoint box in front of it.
//! The test is arithmetic: at a share t of the way from one box to the other, the hull's cross
//! section is again a box, whose sides are linear in t.

use glam::UVec3;
use sightline_world::{
    geometry::Aabb,
    octree::{Cursor, Octree},
};

use super::{NodeVisibility, OccluderNode, VoxelOccluders};

/// A box that is in front by no more than this share of the way touches the side and does not hide
/// it.
const TOUCHING: f32 = 1e-5;

/// If a node's voxels form one layer: the axis across the layer, and where the layer begins and
/// ends along it, in metres.
pub(super) fn layer(node: Cursor<'_>, cube: &Aabb, octree: &Octree) -> Option<(usize, [f32; 2])> {
    let mut voxels = [UVec3::MAX, UVec3::ZERO];
    take(node, UVec3::ZERO, &mut voxels);
    let [first, last] = voxels;
    let axis = (0..3).find(|&axis| first[axis] == last[axis])?;
    // Counted from the octree's origin, so that layers in one plane get the very same place.
    let before = ((cube.min[axis] - octree.origin[axis]) / octree.voxel()).round();
    let at = |voxel: u32| octree.origin[axis] + (before + voxel as f32) * octree.voxel();
    Some((axis, [at(first[axis]), at(first[axis] + 1)]))
}

/// Extends the first and the last voxel along each axis by those of a node, until they cannot form
/// a layer any more. Places are counted in nodes of the node's size.
fn take(node: Cursor<'_>, at: UVec3, voxels: &mut [UVec3; 2]) {
    if node.is_leaf() {
        *voxels = [voxels[0].min(at), voxels[1].max(at)];
        return;
    }
    for (octant, child) in node.children() {
        let place = UVec3::from([0, 1, 2].map(|axis| u32::from(octant >> axis & 1)));
        take(child, 2 * at + place, voxels);
        if voxels[0].cmplt(voxels[1]).all() {
            return;
        }
    }
}

/// Whether every eye sees the side of a node that faces the eyes whole.
pub(super) fn is_unoccluded(
    occluders: &VoxelOccluders,
    hidden: &NodeVisibility,
    node: &OccluderNode,
) -> bool {
    let Some(side) = node.layer.and_then(|axis| side(&node.voxels, axis, &hidden.eyes)) else {
        return false;
    };
    let mut at = 0;
    while let Some(other) = occluders.nodes.get(at) {
        if hidden.is_hidden(other.index) || !is_before(&other.voxels, &side, &hidden.eyes) {
            at = other.end as usize;
        } else if other.end as usize == at + 1 {
            return false;
        } else {
            at += 1;
        }
    }
    true
}

/// The side of a layer that faces the eyes, if all eyes are on one side of it.
fn side(voxels: &Aabb, axis: usize, eyes: &Aabb) -> Option<Aabb> {
    let mut side = *voxels;
    if voxels.max[axis] < eyes.min[axis] {
        side.min[axis] = side.max[axis];
    } else if voxels.min[axis] > eyes.max[axis] {
        side.max[axis] = side.min[axis];
    } else {
        return None;
    }
    Some(side)
}

/// Whether anything in a box may be between some eye and the side that it sees.
fn is_before(bounds: &Aabb, seen: &Aabb, eyes: &Aabb) -> bool {
    // The range of the way in which each of six sides lets the box meet the hull.
    let (mut first, mut last) = (0.0f32, 1.0f32);
    for axis in 0..3 {
        let ends = [
            (bounds.max[axis] - eyes.min[axis], seen.min[axis] - eyes.min[axis]),
            (eyes.max[axis] - bounds.min[axis], eyes.max[axis] - seen.max[axis]),
        ];
        for (room, way) in ends {
            // The side allows shares with `way` times the share at most `room`.
            if way > 0.0 {
                last = last.min(room / way);
            } else if way < 0.0 {
                first = first.max(room / way);
            } else if room < 0.0 {
                return false;
            }
        }
    }
    first <= last && first < 1.0 - TOUCHING
}
