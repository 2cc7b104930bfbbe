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
mod gate_rays;
mod polygon;
mod region;
mod solids;
mod spaces;
mod surfaces;
mod whole;

use glam::Vec3;

use crate::{model::ConvexSolid, occluders::OccluderPlane};

pub(crate) use cells::{CellGrain, cells};
pub(crate) use spaces::Spaces;
pub(crate) use whole::see_all;

/// What space is split along.
pub(crate) struct SubdivisionInput<'a> {
    /// Opaque surfaces by plane, in the building's own axes.
    pub planes: &'a [OccluderPlane],
    /// Opaque solids. When there are any, surfaces do not count: they are the faces of solids.
    pub solids: &'a [ConvexSolid],
    /// Points where eyes can be. A space between solids that no sequence of gates joins to one of
    /// them counts as solid.
    pub eyes: &'a [Vec3],
}

/// How finely spaces are split into cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CellSize {
    /// The width of the widest cell, in metres.
    pub width_max: f32,
    /// The height of the highest cell, in metres.
    pub height_max: f32,
}

impl CellSize {
    /// Cells of this width, in metres. Cells are higher than wide, since eyes move on floors.
    pub(crate) fn of_width(width_max: f32) -> Self {
        Self { width_max, height_max: width_max * 1.5 }
    }

    /// About how many cells a box of this size is split into.
    pub(crate) fn cells_in(&self, size: Vec3) -> f64 {
        let cell = Vec3::new(self.width_max, self.height_max, self.width_max);
        (size / cell).ceil().max(Vec3::ONE).as_dvec3().element_product()
    }
}

#[cfg(test)]
mod tests;
