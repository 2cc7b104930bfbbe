//! The depths of a face's elements, and of many elements at once.

use sightline_world::tolerance::BEHIND_M;

/// What lies no farther behind than this share of the distance counts as not hidden. It exceeds the
/// rounding of single precision.
const BEHIND_SHARE: f64 = 1e-5;

/// Depths along a face's axis, and a pyramid with the least and the greatest of 2 × 2, and so on.
#[derive(Clone, Debug)]
pub(super) struct DepthPyramid {
    /// The depth of each element, row by row.
    pub(super) nearest: Vec<f32>,
    size: usize,
    /// The levels above the elements; the first is for 2 × 2 elements.
    levels: Vec<PyramidLevel>,
}

/// A level of the pyramid.
#[derive(Clone, Debug)]
struct PyramidLevel {
    width: usize,
    /// The least and the greatest depth of each entry, row by row.
    entries: Vec<[f32; 2]>,
}

/// A box as it projects onto a face.
pub(super) struct ProjectedBox {
    /// The first and the last column of elements that it meets.
    pub(super) columns: [usize; 2],
    /// The first and the last row of elements that it meets.
    pub(super) rows: [usize; 2],
    /// An element with a lesser depth hides all of it.
    pub(super) near: f32,
    /// An element with at least this depth hides none of it.
    pub(super) far: f32,
}

/// What a buffer says about a box.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Occlusion {
    /// All of it is hidden.
    All,
    /// No element hides any of it.
    Nothing,
    /// Some of it may be hidden.
    Perhaps,
}

impl DepthPyramid {
    /// Depths where nothing hides anything.
    pub(super) fn new(size: usize) -> Self {
        Self { nearest: vec![f32::INFINITY; size * size], size, levels: Vec::new() }
    }

    /// Builds the pyramid. If depths become less afterwards, tests stay correct but find less
    /// hidden.
    pub(super) fn find_levels(&mut self) {
        self.levels.clear();
        let mut level = PyramidLevel::above(self.size, &self.nearest, |depth| [*depth; 2]);
        while level.width > 1 {
            let next = PyramidLevel::above(level.width, &level.entries, |ends| *ends);
            self.levels.push(std::mem::replace(&mut level, next));
        }
        self.levels.push(level);
    }

    fn entry(&self, level: usize, [column, row]: [usize; 2]) -> [f32; 2] {
        match level.checked_sub(1) {
            None => [self.nearest[row * self.size + column]; 2],
            Some(above) => {
                let PyramidLevel { width, entries } = &self.levels[above];
                entries[row * width + column]
            }
        }
    }

    /// What the depths say about a box.
    pub(super) fn test(&self, projected: &ProjectedBox) -> Occlusion {
        let &ProjectedBox { columns, rows, near, far } = projected;
        debug_assert!(columns[1] < self.size && rows[1] < self.size, "the box is on the face");
        // The level at which the rectangle is at most two or three entries wide.
        let widest = (columns[1] - columns[0]).max(rows[1] - rows[0]) + 1;
        let level = (widest.ilog2() as usize).min(self.levels.len());
        let (mut all, mut none) = (true, true);
        for row in rows[0] >> level..=rows[1] >> level {
            for column in columns[0] >> level..=columns[1] >> level {
                let [least, most] = self.entry(level, [column, row]);
                all = all
                    && (most < near || self.are_before(level, [column, row], columns, rows, near));
                none &= least >= far;
            }
        }
        match (all, none) {
            (true, _) => Occlusion::All,
            (false, true) => Occlusion::Nothing,
            (false, false) => Occlusion::Perhaps,
        }
    }

    /// Whether all depths in the common part of an entry and a rectangle are less than a depth.
    fn are_before(
        &self,
        level: usize,
        at: [usize; 2],
        columns: [usize; 2],
        rows: [usize; 2],
        depth: f32,
    ) -> bool {
        if self.entry(level, at)[1] < depth {
            return true;
        }
        if level == 0 {
            return false;
        }
        let below = self.width(level - 1);
        let within = |at: usize, span: [usize; 2]| {
            let (first, last) = (span[0] >> (level - 1), span[1] >> (level - 1));
            (2 * at).max(first)..=(2 * at + 1).min(last).min(below - 1)
        };
        within(at[1], rows).all(|row| {
            within(at[0], columns)
                .all(|column| self.are_before(level - 1, [column, row], columns, rows, depth))
        })
    }

    fn width(&self, level: usize) -> usize {
        level.checked_sub(1).map_or(self.size, |above| self.levels[above].width)
    }
}

impl PyramidLevel {
    /// The level above some entries, of which there are `width` in a row.
    fn above<T>(width: usize, below: &[T], ends: impl Fn(&T) -> [f32; 2]) -> Self {
        let half = width.div_ceil(2);
        let mut entries = vec![[f32::INFINITY, f32::NEG_INFINITY]; half * half];
        for (row, below) in below.chunks_exact(width).enumerate() {
            let above = &mut entries[row / 2 * half..][..half];
            for (pair, [least, most]) in below.chunks(2).zip(above) {
                for [low, high] in pair.iter().map(&ends) {
                    (*least, *most) = (least.min(low), most.max(high));
                }
            }
        }
        Self { width: half, entries }
    }
}

/// The depth from which on something is hidden: an element with a lesser depth hides what is at
/// `nearest`.
pub(super) fn hidden_from(nearest: f64) -> f32 {
    ((nearest - BEHIND_M) * (1.0 - BEHIND_SHARE)) as f32
}
