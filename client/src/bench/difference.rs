//! How two pictures of one view differ.

use serde::Serialize;

use crate::render::Frame;

/// A channel that differs by no more differs by rounding: one step in each of the two colours, and one where they are
/// mixed.
const ROUNDING: u8 = 2;
/// A shift is looked for so many pixels around.
const SHIFT_MAX: usize = 4;

/// How two pictures differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Difference {
    /// The part of the pixels that differ by more than rounding, from 0 to 1.
    pub differing: f64,
    /// The part of the pixels that are nowhere in the other picture within one pixel of their place.
    pub shifted: f64,
    /// The greatest distance, in pixels along rows or columns, from a pixel to one like it in the other picture; 5
    /// when there is none within 4.
    pub shift_max: usize,
}

impl Difference {
    /// Of two frames of equal size. Pixels are alike when their colours are within rounding, and their depths within
    /// `tolerance`, in metres; far away, where a pixel is larger than that, within the share that it spans.
    pub fn of(a: &Frame, b: &Frame, tolerance: f32) -> Self {
        let (width, height) = (a.width().min(b.width()), a.height().min(b.height()));
        let mut found = Self::default();
        let mut counts = [0usize; 2];
        for y in 0..height {
            for x in 0..width {
                if differs(a.colour[y * a.width() + x], b.colour[y * b.width() + x]) {
                    counts[0] += 1;
                    let shift = shift(a, b, [x, y], tolerance).max(shift(b, a, [x, y], tolerance));
                    counts[1] += usize::from(shift > 1);
                    found.shift_max = found.shift_max.max(shift);
                }
            }
        }
        let pixels = (width * height).max(1) as f64;
        [found.differing, found.shifted] = counts.map(|count| count as f64 / pixels);
        found
    }

    /// The worse of two in each regard.
    pub fn worst(self, other: Self) -> Self {
        Self {
            differing: self.differing.max(other.differing),
            shifted: self.shifted.max(other.shifted),
            shift_max: self.shift_max.max(other.shift_max),
        }
    }
}

/// Whether two colours differ by more than rounding.
pub fn differs(a: u32, b: u32) -> bool {
    a != b && channels(a, b).into_iter().any(|difference| difference > ROUNDING)
}

/// How far each channel of two colours is apart: red, green and blue.
pub fn channels(a: u32, b: u32) -> [u8; 3] {
    [16, 8, 0].map(|shift| ((a >> shift) as u8).abs_diff((b >> shift) as u8))
}

/// How far from its place in `a` a pixel is found in `b`.
fn shift(a: &Frame, b: &Frame, [x, y]: [usize; 2], tolerance: f32) -> usize {
    let at = y * a.width() + x;
    let (colour, depth) = (a.colour[at], a.depth[at]);
    let is_like = |i: usize, j: usize| {
        let other = j * b.width() + i;
        let within = tolerance.max(depth * 0.01);
        let near = b.depth[other] == depth || (b.depth[other] - depth).abs() <= within;
        near && !differs(colour, b.colour[other])
    };
    let is_within = |reach: usize| {
        let span = |at: usize, side: usize| at.saturating_sub(reach)..=(at + reach).min(side - 1);
        span(y, b.height()).any(|j| span(x, b.width()).any(|i| is_like(i, j)))
    };
    (0..=SHIFT_MAX).find(|&reach| is_within(reach)).unwrap_or(SHIFT_MAX + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns of colours that all differ, moved to the right, and one level brighter.
    fn columns(shift: usize, brighter: u32) -> Frame {
        let mut frame = Frame::new(40, 8);
        for (i, pixel) in frame.colour.iter_mut().enumerate() {
            *pixel = ((i % 40 + 40 - shift) % 40 * 6) as u32 * 0x0001_0000 + brighter;
        }
        frame.depth.fill(3.0);
        frame
    }

    #[test]
    fn rounding_is_no_difference_and_shifts_are_found() {
        let base = columns(0, 0);
        assert_eq!(Difference::of(&base, &columns(0, 2), 0.1), Difference::default());
        for (shift, shifted) in [(1, 0.0), (3, 1.0)] {
            let found = Difference::of(&base, &columns(shift, 0), 0.1);
            assert_eq!(found.differing, 1.0);
            // The columns that went out at one side are nowhere near.
            assert!((found.shifted - shifted).abs() < 0.3 && found.shift_max == 5, "{found:?}");
        }
        let mut deeper = columns(1, 0);
        deeper.depth.fill(4.0);
        assert_eq!(Difference::of(&base, &deeper, 0.1).shifted, 1.0);
    }
}
