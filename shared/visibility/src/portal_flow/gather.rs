//! Gathers the sequences of gates that lead to a step.

use super::{
    scratch::FlowScratch,
    sequences::{PortalSequence, SEQUENCE_MAX, SEQUENCES_MAX},
    sightlines::Sightlines,
    step::FlowStep,
};

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
