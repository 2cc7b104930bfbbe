//! The sequences of gates that lead to a step.

use super::{daabb::DAabb, exact::DirectionSigns};

/// The most sequences to one step that are kept apart.
pub(super) const SEQUENCES_MAX: usize = 6;
/// The most boxes of a sequence. Of a longer one only the end counts.
pub(super) const SEQUENCE_MAX: usize = 48;

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
