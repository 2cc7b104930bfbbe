//! The spatial subdivision: a tree of planes whose leaves are cells, the portals between them, the
//! PVS; and the spaces that the cells are parts of, with the gates between those.

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
    /// The smallest box around it, in metres and own axes. Most cells are boxes and fill theirs.
    pub bounds: Aabb,
    /// Index into [`Cells::spaces`]: the space it is a part of.
    pub space: u32,
    /// Indices into [`Cells::portals`], ascending.
    pub portals: Vec<u32>,
}

/// A convex polygon through which one can see from a cell into another.
#[derive(Clone, Debug, PartialEq)]
pub struct Portal {
    /// The cells on the lesser and the greater side.
    pub cells: [CellId; 2],
    /// The polygon.
    pub polygon: Polygon,
}

/// A convex part of the building between occluders: it may be one cell or many. Sight lines are
/// propagated from space to space, since all that occludes lies between spaces.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// The smallest box around it, in metres and own axes.
    pub bounds: Aabb,
    /// Its cells. They cover it.
    pub cells: Range<u32>,
    /// Indices into [`Cells::gates`], ascending.
    pub gates: Vec<u32>,
}

/// A convex polygon through which one can see from a space into another: the portals between their
/// cells, joined.
#[derive(Clone, Debug, PartialEq)]
pub struct Gate {
    /// Indices of the spaces on the lesser and the greater side.
    pub spaces: [u32; 2],
    /// The polygon.
    pub polygon: Polygon,
}

/// A convex polygon, in metres and own axes.
#[derive(Clone, Debug, PartialEq)]
pub enum Polygon {
    /// A rectangle with edges along the axes.
    Rectangle {
        /// Which axis it is perpendicular to: 0, 1 or 2.
        axis: u8,
        /// The rectangle: a box of no width along `axis`.
        bounds: Aabb,
    },
    /// Any other.
    Other {
        /// Of unit length, towards the greater side.
        normal: DVec3,
        /// At least three, in order around the polygon.
        corners: Box<[Vec3]>,
    },
}

impl Polygon {
    /// The smallest box around it.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Rectangle { bounds, .. } => *bounds,
            Self::Other { corners, .. } => Aabb::from_points(corners.iter().copied()),
        }
    }
}

impl Polygon {
    /// The line that a horizontal plane at a height, in metres, shares with it; none when it
    /// is level or elsewhere.
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

/// A node of the tree.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Node {
    /// An axial plane, and the nodes on its lesser and greater side.
    Axial {
        /// Which axis it is perpendicular to: 0, 1 or 2.
        axis: u8,
        /// Where, in metres.
        at: f32,
        /// Indices into [`Cells::tree`], both greater than this node's own.
        sides: [u32; 2],
    },
    /// Any plane, and the nodes behind and in front of it.
    Plane {
        /// Of unit length.
        normal: DVec3,
        /// From the origin along the normal, in metres.
        distance: f64,
        /// Indices into [`Cells::tree`], both greater than this node's own.
        sides: [u32; 2],
    },
    /// A leaf in which an eye can be.
    Leaf(CellId),
    /// A leaf that is opaque all through, or that no sight line from a spawn point gets into.
    Solid,
}

/// For each cell, the cells of which some point is visible from some point of it: never too few.
/// Symmetric, and each cell sees itself.
pub type Pvs = Vec<RoaringBitmap>;

/// All of the subdivision. Cells do not overlap; cells and solid leaves cover `bounds`.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// The building's own axes, in which all that follows is given.
    pub axes: Axes,
    /// What is subdivided, in metres.
    pub bounds: Aabb,
    /// The planes; the root comes first. Never empty.
    pub tree: Vec<Node>,
    /// The leaves, those of one space one after another.
    pub cells: Vec<Cell>,
    /// Where they join.
    pub portals: Vec<Portal>,
    /// What the cells are parts of.
    pub spaces: Vec<Space>,
    /// Where the spaces join.
    pub gates: Vec<Gate>,
    /// Who sees whom.
    pub pvs: Pvs,
}

impl Cells {
    /// A subdivision of one cell.
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

    /// The cell that contains a point of the world; none where it is solid. On a shared boundary
    /// it is the one on the greater side; outside `bounds` the nearest by the tree's planes.
    pub fn at(&self, point: Vec3) -> Option<CellId> {
        self.at_own(self.axes.own(point))
    }

    /// Likewise, of a point in own axes.
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

    /// The cell that contains a point of the world, or one that is a hand's breadth away when the
    /// point is in something solid.
    pub fn near(&self, point: Vec3) -> Option<CellId> {
        self.near_own(self.axes.own(point))
    }

    /// Likewise, of a point in own axes.
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

    /// Appends every cell that shares a point with a box in own axes, boundaries included;
    /// ascending. Cells that are no boxes may be found when they only come near.
    pub fn overlapping(&self, region: &Aabb, found: &mut Vec<CellId>) {
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
                // What single precision may lose, and a little more.
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
        self.pvs[from.0 as usize].contains(to.0)
    }

    /// The part of all pairs of cells that the PVS holds, from 0 to 1.
    pub fn density(&self) -> f64 {
        let pairs: u64 = self.pvs.iter().map(RoaringBitmap::len).sum();
        pairs as f64 / (self.cells.len() as f64).powi(2)
    }

    /// The cells that may be visible from the cell of a point; none when that is solid.
    pub fn visible_from_point(&self, point: Vec3) -> RoaringBitmap {
        self.near(point).map_or_else(RoaringBitmap::new, |cell| self.pvs[cell.0 as usize].clone())
    }

    /// The cells that may be visible from somewhere in a box in own axes.
    pub fn visible_from(&self, region: &Aabb) -> RoaringBitmap {
        let mut cells = Vec::new();
        self.overlapping(region, &mut cells);
        cells.iter().fold(RoaringBitmap::new(), |all, cell| all | &self.pvs[cell.0 as usize])
    }
}
