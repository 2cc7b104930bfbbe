//! What every eye of a box sees whole: flat pieces of floors, walls and ceilings with nothing before them.
//!
//! A node that is more than one layer of voxels hides a part of itself, so it is never seen whole, and its tests
//! against the mask buffer pay. Of a layer the side towards the eyes is seen whole when no box around other voxels meets
//! the convex hull of that side and the box of eyes before it. Between two boxes that is arithmetic: a share t of the way
//! from the one to the other, the hull is again a box, whose sides are linear in t.

use glam::UVec3;
use sightline_world::{
    geometry::Aabb,
    octree::{Cursor, Octree},
};

use super::{NodeVisibility, OccluderNode, VoxelOccluders};

/// What is no farther before than this share of the way touches, and does not hide.
const TOUCHING: f32 = 1e-5;

/// The axis that a node's voxels lie across, and where they begin and end along it in metres, if they are one layer.
pub(super) fn layer(node: Cursor<'_>, cube: &Aabb, octree: &Octree) -> Option<(usize, [f32; 2])> {
    let mut voxels = [UVec3::MAX, UVec3::ZERO];
    take(node, UVec3::ZERO, &mut voxels);
    let [first, last] = voxels;
    let axis = (0..3).find(|&axis| first[axis] == last[axis])?;
    // Such that layers in one plane are in the very same place.
    let before = ((cube.min[axis] - octree.origin[axis]) / octree.voxel()).round();
    let at = |voxel: u32| octree.origin[axis] + (before + voxel as f32) * octree.voxel();
    Some((axis, [at(first[axis]), at(first[axis] + 1)]))
}

/// Takes in the first and the last voxel of a node along each axis, until it cannot be a layer any more. Places are counted
/// in nodes of the node's size.
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

/// Whether every eye sees a node whole, as far as it faces the eyes.
pub(super) fn is_unoccluded(
    walls: &VoxelOccluders,
    hidden: &NodeVisibility,
    node: &OccluderNode,
) -> bool {
    let Some(side) = node.layer.and_then(|axis| side(&node.voxels, axis, &hidden.eyes)) else {
        return false;
    };
    let mut at = 0;
    while let Some(other) = walls.nodes.get(at) {
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

/// The side of a layer that faces the eyes, if all of them are on one side.
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

/// Whether anything in a box may be between some eyes and what they see.
fn is_before(bounds: &Aabb, seen: &Aabb, eyes: &Aabb) -> bool {
    // From where to where on the way each of six sides lets it be.
    let (mut first, mut last) = (0.0f32, 1.0f32);
    for axis in 0..3 {
        let ends = [
            (bounds.max[axis] - eyes.min[axis], seen.min[axis] - eyes.min[axis]),
            (eyes.max[axis] - bounds.min[axis], eyes.max[axis] - seen.max[axis]),
        ];
        for (room, way) in ends {
            // As far as `way` times the share is no more than `room`.
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
