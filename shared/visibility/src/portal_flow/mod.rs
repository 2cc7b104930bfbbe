//! Sight lines through sequences of gates: what can be seen from a box.
//!
//! A search starts in a space and goes from gate to gate. Each step keeps two boxes: the part of
//! the *source* from which the gate can be seen through those before it, and the part of the gate
//! that can be seen from there, its *pass*. Every line that goes from the source through the pass
//! stays within the half-spaces that separate the two (`separators`); these cut the next gate, and
//! with the roles changed the source. What is left of the next gate is the next step; when nothing
//! is left, no line goes through that sequence. The steps form a *stab tree*.
//!
//! For axial boxes the separating planes are the tangents of their projections along the three
//! axes, so that all is arithmetic on intervals. Gates that are no axial rectangles add the planes
//! through their edges.
//!
//! Open places let a gate be reached by very many sequences. A step whose source and pass lie
//! within those of an earlier step at the same gate shows nothing new, and is dropped; and where a
//! gate has `STEPS_AT_GATE_MAX` steps, further ones are joined: the box around both stands for both.
//! That is larger than either, so nothing is missed, and it bounds the work by the number of gates.

mod cell_block;
mod daabb;
mod directed_gate;
mod exact;
mod eye;
mod scratch;
#[cfg(test)]
mod tests;

use std::ops::Range;

pub use cell_block::CellBlock;
pub use daabb::{DAabb, HalfSpace};
pub use scratch::FlowScratch;

use cell_block::blocks;
use daabb::{HalfSpaces, separators};
use directed_gate::{DirectedGate, cut_polygon, edge_separators};
use scratch::{CHAINS_MAX, FlowStep, PortalSequence, QueuedStep, StepParents};
use sightline_world::{Cells, tolerance::WIDENING_M};

/// Steps kept apart at one gate.
const STEPS_AT_GATE_MAX: usize = 6;
/// Longer sequences are looked at from their end.
const CHAIN_MAX: usize = 48;
/// A gate at which joined steps have grown so often takes the whole source and the whole gate.
const JOINS_MAX: u8 = 8;

/// What a search is for.
#[derive(Clone, Copy)]
pub struct Query<'a> {
    /// The space that the source lies in.
    pub space: u32,
    /// From where one looks, widened already.
    pub source: DAabb,
    /// No other spaces are looked into; all when absent.
    pub spaces: Option<&'a [u32]>,
    /// What is seen lies within all of these.
    pub frustum: &'a [HalfSpace],
}

impl Query<'_> {
    fn holds(&self, target: &DAabb) -> bool {
        self.frustum.iter().all(|half| target.meets(half))
    }
}

/// A search with several sources, and what it has found.
struct CellSearch<'a, 'b> {
    query: &'a Query<'b>,
    sources: &'a [DAabb],
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

/// A building's gates, ready for searches.
pub struct Sightlines<'a> {
    cells: &'a Cells,
    /// Two for each gate: `2i` leads to its greater side, `2i + 1` to its lesser side.
    doors: Vec<DirectedGate>,
    targets: Vec<DAabb>,
    blocks: Vec<CellBlock>,
    /// For each space, its blocks.
    blocks_of: Vec<Range<u32>>,
}

impl<'a> Sightlines<'a> {
    /// Prepares the gates of a subdivision.
    pub fn new(cells: &'a Cells) -> Self {
        let doors = cells
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
        Self { cells, doors, targets, blocks, blocks_of }
    }

    /// The doors out of a space.
    fn doors_of(&self, space: u32) -> impl Iterator<Item = u32> + '_ {
        self.cells.spaces[space as usize].gates.iter().map(move |&gate| {
            let is_lesser = self.cells.gates[gate as usize].spaces[0] == space;
            gate * 2 + u32::from(!is_lesser)
        })
    }

    /// The spaces of which some point may be visible from some point of the source: its own first.
    pub fn spaces(&self, scratch: &mut FlowScratch, query: &Query<'_>) -> Vec<u32> {
        scratch.begin(self, 1, query);
        let mut found = vec![query.space];
        scratch.see(query.space);
        self.search(scratch, query);
        for step in 0..scratch.steps.len() {
            let space = self.doors[scratch.steps[step].door as usize].to;
            if scratch.see(space) {
                found.push(space);
            }
        }
        found
    }

    /// The cells of which some point may be visible from some point of the source.
    pub fn cells(&self, scratch: &mut FlowScratch, query: &Query<'_>) -> Vec<u32> {
        let mut found = [Vec::new()];
        self.look(scratch, query, &[query.source], &mut found);
        let [found] = found;
        found
    }

    /// For each cell of a block, the cells of which some point may be visible from some point of it.
    /// Only the given spaces are looked into.
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
        self.look(scratch, &query, &sources, &mut found);
        found
    }

    /// The cells, in blocks that lie close together and see much the same.
    pub fn blocks(&self) -> &[CellBlock] {
        &self.blocks
    }

    /// Finds, for each of some parts of a query's source, the cells that it may see.
    fn look(
        &self,
        scratch: &mut FlowScratch,
        query: &Query<'_>,
        sources: &[DAabb],
        found: &mut [Vec<u32>],
    ) {
        scratch.begin(self, sources.len(), query);
        let mut look = CellSearch { query, sources, found, scratch, halves: HalfSpaces::none() };
        for cell in self.cells.spaces[query.space as usize].cells.clone() {
            if query.holds(&self.targets[cell as usize]) {
                (0..sources.len()).for_each(|source| look.see(source, cell));
            }
        }
        self.search(look.scratch, query);
        let (mut halves, mut back) = (HalfSpaces::none(), HalfSpaces::none());
        for index in 0..look.scratch.steps.len() {
            let step = look.scratch.steps[index];
            if step.is_covered {
                continue;
            }
            let gate = &self.doors[step.door as usize];
            separators(&step.source, &step.pass, &mut halves);
            edge_separators(&step.source, gate, gate.normal, &mut halves);
            let mut is_gathered = false;
            for number in self.blocks_of[gate.to as usize].clone() {
                let block = &self.blocks[number as usize];
                if look.scratch.full[number as usize] == look.scratch.search
                    || !halves.meet(&block.bounds)
                    || !query.holds(&block.bounds)
                {
                    continue;
                }
                // And the other way round: from the block through the gate to the source.
                separators(&block.bounds, &step.pass, &mut back);
                let mut source = step.source;
                if !back.cut(&mut source) {
                    continue;
                }
                if !std::mem::replace(&mut is_gathered, true) {
                    self.gather(look.scratch, &step);
                }
                if look.scratch.is_stabbed(&source, &block.bounds) {
                    self.look_at(&mut look, &step, &source, number);
                }
            }
        }
    }

    /// Finds which parts of the source may see which cells of a block by a step that shows some of
    /// the block to some of the source.
    fn look_at(&self, look: &mut CellSearch<'_, '_>, step: &FlowStep, source: &DAabb, number: u32) {
        let block = &self.blocks[number as usize];
        if look.sources.len() == 1 && block.cells.len() == 1 {
            look.see(0, block.cells.start);
            return;
        }
        let gate = &self.doors[step.door as usize];
        let is_open = look.query.frustum.is_empty()
            && look.scratch.is_open(&look.query.source, &block.bounds);
        let mut all = true;
        for index in 0..look.sources.len() {
            if is_open {
                block.cells.clone().for_each(|cell| look.see(index, cell));
                continue;
            }
            let mut part = look.sources[index];
            part.min = part.min.max(source.min);
            part.max = part.max.min(source.max);
            if !part.min.cmple(part.max).all() {
                all = false;
                continue;
            }
            separators(&part, &step.pass, &mut look.halves);
            edge_separators(&part, gate, gate.normal, &mut look.halves);
            for cell in block.cells.clone() {
                if look.has_seen(index, cell) {
                    continue;
                }
                let target = &self.targets[cell as usize];
                if look.halves.meet(target)
                    && look.query.holds(target)
                    && look.scratch.is_stabbed(&part, target)
                {
                    look.see(index, cell);
                } else {
                    all = false;
                }
            }
        }
        if all {
            look.scratch.full[number as usize] = look.scratch.search;
        }
    }

    /// Finds all steps.
    fn search(&self, scratch: &mut FlowScratch, query: &Query<'_>) {
        let mut halves = HalfSpaces::none();
        for door in self.doors_of(query.space) {
            let gate = &self.doors[door as usize];
            let mut source = query.source;
            if gate.is_before(&source) && source.keep(&gate.before()) {
                let step = FlowStep {
                    is_covered: false,
                    is_first: true,
                    parents: StepParents::NONE,
                    door,
                    source,
                    pass: gate.bounds,
                };
                self.add(scratch, query, step);
            }
        }
        while let Some(QueuedStep { step: index, .. }) = scratch.waiting.pop() {
            let step = scratch.steps[index as usize];
            if step.is_covered {
                continue;
            }
            let gate = &self.doors[step.door as usize];
            separators(&step.source, &step.pass, &mut halves);
            edge_separators(&step.source, gate, gate.normal, &mut halves);
            for next in self.doors_of(gate.to) {
                if next != step.door ^ 1
                    && let Some(next) = self.step(index, &step, next, &halves)
                {
                    self.add(scratch, query, next);
                }
            }
        }
    }

    /// Lists, for every sequence of steps that ends with the given one, what a line must meet to get
    /// along it. Where there are too many sequences, their beginnings are left out.
    fn gather(&self, scratch: &mut FlowScratch, last: &FlowStep) {
        let FlowScratch { steps, chains, .. } = scratch;
        let begin = |chain: &mut PortalSequence| {
            chain.met.clear();
            chain.gates.clear();
            chain.is_whole = true;
            chain.signs = [None; 3];
            chain.next = None;
            self.put(chain, last);
        };
        chains.begin(begin);
        let mut index = 0;
        // Chains split where steps have several parents.
        while index < chains.count {
            let mut step = *last;
            if let Some(next) = chains.all[index].next.take() {
                step = steps[next as usize];
                self.put(&mut chains.all[index], &step);
            }
            // Boxes are larger than what they stand for: steps can seem to come back.
            loop {
                let (&first, others) = match step.parents.as_slice() {
                    [first, others @ ..]
                        if chains.count + others.len() <= CHAINS_MAX
                            && chains.all[index].met.len() < CHAIN_MAX =>
                    {
                        (first, others)
                    }
                    none => {
                        let chain = &mut chains.all[index];
                        chain.met.push(step.source);
                        chain.is_whole &= none.is_empty() && step.is_first;
                        break;
                    }
                };
                for &other in others {
                    chains.split(index, other);
                }
                step = steps[first as usize];
                self.put(&mut chains.all[index], &step);
            }
            index += 1;
        }
    }

    fn put(&self, chain: &mut PortalSequence, step: &FlowStep) {
        chain.met.push(step.pass);
        let door = &self.doors[step.door as usize];
        chain.gates.push(door.bounds);
        chain.is_whole &= door.edges.is_empty();
        let normal = door.normal;
        for axis in 0..3 {
            if normal[axis].abs() == 1.0 {
                chain.signs[axis] = Some(normal[axis] > 0.0);
            }
        }
    }

    /// What of the next gate can be seen through the last one, and from where; none when nothing.
    fn step(
        &self,
        index: u32,
        last: &FlowStep,
        door: u32,
        halves: &HalfSpaces,
    ) -> Option<FlowStep> {
        let (gate, before) = (&self.doors[door as usize], &self.doors[last.door as usize]);
        let (mut pass, mut source) = (gate.bounds, last.source);
        if !gate.is_before(&source)
            || !gate.is_before(&last.pass)
            || !before.is_beyond(&pass)
            || !halves.cut(&mut pass)
        {
            return None;
        }
        if !gate.corners.is_empty() && !cut_polygon(&gate.corners, halves, &mut pass) {
            return None;
        }
        let mut back = HalfSpaces::none();
        separators(&pass, &last.pass, &mut back);
        edge_separators(&pass, before, -before.normal, &mut back);
        back.push(gate.before());
        back.push(before.before());
        let parents = StepParents::one(index);
        back.cut(&mut source).then_some(FlowStep {
            is_covered: false,
            is_first: false,
            parents,
            door,
            source,
            pass,
        })
    }

    /// Adds a step, unless it shows nothing new.
    fn add(&self, scratch: &mut FlowScratch, query: &Query<'_>, mut step: FlowStep) {
        let door = &self.doors[step.door as usize];
        if query.spaces.is_some() && scratch.allowed[door.to as usize] != scratch.search
            || query.frustum.iter().any(|half| !step.pass.meets(half))
        {
            return;
        }
        if scratch.has_known(&step) {
            return;
        }
        let at = &mut scratch.at_door[step.door as usize];
        if at.steps.is_empty() {
            scratch.touched.push(step.door);
        }
        if at.steps.len() >= STEPS_AT_GATE_MAX {
            at.joins += 1;
            for other in at.steps.drain(..) {
                let other = &mut scratch.steps[other as usize];
                other.is_covered = true;
                step.parents.add(&other.parents);
                step.source = step.source.union(&other.source);
                step.pass = step.pass.union(&other.pass);
            }
            if at.joins > JOINS_MAX {
                step.pass = door.bounds;
                step.source = query.source;
                step.parents = StepParents::NONE;
            }
        }
        let index = scratch.steps.len() as u32;
        at.steps.push(index);
        scratch.steps.push(step);
        let distance = query.source.distance_squared(&step.pass);
        scratch.waiting.push(QueuedStep { distance, step: index });
    }
}
