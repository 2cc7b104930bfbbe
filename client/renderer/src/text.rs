//! Text in letters of eight by eight pixels, for names, the status line and chat.

use font8x8::{BASIC_FONTS, LATIN_FONTS, UnicodeFonts};

use super::Frame;

/// Pixels from one letter to the next, and from one line to the next, at scale 1.
pub const LETTER: usize = 8;

/// The width of a text in pixels.
pub fn width(text: &str, scale: usize) -> usize {
    text.chars().count() * LETTER * scale
}

/// Writes a line of text with its upper left corner at a pixel, which may lie outside the picture.
pub fn draw(frame: &mut Frame, [x, y]: [i32; 2], scale: usize, colour: u32, text: &str) {
    each_pixel(frame, [x, y], scale, text, |pixel, _| *pixel = colour);
}

/// Writes a line of text at a depth in metres, behind whatever is nearer. Its upper left corner is
/// at a pixel, which may lie outside the picture.
pub fn draw_at_depth(
    frame: &mut Frame,
    [x, y]: [i32; 2],
    scale: usize,
    colour: u32,
    text: &str,
    depth: f32,
) {
    each_pixel(frame, [x, y], scale, text, |pixel, behind| {
        if depth < behind {
            *pixel = colour;
        }
    });
}

/// Darkens a rectangle, so that text on it can be read.
pub fn darken(frame: &mut Frame, [x, y]: [i32; 2], [width, height]: [usize; 2]) {
    let columns = clipped(x, width, frame.width());
    for row in clipped(y, height, frame.height()) {
        let start = row * frame.width();
        for pixel in &mut frame.colour[start + columns.start..start + columns.end] {
            // Each channel becomes a quarter of itself.
            *pixel = *pixel >> 2 & 0x003f_3f3f;
        }
    }
}

/// Fills a rectangle with a colour.
pub fn fill(frame: &mut Frame, [x, y]: [i32; 2], [width, height]: [usize; 2], colour: u32) {
    let columns = clipped(x, width, frame.width());
    for row in clipped(y, height, frame.height()) {
        let start = row * frame.width();
        frame.colour[start + columns.start..start + columns.end].fill(colour);
    }
}

/// The part of `start..start + length` that lies in a side of the picture.
fn clipped(start: i32, length: usize, side: usize) -> std::ops::Range<usize> {
    let end = i64::from(start) + length.min(side * 2) as i64;
    let inside = |place: i64| place.clamp(0, side as i64) as usize;
    inside(start.into())..inside(end)
}

/// Calls `paint` with the colour and the depth of each pixel that the letters cover.
fn each_pixel(
    frame: &mut Frame,
    [x, y]: [i32; 2],
    scale: usize,
    text: &str,
    mut paint: impl FnMut(&mut u32, f32),
) {
    let side = LETTER * scale;
    for (i, letter) in text.chars().take(frame.width() / LETTER + 1).enumerate() {
        let left = x.saturating_add((i * side) as i32);
        let glyph = glyph(letter);
        let (columns, rows) =
            (clipped(left, side, frame.width()), clipped(y, side, frame.height()));
        for row in rows {
            let bits = glyph[(row as i32 - y) as usize / scale];
            for column in columns.clone() {
                if bits >> ((column as i32 - left) as usize / scale) & 1 == 1 {
                    let at = row * frame.width() + column;
                    let depth = frame.depth[at];
                    paint(&mut frame.colour[at], depth);
                }
            }
        }
    }
}

fn glyph(letter: char) -> [u8; 8] {
    let known = BASIC_FONTS.get(letter).or_else(|| LATIN_FONTS.get(letter));
    known.or_else(|| BASIC_FONTS.get('?')).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_legible_and_stay_inside() {
        let mut frame = Frame::new(24, 10);
        draw(&mut frame, [1, 1], 1, 7, "Ti");
        let row = |y: usize| -> String {
            let row = &frame.colour[y * 24..(y + 1) * 24];
            row.iter().map(|&pixel| if pixel == 7 { '#' } else { '.' }).collect()
        };
        assert_eq!(row(0), "........................");
        assert_eq!(row(1), ".######....##...........");
        assert_eq!(row(2), ".#.##.#.................");
        for at in [[-5, -3], [20, 6], [-2_000_000_000, 0], [2_000_000_000, 2_000_000_000]] {
            draw(&mut frame, at, 3, 9, "far out, ünïcode ✈");
            darken(&mut frame, at, [1 << 40, 9]);
            fill(&mut frame, at, [1 << 40, 9], 5);
        }
    }

    #[test]
    fn what_is_nearer_hides_a_text() {
        let mut frame = Frame::new(16, 8);
        frame.depth[..64].fill(2.0);
        draw_at_depth(&mut frame, [0, 0], 1, 7, "##", 3.0);
        assert!(frame.colour[..64].iter().all(|&pixel| pixel == 0));
        assert!(frame.colour[64..].contains(&7));
    }
}
