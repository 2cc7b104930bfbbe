//! Plans: pictures of a world from above, storey by storey.
//!
//! A plan shows cells and portals, rooms, how much of the building each cell may see, and where
//! avatars are. Each storey is cut 1.3 m above its floor (`storeys.rs`).
//!
//! * `sheet`: the scale, and the level cut through each storey.
//! * `storey`: the picture of one storey; `rooms` draws the declared rooms on it.
//! * `walls`: which walls hide people.
//! * `grid`: coordinates.
//! * `legend`: what marks and colours mean.

mod grid;
mod legend;
mod overlay;
mod rooms;
mod sheet;
mod storey;
mod walls;

use std::ops::Range;

use sightline_picture::Picture;
use sightline_world::World;

use crate::{drawing::stacked, storeys};
pub use overlay::{Mark, Overlay};
use sheet::{Level, Sheet};
use storey::Storey;

/// The width of a picture, in pixels, unless a single storey is wider.
const WIDTH_PX_MAX: u32 = 3600;

/// Draws every storey that has a spawn point or another floor, lowest first, row by row. An avatar
/// between two storeys is drawn on the lower one.
pub fn draw(world: &World, overlay: &Overlay) -> Picture {
    let area = storeys::area(world);
    let floors = storeys::storeys_within(world, &area);
    let sheet = Sheet::new(world, overlay, area, floors.len());
    let panels: Vec<Picture> = levels(&sheet, &floors).map(|storey| storey.draw()).collect();
    let grid = in_grid(&panels);
    match &overlay.legend {
        Some(names) => stacked(&[grid, legend::draw(&sheet, names)], 1),
        None => grid,
    }
}

/// The storeys with these floors, lowest first.
fn levels<'a>(sheet: &'a Sheet<'a>, floors: &'a [f32]) -> impl Iterator<Item = Storey<'a>> + 'a {
    floors.iter().enumerate().map(move |(i, &feet)| {
        let above = floors.get(i + 1).copied().unwrap_or(f32::INFINITY);
        let below = if i == 0 { f32::NEG_INFINITY } else { feet };
        Storey { level: Level { sheet, feet }, holds: below..above }
    })
}

/// The plan of one storey, and where places are on it.
#[derive(Clone, Debug)]
pub struct StoreyPlan {
    /// The picture.
    pub picture: Picture,
    /// Avatars whose feet are at these heights are on this storey, in metres. They are infinite
    /// below the lowest storey and above the highest.
    pub feet: Range<f32>,
    /// The height at which the storey is cut, in metres.
    pub cut: f32,
    /// The x and z of the upper left corner of the picture, in metres.
    pub corner: [f32; 2],
    /// The scale, in pixels per metre: x to the right and z downwards.
    pub px_per_m: f32,
}

/// The plans of all storeys, lowest first.
pub fn by_storey(world: &World) -> Vec<StoreyPlan> {
    let area = storeys::area(world);
    let floors = storeys::storeys_within(world, &area);
    let overlay = Overlay::default();
    let sheet = Sheet::new(world, &overlay, area, floors.len());
    let plans = levels(&sheet, &floors).map(|storey| {
        let corner = storey.level.corner();
        StoreyPlan {
            picture: storey.draw(),
            feet: storey.holds,
            cut: storey.level.height(),
            corner: [corner.x, corner.y],
            px_per_m: sheet.px_per_m,
        }
    });
    plans.collect()
}

/// Puts panels of one size into columns, so that the whole is about 1.5 times as wide as high.
fn in_grid(panels: &[Picture]) -> Picture {
    let (width, height) = panels.first().map_or((1, 1), Picture::dimensions);
    let shape = panels.len() as f32 * height as f32 / width as f32;
    let columns = ((1.5 * shape).sqrt().round() as u32).min(WIDTH_PX_MAX / width);
    stacked(panels, columns.max(1) as usize)
}

#[cfg(test)]
mod tests;
