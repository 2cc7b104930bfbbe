//! What a search keeps in memory.

use std::collections::BinaryHeap;

use sightline_world::CellId;

use super::{
    daabb::DAabb,
    directed_gate::is_between,
    exact::{self, DirectionSigns},
    sequences::PortalSequences,
    step::{FlowStep, QueuedStep},
};
use crate::HalfSpace;

/// The memory of a search, kept from one to the next to save allocations. It may be used for any
/// building.
#[derive(Default)]
pub struct FlowScratch {
    pub(super) steps: Vec<FlowStep>,
    /// The steps to go on from, nearest first.
    pub(super) waiting: BinaryHeap<QueuedStep>,
    /// The gates that a step may reach.
    pub(super) ahead: Vec<u32>,
    /// For each directed gate its steps.
    pub(super) at_gate: Vec<GateSteps>,
    /// The gates that have steps.
    pub(super) touched: Vec<u32>,
    /// For each part of the source and each cell, or for each space, the number of the last search
    /// that found it.
    pub(super) seen: Vec<u32>,
    /// For each space the last search that may enter it.
    pub(super) allowed: Vec<u32>,
    /// For each block the last search that found all of it from all parts of the source.
    pub(super) full: Vec<u32>,
    /// The number of this search.
    pub(super) search: u32,
    pub(super) sequences: PortalSequences,
    /// Boxes as the exact test reflects them.
    pub(super) reflected: Vec<DAabb>,
    pub(super) eye: EyeScratch,
}

/// The memory of a search from a box of eyes.
#[derive(Default)]
pub(super) struct EyeScratch {
    /// The cells that the viewpoint box overlaps.
    pub(super) cells: Vec<CellId>,
    /// The spaces that the PVS of these cells names.
    pub(super) spaces: Vec<u32>,
    /// Half-spaces that hold the frusta of all eyes.
    pub(super) frustum: Vec<HalfSpace>,
}

/// The steps at one gate.
#[derive(Clone, Default)]
pub(super) struct GateSteps {
    /// Indices of the steps that are not covered by others.
    pub(super) steps: Vec<u32>,
    /// How often steps were merged.
    pub(super) merges: u8,
}

/// How much memory a search needs.
pub(super) struct SearchSizes {
    /// The number of parts of the source.
    pub(super) sources: usize,
    /// The number of directed gates.
    pub(super) gates: usize,
    pub(super) spaces: usize,
    pub(super) cells: usize,
    pub(super) blocks: usize,
}

impl FlowScratch {
    /// Prepares for a search that may enter the given spaces.
    pub(super) fn begin(&mut self, sizes: SearchSizes, allowed: &[u32]) {
        let seen = (sizes.sources * sizes.cells).max(sizes.spaces);
        for gate in self.touched.drain(..) {
            let at = &mut self.at_gate[gate as usize];
            at.steps.clear();
            at.merges = 0;
        }
        self.at_gate.resize(sizes.gates.max(self.at_gate.len()), GateSteps::default());
        self.seen.resize(seen.max(self.seen.len()), 0);
        self.allowed.resize(sizes.spaces.max(self.allowed.len()), 0);
        self.full.resize(sizes.blocks.max(self.full.len()), 0);
        self.steps.clear();
        self.waiting.clear();
        self.search = self.search.wrapping_add(1);
        if self.search == 0 {
            self.seen.fill(0);
            self.allowed.fill(0);
            self.full.fill(0);
            self.search = 1;
        }
        for &space in allowed {
            self.allowed[space as usize] = self.search;
        }
    }

    /// Whether another step at the same gate shows everything that a step does. If so, that one
    /// takes over the step's parents.
    pub(super) fn is_known(&mut self, step: &FlowStep) -> bool {
        let at = &self.at_gate[step.gate as usize];
        let holds = |of: &&u32| {
            let of = &self.steps[**of as usize];
            of.source.contains(&step.source) && of.pass.contains(&step.pass)
        };
        let Some(&index) = at.steps.iter().find(holds) else { return false };
        let of = &mut self.steps[index as usize];
        of.parents.add(&step.parents);
        true
    }

    /// Whether some line from a part of the source to a target passes one of the gathered
    /// sequences.
    pub(super) fn line_reaches(&mut self, source: &DAabb, target: &DAabb) -> bool {
        let mut certain: DirectionSigns = [None; 3];
        for (axis, sign) in certain.iter_mut().enumerate() {
            if target.min[axis] > source.max[axis] {
                *sign = Some(true);
            } else if target.max[axis] < source.min[axis] {
                *sign = Some(false);
            }
        }
        let towards = (target.min + target.max) - (source.min + source.max);
        let Self { sequences, reflected, .. } = self;
        sequences.all[..sequences.count].iter_mut().any(|sequence| {
            let signs = [0, 1, 2].map(|axis| sequence.signs[axis].or(certain[axis]));
            sequence.met.extend([*source, *target]);
            let is_met = exact::line_meets_all(&sequence.met, signs, towards, reflected);
            sequence.met.truncate(sequence.met.len() - 2);
            is_met
        })
    }

    /// Whether every line from a source to a target passes one of the gathered sequences.
    pub(super) fn is_open(&self, source: &DAabb, target: &DAabb) -> bool {
        self.sequences.all[..self.sequences.count].iter().any(|sequence| {
            sequence.is_whole && sequence.gates.iter().all(|gate| is_between(source, gate, target))
        })
    }

    /// Whether this search has found an entry of `seen`.
    pub(super) fn has_seen(&self, index: u32) -> bool {
        self.seen[index as usize] == self.search
    }

    /// Marks an entry of `seen` as found. False if it was found before.
    pub(super) fn see(&mut self, index: u32) -> bool {
        !self.has_seen(index) && {
            self.seen[index as usize] = self.search;
            true
        }
    }
}
