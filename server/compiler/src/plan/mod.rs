//! Plan pictures: a world from above, storey by storey: its cells and portals, how much can be seen
//! from where, and who is where.

mod floors;
mod ink;
mod legend;
mod rooms;

use std::ops::Range;

use glam::{Vec2, Vec3};
use image::{Rgb, RgbImage};
use rayon::prelude::*;
use roaring::RoaringBitmap;
use sightline_world::{CellId, Portal, World, geometry::Aabb};

pub(crate) use ink::{INK, PAPER, write};
use ink::{heat, line, mixed, ring, write_sized};

/// Storeys are cut this far above their floor, in metres: above tables, below lintels.
const CUT_HEIGHT: f32 = 1.3;
/// Floors this far below the lowest feet are still drawn, in metres.
const FLOOR_DEPTH: f32 = 1.0;
/// Longest side of one storey's picture, in pixels: of a few storeys, and of many.
const SIDE_PX_MAX: [f32; 2] = [1100.0, 800.0];
const STOREYS_FEW: usize = 3;
/// No picture is wider, in pixels, unless a storey is.
const WIDTH_PX_MAX: u32 = 3600;
const PX_PER_M_MAX: f32 = 24.0;
/// Around the building, in metres.
const MARGIN: f32 = 1.0;
/// Feet stand this far below a storey, by rounding, in metres.
const SOLE_TOLERANCE: f32 = 0.1;
const GAP_PX: u32 = 12;
const CAPTION_PX: u32 = 28;

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
    /// Whether to draw the cells' outlines and the portals that the cut meets.
    pub cells: bool,
    /// Whether to draw the rooms that an author declares, with their windows and names.
    pub rooms: bool,
    /// Whether to draw, beside each storey, how much of the building each cell may see.
    pub density: bool,
    /// Below all, what the marks and colours mean: a name for each colour of mark. None without.
    pub legend: Option<Vec<(&'static str, Mark)>>,
}

/// Draws the storeys on which somebody may begin, and those that have other floors, lowest first,
/// row by row. Who is between two storeys is drawn on the lower one.
pub fn draw(world: &World, overlay: &Overlay) -> RgbImage {
    let area = area(world);
    let storeys = floors::storeys(world, &area);
    let sheet = Sheet::new(world, overlay, area, storeys.len());
    let panels: Vec<RgbImage> = storeys
        .iter()
        .enumerate()
        .map(|(i, &feet)| {
            let above = storeys.get(i + 1).copied().unwrap_or(f32::INFINITY);
            let below = if i == 0 { f32::NEG_INFINITY } else { feet };
            Storey { sheet: &sheet, feet, holds: below..above }.draw()
        })
        .collect();
    let grid = in_grid(&panels);
    match &overlay.legend {
        Some(names) => stacked(&[grid, legend::draw(&sheet, names)], 1),
        None => grid,
    }
}

/// The heights of the storeys' floors, ascending.
pub fn storeys(world: &World) -> Vec<f32> {
    floors::storeys(world, &area(world))
}

/// What of the world is drawn: all that is opaque, and a little around it.
fn area(world: &World) -> Aabb {
    let opaque = Aabb::from_points(world.mesh.positions.iter().copied());
    let whole = if opaque.is_empty() { world.octree.bounds() } else { opaque };
    let area = whole.grown(MARGIN).intersection(&world.bounds());
    if area.is_empty() { world.bounds() } else { area }
}

/// Panels of one size in as many columns as make the whole about half as wide again as it is high.
fn in_grid(panels: &[RgbImage]) -> RgbImage {
    let (width, height) = panels.first().map_or((1, 1), RgbImage::dimensions);
    let shape = panels.len() as f32 * height as f32 / width as f32;
    let columns = ((1.5 * shape).sqrt().round() as u32).min(WIDTH_PX_MAX / width);
    stacked(panels, columns.max(1) as usize)
}

/// Panels in so many columns, row by row.
fn stacked(panels: &[RgbImage], columns: usize) -> RgbImage {
    let rows: Vec<&[RgbImage]> = panels.chunks(columns).collect();
    let wide = |row: &[RgbImage]| row.iter().map(|panel| panel.width() + GAP_PX).sum::<u32>();
    let high = |row: &[RgbImage]| row.iter().map(|panel| panel.height() + GAP_PX).max();
    let width = rows.iter().map(|row| wide(row)).max().unwrap_or(1);
    let height = rows.iter().filter_map(|row| high(row)).sum::<u32>();
    let mut picture = RgbImage::from_pixel(width.max(1), height.max(1), Rgb(PAPER));
    let mut top = 0;
    for row in rows {
        let mut left = 0;
        for panel in row {
            image::imageops::replace(&mut picture, panel, i64::from(left), i64::from(top));
            left += panel.width() + GAP_PX;
        }
        top += high(row).unwrap_or(0);
    }
    picture
}

/// The cell of a point, if it is in one, and not where a Quake map has nothing.
fn cell_at(world: &World, point: Vec3) -> Option<CellId> {
    let leaf = world.origin.as_ref().and_then(|origin| {
        let leaf = origin.leaf_at(point.as_dvec3())?;
        origin.tree.as_ref()?.leafs.get(leaf as usize)
    });
    let is_void = leaf.is_some_and(|leaf| leaf.cluster.is_none());
    if is_void { None } else { world.cells.at(point) }
}

/// The line in which a level cut meets a portal.
fn across(world: &World, portal: &Portal, height: f32) -> Option<[Vec3; 2]> {
    let ends = portal.polygon.across(height)?;
    Some(ends.map(|end| world.cells.axes.world(end)))
}

/// What all storeys share.
struct Sheet<'a> {
    world: &'a World,
    overlay: &'a Overlay,
    area: Aabb,
    px_per_m: f32,
    /// The part of all cells that each cell may see.
    densities: Vec<f32>,
    density_max: f32,
}

impl<'a> Sheet<'a> {
    fn new(world: &'a World, overlay: &'a Overlay, area: Aabb, storeys: usize) -> Self {
        let side_px = SIDE_PX_MAX[usize::from(storeys > STOREYS_FEW)];
        let px_per_m = (side_px / area.size().x.max(area.size().z)).min(PX_PER_M_MAX);
        let all = world.cells.cells.len() as f32;
        let densities: Vec<f32> =
            world.cells.pvs.iter().map(|row| row.len() as f32 / all).collect();
        let density_max = densities.iter().copied().fold(0.0, f32::max);
        Self { world, overlay, area, px_per_m, densities, density_max }
    }

    fn size(&self) -> (u32, u32) {
        let size = (self.area.size() * self.px_per_m).ceil();
        (size.x.max(1.0) as u32, size.z.max(1.0) as u32)
    }

    fn density_colour(&self, cell: CellId) -> [u8; 3] {
        heat(self.densities[cell.0 as usize] / self.density_max.max(f32::MIN_POSITIVE))
    }
}

/// One storey's picture in the making.
struct Storey<'a> {
    sheet: &'a Sheet<'a>,
    feet: f32,
    /// Whose soles are at these heights is drawn here.
    holds: Range<f32>,
}

/// What the cut shows at a pixel.
#[derive(Clone, Copy)]
struct Spot {
    cell: Option<CellId>,
    /// What is cut, or the floor below; none where there is neither.
    surface: Option<[u8; 3]>,
    is_cut: bool,
}

impl Storey<'_> {
    fn draw(&self) -> RgbImage {
        let (sheet, overlay) = (self.sheet, self.sheet.overlay);
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
        let mut caption = format!("{}, floor at {:.1} m", sheet.world.title, self.feet);
        // The title may be long and the building narrow.
        let room = picture.width() as usize / 16;
        if caption.len() > room {
            caption = format!("floor at {:.1} m", self.feet);
        }
        write_sized(&mut picture, [4, 6], 2, &caption, INK);
        picture
    }

    /// One picture of the storey, in colours of its own.
    fn panel(&self, spots: &[Vec<Spot>], colour: &dyn Fn(&Spot) -> [u8; 3]) -> RgbImage {
        let (width, height) = self.sheet.size();
        let overlay = self.sheet.overlay;
        let mut picture = RgbImage::from_pixel(width, height + CAPTION_PX, Rgb(PAPER));
        for (y, row) in spots.iter().enumerate() {
            for (x, spot) in row.iter().enumerate() {
                let right = row.get(x + 1).unwrap_or(spot);
                let below = spots.get(y + 1).map_or(spot, |row| &row[x]);
                let is_edge = spot.cell != right.cell || spot.cell != below.cell;
                let mut colour = colour(spot);
                if overlay.cells && is_edge && !spot.is_cut {
                    colour = mixed(colour, INK, if spot.surface.is_some() { 0.22 } else { 0.10 });
                }
                picture.put_pixel(x as u32, y as u32 + CAPTION_PX, Rgb(colour));
            }
        }
        if overlay.cells {
            self.draw_portals(spots, &mut picture);
        }
        if overlay.rooms {
            rooms::draw(self, &mut picture);
        }
        for mark in overlay.marks.iter().filter(|mark| self.holds(mark.eye)) {
            self.draw_mark(&mut picture, mark);
        }
        picture
    }

    fn cut(&self) -> f32 {
        self.feet + CUT_HEIGHT
    }

    fn holds(&self, eye: Vec3) -> bool {
        let feet = eye.y - self.sheet.world.body.below_eye;
        self.holds.contains(&(feet + SOLE_TOLERANCE))
    }

    /// What is at the cut, else the floor below it.
    fn spot(&self, column: u32, row: u32) -> Spot {
        let Sheet { world, area, px_per_m, .. } = self.sheet;
        let step = Vec3::new(column as f32 + 0.5, 0.0, row as f32 + 0.5) / *px_per_m;
        let mut at = (area.min + step).with_y(self.cut());
        let cell = cell_at(world, at);
        let octree = &world.octree;
        if let Some(node) = octree.leaf_at(at) {
            let surface = Some(if node.is_glass() { GLASS } else { INK });
            return Spot { cell, surface, is_cut: true };
        }
        let mut surface = None;
        while surface.is_none() && at.y > self.feet - FLOOR_DEPTH {
            at.y -= octree.voxel();
            surface = octree.leaf_at(at).map(|node| lightened(node.colour));
        }
        Spot { cell, surface, is_cut: false }
    }

    fn floor_colour(&self, spot: &Spot) -> [u8; 3] {
        let Some(colour) = spot.surface else { return PAPER };
        let visible = self.sheet.overlay.visible.as_ref();
        let is_bright =
            visible.is_none_or(|visible| spot.cell.is_some_and(|cell| visible.contains(cell.0)));
        if is_bright { colour } else { dimmed(colour) }
    }

    fn density_colour(&self, spot: &Spot) -> [u8; 3] {
        match (spot.cell, spot.surface) {
            (_, Some(colour)) if spot.is_cut => colour,
            (None, _) => PAPER,
            (Some(cell), Some(_)) => self.sheet.density_colour(cell),
            // One may look there, but not stand.
            (Some(cell), None) => mixed(self.sheet.density_colour(cell), PAPER, 0.75),
        }
    }

    fn place(&self, at: Vec3) -> Vec2 {
        let step = (at - self.sheet.area.min) * self.sheet.px_per_m;
        Vec2::new(step.x, step.z + CAPTION_PX as f32)
    }

    /// Portals where there is a floor; fainter ones where there is none.
    fn draw_portals(&self, spots: &[Vec<Spot>], picture: &mut RgbImage) {
        let world = self.sheet.world;
        for portal in &world.cells.portals {
            let Some(ends) = across(world, portal, self.cut()) else { continue };
            let [from, to] = ends.map(|end| self.place(end));
            let steps = (to - from).abs().max_element().ceil().clamp(1.0, 1e5) as i32;
            for step in 0..=steps {
                let at = from.lerp(to, step as f32 / steps as f32);
                let (x, y) = (at.x as i32, at.y as i32);
                let spot = usize::try_from(y - CAPTION_PX as i32).ok().and_then(|y| spots.get(y));
                let spot = spot.zip(usize::try_from(x).ok()).and_then(|(row, x)| row.get(x));
                let Some(spot) = spot.filter(|spot| !spot.is_cut && spot.cell.is_some()) else {
                    continue;
                };
                let Some(pixel) = picture.get_pixel_mut_checked(x as u32, y as u32) else {
                    continue;
                };
                let share = if spot.surface.is_some() { 0.7 } else { 0.2 };
                *pixel = Rgb(mixed(pixel.0, PORTAL, share));
            }
        }
    }

    fn draw_mark(&self, picture: &mut RgbImage, mark: &Mark) {
        let radius = (0.3 * self.sheet.px_per_m).max(3.5);
        draw_mark(picture, self.place(mark.eye), radius, mark);
    }
}

fn draw_mark(picture: &mut RgbImage, centre: Vec2, radius: f32, mark: &Mark) {
    let (edge, fill) = if mark.filled { (INK, Some(mark.colour)) } else { (mark.colour, None) };
    ring(picture, centre, radius, edge, fill);
    if let Some(forward) = mark.forward {
        let along = Vec2::new(forward.x, forward.z).normalize_or_zero();
        line(picture, centre + along * radius, centre + along * radius * 3.0, mark.colour);
    }
}

fn lightened(colour: [u8; 3]) -> [u8; 3] {
    colour.map(|c| c / 2 + 120)
}

fn dimmed(colour: [u8; 3]) -> [u8; 3] {
    let grey = colour.iter().map(|&c| u16::from(c)).sum::<u16>() / 3;
    [(grey * 11 / 20) as u8; 3]
}

#[cfg(test)]
mod tests;
