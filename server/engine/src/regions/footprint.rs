//! Region footprints: what a region covers in the building.

use std::{ops::Range, sync::OnceLock};

use sightline_visibility::{
    box_visibility::BoxInSpaces,
    rooms::{RoomIndex, RoomOverlap},
};
use sightline_world::{CellId, Cells, geometry::Aabb};

use super::{CoverBoxes, reach::Piece};
use crate::{bit_set::BitSet, building::Building};

/// A space with more cells than this is searched by the tree of cells.
const CELLS_FEW: usize = 64;

/// What a region covers: its bounding box, its spaces, its cells and its rooms.
#[derive(Clone, Debug)]
pub(crate) struct RegionFootprint {
    /// The box around the region, in own axes.
    pub(crate) bounds: Aabb,
    /// The spaces that the region has a part in, ascending.
    pub(crate) spaces: Vec<u32>,
    /// The part of the region in each space.
    parts: Vec<Aabb>,
    /// The cells, once they were asked for. Sectors and gates decide most pairs without them.
    cells: OnceLock<FootprintCells>,
    /// What of the region is in which rooms; empty where rooms rule nothing out.
    rooms: RoomOverlap,
}

/// The cells of a region. Those of a space follow one another.
#[derive(Clone, Debug)]
struct FootprintCells {
    all: Vec<CellId>,
    /// For each space, where its cells are among all.
    of_space: Vec<Range<usize>>,
}

impl RegionFootprint {
    /// The footprint of a region in some pieces, which boxes cover.
    pub(crate) fn new(building: &Building, pieces: &[Piece], cover: &CoverBoxes) -> Self {
        debug_assert!(pieces.is_sorted_by_key(|piece| piece.space), "cells are in order");
        Self {
            bounds: cover.bounds(),
            spaces: pieces.iter().map(|piece| piece.space).collect(),
            parts: pieces.iter().map(|piece| piece.region).collect(),
            cells: OnceLock::new(),
            rooms: room_overlap(building, cover, pieces),
        }
    }

    /// The box around the region, and its spaces.
    pub(super) fn in_spaces(&self) -> BoxInSpaces<'_> {
        BoxInSpaces { bounds: &self.bounds, spaces: &self.spaces }
    }

    /// Whether rooms let an eye in this region see a body in another.
    pub(crate) fn rooms_allow(&self, bodies: &Self, rooms: &RoomIndex) -> bool {
        !rooms.can_rule_out() || rooms.may_see(&self.rooms, &bodies.rooms)
    }

    /// Whether some cell of this region sees some cell of another.
    pub(crate) fn sees(&self, other: &Self, building: &Building) -> bool {
        let cells = building.cells();
        (0..).zip(&self.spaces).any(|(from, here)| {
            (0..).zip(&other.spaces).any(|(to, there)| {
                let others = || other.cells_in(cells, to);
                let sees = |from: &CellId| others().iter().any(|to| building.sees(*from, *to));
                building.sectors.sees(*here, *there) && self.cells_in(cells, from).iter().any(sees)
            })
        })
    }

    /// The cells, ascending.
    pub(crate) fn cell_numbers(&self, building: &Building) -> Vec<u32> {
        self.cells(building.cells()).all.iter().map(|cell| cell.0).collect()
    }

    /// Adds the cells that are visible from some of this region's cells.
    pub(crate) fn add_visible(&self, building: &Building, seen: &mut BitSet) {
        let cells = building.cells();
        for cell in &self.cells(cells).all {
            building.cell_rows.add_visible(cells, *cell, seen);
        }
    }

    /// Whether the region has a cell of this set.
    pub(crate) fn touches(&self, cells: &Cells, set: &BitSet) -> bool {
        self.cells(cells).all.iter().any(|cell| set.contains(cell.0))
    }

    /// The region's cells in one of its spaces.
    fn cells_in(&self, cells: &Cells, space: usize) -> &[CellId] {
        let found = self.cells(cells);
        &found.all[found.of_space[space].clone()]
    }

    fn cells(&self, cells: &Cells) -> &FootprintCells {
        self.cells.get_or_init(|| {
            let (all, of_space) = (Vec::with_capacity(8), Vec::with_capacity(self.spaces.len()));
            let mut found = FootprintCells { all, of_space };
            for (space, part) in self.spaces.iter().zip(&self.parts) {
                let start = found.all.len();
                add_cells(cells, *space, part, &mut found.all);
                found.of_space.push(start..found.all.len());
            }
            found
        })
    }
}

/// Adds the cells of a space that share a point with a box, ascending.
fn add_cells(cells: &Cells, space: u32, part: &Aabb, found: &mut Vec<CellId>) {
    let all = cells.spaces[space as usize].cells.clone();
    if all.len() > CELLS_FEW {
        let mut near = Vec::new();
        cells.overlapping(part, &mut near);
        found.extend(near.into_iter().filter(|cell| all.contains(&cell.0)));
    } else {
        let touches = |cell: &u32| cells.cells[*cell as usize].bounds.intersects(part);
        found.extend(all.filter(touches).map(CellId));
    }
}

/// What of some boxes, which are in these pieces, is in which rooms. Empty where rooms rule nothing
/// out.
pub(super) fn room_overlap(
    building: &Building,
    cover: &CoverBoxes,
    pieces: &[Piece],
) -> RoomOverlap {
    if !building.rooms.can_rule_out() {
        return RoomOverlap::default();
    }
    let mut found = Vec::new();
    for Piece { space, region } in pieces {
        add_cells(building.cells(), *space, region, &mut found);
    }
    building.rooms.overlap_in_cells(building.cells(), cover.boxes(), &found)
}
