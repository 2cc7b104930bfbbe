//! The steps of a search, and the sequences that they make.

use std::{cmp::Ordering, collections::BinaryHeap};

use super::{Query, Sightlines, daabb::DAabb, directed_gate::is_between, exact, eye};

/// So many sequences to one step are told apart.
pub(super) const CHAINS_MAX: usize = 6;

/// What a search needs memory for; kept from one search to the next.
#[derive(Default)]
pub struct FlowScratch {
    pub(super) steps: Vec<FlowStep>,
    pub(super) waiting: BinaryHeap<QueuedStep>,
    /// For each door, its steps and how often they were joined; those with `touched` hold some.
    pub(super) at_door: Vec<GateSteps>,
    pub(super) touched: Vec<u32>,
    /// For each part of the source and each cell, or for each space, the last search that found it.
    pub(super) seen: Vec<u32>,
    pub(super) allowed: Vec<u32>,
    /// For each block, the last search that found all of it from all parts of the source.
    pub(super) full: Vec<u32>,
    pub(super) search: u32,
    pub(super) chains: PortalSequences,
    pub(super) room: Vec<DAabb>,
    pub(super) room_of_eye: eye::EyeScratch,
}

/// A step of a search: a line from `source` came through `pass`, a part of a gate.
#[derive(Clone, Copy, Debug)]
pub(super) struct FlowStep {
    /// A later step at the same door shows all that this one does.
    pub(super) is_covered: bool,
    /// It goes through a gate of the source's own space.
    pub(super) is_first: bool,
    /// The steps before: none when it is the first, or stands for too many sequences.
    pub(super) parents: StepParents,
    pub(super) door: u32,
    pub(super) source: DAabb,
    pub(super) pass: DAabb,
}

/// The steps that come before a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StepParents {
    pub(super) steps: [u32; Self::MAX],
    pub(super) count: u8,
}

impl StepParents {
    pub(super) const MAX: usize = 4;
    pub(super) const NONE: Self = Self { steps: [0; Self::MAX], count: 0 };

    pub(super) fn one(step: u32) -> Self {
        Self { steps: [step; Self::MAX], count: 1 }
    }

    pub(super) fn as_slice(&self) -> &[u32] {
        &self.steps[..usize::from(self.count)]
    }

    /// Adds others to what is not none; too many are none.
    pub(super) fn add(&mut self, others: &Self) {
        if others.count == 0 {
            *self = Self::NONE;
        }
        for &step in others.as_slice() {
            if self.count == 0 || self.as_slice().contains(&step) {
                continue;
            }
            match self.steps.get_mut(usize::from(self.count)) {
                Some(place) => {
                    *place = step;
                    self.count += 1;
                }
                None => *self = Self::NONE,
            }
        }
    }
}

/// A step that waits; the one nearest to the source goes first.
pub(super) struct QueuedStep {
    pub(super) distance: f64,
    pub(super) step: u32,
}

impl PartialEq for QueuedStep {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for QueuedStep {}

impl PartialOrd for QueuedStep {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for QueuedStep {
    fn cmp(&self, other: &Self) -> Ordering {
        other.distance.total_cmp(&self.distance).then(other.step.cmp(&self.step))
    }
}

#[derive(Clone, Default)]
pub(super) struct GateSteps {
    pub(super) steps: Vec<u32>,
    pub(super) joins: u8,
}

/// What a line has to meet along a sequence of steps, and which way it goes.
#[derive(Default)]
pub(super) struct PortalSequence {
    pub(super) met: Vec<DAabb>,
    pub(super) signs: exact::DirectionSigns,
    /// All of the gates on the way; axial rectangles when `is_whole`, from the source on.
    pub(super) gates: Vec<DAabb>,
    pub(super) is_whole: bool,
    /// The step to go on with.
    pub(super) next: Option<u32>,
}

/// Chains, of which the first `count` are in use.
#[derive(Default)]
pub(super) struct PortalSequences {
    pub(super) all: Vec<PortalSequence>,
    pub(super) count: usize,
}

impl PortalSequences {
    pub(super) fn begin(&mut self, set: impl FnOnce(&mut PortalSequence)) {
        if self.all.is_empty() {
            self.all.resize_with(CHAINS_MAX, PortalSequence::default);
        }
        self.count = 1;
        set(&mut self.all[0]);
    }

    /// Adds a copy of a chain that goes on with a step.
    pub(super) fn split(&mut self, index: usize, next: u32) {
        let (head, tail) = self.all.split_at_mut(self.count);
        let (from, to) = (&head[index], &mut tail[0]);
        to.met.clone_from(&from.met);
        to.gates.clone_from(&from.gates);
        to.is_whole = from.is_whole;
        to.signs = from.signs;
        to.next = Some(next);
        self.count += 1;
    }
}

impl FlowScratch {
    /// Makes ready for a search.
    pub(super) fn begin(&mut self, lines: &Sightlines<'_>, sources: usize, query: &Query<'_>) {
        let (doors, spaces) = (lines.doors.len(), lines.cells.spaces.len());
        let seen = (sources * lines.cells.cells.len()).max(spaces);
        for door in self.touched.drain(..) {
            let at = &mut self.at_door[door as usize];
            at.steps.clear();
            at.joins = 0;
        }
        self.at_door.resize(doors.max(self.at_door.len()), GateSteps::default());
        self.seen.resize(seen.max(self.seen.len()), 0);
        self.allowed.resize(spaces.max(self.allowed.len()), 0);
        self.full.resize(lines.blocks.len().max(self.full.len()), 0);
        self.steps.clear();
        self.waiting.clear();
        self.search = self.search.wrapping_add(1);
        if self.search == 0 {
            self.seen.fill(0);
            self.allowed.fill(0);
            self.full.fill(0);
            self.search = 1;
        }
        for &space in query.spaces.unwrap_or_default() {
            self.allowed[space as usize] = self.search;
        }
    }

    /// Whether a step shows nothing new, because another step at its door does. That one then stands
    /// for both sequences.
    pub(super) fn has_known(&mut self, step: &FlowStep) -> bool {
        let at = &self.at_door[step.door as usize];
        let holds = |of: &&u32| {
            let of = &self.steps[**of as usize];
            of.source.contains(&step.source) && of.pass.contains(&step.pass)
        };
        let Some(&index) = at.steps.iter().find(holds) else { return false };
        let of = &mut self.steps[index as usize];
        of.parents.add(&step.parents);
        true
    }

    /// Whether some line that meets all that was gathered meets a target too.
    pub(super) fn is_stabbed(&mut self, source: &DAabb, target: &DAabb) -> bool {
        let mut certain: exact::DirectionSigns = [None; 3];
        for (axis, sign) in certain.iter_mut().enumerate() {
            if target.min[axis] > source.max[axis] {
                *sign = Some(true);
            } else if target.max[axis] < source.min[axis] {
                *sign = Some(false);
            }
        }
        let towards = (target.min + target.max) - (source.min + source.max);
        let Self { chains, room, .. } = self;
        chains.all[..chains.count].iter_mut().any(|chain| {
            let signs = [0, 1, 2].map(|axis| chain.signs[axis].or(certain[axis]));
            chain.met.extend([*source, *target]);
            let is_stabbed = exact::is_stabbed(&chain.met, signs, towards, room);
            chain.met.truncate(chain.met.len() - 2);
            is_stabbed
        })
    }

    /// Whether every line from a source to a target goes along one of the sequences gathered.
    pub(super) fn is_open(&self, source: &DAabb, target: &DAabb) -> bool {
        self.chains.all[..self.chains.count].iter().any(|chain| {
            chain.is_whole && chain.gates.iter().all(|gate| is_between(source, gate, target))
        })
    }

    pub(super) fn has_seen(&self, index: u32) -> bool {
        self.seen[index as usize] == self.search
    }

    /// Notes that something is seen; false when it is known.
    pub(super) fn see(&mut self, index: u32) -> bool {
        !self.has_seen(index) && {
            self.seen[index as usize] = self.search;
            true
        }
    }
}
