//! The gates of a building, and what can be seen through them.

use std::ops::Range;

use sightline_world::{Cells, tolerance::WIDENING_M};

use super::{
    box_tree::BoxTree,
    cell_block::{CellBlock, blocks},
    daabb::DAabb,
    directed_gate::DirectedGate,
    scratch::{FlowScratch, SearchSizes},
};
use crate::HalfSpace;

/// A question: what can be seen from a source?
#[derive(Clone, Copy)]
pub struct Query<'a> {
    /// The space that the source lies in.
    pub space: u32,
    /// The box of eyes, widened already by the caller.
    pub source: DAabb,
    /// The spaces that may be entered; all of them if absent.
    pub spaces: Option<&'a [u32]>,
    /// Half-spaces that hold whatever is looked for.
    pub frustum: &'a [HalfSpace],
}

impl Query<'_> {
    /// Whether some of a box may be in all half-spaces of the frustum.
    pub(super) fn meets(&self, target: &DAabb) -> bool {
        self.frustum.iter().all(|half| target.meets(half))
    }
}

/// The gates of a building, prepared for searches.
pub struct Sightlines<'a> {
    pub(super) cells: &'a Cells,
    /// Two for each gate: `2i` leads to the greater side of gate `i`, `2i + 1` to its lesser side.
    pub(super) gates: Vec<DirectedGate>,
    /// For each space the gates out of it.
    pub(super) gates_out: Vec<BoxTree>,
    /// The box around each cell, widened.
    pub(super) targets: Vec<DAabb>,
    pub(super) blocks: Vec<CellBlock>,
    /// For each space its blocks, as indices into `blocks`.
    pub(super) blocks_of: Vec<Range<u32>>,
}

impl<'a> Sightlines<'a> {
    /// Prepares the gates of a subdivision.
    pub fn new(cells: &'a Cells) -> Self {
        let gates: Vec<DirectedGate> = cells
            .gates
            .iter()
            .flat_map(|gate| {
                let [lesser, greater] = gate.spaces;
                [
                    DirectedGate::new(&gate.polygon, greater, 1.0),
                    DirectedGate::new(&gate.polygon, lesser, -1.0),
                ]
            })
            .collect();
        let targets: Vec<DAabb> =
            cells.cells.iter().map(|cell| DAabb::around(&cell.bounds, WIDENING_M)).collect();
        let blocks = blocks(cells, &targets);
        let starting = |cell: u32| blocks.partition_point(|block| block.cells.start < cell) as u32;
        let blocks_of = cells
            .spaces
            .iter()
            .map(|space| starting(space.cells.start)..starting(space.cells.end))
            .collect();
        assert_eq!(gates.len(), 2 * cells.gates.len());
        let out_of = |space: u32| {
            let gates_out = gates_from(cells, space);
            BoxTree::new(gates_out.map(|gate| (gates[gate as usize].bounds, gate)).collect())
        };
        let gates_out = (0..cells.spaces.len() as u32).map(out_of).collect();
        Self { cells, gates, gates_out, targets, blocks, blocks_of }
    }

    /// The gates out of a space, as indices into `gates`.
    pub(super) fn gates_from(&self, space: u32) -> impl Iterator<Item = u32> + '_ {
        gates_from(self.cells, space)
    }

    /// The spaces of which some point may be visible from some point of the source. The source's
    /// own space comes first.
    pub fn spaces(&self, scratch: &mut FlowScratch, query: &Query<'_>) -> Vec<u32> {
        scratch.begin(self.sizes(1), query.spaces.unwrap_or_default());
        let mut found = vec![query.space];
        scratch.see(query.space);
        self.search(scratch, query);
        for step in 0..scratch.steps.len() {
            let space = self.gates[scratch.steps[step].gate as usize].to;
            if scratch.see(space) {
                found.push(space);
            }
        }
        found
    }

    /// The cells of which some point may be visible from some point of the source.
    pub fn cells(&self, scratch: &mut FlowScratch, query: &Query<'_>) -> Vec<u32> {
        let mut found = [Vec::new()];
        self.search_cells(scratch, query, &[query.source], &mut found);
        let [found] = found;
        found
    }

    /// For each cell of a block, the cells of which some point may be visible from some point of
    /// it. Only the given spaces are entered.
    pub fn rows(
        &self,
        scratch: &mut FlowScratch,
        block: &CellBlock,
        spaces: &[u32],
    ) -> Vec<Vec<u32>> {
        let CellBlock { bounds, ref cells, space } = *block;
        let query = Query { space, source: bounds, spaces: Some(spaces), frustum: &[] };
        let sources: Vec<DAabb> = cells.clone().map(|cell| self.targets[cell as usize]).collect();
        let mut found = vec![Vec::new(); sources.len()];
        self.search_cells(scratch, &query, &sources, &mut found);
        found
    }

    /// All cells, in blocks of cells that lie close together and see much the same.
    pub fn blocks(&self) -> &[CellBlock] {
        &self.blocks
    }

    /// The sizes that scratch memory has to have for a search with this number of sources.
    pub(super) fn sizes(&self, sources: usize) -> SearchSizes {
        SearchSizes {
            sources,
            gates: self.gates.len(),
            spaces: self.cells.spaces.len(),
            cells: self.cells.cells.len(),
            blocks: self.blocks.len(),
        }
    }
}

/// The gates out of a space, as indices of directed gates.
fn gates_from(cells: &Cells, space: u32) -> impl Iterator<Item = u32> + '_ {
    cells.spaces[space as usize].gates.iter().map(move |&gate| {
        let is_lesser = cells.gates[gate as usize].spaces[0] == space;
        gate * 2 + u32::from(!is_lesser)
    })
}
