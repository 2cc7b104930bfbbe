//! The spatial subdivision: a BSP tree whose leaves are cells, the portals between cells, and the
//! PVS.
//!
//! Cells are grouped into spaces, and the portals between two spaces are joined into gates.

use std::ops::Range;

use glam::{DVec3, Vec3};
use roaring::RoaringBitmap;
use serde::{Deserialize, Serialize};

use crate::{
    geometry::{Aabb, Axes},
    tolerance::{ASTRAY_M, SLANTED_PLANE_M},
};

/// Index of a cell in [`Cells::cells`].
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Default,
)]
pub struct CellId(pub u32);

/// A convex leaf of the subdivision.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// The smallest box around the cell, in metres and own axes. Most cells fill their boxes.
    pub bounds: Aabb,
    /// The space that the cell belongs to: an index into [`Cells::spaces`].
    pub space: u32,
    /// The cell's portals: ascending indices into [`Cells::portals`].
    pub portals: Vec<u32>,
}

/// A convex polygon through which one cell can be seen from another.
#[derive(Clone, Debug, PartialEq)]
pub struct Portal {
    /// The cells on the lesser and on the greater side.
    pub cells: [CellId; 2],
    /// The polygon.
    pub polygon: Polygon,
}

/// A convex part of the building between occluders, made of one or more cells. Nothing inside a
/// space occludes, so sight lines are propagated from space to space.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// The smallest box around the space, in metres and own axes.
    pub bounds: Aabb,
    /// The cells of the space. They cover it.
    pub cells: Range<u32>,
    /// The gates of the space: ascending indices into [`Cells::gates`].
    pub gates: Vec<u32>,
}

/// A convex polygon through which one space can be seen from another: the union of the portals
/// between their cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Gate {
    /// The spaces on the lesser and on the greater side: indices into [`Cells::spaces`].
    pub spaces: [u32; 2],
    /// The polygon.
    pub polygon: Polygon,
}

/// A convex polygon, in metres and own axes.
#[derive(Clone, Debug, PartialEq)]
pub enum Polygon {
    /// A rectangle with edges along the axes.
    Rectangle {
        /// The axis that it is perpendicular to: 0, 1 or 2.
        axis: u8,
        /// The rectangle, as a box without width along `axis`.
        bounds: Aabb,
    },
    /// Any other convex polygon.
    Other {
        /// The unit normal, towards the greater side.
        normal: DVec3,
        /// The corners in order around the polygon, at least three.
        corners: Box<[Vec3]>,
    },
}

impl Polygon {
    /// The smallest box around the polygon.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Rectangle { bounds, .. } => *bounds,
            Self::Other { corners, .. } => Aabb::from_points(corners.iter().copied()),
        }
    }

    /// The segment in which a horizontal plane cuts the polygon. `None` when the polygon is
    /// horizontal, or above or below the plane. `height` is in metres.
    pub fn across(&self, height: f32) -> Option<[Vec3; 2]> {
        match self {
            Self::Rectangle { axis: 1, .. } => None,
            Self::Rectangle { bounds: Aabb { min, max }, .. } => {
                let at = |corner: &Vec3| Vec3::new(corner.x, height, corner.z);
                (min.y <= height && height <= max.y).then(|| [at(min), at(max)])
            }
            Self::Other { corners, .. } => {
                let edges = corners.iter().zip(corners.iter().cycle().skip(1));
                let mut ends = edges.filter_map(|(a, b)| {
                    let crosses = (a.y < height) != (b.y < height);
                    crosses.then(|| a.lerp(*b, (height - a.y) / (b.y - a.y)))
                });
                Some([ends.next()?, ends.next()?])
            }
        }
    }
}

/// A node of the BSP tree.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Node {
    /// An axial plane that splits space into a lesser and a greater side.
    Axial {
        /// The axis that the plane is perpendicular to: 0, 1 or 2.
        axis: u8,
        /// The plane's coordinate along the axis, in metres.
        at: f32,
        /// The nodes on the lesser and on the greater side: indices into [`Cells::tree`], both
        /// greater than this node's own.
        sides: [u32; 2],
    },
    /// A plane of any direction that splits space into a part behind it and one in front of it.
    Plane {
        /// The unit normal.
        normal: DVec3,
        /// The distance from the origin along the normal, in metres.
        distance: f64,
        /// The nodes behind and in front of the plane: indices into [`Cells::tree`], both greater
        /// than this node's own.
        sides: [u32; 2],
    },
    /// A leaf in which an eye can be.
    Leaf(CellId),
    /// A leaf that is opaque throughout, or that no sight line from a spawn point reaches.
    Solid,
}

/// The potentially visible set (PVS): for each cell, the cells of which some point may be visible
/// from some point of it. It never has too few. It is symmetric, and each cell sees itself.
pub type Pvs = Vec<RoaringBitmap>;

/// The whole subdivision. Cells do not overlap. Cells and solid leaves together cover `bounds`.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// The building's own axes. All other fields are given along these.
    pub axes: Axes,
    /// The region that is subdivided, in metres.
    pub bounds: Aabb,
    /// The nodes of the tree, the root first. Never empty.
    pub tree: Vec<Node>,
    /// The cells. Those of one space are contiguous.
    pub cells: Vec<Cell>,
    /// The portals between cells.
    pub portals: Vec<Portal>,
    /// The spaces that the cells belong to.
    pub spaces: Vec<Space>,
    /// The gates between spaces.
    pub gates: Vec<Gate>,
    /// The potentially visible set, one row per cell.
    pub pvs: Pvs,
}

impl Cells {
    /// A subdivision with a single cell.
    pub fn whole(bounds: Aabb) -> Self {
        Self {
            axes: Axes::WORLD,
            bounds,
            tree: vec![Node::Leaf(CellId(0))],
            cells: vec![Cell { bounds, space: 0, portals: Vec::new() }],
            portals: Vec::new(),
            spaces: vec![Space { bounds, cells: 0..1, gates: Vec::new() }],
            gates: Vec::new(),
            pvs: vec![RoaringBitmap::from_iter([0])],
        }
    }

    /// The cell that contains a point, given in the world's axes. `None` in a solid leaf.
    ///
    /// On a shared boundary it is the cell on the greater side. Outside `bounds` it is the cell
    /// that the tree's planes lead to.
    pub fn at(&self, point: Vec3) -> Option<CellId> {
        self.at_own(self.axes.own(point))
    }

    /// The cell that contains a point, given in own axes; otherwise like [`Cells::at`].
    pub fn at_own(&self, point: Vec3) -> Option<CellId> {
        let mut node = 0;
        loop {
            let (is_greater, sides) = match self.tree[node] {
                Node::Leaf(cell) => return Some(cell),
                Node::Solid => return None,
                Node::Axial { axis, at, sides } => (point[usize::from(axis)] >= at, sides),
                Node::Plane { normal, distance, sides } => {
                    (normal.dot(point.as_dvec3()) >= distance, sides)
                }
            };
            node = sides[usize::from(is_greater)] as usize;
        }
    }

    /// The cell that contains a point, given in the world's axes. For a point in a solid leaf, the
    /// nearest cell within [`ASTRAY_M`].
    pub fn near(&self, point: Vec3) -> Option<CellId> {
        self.near_own(self.axes.own(point))
    }

    /// The cell that contains a point, given in own axes, or is near it; otherwise like
    /// [`Cells::near`].
    pub fn near_own(&self, point: Vec3) -> Option<CellId> {
        self.at_own(point).or_else(|| {
            let mut found = Vec::new();
            self.descend(0, &Aabb::around(point, ASTRAY_M), &mut found);
            let away = |cell: &CellId| {
                let bounds = &self.cells[cell.0 as usize].bounds;
                point.clamp(bounds.min, bounds.max).distance_squared(point)
            };
            found.into_iter().min_by(|a, b| away(a).total_cmp(&away(b)).then(a.cmp(b)))
        })
    }

    /// Appends every cell that shares a point with a box along own axes, boundaries included, in
    /// ascending order. A cell that is not a box may be found although it only comes near.
    pub fn overlapping(&self, region: &Aabb, found: &mut Vec<CellId>) {
        debug_assert!(!self.tree.is_empty(), "a subdivision has at least a leaf");
        let start = found.len();
        self.descend(0, region, found);
        found[start..].sort_unstable();
    }

    fn descend(&self, node: u32, region: &Aabb, found: &mut Vec<CellId>) {
        let (low, high, sides) = match self.tree[node as usize] {
            Node::Solid => return,
            Node::Leaf(cell) => return found.push(cell),
            Node::Axial { axis, at, sides } => {
                let axis = usize::from(axis);
                (region.min[axis] <= at, region.max[axis] >= at, sides)
            }
            Node::Plane { normal, distance, sides } => {
                let centre = region.centre().as_dvec3();
                let away = normal.dot(centre) - distance;
                let reach = normal.abs().dot(region.size().as_dvec3() * 0.5) + SLANTED_PLANE_M;
                (away <= reach, away >= -reach, sides)
            }
        };
        if low {
            self.descend(sides[0], region, found);
        }
        if high {
            self.descend(sides[1], region, found);
        }
    }

    /// Whether some point of one cell may be visible from some point of the other.
    pub fn sees(&self, from: CellId, to: CellId) -> bool {
        debug_assert!((to.0 as usize) < self.cells.len(), "no cell has the number {}", to.0);
        self.pvs[from.0 as usize].contains(to.0)
    }

    /// The share of all pairs of cells that the PVS contains, from 0 to 1.
    pub fn density(&self) -> f64 {
        let pairs: u64 = self.pvs.iter().map(RoaringBitmap::len).sum();
        pairs as f64 / (self.cells.len() as f64).powi(2)
    }

    /// The cells that may be visible from the cell of a point, given in the world's axes. Empty
    /// when there is no cell near it.
    pub fn visible_from_point(&self, point: Vec3) -> RoaringBitmap {
        self.near(point).map_or_else(RoaringBitmap::new, |cell| self.pvs[cell.0 as usize].clone())
    }

    /// The cells that may be visible from some point of a box along own axes.
    pub fn visible_from(&self, region: &Aabb) -> RoaringBitmap {
        let mut cells = Vec::new();
        self.overlapping(region, &mut cells);
        cells.iter().fold(RoaringBitmap::new(), |all, cell| all | &self.pvs[cell.0 as usize])
    }
}
