//! The legend below the storeys: the scale, and what marks and colours mean.

use glam::Vec2;
use sightline_picture::Picture;
use sightline_world::rooms::RoomId;

use super::{
    overlay::{Mark, draw_mark},
    sheet::{GLASS, PORTAL, Sheet},
    walls,
};
use crate::drawing::{INK, PAPER, heat, line, mixed, put, write_sized};

/// The height of a row, in pixels.
const ROW_PX: i32 = 30;
/// The height of a letter, in pixels.
const LETTER_PX: i32 = 16;
/// The length of the ramp of colours, in pixels.
const RAMP_PX: i32 = 240;

/// Draws the legend of a sheet.
pub(super) fn draw(sheet: &Sheet<'_>, names: &[(&'static str, Mark)]) -> Picture {
    let width = sheet.size().0.max(520);
    let mut rows = 2 + names.len() as i32;
    if sheet.overlay.cells {
        rows += 2;
    }
    if sheet.overlay.density {
        rows += 2;
    }
    let has_rooms = sheet.overlay.rooms && !sheet.world.rooms.list().is_empty();
    rows += 2 * i32::from(has_rooms);
    let has_walls = !sheet.overlay.walls.is_empty();
    rows += 2 * i32::from(has_walls);
    let mut picture = Picture::filled(width, (rows * ROW_PX + 8) as u32, PAPER);
    let mut pen = Pen { picture: &mut picture, top: 4 };
    pen.scale_bar(sheet.px_per_m);
    for (name, mark) in names {
        pen.row(name, |picture, centre| draw_mark(picture, centre, 7.0, mark));
    }
    if sheet.overlay.cells {
        pen.row("portal", |picture, at| stroke(picture, at, PORTAL));
        pen.row("boundary of a cell", |picture, at| stroke(picture, at, mixed(PAPER, INK, 0.3)));
    }
    if has_walls {
        let wall = |colour| {
            move |picture: &mut Picture, at: Vec2| {
                for dy in [-1.0, 0.0, 1.0] {
                    stroke(picture, at + Vec2::Y * dy, colour);
                }
            }
        };
        pen.row("wall that hides people", wall(walls::HIDES));
        pen.row("wall that hides nobody", wall(walls::HIDES_NOBODY));
    }
    if has_rooms {
        let colour = RoomId(0).colour();
        pen.row("boundary of a room", |picture, at| {
            for dy in [-1.0, 0.0, 1.0] {
                stroke(picture, at + Vec2::Y * dy, colour);
            }
        });
        pen.row("window of a room", |picture, at| {
            for dy in [-3.0, 3.0] {
                stroke(picture, at + Vec2::Y * dy, colour);
            }
            for dx in (-16..16).step_by(5).map(|dx| dx as f32) {
                for dy in [3.0, -3.0] {
                    let [from, to] = [(dx, dy), (dx + 5.0, -dy)].map(|(x, y)| at + Vec2::new(x, y));
                    line(picture, from, to, colour);
                }
            }
        });
    }
    pen.row("wall, and glass", |picture, at| {
        for dx in -16..16 {
            let colour = if dx < 4 { INK } else { GLASS };
            (-6..6).for_each(|dy| put(picture, at.x as i32 + dx, at.y as i32 + dy, colour));
        }
    });
    if sheet.overlay.density {
        pen.ramp(sheet.density_max);
    }
    picture
}

/// Writes rows from top to bottom.
struct Pen<'a> {
    picture: &'a mut Picture,
    top: i32,
}

impl Pen<'_> {
    /// Draws a sign, and writes what it means.
    fn row(&mut self, name: &str, sign: impl FnOnce(&mut Picture, Vec2)) {
        sign(self.picture, Vec2::new(28.0, (self.top + ROW_PX / 2) as f32));
        self.text(60, name);
        self.top += ROW_PX;
    }

    fn text(&mut self, left: i32, text: &str) {
        let top = self.top + (ROW_PX - LETTER_PX) / 2;
        write_sized(self.picture, [left, top], 2, text, INK);
    }

    /// Draws a bar of a round length, about a fifth of the picture wide.
    fn scale_bar(&mut self, px_per_m: f32) {
        let wish = self.picture.width() as f32 / 5.0 / px_per_m;
        let power = 10.0f32.powf(wish.max(1e-3).log10().floor());
        let step = [5.0, 2.0, 1.0].into_iter().find(|step| step * power <= wish);
        let metres = step.unwrap_or(1.0) * power;
        let (left, y) = (12.0, (self.top + ROW_PX / 2) as f32);
        let right = left + metres * px_per_m;
        for dy in [-1.0, 0.0, 1.0] {
            line(self.picture, Vec2::new(left, y + dy), Vec2::new(right, y + dy), INK);
        }
        for x in [left, right] {
            line(self.picture, Vec2::new(x, y - 7.0), Vec2::new(x, y + 7.0), INK);
        }
        self.text(right as i32 + 12, &format!("{metres} m"));
        self.top += ROW_PX;
    }

    /// Draws the colours of densities from 0 to the greatest one.
    fn ramp(&mut self, most: f32) {
        self.text(12, "share of all cells that a cell may see:");
        self.top += ROW_PX;
        for x in 0..RAMP_PX {
            let colour = heat(x as f32 / (RAMP_PX - 1) as f32);
            (4..ROW_PX - 4).for_each(|y| put(self.picture, 60 + x, self.top + y, colour));
        }
        self.text(12, "0 %");
        self.text(60 + RAMP_PX + 12, &format!("{:.0} %", most * 100.0));
        self.top += ROW_PX;
    }
}

/// Draws a short level line about a point.
fn stroke(picture: &mut Picture, at: Vec2, colour: [u8; 3]) {
    line(picture, at - Vec2::X * 16.0, at + Vec2::X * 16.0, colour);
}
