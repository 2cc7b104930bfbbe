//! The size of an octree, in memory and on the wire.

use serde::Serialize;
use sightline_world::octree::Octree;

/// The size of an octree, in memory and on the wire.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct OctreeStatistics {
    /// The number of leaves.
    pub voxels: usize,
    /// The edge of a leaf, in metres.
    pub voxel_m: f32,
    /// The number of inner nodes.
    pub inner_nodes: usize,
    /// The number of different materials.
    pub materials: usize,
    /// The number of levels below the root.
    pub depth: u8,
    /// Bytes of nodes and materials in a client.
    pub memory_bytes: usize,
    /// Bytes in a client for each leaf.
    pub memory_bytes_per_voxel: f64,
    /// Bytes of the octree in the world file.
    pub wire_bytes: usize,
    /// Bytes in the world file for each leaf.
    pub wire_bytes_per_voxel: f64,
}

impl OctreeStatistics {
    /// Measures an octree. It is encoded to measure its size on the wire.
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
