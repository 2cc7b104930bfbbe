//! A Quake map's own data, kept in the world that was compiled from it to verify the compiler: the
//! brushes that block sight, before rounding to triangles, and the map's own BSP tree and PVS.

use glam::{DVec3, Vec3};

use crate::geometry::Aabb;

/// The data of the Quake map that a world was compiled from.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Origin {
    /// The planes of the solids and of the nodes.
    pub planes: Vec<OriginPlane>,
    /// The brushes that block sight. Curved patches block sight too, but exist only as triangles.
    pub solids: Vec<Solid>,
    /// The map's own BSP tree, if it has one.
    pub tree: Option<OriginTree>,
}

/// A plane: the points with `normal · p = distance`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OriginPlane {
    /// The normal. Its length is one only as far as the map's editor rounded it so.
    pub normal: Vec3,
    /// The distance from the origin along the normal, in metres.
    pub distance: f64,
}

impl OriginPlane {
    /// The signed distance of a point in front of the plane, in metres.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.as_dvec3().dot(point) - self.distance
    }
}

/// A convex solid: the points behind all of its sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// A box around the solid, in metres.
    pub bounds: Aabb,
    /// The sides: indices into [`Origin::planes`].
    pub sides: Vec<u32>,
}

/// The map's own BSP tree and PVS.
#[derive(Clone, Debug, PartialEq)]
pub struct OriginTree {
    /// The nodes, the root first. Never empty.
    pub nodes: Vec<OriginNode>,
    /// The leaves. None occurs twice in the tree.
    pub leafs: Vec<OriginLeaf>,
    /// The number of clusters.
    pub clusters: u32,
    /// The map's PVS: a bit for each pair of clusters, in rows of whole bytes. Empty when the map's
    /// author never computed it.
    pub visible: Vec<u8>,
}

/// A node of the map's BSP tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OriginNode {
    /// The splitting plane: an index into [`Origin::planes`].
    pub plane: u32,
    /// The children in front of the plane and behind it.
    pub sides: [OriginSide; 2],
}

/// A child of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OriginSide {
    /// A node: an index into [`OriginTree::nodes`], greater than the parent's.
    Node(u32),
    /// A leaf: an index into [`OriginTree::leafs`].
    Leaf(u32),
}

/// A leaf of the map's BSP tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OriginLeaf {
    /// The leaf's box as the map gives it, in metres.
    pub bounds: Aabb,
    /// The leaf's cluster. `None` for a leaf that is solid or outside of the map.
    pub cluster: Option<u32>,
}

impl Origin {
    /// The leaf of the map's own tree that contains a point. `None` without a tree.
    pub fn leaf_at(&self, point: DVec3) -> Option<u32> {
        let tree = self.tree.as_ref()?;
        let mut node = 0;
        loop {
            let OriginNode { plane, sides } = tree.nodes[node];
            let behind = self.planes[plane as usize].height(point) < 0.0;
            match sides[usize::from(behind)] {
                OriginSide::Leaf(leaf) => return Some(leaf),
                OriginSide::Node(below) => node = below as usize,
            }
        }
    }

    /// The sides of a solid.
    pub fn sides<'a>(&'a self, solid: &'a Solid) -> impl Iterator<Item = &'a OriginPlane> {
        solid.sides.iter().map(|&side| &self.planes[side as usize])
    }
}

impl OriginTree {
    /// Whether the map's own PVS contains a pair of clusters. Without a PVS all pairs count as
    /// contained.
    pub fn sees(&self, from: u32, to: u32) -> bool {
        debug_assert!(from < self.clusters && to < self.clusters, "no such cluster");
        let byte = from as usize * self.row_bytes() + to as usize / 8;
        self.visible.get(byte).is_none_or(|byte| byte & 1 << (to % 8) != 0)
    }

    /// The number of bytes in a row of [`OriginTree::visible`].
    pub fn row_bytes(&self) -> usize {
        (self.clusters as usize).div_ceil(8)
    }
}
