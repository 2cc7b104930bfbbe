//! A grid of coordinates on a plan, so that a reader can name a place.

use glam::{Vec2, Vec3};
use sightline_picture::Picture;

use super::sheet::{CAPTION_PX, Level};
use crate::drawing::{INK, PAPER, mixed, put, write_sized};

/// Lines are at least this far apart, in pixels, so that their numbers fit.
const APART_PX: f32 = 56.0;
/// How dark lines are.
const SHADE: f32 = 0.22;

/// Draws lines of equal x and equal z at round numbers of metres, with the numbers at the top and
/// on the left.
pub(super) fn draw(level: &Level<'_>, picture: &mut Picture) {
    let sheet = level.sheet;
    let step = step_m(sheet.px_per_m);
    let (min, max) = (level.point(0, 0), {
        let (width, height) = sheet.size();
        level.point(width - 1, height - 1)
    });
    let top = CAPTION_PX as i32;
    let bottom = picture.height() as i32;
    for x in round_numbers(min.x, max.x, step) {
        let at = level.place(Vec3::new(x, 0.0, min.z)).x as i32;
        (top..bottom).for_each(|y| darken(picture, at, y));
        write_sized(picture, [at + 2, top + 2], 1, &format!("x {x}"), INK);
    }
    for z in round_numbers(min.z, max.z, step) {
        let at = level.place(Vec3::new(min.x, 0.0, z)).y as i32;
        (0..picture.width() as i32).for_each(|x| darken(picture, x, at));
        write_sized(picture, [2, at + 2], 1, &format!("z {z}"), INK);
    }
}

/// The distance between lines: 1, 2 or 5 metres, or ten times as many, and so on.
fn step_m(px_per_m: f32) -> f32 {
    let powers = std::iter::successors(Some(1.0f32), |power| Some(power * 10.0));
    let mut steps = powers.flat_map(|power| [power, 2.0 * power, 5.0 * power]);
    steps.find(|step| step * px_per_m >= APART_PX).unwrap_or(1.0)
}

/// The multiples of a step between two numbers.
fn round_numbers(from: f32, to: f32, step: f32) -> impl Iterator<Item = f32> {
    let [first, last] = [(from / step).ceil() as i32, (to / step).floor() as i32];
    (first..=last).map(move |index| index as f32 * step)
}

fn darken(picture: &mut Picture, x: i32, y: i32) {
    let at = Vec2::new(x as f32, y as f32).as_uvec2();
    if let Some(&mut colour) = picture.pixel_mut(at.x, at.y) {
        let is_paper = colour == PAPER;
        put(picture, x, y, mixed(colour, INK, if is_paper { SHADE * 0.5 } else { SHADE }));
    }
}
