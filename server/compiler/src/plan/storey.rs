//! The picture of one storey.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;
use sightline_picture::Picture;
use sightline_world::{CellId, Portal, World};

use super::{
    grid,
    overlay::{Mark, draw_mark},
    rooms,
    sheet::{CAPTION_PX, GLASS, Level, PORTAL},
    walls,
};
use crate::{
    drawing::{INK, PAPER, mixed, stacked, write_sized},
    storeys::{FLOOR_DEPTH, cell_at},
};

/// Rounding puts feet below their storey by no more than this, in metres.
const SOLE_TOLERANCE: f32 = 0.1;

/// The picture of one storey.
pub(super) struct Storey<'a> {
    pub(super) level: Level<'a>,
    /// Avatars whose feet are at these heights are drawn on this storey.
    pub(super) holds: Range<f32>,
}

/// What the cut shows at a pixel.
#[derive(Clone, Copy)]
struct Spot {
    cell: Option<CellId>,
    /// The colour of what is cut, or of the floor below; none where there is neither.
    surface: Option<[u8; 3]>,
    /// Whether the cut itself meets something.
    is_cut: bool,
}

impl Storey<'_> {
    /// Draws the storey, with a caption.
    pub(super) fn draw(&self) -> Picture {
        let Level { sheet, feet } = self.level;
        let overlay = sheet.overlay;
        let (width, height) = sheet.size();
        let spots: Vec<Vec<Spot>> = (0..height)
            .into_par_iter()
            .map(|row| (0..width).map(|column| self.spot(column, row)).collect())
            .collect();
        let floor = self.panel(&spots, &|spot| self.floor_colour(spot));
        let mut picture = if overlay.density {
            let density = self.panel(&spots, &|spot| self.density_colour(spot));
            stacked(&[floor, density], 2)
        } else {
            floor
        };
        let mut caption = format!("{}, floor at {:.1} m", sheet.world.title, feet);
        // The title may be long and the building narrow.
        let room = picture.width() as usize / 16;
        if caption.len() > room {
            caption = format!("floor at {feet:.1} m");
        }
        write_sized(&mut picture, [4, 6], 2, &caption, INK);
        picture
    }

    /// Draws one panel of the storey. `colour` gives the colour of each pixel.
    fn panel(&self, spots: &[Vec<Spot>], colour: &dyn Fn(&Spot) -> [u8; 3]) -> Picture {
        let (width, height) = self.level.sheet.size();
        let overlay = self.level.sheet.overlay;
        let mut picture = Picture::filled(width, height + CAPTION_PX, PAPER);
        for (y, row) in spots.iter().enumerate() {
            for (x, spot) in row.iter().enumerate() {
                let right = row.get(x + 1).unwrap_or(spot);
                let below = spots.get(y + 1).map_or(spot, |row| &row[x]);
                let is_edge = spot.cell != right.cell || spot.cell != below.cell;
                let mut colour = colour(spot);
                if overlay.cells && is_edge && !spot.is_cut {
                    colour = mixed(colour, INK, if spot.surface.is_some() { 0.22 } else { 0.10 });
                }
                if let Some(pixel) = picture.pixel_mut(x as u32, y as u32 + CAPTION_PX) {
                    *pixel = colour;
                }
            }
        }
        if overlay.cells {
            self.draw_portals(spots, &mut picture);
        }
        walls::draw(&self.level, &mut picture);
        if overlay.rooms {
            rooms::draw(&self.level, &mut picture);
        }
        if overlay.grid {
            grid::draw(&self.level, &mut picture);
        }
        for mark in overlay.marks.iter().filter(|mark| self.holds(mark.eye)) {
            self.draw_mark(&mut picture, mark);
        }
        picture
    }

    /// Whether an avatar is drawn on this storey.
    fn holds(&self, eye: Vec3) -> bool {
        let feet = eye.y - self.level.sheet.world.body.below_eye;
        self.holds.contains(&(feet + SOLE_TOLERANCE))
    }

    /// What the cut meets at a pixel, or else the floor below it.
    fn spot(&self, column: u32, row: u32) -> Spot {
        let world = self.level.sheet.world;
        let at = self.level.point(column, row);
        let cell = cell_at(world, at);
        let octree = &world.octree;
        if let Some(node) = octree.leaf_at(at) {
            let surface = Some(if node.is_glass() { GLASS } else { INK });
            return Spot { cell, surface, is_cut: true };
        }
        let floor = octree.first_below(at, self.level.feet - FLOOR_DEPTH);
        let surface = floor.map(|(_, material)| lightened(material.colour));
        Spot { cell, surface, is_cut: false }
    }

    fn floor_colour(&self, spot: &Spot) -> [u8; 3] {
        let Some(colour) = spot.surface else { return PAPER };
        let visible = self.level.sheet.overlay.visible.as_ref();
        let is_bright =
            visible.is_none_or(|visible| spot.cell.is_some_and(|cell| visible.contains(cell.0)));
        if is_bright { colour } else { dimmed(colour) }
    }

    fn density_colour(&self, spot: &Spot) -> [u8; 3] {
        match (spot.cell, spot.surface) {
            (_, Some(colour)) if spot.is_cut => colour,
            (None, _) => PAPER,
            (Some(cell), Some(_)) => self.level.sheet.density_colour(cell),
            // An eye may look there, but nobody can stand there.
            (Some(cell), None) => mixed(self.level.sheet.density_colour(cell), PAPER, 0.75),
        }
    }

    /// Draws the portals that the cut meets; fainter where there is no floor.
    fn draw_portals(&self, spots: &[Vec<Spot>], picture: &mut Picture) {
        let world = self.level.sheet.world;
        for portal in &world.cells.portals {
            let Some(ends) = across(world, portal, self.level.height()) else { continue };
            let [from, to] = ends.map(|end| self.level.place(end));
            let steps = (to - from).abs().max_element().ceil().clamp(1.0, 1e5) as i32;
            for step in 0..=steps {
                let at = from.lerp(to, step as f32 / steps as f32);
                let (x, y) = (at.x as i32, at.y as i32);
                let spot = usize::try_from(y - CAPTION_PX as i32).ok().and_then(|y| spots.get(y));
                let spot = spot.zip(usize::try_from(x).ok()).and_then(|(row, x)| row.get(x));
                let Some(spot) = spot.filter(|spot| !spot.is_cut && spot.cell.is_some()) else {
                    continue;
                };
                let Some(pixel) = picture.pixel_mut(x as u32, y as u32) else {
                    continue;
                };
                let share = if spot.surface.is_some() { 0.7 } else { 0.2 };
                *pixel = mixed(*pixel, PORTAL, share);
            }
        }
    }

    fn draw_mark(&self, picture: &mut Picture, mark: &Mark) {
        let radius = (0.3 * self.level.sheet.px_per_m).max(3.5);
        draw_mark(picture, self.level.place(mark.eye), radius, mark);
    }
}

fn lightened(colour: [u8; 3]) -> [u8; 3] {
    colour.map(|c| c / 2 + 120)
}

fn dimmed(colour: [u8; 3]) -> [u8; 3] {
    let grey = colour.iter().map(|&c| u16::from(c)).sum::<u16>() / 3;
    [(grey * 11 / 20) as u8; 3]
}

/// The segment in which a level cut meets a portal.
fn across(world: &World, portal: &Portal, height: f32) -> Option<[Vec3; 2]> {
    let ends = portal.polygon.across(height)?;
    Some(ends.map(|end| world.cells.axes.world(end)))
}
