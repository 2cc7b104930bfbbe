//! A BSP tree, and the polygons where two of its leaves join.

use glam::DVec3;
use sightline_world::tolerance::ON_PLANE_F32_M;

use super::region::{Region, part};
use crate::split_plane::SplitPlane;

/// The greatest depth of a tree. The reader of world files allows twice as much.
pub(super) const DEPTH_MAX: u16 = 256;

/// A node of the tree.
#[derive(Clone, Debug)]
pub(super) enum BspNode {
    /// A plane, and the nodes on its lesser and greater side.
    Split {
        /// The plane.
        cut: SplitPlane,
        /// The index of the occluder plane in it, if any.
        plane: Option<u32>,
        /// The children on the lesser and on the greater side, with greater indices than the node.
        sides: [u32; 2],
    },
    /// A leaf, by its index.
    Leaf(u32),
    /// A solid leaf.
    Solid,
}

/// A BSP tree whose leaves are convex regions.
#[derive(Clone, Debug, Default)]
pub(super) struct BspTree {
    /// All nodes, the root first.
    pub nodes: Vec<BspNode>,
    /// The regions of the leaves, in the order of the tree.
    pub leaves: Vec<Region>,
}

/// A convex polygon where two leaves join. The leaf on the lesser side of its plane comes first.
pub(super) struct SharedFace {
    pub leaves: [u32; 2],
    pub cut: SplitPlane,
    pub plane: Option<u32>,
    pub polygon: Vec<DVec3>,
}

impl BspTree {
    /// Adds a node to be set later, so that its children come after it.
    pub(super) fn reserve(&mut self) -> u32 {
        self.nodes.push(BspNode::Solid);
        self.nodes.len() as u32 - 1
    }

    /// Makes a reserved node a split.
    pub(super) fn set_split(
        &mut self,
        index: u32,
        cut: SplitPlane,
        plane: Option<u32>,
        sides: [u32; 2],
    ) {
        assert!(sides.iter().all(|&side| side > index), "children come after their parent");
        self.nodes[index as usize] = BspNode::Split { cut, plane, sides };
    }

    /// Adds a solid leaf.
    pub(super) fn solid(&mut self) -> u32 {
        self.reserve()
    }

    /// Adds a leaf.
    pub(super) fn space(&mut self, region: Region) -> u32 {
        self.nodes.push(BspNode::Leaf(self.leaves.len() as u32));
        self.leaves.push(region);
        self.nodes.len() as u32 - 1
    }

    /// The leaf that contains a point. None when it is solid there.
    pub(super) fn leaf_at(&self, point: DVec3) -> Option<u32> {
        let mut node = 0;
        loop {
            match self.nodes[node] {
                BspNode::Leaf(leaf) => return Some(leaf),
                BspNode::Solid => return None,
                BspNode::Split { cut, sides, .. } => {
                    node = sides[usize::from(cut.height(point) >= 0.0)] as usize;
                }
            }
        }
    }

    /// All polygons where two leaves of a subtree join.
    pub(super) fn shared_faces(&self, root: u32, region: &Region) -> Vec<SharedFace> {
        let mut found = Vec::new();
        self.add_faces_below(root, region, &mut found);
        found
    }

    fn add_faces_below(&self, node: u32, region: &Region, found: &mut Vec<SharedFace>) {
        if let BspNode::Split { cut, plane, sides } = &self.nodes[node as usize] {
            let [low, high] = region.halves(cut).map(Region::tightened);
            self.add_faces_across(*sides, cut, *plane, region.section(cut), found);
            self.add_faces_below(sides[0], &low, found);
            self.add_faces_below(sides[1], &high, found);
        }
    }

    /// Adds the polygons where leaves of a subtree below a plane join leaves of one above it,
    /// within a polygon on the plane.
    pub(super) fn add_faces_across(
        &self,
        nodes: [u32; 2],
        cut: &SplitPlane,
        plane: Option<u32>,
        polygon: Vec<DVec3>,
        found: &mut Vec<SharedFace>,
    ) {
        if polygon.len() < 3 {
            return;
        }
        for below in 0..2 {
            let BspNode::Split { cut: other, sides, .. } = &self.nodes[nodes[below] as usize]
            else {
                continue;
            };
            let replaced = |side| if below == 0 { [side, nodes[1]] } else { [nodes[0], side] };
            let heights = polygon.iter().map(|&corner| other.height(corner));
            let (lowest, highest) =
                heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| (a.min(h), b.max(h)));
            if lowest > -ON_PLANE_F32_M && highest < ON_PLANE_F32_M {
                // The planes nearly coincide: only the side that touches can join.
                let agree = other.normal().dot(cut.normal()) > 0.0;
                let side = sides[usize::from((below == 1) != agree)];
                self.add_faces_across(replaced(side), cut, plane, polygon, found);
            } else if highest <= 0.0 {
                self.add_faces_across(replaced(sides[0]), cut, plane, polygon, found);
            } else if lowest >= 0.0 {
                self.add_faces_across(replaced(sides[1]), cut, plane, polygon, found);
            } else {
                for (is_greater, side) in [false, true].into_iter().zip(sides) {
                    let half = part(&polygon, other, is_greater);
                    self.add_faces_across(replaced(*side), cut, plane, half, found);
                }
            }
            return;
        }
        let leaf = |node: u32| match self.nodes[node as usize] {
            BspNode::Leaf(leaf) => Some(leaf),
            _ => None,
        };
        if let [Some(low), Some(high)] = nodes.map(leaf) {
            found.push(SharedFace { leaves: [low, high], cut: *cut, plane, polygon });
        }
    }
}
