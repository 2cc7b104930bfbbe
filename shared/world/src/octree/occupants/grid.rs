//! The cells of every level, and the cells that a box overlaps.

use glam::{UVec3, Vec3};

use crate::geometry::Aabb;

/// The cubic region, divided into 2^`depth` cells along each axis at the deepest level.
#[derive(Clone, Debug)]
pub(super) struct OccupantGrid {
    pub(super) region: Aabb,
    pub(super) depth: u8,
    /// The number of cells of the deepest level per metre.
    scale: f32,
}

/// The cells that a box overlaps, at every level down to the one at which it is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CellRange {
    /// The first cell, in coordinates of the deepest level.
    pub(super) low: UVec3,
    /// The last cell, in coordinates of the deepest level.
    pub(super) high: UVec3,
    /// The level at which nodes keep the box. There it overlaps at most two cells along each axis.
    pub(super) level: u8,
}

/// The cell of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct GridCell {
    pub(super) depth: u8,
    pub(super) at: [u16; 3],
}

impl OccupantGrid {
    pub(super) fn new(region: Aabb, depth: u8) -> Self {
        Self { region, depth, scale: (1u32 << depth) as f32 / region.size().x }
    }

    /// The cells of a box that is to be kept. The root keeps boxes that reach out of the region.
    pub(super) fn span(&self, bounds: &Aabb) -> CellRange {
        let mut span = self.cells(bounds);
        span.level = 0;
        if self.region.contains_box(bounds) {
            let size_cells = bounds.size().max_element() * self.scale;
            // The level depends on the size alone, so that a moving body stays at one level.
            let shift = (size_cells.ceil() as u32).max(1).next_power_of_two().trailing_zeros();
            span.level = self.depth.saturating_sub(shift as u8);
            // By rounding, an edge may fall into the next cell.
            while span.level > 0 && span.width(self.depth - span.level) > 1 {
                span.level -= 1;
            }
        }
        // Without the finer bits, equal spans show that no node changes.
        let mask = !((1 << (self.depth - span.level)) - 1);
        CellRange { low: span.low & mask, high: span.high & mask, ..span }
    }

    /// The cells of a box of any size, at all levels.
    pub(super) fn cells(&self, bounds: &Aabb) -> CellRange {
        CellRange { low: self.cell(bounds.min), high: self.cell(bounds.max), level: self.depth }
    }

    /// The cell of a point. It is monotonic in each coordinate, so boxes that touch share a cell
    /// even after rounding.
    fn cell(&self, point: Vec3) -> UVec3 {
        let last = (1u32 << self.depth) - 1;
        ((point - self.region.min) * self.scale)
            .clamp(Vec3::ZERO, Vec3::splat(last as f32))
            .as_uvec3()
    }

    /// Whether a cell is one of the cells of a box.
    pub(super) fn meets(&self, cell: GridCell, span: &CellRange) -> bool {
        let shift = u32::from(self.depth - cell.depth);
        let at = cell.place();
        (span.low >> shift).cmple(at).all() && at.cmple(span.high >> shift).all()
    }

    /// The octants of a cell that a box overlaps, a bit each. The cell must be one of the box's.
    pub(super) fn octants(&self, cell: GridCell, span: &CellRange) -> u8 {
        debug_assert!(self.meets(cell, span), "the box must overlap the cell");
        let shift = u32::from(self.depth - cell.depth - 1);
        let middle = cell.place() * 2 + 1;
        let below = (span.low >> shift).cmplt(middle).bitmask() as usize;
        let above = (span.high >> shift).cmpge(middle).bitmask() as usize;
        (0..3).fold(0xff, |octants, axis| {
            let (low, high) = (below >> axis & 1 == 1, above >> axis & 1 == 1);
            octants & (if low { LOWER[axis] } else { 0 } | if high { !LOWER[axis] } else { 0 })
        })
    }

    /// The depth of the lowest node that contains these cells: their common ancestor, or higher if
    /// the level demands it.
    pub(super) fn common_depth(&self, span: &CellRange) -> u8 {
        let differ = span.low ^ span.high;
        let bits = u32::BITS - (differ.x | differ.y | differ.z).leading_zeros();
        (self.depth - bits as u8).min(span.level)
    }

    /// The cube of a cell, in metres.
    pub(super) fn bounds(&self, cell: GridCell) -> Aabb {
        let edge = self.region.size() / (1u32 << cell.depth) as f32;
        let min = self.region.min + cell.place().as_vec3() * edge;
        Aabb::new(min, min + edge)
    }
}

/// The octants in the lower half along each axis, a bit each.
const LOWER: [u8; 3] = [0b0101_0101, 0b0011_0011, 0b0000_1111];

impl CellRange {
    /// The range around both, with the higher of both levels.
    pub(super) fn union(&self, other: &Self) -> Self {
        let (low, high) = (self.low.min(other.low), self.high.max(other.high));
        Self { low, high, level: self.level.min(other.level) }
    }

    fn width(&self, shift: u8) -> u32 {
        ((self.high >> u32::from(shift)) - (self.low >> u32::from(shift))).max_element()
    }
}

impl GridCell {
    pub(super) const ROOT: Self = Self { depth: 0, at: [0; 3] };

    pub(super) fn child(self, octant: u8) -> Self {
        let at = |axis: usize| self.at[axis] << 1 | u16::from(octant >> axis & 1);
        Self { depth: self.depth + 1, at: [at(0), at(1), at(2)] }
    }

    pub(super) fn octant(self) -> u8 {
        (0..3).fold(0, |octant, axis| octant | (self.at[axis] as u8 & 1) << axis)
    }

    fn place(self) -> UVec3 {
        UVec3::from(self.at.map(u32::from))
    }
}
