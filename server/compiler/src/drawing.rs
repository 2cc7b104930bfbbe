//! Drawing on pictures: points, lines, rings, letters, colours.

use font8x8::UnicodeFonts;
use glam::Vec2;
use sightline_picture::Picture;

/// The background, in sRGB.
pub(crate) const PAPER: [u8; 3] = [250, 250, 247];
/// Lines and letters, in sRGB.
pub(crate) const INK: [u8; 3] = [40, 42, 48];

/// Colours a pixel, if it lies in the picture.
pub(crate) fn put(picture: &mut Picture, x: i32, y: i32, colour: [u8; 3]) {
    let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { return };
    if let Some(pixel) = picture.pixel_mut(x, y) {
        *pixel = colour;
    }
}

/// Draws a line one pixel wide.
pub(crate) fn line(picture: &mut Picture, from: Vec2, to: Vec2, colour: [u8; 3]) {
    let steps = (to - from).abs().max_element().ceil().max(1.0) as i32;
    for step in 0..=steps {
        let at = from.lerp(to, step as f32 / steps as f32);
        put(picture, at.x as i32, at.y as i32, colour);
    }
}

/// Draws a ring, and fills it when `fill` is a colour.
pub(crate) fn ring(
    picture: &mut Picture,
    centre: Vec2,
    radius: f32,
    colour: [u8; 3],
    fill: Option<[u8; 3]>,
) {
    let reach = radius.ceil() as i32 + 1;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let away = Vec2::new(dx as f32, dy as f32).length();
            let colour = if away <= radius - 1.5 { fill } else { Some(colour) };
            if let Some(colour) = colour.filter(|_| away <= radius) {
                put(picture, centre.x as i32 + dx, centre.y as i32 + dy, colour);
            }
        }
    }
}

/// Writes one line of text, eight pixels high.
pub(crate) fn write(picture: &mut Picture, left: i32, top: i32, text: &str, colour: [u8; 3]) {
    write_sized(picture, [left, top], 1, text, colour);
}

/// Writes one line of text, `8 * scale` pixels high. Characters without a glyph stay blank.
pub(crate) fn write_sized(
    picture: &mut Picture,
    [left, top]: [i32; 2],
    scale: i32,
    text: &str,
    colour: [u8; 3],
) {
    for (i, character) in (0..).zip(text.chars()) {
        let Some(glyph) = font8x8::BASIC_FONTS.get(character) else { continue };
        for (y, row) in (0..8 * scale).map(|y| (y, glyph[(y / scale) as usize])) {
            for x in (0..8 * scale).filter(|x| row & (1 << (x / scale)) != 0) {
                put(picture, left + i * 8 * scale + x, top + y, colour);
            }
        }
    }
}

/// The gap between panels, in pixels.
const GAP_PX: u32 = 12;

/// Puts panels into columns, row by row.
pub(crate) fn stacked(panels: &[Picture], columns: usize) -> Picture {
    let rows: Vec<&[Picture]> = panels.chunks(columns).collect();
    let wide = |row: &[Picture]| row.iter().map(|panel| panel.width() + GAP_PX).sum::<u32>();
    let high = |row: &[Picture]| row.iter().map(|panel| panel.height() + GAP_PX).max();
    let width = rows.iter().map(|row| wide(row)).max().unwrap_or(1);
    let height = rows.iter().filter_map(|row| high(row)).sum::<u32>();
    let mut picture = Picture::filled(width.max(1), height.max(1), PAPER);
    let mut top = 0;
    for row in rows {
        let mut left = 0;
        for panel in row {
            picture.paste(panel, left, top);
            left += panel.width() + GAP_PX;
        }
        top += high(row).unwrap_or(0);
    }
    picture
}

/// A colour between two: the first at share 0, the second at share 1.
pub(crate) fn mixed(first: [u8; 3], second: [u8; 3], share: f32) -> [u8; 3] {
    std::array::from_fn(|i| {
        let (a, b) = (f32::from(first[i]), f32::from(second[i]));
        (a + (b - a) * share.clamp(0.0, 1.0)).round() as u8
    })
}

/// The colour of a share from 0 to 1: from pale yellow over green to dark blue. It darkens all the
/// way, so that a reader can do without colours.
pub(crate) fn heat(share: f32) -> [u8; 3] {
    const STOPS: [[u8; 3]; 6] = [
        [247, 247, 178],
        [199, 233, 180],
        [127, 205, 187],
        [65, 182, 196],
        [34, 94, 168],
        [20, 42, 110],
    ];
    let at = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f32;
    let below = (at as usize).min(STOPS.len() - 2);
    mixed(STOPS[below], STOPS[below + 1], at - below as f32)
}
