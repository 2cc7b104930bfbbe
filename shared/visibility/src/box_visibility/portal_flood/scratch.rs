//! What a flood keeps in memory: the steps it took, and those it has yet to go on from.

use super::simd_box::SimdBox;

/// The most steps into one space that are kept apart. Further ones are merged.
const STEPS_PER_SPACE_MAX: usize = 3;

/// A set of lines that have entered a space.
#[derive(Clone, Copy, Debug)]
pub(super) struct FloodStep {
    pub space: u32,
    /// The least share of its length, from 0 to 1, at which any of the lines enters the space.
    pub entry_t: f32,
    /// Where the lines begin.
    pub from: SimdBox,
    /// Where the lines end.
    pub to: SimdBox,
    /// The step before this one into the same space.
    pub next: Option<u32>,
}

impl FloodStep {
    /// Whether its lines include all lines of another step.
    fn holds(&self, other: &Self) -> bool {
        self.entry_t <= other.entry_t && self.from.holds(&other.from) && self.to.holds(&other.to)
    }
}

/// The memory of a flood, kept from one to the next to save allocations.
#[derive(Clone, Debug, Default)]
pub(in super::super) struct FloodScratch {
    /// The number of this flood. Entries with another number are stale.
    flood: u32,
    /// For each space the last flood that entered it, and that flood's last step there.
    reached: Vec<(u32, u32)>,
    /// For each space the last flood that had it as a goal.
    goals: Vec<u32>,
    steps: Vec<FloodStep>,
    /// Steps to go on from, as indices into `steps`.
    open: Vec<u32>,
    /// Open nodes of the tree of spaces.
    pub(super) nodes: Vec<u32>,
    /// The spaces of the two boxes.
    pub(super) ends: [Vec<u32>; 2],
}

impl FloodScratch {
    /// Prepares for a flood through a building with this number of spaces.
    pub(super) fn begin(&mut self, spaces: usize) {
        self.flood = self.flood.wrapping_add(1);
        if self.flood == 0 || self.goals.len() < spaces {
            self.reached = vec![(0, 0); spaces];
            self.goals = vec![0; spaces];
            self.flood = 1;
        }
        self.steps.clear();
        self.open.clear();
    }

    pub(super) fn set_goals(&mut self, goals: &[u32]) {
        goals.iter().for_each(|goal| self.goals[*goal as usize] = self.flood);
    }

    pub(super) fn is_goal(&self, space: u32) -> bool {
        self.goals[space as usize] == self.flood
    }

    /// Takes the step to go on from next.
    pub(super) fn pop(&mut self) -> Option<FloodStep> {
        self.open.pop().map(|index| self.steps[index as usize])
    }

    /// Adds a step, unless an earlier one into the same space includes its lines. When that space
    /// has too many steps already, the new one is merged into the last.
    pub(super) fn enter(&mut self, step: FloodStep) {
        debug_assert!(step.entry_t.is_finite(), "lines enter somewhere along their length");
        let known = &mut self.reached[step.space as usize];
        let mut next = (known.0 == self.flood).then_some(known.1);
        let (first, mut count) = (next, 0);
        while let Some(index) = next {
            let other = &self.steps[index as usize];
            if other.holds(&step) {
                return;
            }
            (next, count) = (other.next, count + 1);
        }
        match first {
            Some(index) if count >= STEPS_PER_SPACE_MAX => {
                let merged = &mut self.steps[index as usize];
                merged.entry_t = merged.entry_t.min(step.entry_t);
                merged.from = merged.from.union(&step.from);
                merged.to = merged.to.union(&step.to);
                self.open.push(index);
            }
            _ => {
                let index = self.steps.len() as u32;
                *known = (self.flood, index);
                self.steps.push(FloodStep { next: first, ..step });
                self.open.push(index);
            }
        }
    }
}
