//! The spatial subdivision: a k-d tree whose leaves are cells, the portals between them, the PVS.

use glam::Vec3;
use roaring::RoaringBitmap;
use serde::{Deserialize, Serialize};

use crate::geometry::Aabb;

/// Index of a cell in [`Cells::cells`].
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Default,
)]
pub struct CellId(pub u32);

/// A convex leaf of the subdivision: a box.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Its extent, in metres.
    pub bounds: Aabb,
    /// Indices into [`Cells::portals`], ascending.
    pub portals: Vec<u32>,
}

/// A rectangle through which one can see from a cell into another.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Portal {
    /// The cells on the lesser and the greater side.
    pub cells: [CellId; 2],
    /// Which axis it is perpendicular to: 0, 1 or 2.
    pub axis: u8,
    /// The rectangle: a box of no width along `axis`.
    pub bounds: Aabb,
}

/// A node of the k-d tree.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum KdNode {
    /// A plane, and the nodes on its lesser and greater side.
    Split {
        /// Which axis it is perpendicular to: 0, 1 or 2.
        axis: u8,
        /// Where, in metres.
        at: f32,
        /// Indices into [`Cells::tree`], both greater than this node's own.
        sides: [u32; 2],
    },
    /// A leaf.
    Leaf(CellId),
}

/// For each cell, the cells of which some point is visible from some point of it: never too few.
/// Symmetric, and each cell sees itself.
pub type Pvs = Vec<RoaringBitmap>;

/// All of the subdivision. The cells cover `bounds` without overlap.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// What is subdivided, in metres.
    pub bounds: Aabb,
    /// The k-d tree; the root comes first. Never empty.
    pub tree: Vec<KdNode>,
    /// The leaves.
    pub cells: Vec<Cell>,
    /// Where they join.
    pub portals: Vec<Portal>,
    /// Who sees whom.
    pub pvs: Pvs,
}

impl Cells {
    /// The cell that contains a point. On a shared boundary it is the one on the greater side;
    /// outside `bounds` it is the nearest by the tree's planes.
    pub fn at(&self, point: Vec3) -> CellId {
        let mut node = 0;
        loop {
            match self.tree[node] {
                KdNode::Leaf(cell) => return cell,
                KdNode::Split { axis, at, sides } => {
                    let side = usize::from(point[usize::from(axis)] >= at);
                    node = sides[side] as usize;
                }
            }
        }
    }

    /// Appends every cell that shares a point with a box, boundaries included; ascending.
    pub fn overlapping(&self, region: &Aabb, found: &mut Vec<CellId>) {
        let start = found.len();
        self.descend(0, region, found);
        found[start..].sort_unstable();
    }

    fn descend(&self, node: u32, region: &Aabb, found: &mut Vec<CellId>) {
        match self.tree[node as usize] {
            KdNode::Leaf(cell) => found.push(cell),
            KdNode::Split { axis, at, sides } => {
                let axis = usize::from(axis);
                if region.min[axis] <= at {
                    self.descend(sides[0], region, found);
                }
                if region.max[axis] >= at {
                    self.descend(sides[1], region, found);
                }
            }
        }
    }

    /// Whether some point of one cell may be visible from some point of the other.
    pub fn sees(&self, from: CellId, to: CellId) -> bool {
        self.pvs[from.0 as usize].contains(to.0)
    }

    /// The part of all pairs of cells that the PVS holds, from 0 to 1.
    pub fn density(&self) -> f64 {
        let pairs: u64 = self.pvs.iter().map(RoaringBitmap::len).sum();
        pairs as f64 / (self.cells.len() as f64).powi(2)
    }

    /// The cells that may be visible from somewhere in a box.
    pub fn visible_from(&self, region: &Aabb) -> RoaringBitmap {
        let mut cells = Vec::new();
        self.overlapping(region, &mut cells);
        cells.iter().fold(RoaringBitmap::new(), |all, cell| all | &self.pvs[cell.0 as usize])
    }
}
