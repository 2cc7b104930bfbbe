//! The Z pyramid: how far away at the most everything in a part of the picture is.
//!
//! Its lowest level has an entry for 8 × 8 pixels, each other one for 2 × 2 entries of the one below.
//! An entry is worked out when it is asked for, so a picture costs what is asked about it.

/// The pixels of an entry of the lowest level, each way.
const TILE: usize = 8;

/// A picture's depths, from coarse to fine.
#[derive(Clone, Debug, Default)]
pub(super) struct Pyramid {
    size: [usize; 2],
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    across: usize,
    /// No number where it is not known.
    farthest: Vec<f32>,
}

/// Rows or columns: the first, and the one after the last.
pub(super) type Span = [usize; 2];

impl Pyramid {
    /// Forgets everything, since there is a new picture.
    pub(super) fn begin(&mut self, size: [usize; 2]) {
        if self.size != size {
            self.size = size;
            self.levels.clear();
            let mut entries = size.map(|side| side.div_ceil(TILE).max(1));
            loop {
                let farthest = vec![f32::NAN; entries[0] * entries[1]];
                self.levels.push(Level { across: entries[0], farthest });
                if entries == [1, 1] {
                    return;
                }
                entries = entries.map(|side| side.div_ceil(2));
            }
        }
        self.levels.iter_mut().for_each(|level| level.farthest.fill(f32::NAN));
    }

    /// Whether everything in a rectangle of a picture, which is not empty, is nearer than something.
    pub(super) fn hides(
        &mut self,
        depths: &[f32],
        columns: Span,
        rows: Span,
        nearest: f32,
    ) -> bool {
        let top = self.levels.len() - 1;
        let is_hidden = self.look(depths, (top, [0, 0]), (columns, rows), nearest);
        is_hidden.is_some()
    }

    /// Looks at the part of a rectangle that is in an entry. When all of it is nearer: how far away the
    /// entry's pixels are at the most, as far as they were looked at.
    fn look(
        &mut self,
        depths: &[f32],
        (level, at): (usize, [usize; 2]),
        (columns, rows): (Span, Span),
        nearest: f32,
    ) -> Option<f32> {
        let place = at[1] * self.levels[level].across + at[0];
        let known = self.levels[level].farthest[place];
        if known < nearest {
            return Some(known);
        }
        let side = TILE << level;
        if level == 0 {
            return self.look_closely(depths, at, (columns, rows), nearest);
        }
        let half = side / 2;
        let mut farthest = 0.0f32;
        for y in 0..2 {
            for x in 0..2 {
                let child = [2 * at[0] + x, 2 * at[1] + y];
                let meets = |axis: usize, span: Span| {
                    child[axis] * half < span[1] && (child[axis] + 1) * half > span[0]
                };
                if meets(0, columns) && meets(1, rows) {
                    let found = self.look(depths, (level - 1, child), (columns, rows), nearest)?;
                    farthest = farthest.max(found);
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

    /// The same of 8 × 8 pixels.
    fn look_closely(
        &mut self,
        depths: &[f32],
        at: [usize; 2],
        (columns, rows): (Span, Span),
        nearest: f32,
    ) -> Option<f32> {
        let [width, height] = self.size;
        let most = |columns: Span, rows: Span| {
            let pixels = |row: usize| &depths[row * width + columns[0]..row * width + columns[1]];
            farthest((rows[0]..rows[1]).map(pixels))
        };
        let tile = [0, 1].map(|axis: usize| {
            [at[axis] * TILE, ((at[axis] + 1) * TILE).min([width, height][axis])]
        });
        let farthest = &mut self.levels[0].farthest[at[1] * width.div_ceil(TILE).max(1) + at[0]];
        if farthest.is_nan() {
            *farthest = most(tile[0], tile[1]);
        }
        let farthest = *farthest;
        if farthest < nearest {
            return Some(farthest);
        }
        let within = |span: Span, tile: Span| [span[0].max(tile[0]), span[1].min(tile[1])];
        let part = most(within(columns, tile[0]), within(rows, tile[1]));
        // The rest of the tile is farther: nobody may take this for all of it.
        (part < nearest).then_some(f32::INFINITY)
    }
}

/// The greatest of all depths in rows of a tile.
fn farthest<'a>(rows: impl Iterator<Item = &'a [f32]>) -> f32 {
    // Side by side, since there is nothing else to do in most pictures.
    let mut most = [0.0f32; TILE];
    for row in rows {
        most.iter_mut().zip(row).for_each(|(most, depth)| {
            *most = if *depth > *most { *depth } else { *most };
        });
    }
    most.into_iter().fold(0.0, f32::max)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// The twin looks at every pixel.
        #[test]
        fn a_rectangle_is_hidden_when_all_its_pixels_are_nearer(
            size in prop::array::uniform2(1usize..70),
            patches in prop::collection::vec((prop::array::uniform4(0.0f32..1.0), 0.5f32..9.0), 1..12),
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
            let mut depths = vec![5.0; size[0] * size[1]];
            for (corners, depth) in patches {
                pixels(spans(corners)).for_each(|pixel| depths[pixel] = depth);
            }
            let mut pyramid = Pyramid::default();
            pyramid.begin(size);
            for (corners, nearest) in asked {
                let (columns, rows) = spans(corners);
                let expected = pixels((columns, rows)).all(|pixel| depths[pixel] < nearest);
                prop_assert_eq!(pyramid.hides(&depths, columns, rows, nearest), expected);
            }
        }
    }
}
