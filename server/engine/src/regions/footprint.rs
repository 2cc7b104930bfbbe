//! Region footprints: what a region covers in the building.

use sightline_visibility::rooms::{RoomIndex, RoomOverlap};
use sightline_world::{CellId, geometry::Aabb};

use super::CoverBoxes;
use crate::building::Building;

/// What a region covers: its bounding box, its spaces, its cells and its rooms.
#[derive(Clone, Debug)]
pub(crate) struct RegionFootprint {
    /// The box around the region, in own axes.
    pub(crate) bounds: Aabb,
    /// The spaces that the region has a part in, ascending.
    pub(crate) spaces: Vec<u32>,
    /// For each space, where its cells end among all cells.
    ends: Vec<u32>,
    /// The cells, ascending. The cells of a space follow one another.
    cells: Vec<CellId>,
    /// What of the region is in which rooms; empty where rooms rule nothing out.
    rooms: RoomOverlap,
}

impl RegionFootprint {
    /// The footprint of boxes in some cells, which are ascending.
    pub(crate) fn new(building: &Building, cells: Vec<CellId>, cover: &CoverBoxes) -> Self {
        debug_assert!(cells.is_sorted(), "the cells of a space follow one another");
        let bounds = cover.boxes().iter().fold(Aabb::EMPTY, |all, part| all.union(part));
        let (mut spaces, mut ends): (Vec<u32>, Vec<u32>) = (Vec::new(), Vec::new());
        for (end, cell) in (1..).zip(&cells) {
            let space = building.cells().cells[cell.0 as usize].space;
            if spaces.last() == Some(&space) {
                ends.pop();
            } else {
                spaces.push(space);
            }
            ends.push(end);
        }
        let rooms = room_overlap(building, cover, &cells);
        Self { bounds, spaces, ends, cells, rooms }
    }

    /// The cells, ascending.
    pub(crate) fn cells(&self) -> &[CellId] {
        &self.cells
    }

    /// Whether rooms let an eye in this region see a body in another.
    pub(crate) fn rooms_allow(&self, bodies: &Self, rooms: &RoomIndex) -> bool {
        !rooms.can_rule_out() || rooms.may_see(&self.rooms, &bodies.rooms)
    }

    /// Each space and the region's cells in it.
    fn by_space(&self) -> impl Iterator<Item = (u32, &[CellId])> {
        let starts = std::iter::once(&0).chain(&self.ends);
        self.spaces
            .iter()
            .zip(starts.zip(&self.ends))
            .map(|(space, (start, end))| (*space, &self.cells[*start as usize..*end as usize]))
    }

    /// Whether some cell of this region sees some cell of another.
    pub(crate) fn sees(&self, other: &Self, building: &Building) -> bool {
        self.by_space().any(|(here, some)| {
            other.by_space().any(|(there, others)| {
                let sees =
                    |from: &CellId| others.iter().any(|to| building.cells().sees(*from, *to));
                building.sectors.sees(here, there) && some.iter().any(sees)
            })
        })
    }
}

/// What of some boxes, which are in these ascending cells, is in which rooms. Empty where rooms
/// rule nothing out.
pub(super) fn room_overlap(
    building: &Building,
    cover: &CoverBoxes,
    cells: &[CellId],
) -> RoomOverlap {
    if building.rooms.can_rule_out() {
        building.rooms.overlap_in_cells(building.cells(), cover.boxes(), cells)
    } else {
        RoomOverlap::default()
    }
}
