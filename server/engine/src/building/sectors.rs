//! The building at a resolution coarser than cells.

use sightline_world::Cells;

use crate::bit_set::BitSet;

/// The most sectors of a building, so that the table of which sector sees which takes at most
/// 32 MiB.
const SECTORS_MAX: usize = 1 << 14;

/// Groups of cells. A sector is a space, or several that follow one another in very large
/// buildings. Regions overlap many cells but few sectors, and box visibility decides what sectors
/// leave open.
#[derive(Clone, Debug)]
pub(crate) struct Sectors {
    /// How many spaces make one sector.
    spaces_each: u32,
    /// For each sector, those that have a cell visible from one of its cells.
    visible: Vec<BitSet>,
}

impl Sectors {
    pub(crate) fn new(cells: &Cells) -> Self {
        let spaces_each = cells.spaces.len().div_ceil(SECTORS_MAX).max(1) as u32;
        let of_cell: Vec<u32> = cells.cells.iter().map(|cell| cell.space / spaces_each).collect();
        let count = of_cell.iter().max().map_or(0, |last| *last as usize + 1);
        debug_assert!(count <= SECTORS_MAX, "the table would be too large");
        debug_assert!(of_cell.is_sorted(), "cells are in the order of spaces");
        let mut visible = vec![BitSet::default(); count];
        for (sector, row) in of_cell.iter().zip(&cells.pvs) {
            let mut row = row.iter();
            while let Some(range) = row.next_range() {
                let [first, last] =
                    [range.start(), range.end()].map(|cell| of_cell[*cell as usize]);
                visible[*sector as usize].insert_range(first..=last);
            }
        }
        Self { spaces_each, visible }
    }

    pub(crate) fn len(&self) -> usize {
        self.visible.len()
    }

    /// The sectors of some spaces, which are ascending.
    pub(crate) fn of(&self, spaces: &[u32]) -> Vec<u32> {
        debug_assert!(spaces.is_sorted(), "sectors are in the order of spaces");
        let mut sectors: Vec<u32> = spaces.iter().map(|space| space / self.spaces_each).collect();
        sectors.dedup();
        sectors
    }

    /// Whether a space may see another.
    pub(crate) fn sees(&self, space: u32, other: u32) -> bool {
        self.visible[(space / self.spaces_each) as usize].contains(other / self.spaces_each)
    }

    /// Whether some of these sectors may see some of those.
    pub(crate) fn any_sees(&self, these: &[u32], those: &[u32]) -> bool {
        let seen = |sector: &u32| &self.visible[*sector as usize];
        these.iter().map(seen).any(|seen| those.iter().any(|other| seen.contains(*other)))
    }

    /// All sectors that are visible from some of these.
    pub(crate) fn visible_from(&self, sectors: &[u32]) -> BitSet {
        let mut all = BitSet::default();
        sectors.iter().for_each(|sector| all.unite(&self.visible[*sector as usize]));
        all
    }
}
