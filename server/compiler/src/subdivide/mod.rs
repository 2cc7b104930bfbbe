//! Cells and portals: space split along what occludes, and the open part of each boundary.
//!
//! Space is split in two steps, by one [`BspTree`](bsp_tree::BspTree) each:
//!
//! 1. [`Spaces`] are convex regions. They lie between the solids of a model that has solids
//!    (`solids`), else between its opaque surfaces (`surfaces`). Two spaces join at *gates*.
//! 2. [`cells()`] splits each space further: from one part of a hall much less is visible than from
//!    the whole hall. Two cells join at *portals*.

mod bsp_tree;
mod cells;
mod polygon;
mod region;
mod solids;
mod spaces;
mod surfaces;

use glam::Vec3;

use crate::{model::ConvexSolid, occluders::OccluderPlane};

pub(crate) use cells::cells;
pub(crate) use spaces::Spaces;
/// What occludes.
pub struct SubdivisionInput<'a> {
    /// Opaque surfaces, by plane, in own axes.
    pub planes: &'a [OccluderPlane],
    /// What is opaque all through. When there is any, surfaces do not count: they are its faces.
    pub solids: &'a [ConvexSolid],
    /// Eyes are sure to be in some of these places; spaces between solids that no sight line from
    /// there gets into count as solid.
    pub eyes: &'a [Vec3],
}

/// How finely spaces are split into cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellSize {
    /// No cell is wider, in metres.
    pub width_max: f32,
    /// No cell is higher, in metres.
    pub height_max: f32,
}

impl CellSize {
    /// Every space is one cell.
    pub const WHOLE: Self = Self { width_max: f32::INFINITY, height_max: f32::INFINITY };

    /// Cells of this width, in metres. They are higher than wide, since eyes move on floors.
    pub fn of_width(width_max: f32) -> Self {
        Self { width_max, height_max: width_max * 1.5 }
    }

    /// Into how many cells a box of this size is split, roughly.
    pub fn cells_in(&self, size: Vec3) -> f64 {
        let cell = Vec3::new(self.width_max, self.height_max, self.width_max);
        (size / cell).ceil().max(Vec3::ONE).as_dvec3().element_product()
    }
}

#[cfg(test)]
mod tests;
