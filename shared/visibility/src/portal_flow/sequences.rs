//! The sequences of gates that lead to a step.

use super::{
    daabb::DAabb, exact::DirectionSigns, scratch::FlowScratch, sightlines::Sightlines,
    step::FlowStep,
};

/// The most sequences to one step that are kept apart.
const SEQUENCES_MAX: usize = 6;
/// The most boxes of a sequence. Of a longer one only the end counts.
const SEQUENCE_MAX: usize = 48;

/// What a line has to meet along a sequence of steps, and its direction.
#[derive(Default)]
pub(super) struct PortalSequence {
    /// The boxes that the line has to meet.
    pub(super) met: Vec<DAabb>,
    pub(super) signs: DirectionSigns,
    /// The gates that the line passes.
    pub(super) gates: Vec<DAabb>,
    /// Whether these are all gates from the source on, and all are axial rectangles.
    pub(super) is_whole: bool,
    /// The step at which to go on.
    pub(super) next: Option<u32>,
}

/// Several sequences, of which the first `count` are in use.
#[derive(Default)]
pub(super) struct PortalSequences {
    pub(super) all: Vec<PortalSequence>,
    pub(super) count: usize,
}

impl PortalSequences {
    pub(super) fn begin(&mut self, set: impl FnOnce(&mut PortalSequence)) {
        if self.all.is_empty() {
            self.all.resize_with(SEQUENCES_MAX, PortalSequence::default);
        }
        self.count = 1;
        set(&mut self.all[0]);
    }

    /// Adds a copy of a sequence that goes on at another step.
    pub(super) fn split(&mut self, index: usize, next: u32) {
        debug_assert!(index < self.count && self.count < SEQUENCES_MAX);
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

impl Sightlines<'_> {
    /// Lists for every sequence of steps that ends with the given one what a line has to meet to
    /// pass it. Where there are too many sequences, their beginnings are left out.
    pub(super) fn gather_sequences(&self, scratch: &mut FlowScratch, last: &FlowStep) {
        let FlowScratch { steps, sequences, .. } = scratch;
        let begin = |sequence: &mut PortalSequence| {
            sequence.met.clear();
            sequence.gates.clear();
            sequence.is_whole = true;
            sequence.signs = [None; 3];
            sequence.next = None;
            self.put(sequence, last);
        };
        sequences.begin(begin);
        let mut index = 0;
        // Sequences split where steps have several parents.
        while index < sequences.count {
            let mut step = *last;
            if let Some(next) = sequences.all[index].next.take() {
                step = steps[next as usize];
                self.put(&mut sequences.all[index], &step);
            }
            // Boxes are larger than what they stand for, so steps may seem to form a cycle. The
            // limit of the length ends it.
            loop {
                let (&first, others) = match step.parents.as_slice() {
                    [first, others @ ..]
                        if sequences.count + others.len() <= SEQUENCES_MAX
                            && sequences.all[index].met.len() < SEQUENCE_MAX =>
                    {
                        (first, others)
                    }
                    none => {
                        let sequence = &mut sequences.all[index];
                        sequence.met.push(step.source);
                        sequence.is_whole &= none.is_empty() && step.is_first;
                        break;
                    }
                };
                for &other in others {
                    sequences.split(index, other);
                }
                step = steps[first as usize];
                self.put(&mut sequences.all[index], &step);
            }
            index += 1;
        }
    }

    /// Puts a step at the front of a sequence.
    fn put(&self, sequence: &mut PortalSequence, step: &FlowStep) {
        sequence.met.push(step.pass);
        let gate = &self.gates[step.gate as usize];
        sequence.gates.push(gate.bounds);
        sequence.is_whole &= gate.edges.is_empty();
        let normal = gate.normal;
        for axis in 0..3 {
            if normal[axis].abs() == 1.0 {
                sequence.signs[axis] = Some(normal[axis] > 0.0);
            }
        }
    }
}
