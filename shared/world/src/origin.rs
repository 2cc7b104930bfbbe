//! What a Quake map says of itself, kept in its world so that both can be verified: the brushes that
//! block sight as they were, without rounding to triangles, and the map's own subdivision and PVS.

use glam::{DVec3, Vec3};

use crate::geometry::Aabb;

/// The original of a world that comes from a Quake map.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Origin {
    /// The planes of solids and nodes.
    pub planes: Vec<OriginPlane>,
    /// The brushes that block sight. Patches block it too, but are only among the triangles.
    pub solids: Vec<Solid>,
    /// The map's own subdivision, for a map that has one.
    pub tree: Option<OriginTree>,
}

/// A plane: the points with `normal · p = distance`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OriginPlane {
    /// Of unit length as well as the map's author cared.
    pub normal: Vec3,
    /// In metres.
    pub distance: f64,
}

impl OriginPlane {
    /// How far a point is in front of the plane, in metres.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.as_dvec3().dot(point) - self.distance
    }
}

/// A convex solid: what is behind all its sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// All of it is inside, in metres.
    pub bounds: Aabb,
    /// Indices into [`Origin::planes`].
    pub sides: Vec<u32>,
}

/// The map's own BSP, and its vis lump.
#[derive(Clone, Debug, PartialEq)]
pub struct OriginTree {
    /// The root comes first. Never empty.
    pub nodes: Vec<OriginNode>,
    /// The leafs, none of them twice in the tree.
    pub leafs: Vec<OriginLeaf>,
    /// How many clusters there are.
    pub clusters: u32,
    /// A bit for each pair of clusters, whole bytes for each row; empty when the map was never vised.
    pub visible: Vec<u8>,
}

/// A node of the map's BSP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OriginNode {
    /// Index into [`Origin::planes`].
    pub plane: u32,
    /// What is in front of the plane, and what is behind it.
    pub sides: [OriginSide; 2],
}

/// Where a node leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OriginSide {
    /// Index into [`OriginTree::nodes`], greater than that of the node that leads there.
    Node(u32),
    /// Index into [`OriginTree::leafs`].
    Leaf(u32),
}

/// A leaf of the map's BSP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OriginLeaf {
    /// Its extent as the map tells it, in metres.
    pub bounds: Aabb,
    /// Which cluster it belongs to; none when it is solid or outside.
    pub cluster: Option<u32>,
}

impl Origin {
    /// The leaf of the map's own tree that contains a point, if there is a tree.
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
    /// Whether the map's own PVS holds a pair of clusters; all, when it was never vised.
    pub fn sees(&self, from: u32, to: u32) -> bool {
        let byte = from as usize * self.row_bytes() + to as usize / 8;
        self.visible.get(byte).is_none_or(|byte| byte & 1 << (to % 8) != 0)
    }

    /// The bytes of one row of [`OriginTree::visible`].
    pub fn row_bytes(&self) -> usize {
        (self.clusters as usize).div_ceil(8)
    }
}
