//! Which of 4 × 4 × 4 cells a line meets, by three look-ups.
//!
//! A line meets a cell when the three stretches in which it lies between the cell's planes along x,
//! y and z have a point in common. Three stretches have one when each two of them have (Helly's
//! theorem). So a line meets exactly the cells that it meets as seen along each of the three axes.
//! Seen along an axis it is a line in a grid of 4 × 4 squares, which is given by two numbers: its
//! slope and its place. [`Lines`] holds the squares for all slopes and places, rounded.
//!
//! Lines never go backwards along an axis: callers mirror the axes until that holds. Cells are
//! numbered as by [`morton`](sightline_world::octree::morton), so the numbers ascend along a line.

use std::sync::OnceLock;

/// The number of slopes that are told apart, less one.
const SLOPES: usize = 128;

/// The number of places that are told apart.
pub(super) const PLACES: usize = 128;

/// The entry of place 0 in a row. The entries before it are of lines that pass the grid by.
pub(super) const FIRST: usize = 64;

/// The number of entries of a row. The first and the last have no cells.
pub(super) const ENTRIES: usize = 2 * FIRST + PLACES;

/// The axes of each plane.
pub(super) const PLANES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// The cells that lines of one slope meet, by their places: a bit for each cell.
pub(super) type CellRow = [u64; ENTRIES];

/// By how much cells may be widened on each side, in edges of a cell.
const MARGINS: [f32; 5] = [0.0625, 0.125, 0.25, 0.5, 1.0];

/// The look-up table for one margin: a row for each of [`PLANES`] and each slope. It takes 800 kB,
/// of which a brick reads 6 kB.
pub(super) struct Lines {
    rows: Vec<CellRow>,
}

/// The look-up table for each of [`MARGINS`], made when it is first used.
static LINES: [OnceLock<Lines>; MARGINS.len()] = [const { OnceLock::new() }; MARGINS.len()];

impl Lines {
    /// The look-up table for lines whose place may be wrong by `margin` edges of a cell: that of
    /// the least of [`MARGINS`] that is enough.
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

    /// The index of the row for lines in a plane. `share` is the component of their direction along
    /// the plane's first axis, divided by the sum of both components.
    #[inline(always)]
    pub(super) fn index(plane: usize, share: f32) -> usize {
        debug_assert!(plane < PLANES.len(), "plane {plane}");
        let slope = (share * SLOPES as f32 + 0.5) as usize;
        plane * (SLOPES + 1) + slope.min(SLOPES)
    }

    /// A row by its index.
    #[inline(always)]
    pub(super) fn row(&self, index: usize) -> &CellRow {
        &self.rows[index]
    }
}

/// The cells whose squares lines of this slope and place meet. The direction of the lines is
/// (`share`, 1 − `share`). At place 0 a line touches the corner (4, 0), at the last place the
/// corner (0, 4).
///
/// All lines that are rounded to this slope and place count, so no cell on a line is missing. A
/// cell that is there without need lies within a sixteenth of a cell's edge, and the margin, of the
/// line.
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
        // Half a place, and half a slope times the distance to the middle of the grid.
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

    /// The length of the stretch in which a line lies in a cell that is grown on all sides.
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
