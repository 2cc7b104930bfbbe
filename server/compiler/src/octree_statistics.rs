//! What an octree takes.

use serde::Serialize;
use sightline_world::octree::Octree;

/// How large an octree is, in memory and on the wire.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct OctreeStatistics {
    /// Leaves.
    pub voxels: usize,
    /// The edge of a leaf, in metres.
    pub voxel_m: f32,
    /// Nodes that are no leaves.
    pub inner_nodes: usize,
    /// Looks that are told apart.
    pub materials: usize,
    /// Levels below the root.
    pub depth: u8,
    /// Nodes and materials, as a client holds them.
    pub memory_bytes: usize,
    /// The same for each leaf.
    pub memory_bytes_per_voxel: f64,
    /// What the octree's part of the world file takes.
    pub wire_bytes: usize,
    /// The same for each leaf.
    pub wire_bytes_per_voxel: f64,
}

impl OctreeStatistics {
    /// Measures an octree; it is coded for that.
    pub fn of(octree: &Octree) -> Self {
        let voxels = octree.leaves.len();
        let (memory_bytes, wire_bytes) = (octree.memory_bytes(), octree.to_bytes().len());
        let per_voxel = |bytes: usize| bytes as f64 / voxels.max(1) as f64;
        Self {
            voxels,
            voxel_m: octree.voxel(),
            inner_nodes: octree.inner.len(),
            materials: octree.materials.len(),
            depth: octree.depth,
            memory_bytes,
            memory_bytes_per_voxel: per_voxel(memory_bytes),
            wire_bytes,
            wire_bytes_per_voxel: per_voxel(wire_bytes),
        }
    }
}
