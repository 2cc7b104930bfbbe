//! Plan pictures: a world from above, storey by storey, with who is where and what may be seen.

use std::ops::Range;

use font8x8::UnicodeFonts;
use glam::{Vec2, Vec3};
use image::{Rgb, RgbImage};
use rayon::prelude::*;
use roaring::RoaringBitmap;
use sightline_shared::{
    geometry::Aabb,
    world::{CellId, World},
};

/// Storeys are cut this far above their floor, in metres: above tables, below lintels.
const CUT_HEIGHT: f32 = 1.3;
/// Floors this far below the lowest feet are still drawn, in metres.
const FLOOR_DEPTH: f32 = 1.0;
/// Feet whose heights differ by less stand on one storey, in metres.
const STOREY_APART: f32 = 2.0;
/// Longest side of one storey's picture, in pixels.
const SIDE_PX_MAX: f32 = 1100.0;
/// Feet stand this far below a storey, by rounding, in metres.
const SOLE_TOLERANCE: f32 = 0.1;
const GAP_PX: u32 = 12;
const CAPTION_PX: u32 = 20;

const PAPER: [u8; 3] = [250, 250, 247];
const INK: [u8; 3] = [40, 42, 48];
const GLASS: [u8; 3] = [140, 190, 225];
const PORTAL: [u8; 3] = [30, 110, 220];

/// Somebody, on a plan.
#[derive(Clone, Debug)]
pub struct Mark {
    /// The eye, in metres.
    pub eye: Vec3,
    /// The direction of sight, for one who is drawn with it.
    pub forward: Option<Vec3>,
    /// sRGB.
    pub colour: [u8; 3],
    /// Filled, or only a ring.
    pub filled: bool,
}

/// What to draw over the building.
#[derive(Clone, Debug, Default)]
pub struct Overlay {
    /// Who is where.
    pub marks: Vec<Mark>,
    /// Cells that stay bright; the others are dimmed. All are bright when absent.
    pub visible: Option<RoaringBitmap>,
    /// Whether to draw the portals that the cut meets.
    pub portals: bool,
}

/// Draws all storeys on which somebody may begin, lowest first, one below the other. Who is between
/// two storeys is drawn on the lower one.
pub fn draw(world: &World, overlay: &Overlay) -> RgbImage {
    let storeys = storeys(world);
    let panels: Vec<RgbImage> = storeys
        .iter()
        .enumerate()
        .map(|(i, &feet)| {
            let above = storeys.get(i + 1).copied().unwrap_or(f32::INFINITY);
            let below = if i == 0 { f32::NEG_INFINITY } else { feet };
            Storey::new(world, feet, below..above).draw(overlay)
        })
        .collect();
    let width = panels.iter().map(RgbImage::width).max().unwrap_or(1);
    let height = panels.iter().map(|panel| panel.height() + GAP_PX).sum::<u32>().max(1);
    let mut picture = RgbImage::from_pixel(width, height, Rgb(PAPER));
    let mut top = 0;
    for panel in panels {
        image::imageops::replace(&mut picture, &panel, 0, i64::from(top));
        top += panel.height() + GAP_PX;
    }
    picture
}

/// The heights of the soles of those who begin there, one for each storey, ascending.
fn storeys(world: &World) -> Vec<f32> {
    let feet = world.spawns.iter().map(|spawn| spawn.eye.y - world.body.below_eye);
    let mut feet: Vec<f32> = feet.collect();
    feet.sort_unstable_by(f32::total_cmp);
    feet.dedup_by(|a, b| *a - *b < STOREY_APART);
    feet
}

/// One storey's picture in the making.
struct Storey<'a> {
    world: &'a World,
    feet: f32,
    /// Whose soles are at these heights is drawn here.
    holds: Range<f32>,
    area: Aabb,
    px_per_m: f32,
}

impl<'a> Storey<'a> {
    fn new(world: &'a World, feet: f32, holds: Range<f32>) -> Self {
        let octree = world.octree.bounds();
        let area = world.bounds().intersection(&octree.grown(1.0));
        let size = area.size();
        let px_per_m = (SIDE_PX_MAX / size.x.max(size.z)).min(24.0);
        Self { world, feet, holds, area, px_per_m }
    }

    fn draw(&self, overlay: &Overlay) -> RgbImage {
        let size = (self.area.size() * self.px_per_m).ceil();
        let (width, height) = (size.x.max(1.0) as u32, size.z.max(1.0) as u32);
        let mut picture = RgbImage::from_pixel(width, height + CAPTION_PX, Rgb(PAPER));
        let rows: Vec<Vec<[u8; 3]>> = (0..height)
            .into_par_iter()
            .map(|row| (0..width).map(|column| self.pixel(column, row, overlay)).collect())
            .collect();
        for (y, row) in (0..).zip(&rows) {
            for (x, &colour) in (0..).zip(row) {
                picture.put_pixel(x, y + CAPTION_PX, Rgb(colour));
            }
        }
        if overlay.portals {
            self.draw_portals(&mut picture);
        }
        for mark in overlay.marks.iter().filter(|mark| self.holds(mark.eye)) {
            self.draw_mark(&mut picture, mark);
        }
        let caption = format!("{}, floor at {:.1} m", self.world.title, self.feet);
        write(&mut picture, 4, 6, &caption, INK);
        picture
    }

    fn cut(&self) -> f32 {
        self.feet + CUT_HEIGHT
    }

    fn holds(&self, eye: Vec3) -> bool {
        let feet = eye.y - self.world.body.below_eye;
        self.holds.contains(&(feet + SOLE_TOLERANCE))
    }

    /// The colour of a place: cut walls dark, else the floor below the cut.
    fn pixel(&self, column: u32, row: u32, overlay: &Overlay) -> [u8; 3] {
        let step = Vec3::new(column as f32 + 0.5, 0.0, row as f32 + 0.5) / self.px_per_m;
        let mut at = self.area.min + step;
        at.y = self.cut();
        let cell = self.world.cells.at(at);
        let octree = &self.world.octree;
        let mut colour = None;
        if let Some(node) = octree.leaf_at(at) {
            colour = Some(if node.is_glass() { GLASS } else { INK });
        }
        while colour.is_none() && at.y > self.feet - FLOOR_DEPTH {
            at.y -= octree.voxel();
            colour = octree.leaf_at(at).map(|node| lightened(node.colour));
        }
        match colour {
            None => PAPER,
            Some(colour) if is_visible(overlay, cell) => colour,
            Some(colour) => dimmed(colour),
        }
    }

    fn place(&self, at: Vec3) -> Vec2 {
        let step = (at - self.area.min) * self.px_per_m;
        Vec2::new(step.x, step.z + CAPTION_PX as f32)
    }

    fn draw_portals(&self, picture: &mut RgbImage) {
        let cut = self.cut();
        for portal in &self.world.cells.portals {
            let b = portal.bounds;
            if portal.axis != 1 && b.min.y <= cut && cut <= b.max.y {
                line(picture, self.place(b.min), self.place(b.max), PORTAL);
            }
        }
    }

    fn draw_mark(&self, picture: &mut RgbImage, mark: &Mark) {
        let centre = self.place(mark.eye);
        let radius = (0.3 * self.px_per_m).max(3.5);
        let reach = radius.ceil() as i32 + 1;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let away = Vec2::new(dx as f32, dy as f32).length();
                let colour = match (away <= radius - 1.5, away <= radius) {
                    (true, _) if mark.filled => mark.colour,
                    (false, true) => {
                        if mark.filled {
                            INK
                        } else {
                            mark.colour
                        }
                    }
                    _ => continue,
                };
                put(picture, centre.x as i32 + dx, centre.y as i32 + dy, colour);
            }
        }
        if let Some(forward) = mark.forward {
            let along = Vec2::new(forward.x, forward.z).normalize_or_zero();
            line(picture, centre + along * radius, centre + along * radius * 3.0, mark.colour);
        }
    }
}

fn is_visible(overlay: &Overlay, cell: CellId) -> bool {
    overlay.visible.as_ref().is_none_or(|visible| visible.contains(cell.0))
}

fn lightened(colour: [u8; 3]) -> [u8; 3] {
    colour.map(|c| c / 2 + 120)
}

fn dimmed(colour: [u8; 3]) -> [u8; 3] {
    let grey = colour.iter().map(|&c| u16::from(c)).sum::<u16>() / 3;
    [(grey * 11 / 20) as u8; 3]
}

fn put(picture: &mut RgbImage, x: i32, y: i32, colour: [u8; 3]) {
    let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { return };
    if let Some(pixel) = picture.get_pixel_mut_checked(x, y) {
        *pixel = Rgb(colour);
    }
}

fn line(picture: &mut RgbImage, from: Vec2, to: Vec2, colour: [u8; 3]) {
    let steps = (to - from).abs().max_element().ceil().max(1.0) as i32;
    for step in 0..=steps {
        let at = from.lerp(to, step as f32 / steps as f32);
        put(picture, at.x as i32, at.y as i32, colour);
    }
}

/// Writes a line of text with its upper left corner at a pixel.
pub(crate) fn write(picture: &mut RgbImage, left: i32, top: i32, text: &str, colour: [u8; 3]) {
    for (i, character) in (0..).zip(text.chars()) {
        let Some(glyph) = font8x8::BASIC_FONTS.get(character) else { continue };
        for (y, row) in (0..).zip(glyph) {
            for x in (0..8).filter(|x| row & (1 << x) != 0) {
                put(picture, left + i * 8 + x, top + y, colour);
            }
        }
    }
}
