//! The PVS as rows of bits, for lookups and unions without a search.

use roaring::RoaringBitmap;
use sightline_world::{CellId, Cells};

use crate::bit_set::BitSet;

/// The most cells for which there are rows of bits, so that they take at most 64 MiB.
const CELLS_MAX: usize = 23_000;

/// Which cells see which.
///
/// The rows of [`Cells::pvs`] are compressed. A tick asks for thousands of them, and on maps with
/// many small cells that is most of its cost. Very large buildings keep the compressed rows.
#[derive(Clone, Debug)]
pub(crate) struct CellRows {
    /// One row for each cell; none in a very large building.
    rows: Vec<BitSet>,
}

impl CellRows {
    pub(crate) fn new(cells: &Cells) -> Self {
        Self::with_limit(cells, CELLS_MAX)
    }

    fn with_limit(cells: &Cells, cells_max: usize) -> Self {
        let pvs = if cells.cells.len() <= cells_max { &cells.pvs[..] } else { &[] };
        let row = |cells| {
            let mut row = BitSet::default();
            add_ranges(cells, &mut row);
            row
        };
        Self { rows: pvs.iter().map(row).collect() }
    }

    /// Whether some point of one cell may be visible from some point of the other.
    pub(crate) fn sees(&self, cells: &Cells, from: CellId, to: CellId) -> bool {
        match self.rows.get(from.0 as usize) {
            Some(row) => row.contains(to.0),
            None => cells.sees(from, to),
        }
    }

    /// Adds the cells that are visible from a cell.
    pub(crate) fn add_visible(&self, cells: &Cells, from: CellId, seen: &mut BitSet) {
        match self.rows.get(from.0 as usize) {
            Some(row) => seen.unite(row),
            None => add_ranges(&cells.pvs[from.0 as usize], seen),
        }
    }
}

/// Adds the cells of a compressed row.
fn add_ranges(row: &RoaringBitmap, seen: &mut BitSet) {
    let mut row = row.iter();
    while let Some(range) = row.next_range() {
        seen.insert_range(range);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::stage;

    #[test]
    fn rows_agree_with_the_pvs_whether_compressed_or_not() {
        let world = stage::row(7);
        let cells = &world.cells;
        let all = || (0..cells.cells.len() as u32).map(CellId);
        for rows in [CellRows::new(cells), CellRows::with_limit(cells, 3)] {
            for from in all() {
                let mut seen = BitSet::default();
                rows.add_visible(cells, from, &mut seen);
                for to in all() {
                    assert_eq!(rows.sees(cells, from, to), cells.sees(from, to));
                    assert_eq!(seen.contains(to.0), cells.sees(from, to));
                }
            }
        }
    }
}
