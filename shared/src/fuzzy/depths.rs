//! How far the nearest non-fuzzy region is, element by element, and of many at once.

/// Depths along a face's axis, and of 2 × 2 of them the least and the greatest, and so on.
#[derive(Clone, Debug)]
pub(super) struct Depths {
    pub(super) levels: Vec<Vec<[f32; 2]>>,
}

/// What a buffer says of what is in a box.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Hidden {
    All,
    Nothing,
    Perhaps,
}

impl Depths {
    pub(super) fn new(nearest: &[f32], size: usize) -> Self {
        let first: Vec<[f32; 2]> = nearest.iter().map(|depth| [*depth; 2]).collect();
        let (mut levels, mut width) = (vec![first], size);
        while width > 1 {
            let (below, half) = (&levels[levels.len() - 1], width.div_ceil(2));
            let mut level = vec![[f32::INFINITY, f32::NEG_INFINITY]; half * half];
            for (row, depths) in below.chunks_exact(width).enumerate() {
                let above = &mut level[row / 2 * half..][..half];
                for (pair, [least, most]) in depths.chunks(2).zip(above) {
                    for depth in pair {
                        (*least, *most) = (least.min(depth[0]), most.max(depth[1]));
                    }
                }
            }
            levels.push(level);
            width = half;
        }
        Self { levels }
    }

    /// What depths there are in a rectangle: all less than one, or none less than another.
    pub(super) fn look(
        &self,
        columns: [usize; 2],
        rows: [usize; 2],
        [near, far]: [f32; 2],
    ) -> Hidden {
        // Where the rectangle is no more than two or three wide.
        let widest = (columns[1] - columns[0]).max(rows[1] - rows[0]) + 1;
        let level = (widest.ilog2() as usize).min(self.levels.len() - 1);
        let width = self.width(level);
        let (mut all, mut none) = (true, true);
        for row in rows[0] >> level..=rows[1] >> level {
            for column in columns[0] >> level..=columns[1] >> level {
                let [least, most] = self.levels[level][row * width + column];
                all = all
                    && (most < near || self.are_before(level, [column, row], columns, rows, near));
                none &= least >= far;
            }
        }
        match (all, none) {
            (true, _) => Hidden::All,
            (false, true) => Hidden::Nothing,
            (false, false) => Hidden::Perhaps,
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
        if self.levels[level][at[1] * self.width(level) + at[0]][1] < depth {
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

    pub(super) fn width(&self, level: usize) -> usize {
        self.levels[level].len().isqrt()
    }
}
