//! The Z pyramid: an upper bound of the depths in each part of a picture.
//!
//! The lowest level has an entry for each block of 8 × 8 pixels, which comes with the picture. Each
//! higher level has an entry for 2 × 2 entries of the level below. Higher entries are worked out
//! when a test needs them, so a picture costs only what it is tested for.

use super::{Frame, mask::BLOCK};

/// The Z pyramid of a picture.
#[derive(Clone, Debug, Default)]
pub(super) struct Pyramid {
    /// Columns and rows of the picture, in pixels.
    size: [usize; 2],
    /// From fine to coarse.
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    /// Entries in a row.
    across: usize,
    /// The upper bound of each entry's depths in metres; infinite where it is not known.
    farthest: Vec<f32>,
}

/// A range of rows or columns: the first, and the one after the last.
pub(super) type Span = [usize; 2];

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rectangle {
    pub(super) columns: Span,
    pub(super) rows: Span,
}

/// An entry of the pyramid.
#[derive(Clone, Copy)]
struct Entry {
    level: usize,
    /// Column and row in the level.
    at: [usize; 2],
}

impl Pyramid {
    /// Begins a new picture.
    pub(super) fn begin(&mut self, frame: &Frame) {
        let size = [frame.width, frame.height];
        if self.size != size {
            self.size = size;
            self.levels.clear();
            let mut entries = size.map(|side| side.div_ceil(BLOCK).max(1));
            loop {
                let farthest = vec![f32::INFINITY; entries[0] * entries[1]];
                self.levels.push(Level { across: entries[0], farthest });
                if entries == [1, 1] {
                    break;
                }
                entries = entries.map(|side| side.div_ceil(2));
            }
        }
        self.levels[0].farthest.clone_from(&frame.farthest);
        self.levels[1..].iter_mut().for_each(|level| level.farthest.fill(f32::INFINITY));
    }

    /// Whether every pixel of a rectangle is nearer than `nearest`. The rectangle lies in the
    /// picture and is not empty.
    pub(super) fn hides(&mut self, depths: &[f32], rectangle: Rectangle, nearest: f32) -> bool {
        let Rectangle { columns, rows } = rectangle;
        assert_eq!(depths.len(), self.size[0] * self.size[1], "depths of another picture");
        debug_assert!(columns[0] < columns[1] && columns[1] <= self.size[0], "{columns:?}");
        debug_assert!(rows[0] < rows[1] && rows[1] <= self.size[1], "{rows:?}");
        let top = self.levels.len() - 1;
        self.test(depths, Entry { level: top, at: [0, 0] }, rectangle, nearest).is_some()
    }

    /// Tests the part of a rectangle that is in an entry. If every pixel of it is nearer, returns
    /// an upper bound of the depths tested.
    fn test(
        &mut self,
        depths: &[f32],
        entry: Entry,
        rectangle: Rectangle,
        nearest: f32,
    ) -> Option<f32> {
        let Entry { level, at } = entry;
        let Rectangle { columns, rows } = rectangle;
        let place = at[1] * self.levels[level].across + at[0];
        let known = self.levels[level].farthest[place];
        if known < nearest {
            return Some(known);
        }
        let side = BLOCK << level;
        let mut farthest = 0.0f32;
        if level == 0 {
            farthest = self.farthest_in_block(depths, at, rectangle);
            if farthest >= nearest {
                return None;
            }
        } else {
            let half = side / 2;
            for y in 0..2 {
                for x in 0..2 {
                    let child = [2 * at[0] + x, 2 * at[1] + y];
                    let meets = |axis: usize, span: Span| {
                        child[axis] * half < span[1] && (child[axis] + 1) * half > span[0]
                    };
                    if meets(0, columns) && meets(1, rows) {
                        let child = Entry { level: level - 1, at: child };
                        let found = self.test(depths, child, rectangle, nearest)?;
                        farthest = farthest.max(found);
                    }
                }
            }
        }
        let covers = |axis: usize, span: Span| {
            span[0] <= at[axis] * side && ((at[axis] + 1) * side).min(self.size[axis]) <= span[1]
        };
        if covers(0, columns) && covers(1, rows) {
            self.levels[level].farthest[place] = farthest;
        }
        Some(farthest)
    }

    /// The greatest depth in the part of a rectangle that is in a block.
    fn farthest_in_block(&self, depths: &[f32], at: [usize; 2], rectangle: Rectangle) -> f32 {
        let within = |axis: usize, span: Span| {
            [span[0].max(at[axis] * BLOCK), span[1].min((at[axis] + 1) * BLOCK)]
        };
        let (columns, rows) = (within(0, rectangle.columns), within(1, rectangle.rows));
        let row = |y: usize| &depths[y * self.size[0] + columns[0]..y * self.size[0] + columns[1]];
        (rows[0]..rows[1]).flat_map(row).fold(0.0, |most: f32, depth| most.max(*depth))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// The reference model tests every pixel.
        #[test]
        fn a_rectangle_is_hidden_when_all_its_pixels_are_nearer(
            size in prop::array::uniform2(1usize..70),
            patches in prop::collection::vec((prop::array::uniform4(0.0f32..1.0), 0.5f32..9.0), 1..12),
            known in 1usize..4,
            asked in prop::collection::vec((prop::array::uniform4(0.0f32..1.0), 0.5f32..9.0), 1..40),
        ) {
            let spans = |[a, b, c, d]: [f32; 4]| {
                let span = |one: f32, other: f32, side: usize| {
                    let [low, high] = [one.min(other), one.max(other)].map(|at| (at * side as f32) as usize);
                    [low.min(side - 1), (high + 1).min(side)]
                };
                (span(a, b, size[0]), span(c, d, size[1]))
            };
            let pixels = |(columns, rows): (Span, Span)| {
                (rows[0]..rows[1]).flat_map(move |y| (columns[0]..columns[1]).map(move |x| y * size[0] + x))
            };
            let mut frame = Frame::new(size[0], size[1]);
            frame.depth.fill(5.0);
            for (corners, depth) in patches {
                pixels(spans(corners)).for_each(|pixel| frame.depth[pixel] = depth);
            }
            // The greatest depth is known of some blocks and unknown of others.
            let across = size[0].div_ceil(BLOCK);
            frame.farthest.iter_mut().step_by(known).for_each(|farthest| *farthest = 0.0);
            for (pixel, depth) in frame.depth.iter().enumerate() {
                let block = pixel / size[0] / BLOCK * across + pixel % size[0] / BLOCK;
                frame.farthest[block] = frame.farthest[block].max(*depth);
            }
            let mut pyramid = Pyramid::default();
            pyramid.begin(&frame);
            for (corners, nearest) in asked {
                let (columns, rows) = spans(corners);
                let expected = pixels((columns, rows)).all(|pixel| frame.depth[pixel] < nearest);
                prop_assert_eq!(pyramid.hides(&frame.depth, Rectangle { columns, rows }, nearest), expected);
            }
        }
    }
}
