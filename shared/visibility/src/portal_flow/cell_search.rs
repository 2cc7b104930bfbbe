//! Which cells the parts of a source can see.

use super::{
    daabb::DAabb,
    directed_gate::edge_separators,
    scratch::FlowScratch,
    separators::{HalfSpaces, separators},
    sightlines::{Query, Sightlines},
    step::FlowStep,
};

/// A search for the cells that several parts of a source can see, and what it has found.
struct CellSearch<'a, 'b> {
    query: &'a Query<'b>,
    /// The parts of the source.
    sources: &'a [DAabb],
    /// For each part the cells found.
    found: &'a mut [Vec<u32>],
    scratch: &'a mut FlowScratch,
    halves: HalfSpaces,
}

impl CellSearch<'_, '_> {
    fn index(&self, source: usize, cell: u32) -> u32 {
        cell * self.sources.len() as u32 + source as u32
    }

    fn has_seen(&self, source: usize, cell: u32) -> bool {
        self.scratch.has_seen(self.index(source, cell))
    }

    fn see(&mut self, source: usize, cell: u32) {
        let index = self.index(source, cell);
        if self.scratch.see(index) {
            self.found[source].push(cell);
        }
    }
}

impl Sightlines<'_> {
    /// Finds for each of several parts of a query's source the cells that it may see.
    pub(super) fn search_cells(
        &self,
        scratch: &mut FlowScratch,
        query: &Query<'_>,
        sources: &[DAabb],
        found: &mut [Vec<u32>],
    ) {
        debug_assert_eq!(sources.len(), found.len(), "one list for each part");
        scratch.begin(self.sizes(sources.len()), query.spaces.unwrap_or_default());
        let mut search = CellSearch { query, sources, found, scratch, halves: HalfSpaces::none() };
        for cell in self.cells.spaces[query.space as usize].cells.clone() {
            if query.meets(&self.targets[cell as usize]) {
                (0..sources.len()).for_each(|source| search.see(source, cell));
            }
        }
        self.search(search.scratch, query);
        let (mut halves, mut back) = (HalfSpaces::none(), HalfSpaces::none());
        for index in 0..search.scratch.steps.len() {
            let step = search.scratch.steps[index];
            if step.is_covered {
                continue;
            }
            let gate = &self.gates[step.gate as usize];
            separators(&step.source, &step.pass, &mut halves);
            edge_separators(&step.source, gate, gate.normal, &mut halves);
            let mut is_gathered = false;
            for number in self.blocks_of[gate.to as usize].clone() {
                let block = &self.blocks[number as usize];
                if search.scratch.full[number as usize] == search.scratch.search
                    || !halves.meet(&block.bounds)
                    || !query.meets(&block.bounds)
                {
                    continue;
                }
                // The other way round: from the block through the gate to the source.
                separators(&block.bounds, &step.pass, &mut back);
                let mut source = step.source;
                if !back.cut(&mut source) {
                    continue;
                }
                if !std::mem::replace(&mut is_gathered, true) {
                    self.gather_sequences(search.scratch, &step);
                }
                if search.scratch.line_reaches(&source, &block.bounds) {
                    self.test_block(&mut search, &step, &source, number);
                }
            }
        }
    }

    /// Finds which parts of the source may see which cells of a block through a step's gate. The
    /// step shows some of the block to the part `source` of the source.
    fn test_block(
        &self,
        search: &mut CellSearch<'_, '_>,
        step: &FlowStep,
        source: &DAabb,
        number: u32,
    ) {
        let block = &self.blocks[number as usize];
        if search.sources.len() == 1 && block.cells.len() == 1 {
            search.see(0, block.cells.start);
            return;
        }
        let gate = &self.gates[step.gate as usize];
        let is_open = search.query.frustum.is_empty()
            && search.scratch.is_open(&search.query.source, &block.bounds);
        let mut all = true;
        for index in 0..search.sources.len() {
            if is_open {
                block.cells.clone().for_each(|cell| search.see(index, cell));
                continue;
            }
            let mut part = search.sources[index];
            part.min = part.min.max(source.min);
            part.max = part.max.min(source.max);
            if !part.min.cmple(part.max).all() {
                all = false;
                continue;
            }
            separators(&part, &step.pass, &mut search.halves);
            edge_separators(&part, gate, gate.normal, &mut search.halves);
            for cell in block.cells.clone() {
                if search.has_seen(index, cell) {
                    continue;
                }
                let target = &self.targets[cell as usize];
                if search.halves.meet(target)
                    && search.query.meets(target)
                    && search.scratch.line_reaches(&part, target)
                {
                    search.see(index, cell);
                } else {
                    all = false;
                }
            }
        }
        if all {
            search.scratch.full[number as usize] = search.scratch.search;
        }
    }
}
