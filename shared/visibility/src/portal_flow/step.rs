//! The steps of a search.

use std::cmp::Ordering;

use super::daabb::DAabb;

/// A step of a search: lines from `source` go through `pass`, a part of a gate.
#[derive(Clone, Copy, Debug)]
pub(super) struct FlowStep {
    /// Whether a later step at the same gate shows everything that this one does.
    pub(super) is_covered: bool,
    /// Whether its gate leads out of the source's own space.
    pub(super) is_first: bool,
    /// The steps before this one. None if it is the first, or stands for too many sequences.
    pub(super) parents: StepParents,
    /// Index of the gate it goes through, which is directed.
    pub(super) gate: u32,
    pub(super) source: DAabb,
    pub(super) pass: DAabb,
}

/// The steps before a step, of which the first `count` are in use.
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

    /// Adds other parents. No parents on either side, or too many in all, make no parents: the step
    /// then stands for sequences that begin anywhere.
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

/// A step that waits to be gone on from. The greatest is the one nearest to the source.
pub(super) struct QueuedStep {
    /// The squared distance of its pass from the source.
    pub(super) distance_squared: f64,
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
        other.distance_squared.total_cmp(&self.distance_squared).then(other.step.cmp(&self.step))
    }
}
