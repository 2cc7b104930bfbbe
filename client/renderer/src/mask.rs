//! The mask buffer of a band: one bit for each pixel in words of 8 × 8 pixels, and above these one
//! bit for each word (Dell 2012, box 83).

/// The side of a block in pixels. The mask of a block is one word, with bit 8·y + x for each pixel.
pub(super) const BLOCK: usize = 8;

/// A rectangle of pixels of a band. `right` and `bottom` lie outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Area {
    pub(super) left: usize,
    pub(super) right: usize,
    pub(super) top: usize,
    pub(super) bottom: usize,
}

impl Area {
    /// The pixels of the area that lie in a block which it meets, as a mask.
    #[inline(always)]
    pub(super) fn word(&self, column: usize, row: usize) -> u64 {
        let (x, y) = (column * BLOCK, row * BLOCK);
        let columns = low_bits(self.right - x) & !low_bits(self.left.saturating_sub(x));
        let rows = low_bytes(self.bottom - y) & !low_bytes(self.top.saturating_sub(y));
        ((columns & 0xff) * 0x0101_0101_0101_0101) & rows
    }

    /// The columns and rows of blocks that the area meets.
    #[inline(always)]
    pub(super) fn blocks(&self) -> [std::ops::Range<usize>; 2] {
        [
            self.left / BLOCK..self.right.div_ceil(BLOCK),
            self.top / BLOCK..self.bottom.div_ceil(BLOCK),
        ]
    }
}

/// The mask buffer: which pixels are written. Pixels outside of the picture count as written.
#[derive(Default)]
pub(super) struct Mask {
    /// Blocks in a row.
    across: usize,
    /// The mask of each block, row by row.
    words: Vec<u64>,
    /// A bit for each block that has pixels left to write, row by row. Rows begin at whole words.
    open: Vec<u64>,
    /// Words of `open` in a row.
    open_across: usize,
    /// The number of blocks that have pixels left to write.
    blocks_open: usize,
}

impl Mask {
    /// Begins a picture of this size in which nothing is written.
    pub(super) fn clear(&mut self, width: usize, height: usize) {
        let (across, down) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
        self.across = across;
        self.open_across = across.div_ceil(64);
        self.blocks_open = across * down;
        let all = Area { left: 0, right: width, top: 0, bottom: height };
        self.words.clear();
        self.words.extend((0..across * down).map(|i| !all.word(i % across, i / across)));
        self.open.clear();
        let word = |i: usize| low_bits(across - i * 64);
        self.open.extend((0..down).flat_map(|_| (0..self.open_across).map(word)));
    }

    /// The number of blocks in a row.
    #[inline(always)]
    pub(super) fn across(&self) -> usize {
        self.across
    }

    /// Whether every pixel is written.
    #[inline(always)]
    pub(super) fn is_full(&self) -> bool {
        self.blocks_open == 0
    }

    /// The mask of a block.
    #[inline(always)]
    pub(super) fn word(&self, block: usize) -> u64 {
        self.words[block]
    }

    /// Marks pixels of a block as written.
    #[inline(always)]
    pub(super) fn cover(&mut self, block: usize, pixels: u64) {
        let word = &mut self.words[block];
        let was_open = *word != !0;
        *word |= pixels;
        if was_open && *word == !0 {
            let (column, row) = (block % self.across, block / self.across);
            self.open[row * self.open_across + column / 64] &= !(1 << (column % 64));
            self.blocks_open -= 1;
        }
    }

    /// Whether an area has pixels left to write. For an area of many blocks the answer may be yes
    /// because of other pixels in the same blocks.
    #[inline(always)]
    pub(super) fn is_open(&self, area: &Area) -> bool {
        let [columns, rows] = area.blocks();
        if columns.len() > 4 {
            return rows.into_iter().any(|row| self.has_open_block(row, &columns));
        }
        rows.into_iter().any(|row| {
            let words = &self.words[row * self.across..];
            columns.clone().any(|column| !words[column] & area.word(column, row) != 0)
        })
    }

    #[inline(always)]
    fn has_open_block(&self, row: usize, columns: &std::ops::Range<usize>) -> bool {
        let (first, last) = (columns.start / 64, (columns.end - 1) / 64);
        (first..=last).any(|i| {
            let wanted =
                low_bits(columns.end - i * 64) & !low_bits(columns.start.saturating_sub(i * 64));
            self.open[row * self.open_across + i] & wanted != 0
        })
    }
}

/// A word whose lowest `count` bits are set; all of them from 64 on.
#[inline(always)]
pub(super) fn low_bits(count: usize) -> u64 {
    if count >= 64 { !0 } else { (1 << count) - 1 }
}

/// A word whose lowest `count` bytes are set; all of them from 8 on.
#[inline(always)]
fn low_bytes(count: usize) -> u64 {
    if count >= 8 { !0 } else { (1 << (8 * count)) - 1 }
}

/// Which lines of a block have pixels: a bit for each byte that is not zero.
#[inline(always)]
pub(super) fn lines(pixels: u64) -> u64 {
    let low = 0x7f7f_7f7f_7f7f_7f7f;
    let some = (((pixels & low) + low) | pixels) & !low;
    (some >> 7).wrapping_mul(0x0102_0408_1020_4080) >> 56
}

/// The positions of the bits that are set, in ascending order.
#[inline(always)]
pub(super) fn bits(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = (word != 0).then(|| word.trailing_zeros() as usize)?;
        word &= word - 1;
        Some(place)
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WIDTH: usize = 611;
    const HEIGHT: usize = 43;

    fn area() -> impl Strategy<Value = Area> {
        let ends = |side: usize| (0..side - 1).prop_flat_map(move |a| (Just(a), a + 1..side));
        (ends(WIDTH), ends(HEIGHT)).prop_map(|((left, right), (top, bottom))| Area {
            left,
            right,
            top,
            bottom,
        })
    }

    proptest! {
        #[test]
        fn areas_are_open_until_all_is_written(
            written in prop::collection::vec(area(), 0..12),
            asked in prop::collection::vec(area(), 1..12),
        ) {
            let mut mask = Mask::default();
            mask.clear(WIDTH, HEIGHT);
            let mut naive = vec![false; WIDTH * HEIGHT];
            for area in &written {
                let [columns, rows] = area.blocks();
                for (row, column) in rows.flat_map(|r| columns.clone().map(move |c| (r, c))) {
                    mask.cover(row * mask.across() + column, area.word(column, row));
                }
                for y in area.top..area.bottom {
                    naive[y * WIDTH + area.left..y * WIDTH + area.right].fill(true);
                }
            }
            for area in asked {
                let open = (area.top..area.bottom).any(|y| {
                    naive[y * WIDTH + area.left..y * WIDTH + area.right].contains(&false)
                });
                // Large areas may be called open when they are not.
                let small = area.blocks()[0].len() <= 4;
                prop_assert!(mask.is_open(&area) == open || !small && !open);
            }
            prop_assert_eq!(mask.is_full(), !naive.contains(&false));
        }
    }
}
