//! The size of an octree, in memory and on the wire.

use glam::Vec3;
use serde::Serialize;
use sightline_world::{
    geometry::Aabb,
    octree::{Cursor, Octree},
};

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

/// The smallest box around all voxels. Empty when there are none.
pub fn occupied(octree: &Octree) -> Aabb {
    let mut bounds = Aabb::EMPTY;
    if let Some(root) = octree.root() {
        extend(&mut bounds, root, octree.origin, octree.edge);
    }
    bounds
}

/// Extends a box to the voxels below a node, which fills a cube.
fn extend(bounds: &mut Aabb, node: Cursor<'_>, min: Vec3, edge: f32) {
    let cube = Aabb::new(min, min + edge);
    if bounds.contains_box(&cube) {
        return;
    }
    if node.is_leaf() {
        *bounds = bounds.union(&cube);
        return;
    }
    let half = edge * 0.5;
    for (octant, child) in node.children() {
        let corner = Vec3::new(
            f32::from(octant & 1),
            f32::from(octant >> 1 & 1),
            f32::from(octant >> 2 & 1),
        );
        extend(bounds, child, min + corner * half, half);
    }
}

#[cfg(test)]
mod tests {
    use glam::UVec3;
    use sightline_world::octree::{Voxel, morton};

    use super::*;

    #[test]
    fn the_occupied_box_is_that_of_the_voxels() {
        let voxel = |x, y, z| Voxel { key: morton(UVec3::new(x, y, z)), ..Voxel::default() };
        let voxels = vec![voxel(3, 5, 0), voxel(9, 2, 30)];
        let octree = Octree::from_voxels(Vec3::splat(-1.0), 0.5, 5, voxels).unwrap();
        let expected = Aabb::new(Vec3::new(0.5, 0.0, -1.0), Vec3::new(4.0, 2.0, 14.5));
        assert_eq!(occupied(&octree), expected);
        assert!(occupied(&Octree::empty(Vec3::ZERO, 8.0, 4)).is_empty());
    }
}
