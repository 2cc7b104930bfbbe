//! How two pictures of one view differ.

use rayon::prelude::*;
use serde::Serialize;
use sightline_renderer::Frame;

/// The largest difference of a channel due to rounding: one level for each of two colours, and one
/// for mixing them.
const ROUNDING: u8 = 2;
/// The largest shift that is searched for, in pixels.
const SHIFT_MAX: usize = 4;

/// How two pictures of one view differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PictureDifference {
    /// The share of pixels whose colours differ by more than rounding, from 0 to 1: by more than
    /// two levels of 255 in some channel. Where voxels are about as wide as a pixel, this includes
    /// voxels that begin a fraction of a pixel earlier.
    pub differing: f64,
    /// The share of pixels whose colour lies outside the range of the colours within one pixel of
    /// their place in the other picture, by more than rounding. An edge that is shifted by up to a
    /// pixel does not explain it.
    pub unlike: f64,
    /// The share of pixels whose depth lies outside the range of the depths within one pixel of
    /// their place in the other picture.
    pub shifted: f64,
    /// The number of pixels, along rows or columns, within which every pixel's depth lies in the
    /// range of the other picture's depths. It is 5 when 4 is not enough. Things thinner than a
    /// pixel may show in one picture only.
    pub shift_max: usize,
}

impl PictureDifference {
    /// Compares two frames of equal size. Depths match within `tolerance` metres. Far away, where a
    /// pixel spans more than that, they match within a hundredth.
    pub fn of(a: &Frame, b: &Frame, tolerance: f32) -> Self {
        let (width, height) = (a.width(), a.height());
        assert_eq!((width, height), (b.width(), b.height()), "pictures of equal size");
        let look = |(x, y): (usize, usize)| {
            let differing = differs(a.colour[y * a.width() + x], b.colour[y * b.width() + x]);
            let unlike = differing && (is_unlike(a, b, [x, y]) || is_unlike(b, a, [x, y]));
            let shift = shift(a, b, [x, y], tolerance).max(shift(b, a, [x, y], tolerance));
            [usize::from(differing), usize::from(unlike), usize::from(shift > 1), shift]
        };
        let rows = (0..height).into_par_iter().map(|y| {
            (0..width)
                .map(|x| look((x, y)))
                .fold([0; 4], |sum: [usize; 4], pixel| total(sum, pixel))
        });
        let [differing, unlike, shifted, shift_max] = rows.reduce(|| [0; 4], total);
        let share = |count: usize| count as f64 / (width * height).max(1) as f64;
        let [differing, unlike, shifted] = [differing, unlike, shifted].map(share);
        Self { differing, unlike, shifted, shift_max }
    }
}

/// Adds the counts, and takes the greater shift.
fn total(a: [usize; 4], b: [usize; 4]) -> [usize; 4] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3].max(b[3])]
}

/// Whether a pixel's colour in `a` is outside the range of the colours around it in `b`.
fn is_unlike(a: &Frame, b: &Frame, [x, y]: [usize; 2]) -> bool {
    let levels = |pixel: u32| [16, 8, 0].map(|shift| (pixel >> shift) as u8);
    let mut span = [[u8::MAX, 0]; 3];
    around(b, [x, y], 1).for_each(|i| {
        for (span, level) in span.iter_mut().zip(levels(b.colour[i])) {
            *span = [span[0].min(level), span[1].max(level)];
        }
    });
    let own = levels(a.colour[y * a.width() + x]);
    own.into_iter().zip(span).any(|(level, [low, high])| {
        level < low.saturating_sub(ROUNDING) || level > high.saturating_add(ROUNDING)
    })
}

/// The pixels within a distance of a place.
fn around(frame: &Frame, [x, y]: [usize; 2], reach: usize) -> impl Iterator<Item = usize> {
    let (width, height) = (frame.width(), frame.height());
    let span = move |at: usize, side: usize| at.saturating_sub(reach)..=(at + reach).min(side - 1);
    span(y, height).flat_map(move |j| span(x, width).map(move |i| j * width + i))
}

/// Whether two colours differ by more than rounding.
pub fn differs(a: u32, b: u32) -> bool {
    a != b && channels(a, b).into_iter().any(|difference| difference > ROUNDING)
}

/// The differences of the channels of two colours: red, green and blue.
pub fn channels(a: u32, b: u32) -> [u8; 3] {
    [16, 8, 0].map(|shift| ((a >> shift) as u8).abs_diff((b >> shift) as u8))
}

/// The distance from its place in `a` at which a pixel's depth is found in `b`.
fn shift(a: &Frame, b: &Frame, [x, y]: [usize; 2], tolerance: f32) -> usize {
    let depth = a.depth[y * a.width() + x];
    let within = tolerance.max(depth.min(f32::MAX) * 0.01);
    let found = |reach: &usize| {
        let depths = around(b, [x, y], *reach).map(|i| b.depth[i]);
        let none = (f32::INFINITY, f32::NEG_INFINITY);
        let (low, high) = depths.fold(none, |(low, high), z| (low.min(z), high.max(z)));
        depth >= low - within && depth <= high + within
    };
    (0..=SHIFT_MAX).find(found).unwrap_or(SHIFT_MAX + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns of different colours and depths, shifted to the right, and brighter by some levels.
    fn columns(shift: usize, brighter: u32) -> Frame {
        let mut frame = Frame::new(40, 8);
        for i in 0..frame.colour.len() {
            let column = (i % 40).saturating_sub(shift).min(30);
            frame.colour[i] = column as u32 * 0x0006_0000 + brighter;
            frame.depth[i] = 1.0 + column as f32;
        }
        frame
    }

    #[test]
    fn rounding_is_no_difference_and_shifts_are_measured() {
        let base = columns(0, 0);
        assert_eq!(PictureDifference::of(&base, &columns(0, 2), 0.1), PictureDifference::default());
        let brighter = PictureDifference::of(&base, &columns(0, 3), 0.1);
        assert_eq!((brighter.differing, brighter.unlike, brighter.shifted), (1.0, 1.0, 0.0));
        let moved = |shift| PictureDifference::of(&base, &columns(shift, 0), 0.1);
        let one = PictureDifference {
            differing: 30.0 / 40.0,
            shift_max: 1,
            ..PictureDifference::default()
        };
        assert_eq!(moved(1), one);
        let three = moved(3);
        assert_eq!((three.shift_max, three.differing), (3, 32.0 / 40.0));
        assert!(three.unlike > 0.7 && three.shifted > 0.7, "{three:?}");
    }

    #[test]
    fn a_hole_counts_as_a_shift_beyond_the_limit() {
        let (mut whole, mut holed) = (columns(0, 0), columns(0, 0));
        whole.depth.fill(3.0);
        holed.depth.fill(3.0);
        holed.depth[4 * 40 + 20] = f32::INFINITY;
        let found = PictureDifference::of(&whole, &holed, 0.1);
        assert_eq!((found.shifted, found.shift_max), (1.0 / 320.0, 5));
    }
}
