//! Which of 4 × 4 × 4 cells a line meets, by three look-ups.
//!
//! A line meets a cell when the stretches in which it lies between the cell's planes along x, y and
//! z have a point in common, and three stretches have one when each two of them have (Helly). So
//! the cells on a line are those that it meets as seen along z, and along x, and along y; and as
//! seen along an axis it is a line in a grid of 4 × 4 squares, which has two numbers: its slope, and
//! where it lies. [`Lines`] has the squares for all slopes and places, rounded.
//!
//! Lines never go backwards along an axis: whoever asks mirrors the axes until that holds. Cells
//! are numbered as by [`morton`](sightline_world::octree::morton), so that along a line the
//! numbers ascend.

use std::sync::OnceLock;

/// Slopes that are told apart, less one.
const SLOPES: usize = 128;

/// Places that are told apart.
pub(super) const PLACES: usize = 128;

/// The entry of place 0 in a row: there is room for lines that pass the grid by.
pub(super) const FIRST: usize = 64;

/// Entries of a row; the first and last have no cells.
pub(super) const ENTRIES: usize = 2 * FIRST + PLACES;

/// The axes of each plane.
pub(super) const PLANES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// The cells that lines of one slope meet, by their places.
pub(super) type CellRow = [u64; ENTRIES];

/// How much wider cells may be taken to be on each side, in cells' edges.
const MARGINS: [f32; 5] = [0.0625, 0.125, 0.25, 0.5, 1.0];

/// For each of [`PLANES`] and each slope, the cells: 800 kB, of which a brick uses 6.
pub(super) struct Lines {
    rows: Vec<CellRow>,
}

/// For each of [`MARGINS`].
static LINES: [OnceLock<Lines>; MARGINS.len()] = [const { OnceLock::new() }; MARGINS.len()];

impl Lines {
    /// All that can be asked for, when lines may lie beside where they are said to by so much of a cell's edge.
    pub(super) fn with_margin(margin: f32) -> &'static Self {
        let which = MARGINS.iter().position(|&wider| margin <= wider).unwrap_or(MARGINS.len() - 1);
        LINES[which].get_or_init(|| Self::new(MARGINS[which]))
    }

    fn new(margin: f32) -> Self {
        let rows = PLANES.into_iter().flat_map(|plane| {
            (0..=SLOPES).map(move |slope| {
                let share = slope as f32 / SLOPES as f32;
                let cells = |entry| cells_met(plane, share, entry as f32 - FIRST as f32, margin);
                std::array::from_fn(cells)
            })
        });
        Self { rows: rows.collect() }
    }

    /// Which row is that of lines in a plane, whose direction's share along the plane's first axis
    /// is so much of that along both.
    #[inline(always)]
    pub(super) fn index(plane: usize, share: f32) -> usize {
        let slope = (share * SLOPES as f32 + 0.5) as usize;
        plane * (SLOPES + 1) + slope.min(SLOPES)
    }

    /// A row by its index.
    #[inline(always)]
    pub(super) fn row(&self, index: usize) -> &CellRow {
        &self.rows[index]
    }
}

/// The cells whose squares some lines meet: the direction is (`share`, 1 − `share`), and the place
/// goes from 0, where a line touches the corner (4, 0), to the last, where it touches (0, 4).
///
/// All lines that are rounded to this slope and place count, so that no cell is missing from all
/// three planes' cells. What is too much lies within a sixteenth of a cell's edge, and the margin.
fn cells_met([first, second]: [usize; 2], share: f32, place: f32, margin: f32) -> u64 {
    let rest = 1.0 - share;
    let s = 4.0 * (place + 0.5) / PLACES as f32 - 4.0 * rest;
    if s < -margin - 4.0 || s > margin + 4.0 {
        return 0;
    }
    let mut cells = 0;
    for cell in 0..64 {
        let at = |axis: usize| ((cell >> axis & 1) + 2 * (cell >> (axis + 3) & 1)) as f32;
        let (a, b) = (at(first), at(second));
        let low = b * share - (a + 1.0) * rest;
        let high = (b + 1.0) * share - a * rest;
        // Half a place, and what half a slope makes of the way to the grid's middle.
        let turn = (a + b - 3.0).abs().max(1.0);
        let rounding = 2.0 / PLACES as f32 + turn * 0.5 / SLOPES as f32 + margin;
        if low - rounding < s && s < high + rounding {
            cells |= 1 << cell;
        }
    }
    cells
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;

    /// The stretch in which a line lies in a cell that is grown on all sides.
    fn stretch(cell: usize, from: Vec3, direction: Vec3, grown: f32) -> f32 {
        let at = |axis: usize| ((cell >> axis & 1) + 2 * (cell >> (axis + 3) & 1)) as f32;
        let low = Vec3::new(at(0), at(1), at(2)) - grown - from;
        let (a, b) = (low / direction, (low + 1.0 + 2.0 * grown) / direction);
        a.max(b).min_element() - a.min(b).max_element()
    }

    proptest! {
        #[test]
        fn no_cell_is_missing_and_none_is_far(
            direction in prop::array::uniform3(0.001f32..1.0),
            through in prop::array::uniform3(0.0f32..4.0),
            margin in prop::sample::select(MARGINS.to_vec()),
            share in prop::array::uniform3(-1.0f32..1.0),
        ) {
            let (lines, beside) = (Lines::with_margin(margin), share.map(|share| share * margin));
            let (direction, through) = (Vec3::from(direction), Vec3::from(through));
            let mut met = !0;
            for (plane, [first, second]) in PLANES.into_iter().enumerate() {
                let both = direction[first] + direction[second];
                let share = direction[first] / both;
                let s = (through[second] * direction[first] - through[first] * direction[second])
                    / both;
                let place = (s + 4.0 * (1.0 - share)) / 4.0 * PLACES as f32;
                let row = lines.row(Lines::index(plane, share));
                met &= row[(FIRST as f32 + place + beside[plane] / 4.0 * PLACES as f32) as usize];
            }
            for cell in 0..64 {
                let is_met = met >> cell & 1 == 1;
                if stretch(cell, through, direction, 0.0) > 1.0e-4 {
                    prop_assert!(is_met, "{cell} is missing");
                }
                if is_met {
                    let grown = 0.1 + 4.0 * margin;
                    prop_assert!(stretch(cell, through, direction, grown) > 0.0, "{cell} is far");
                }
            }
        }
    }
}
