//! Which rooms a region overlaps.

use sightline_world::{CellId, Cells, geometry::Aabb, rooms::RoomId};

use super::{index::RoomIndex, overlap::RoomOverlap, pieces::cover};

/// A region and the parts of it that are in cells.
struct RegionParts<'a> {
    /// The boxes of the region.
    boxes: &'a [Aabb],
    /// The cells that the region is in, ascending.
    cells: &'a [CellId],
    /// Boxes that together hold every place of the region.
    whole: &'a [Aabb],
    /// Boxes that together hold every place of the region that is in a cell.
    in_cells: &'a [Aabb],
}

impl RoomIndex {
    /// The rooms that a region overlaps. The region is the union of some boxes in own axes.
    pub fn overlap(&self, cells: &Cells, boxes: &[Aabb]) -> RoomOverlap {
        if self.is_empty() {
            return RoomOverlap::without_rooms();
        }
        let mut found: Vec<CellId> = Vec::new();
        let mut is_bare = false;
        for region in boxes {
            let start = found.len();
            cells.overlapping(region, &mut found);
            is_bare |= self.is_bare(cells, region, &found[start..]);
        }
        found.sort_unstable();
        found.dedup();
        let parts = parts_in_cells(cells, boxes, &found);
        let region = RegionParts { boxes, cells: &found, whole: boxes, in_cells: &parts };
        self.overlap_of(&region, is_bare)
    }

    /// The rooms that some boxes overlap inside some cells, which come in ascending order. It is
    /// for somebody who can be in these cells only, whatever walls the boxes reach through.
    pub fn overlap_in_cells(&self, cells: &Cells, boxes: &[Aabb], found: &[CellId]) -> RoomOverlap {
        debug_assert!(found.is_sorted(), "cells come in ascending order");
        if self.is_empty() {
            return RoomOverlap::without_rooms();
        }
        let is_bare =
            boxes.is_empty() || boxes.iter().any(|region| self.is_bare(cells, region, found));
        let parts = parts_in_cells(cells, boxes, found);
        let region = RegionParts { boxes, cells: found, whole: &parts, in_cells: &parts };
        self.overlap_of(&region, is_bare)
    }

    fn overlap_of(&self, region: &RegionParts<'_>, is_bare: bool) -> RoomOverlap {
        let &RegionParts { boxes, cells, whole, in_cells } = region;
        let mut overlap = RoomOverlap { boxes: boxes.to_vec(), is_bare, ..RoomOverlap::default() };
        let near = cells.iter().flat_map(|cell| self.rooms_near(*cell)).copied();
        overlap.touched = near.chain(self.unbounded.iter().copied()).collect();
        overlap.touched.sort_unstable();
        overlap.touched.dedup();
        overlap.touched.retain(|id| whole.iter().any(|part| self.meets(*id, part)));
        let holds = |id: &RoomId, all: &[Aabb]| {
            !all.is_empty() && all.iter().all(|part| cover(self.pieces(*id).iter(), part))
        };
        // A place in no cell is in something solid, where no part of a body is seen.
        let is_within = |id: &RoomId| holds(id, whole) || holds(id, in_cells);
        overlap.within = overlap.touched.iter().copied().filter(is_within).collect();
        let restricts = |id: &RoomId| self.room(*id).restricts;
        overlap.restricting = overlap.touched.iter().copied().filter(restricts).collect();
        let sealed = overlap.touched.iter().filter(|id| self.room(**id).is_sealed);
        overlap.sealed = sealed.map(|id| (*id, overlap.within.binary_search(id).is_ok())).collect();
        if self.names_cells {
            overlap.cells = cells.to_vec();
        }
        overlap
    }

    /// The rooms that overlap a cell, ascending.
    fn rooms_near(&self, cell: CellId) -> &[RoomId] {
        self.rooms_of_cell.get(cell.0 as usize).map_or(&[], Vec::as_slice)
    }

    /// Whether some of a box may be in a room: may be wrongly true, never wrongly false.
    fn meets(&self, id: RoomId, region: &Aabb) -> bool {
        self.room(id).pieces.iter().any(|piece| piece.meets(region))
    }

    /// Whether an eye somewhere in a box, in one of the given cells, may be in no restricting room.
    /// Eyes are in cells, or a little way into something solid.
    fn is_bare(&self, cells: &Cells, region: &Aabb, found: &[CellId]) -> bool {
        if !self.is_restricting {
            return true;
        }
        let is_covered = |part: &Aabb, near: &[RoomId]| {
            let near = near.iter().filter(|id| self.room(**id).restricts);
            cover(near.flat_map(|id| self.pieces(*id)), part)
        };
        let overlaps = |cell: &&CellId| cells.cells[cell.0 as usize].bounds.intersects(region);
        !found.iter().any(|cell| overlaps(&cell))
            || found.iter().filter(overlaps).any(|cell| {
                let part = cells.cells[cell.0 as usize].bounds.intersection(region);
                !self.covered.contains(cell.0)
                    && !part.is_empty()
                    && !is_covered(&part, self.rooms_near(*cell))
            })
    }
}

/// The parts of some boxes that are in some cells.
fn parts_in_cells(cells: &Cells, boxes: &[Aabb], found: &[CellId]) -> Vec<Aabb> {
    let bounds = found.iter().map(|cell| &cells.cells[cell.0 as usize].bounds);
    let parts = bounds.flat_map(|bounds| boxes.iter().map(|region| region.intersection(bounds)));
    parts.filter(|part| !part.is_empty()).collect()
}
