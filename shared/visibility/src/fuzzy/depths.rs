//! How far the nearest non-fuzzy region is, element by element, and of many at once.

/// Depths along a face's axis, and of 2 × 2 of them the least and the greatest, and so on.
#[derive(Clone, Debug)]
pub(super) struct DepthPyramid {
    /// Row by row.
    pub(super) nearest: Vec<f32>,
    size: usize,
    /// From 2 × 2 on.
    levels: Vec<PyramidLevel>,
}

#[derive(Clone, Debug)]
struct PyramidLevel {
    width: usize,
    /// The least and the greatest.
    entries: Vec<[f32; 2]>,
}

/// What a buffer says of what is in a box.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Occlusion {
    All,
    Nothing,
    Perhaps,
}

impl DepthPyramid {
    /// Nothing is near.
    pub(super) fn new(size: usize) -> Self {
        Self { nearest: vec![f32::INFINITY; size * size], size, levels: Vec::new() }
    }

    /// Makes it fit to be looked at. When depths become less thereafter, what is found is right and less than there is.
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

    /// What depths there are in a rectangle: all less than one, or none less than another.
    pub(super) fn look(
        &self,
        columns: [usize; 2],
        rows: [usize; 2],
        [near, far]: [f32; 2],
    ) -> Occlusion {
        // Where the rectangle is no more than two or three wide.
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

    /// Whether all depths in the part of a rectangle that an entry of a level is for are less.
    pub(super) fn are_before(
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
    /// That above some entries, so many to a row.
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
