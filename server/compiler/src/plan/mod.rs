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
    let storeys = storeys::storeys_within(world, &area);
    let sheet = Sheet::new(world, overlay, area, storeys.len());
    let panels: Vec<Picture> = storeys
        .iter()
        .enumerate()
        .map(|(i, &feet)| {
            let above = storeys.get(i + 1).copied().unwrap_or(f32::INFINITY);
            let below = if i == 0 { f32::NEG_INFINITY } else { feet };
            let level = Level { sheet: &sheet, feet };
            Storey { level, holds: below..above }.draw()
        })
        .collect();
    let grid = in_grid(&panels);
    match &overlay.legend {
        Some(names) => stacked(&[grid, legend::draw(&sheet, names)], 1),
        None => grid,
    }
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
