//! The scale of a plan, and the level cuts through its storeys.

use glam::{Vec2, Vec3};
use sightline_world::{CellId, World, geometry::Aabb};

use super::overlay::Overlay;
use crate::{drawing::heat, storeys::CUT_HEIGHT};

/// The longest side of one storey's picture, in pixels: when there are few storeys, and many.
const SIDE_PX_MAX: [f32; 2] = [1100.0, 800.0];

/// This many storeys are still few.
const STOREYS_FEW: usize = 3;

/// The largest scale, in pixels per metre.
const PX_PER_M_MAX: f32 = 24.0;

/// The height of a caption, in pixels.
pub(super) const CAPTION_PX: u32 = 28;

/// Glass, in sRGB.
pub(super) const GLASS: [u8; 3] = [140, 190, 225];

/// Portals, in sRGB.
pub(super) const PORTAL: [u8; 3] = [30, 110, 220];

/// What the pictures of all storeys share.
pub(super) struct Sheet<'a> {
    pub(super) world: &'a World,
    pub(super) overlay: &'a Overlay,
    /// The part of the world that is drawn.
    area: Aabb,
    pub(super) px_per_m: f32,
    /// The part of all cells that each cell may see.
    densities: Vec<f32>,
    pub(super) density_max: f32,
}

impl<'a> Sheet<'a> {
    pub(super) fn new(world: &'a World, overlay: &'a Overlay, area: Aabb, storeys: usize) -> Self {
        let side_px = SIDE_PX_MAX[usize::from(storeys > STOREYS_FEW)];
        let px_per_m = (side_px / area.size().x.max(area.size().z)).min(PX_PER_M_MAX);
        assert!(px_per_m > 0.0, "the area has a size");
        let all = world.cells.cells.len() as f32;
        let densities: Vec<f32> =
            world.cells.pvs.iter().map(|row| row.len() as f32 / all).collect();
        let density_max = densities.iter().copied().fold(0.0, f32::max);
        Self { world, overlay, area, px_per_m, densities, density_max }
    }

    /// The size of one panel without its caption, in pixels.
    pub(super) fn size(&self) -> (u32, u32) {
        let size = (self.area.size() * self.px_per_m).ceil();
        (size.x.max(1.0) as u32, size.z.max(1.0) as u32)
    }

    /// The colour of how many cells a cell may see.
    pub(super) fn density_colour(&self, cell: CellId) -> [u8; 3] {
        heat(self.densities[cell.0 as usize] / self.density_max.max(f32::MIN_POSITIVE))
    }
}

/// A level cut through one storey.
pub(super) struct Level<'a> {
    pub(super) sheet: &'a Sheet<'a>,
    /// The height of the floor, in metres.
    pub(super) feet: f32,
}

impl Level<'_> {
    /// The height of the cut, in metres.
    pub(super) fn height(&self) -> f32 {
        self.feet + CUT_HEIGHT
    }

    /// The point at the cut that a pixel of a panel shows.
    pub(super) fn point(&self, column: u32, row: u32) -> Vec3 {
        let step = Vec3::new(column as f32 + 0.5, 0.0, row as f32 + 0.5) / self.sheet.px_per_m;
        (self.sheet.area.min + step).with_y(self.height())
    }

    /// The x and z of the upper left corner of the picture, caption included.
    pub(super) fn corner(&self) -> Vec2 {
        let min = self.sheet.area.min;
        Vec2::new(min.x, min.z - CAPTION_PX as f32 / self.sheet.px_per_m)
    }

    /// The place of a point on the picture, below the caption, in pixels.
    pub(super) fn place(&self, at: Vec3) -> Vec2 {
        let step = (at - self.sheet.area.min) * self.sheet.px_per_m;
        Vec2::new(step.x, step.z + CAPTION_PX as f32)
    }
}
