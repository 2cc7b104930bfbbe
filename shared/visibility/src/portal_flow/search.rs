//! The search from gate to gate.

use super::{
    daabb::DAabb,
    directed_gate::{cut_polygon, edge_separators},
    scratch::FlowScratch,
    separators::{HalfSpaces, separators},
    sightlines::{Query, Sightlines},
    step::{FlowStep, QueuedStep, StepParents},
};

/// The most steps that are kept apart at one gate.
const STEPS_AT_GATE_MAX: usize = 6;
/// When steps at a gate were merged more often than this, they are replaced by the whole source and
/// the whole gate.
const MERGES_MAX: u8 = 8;

impl Sightlines<'_> {
    /// Finds all steps of a query, into `scratch.steps`.
    pub(super) fn search(&self, scratch: &mut FlowScratch, query: &Query<'_>) {
        let mut halves = HalfSpaces::none();
        for index in self.gates_from(query.space) {
            let gate = &self.gates[index as usize];
            let mut source = query.source;
            if self.may_enter(scratch, query, index)
                && gate.is_before(&source)
                && source.keep(&gate.near_side())
            {
                let step = FlowStep {
                    is_covered: false,
                    is_first: true,
                    parents: StepParents::NONE,
                    gate: index,
                    source,
                    pass: gate.bounds,
                };
                self.add(scratch, query, step);
            }
        }
        let mut ahead = std::mem::take(&mut scratch.ahead);
        while let Some(QueuedStep { step: index, .. }) = scratch.waiting.pop() {
            let step = scratch.steps[index as usize];
            if step.is_covered {
                continue;
            }
            let gate = &self.gates[step.gate as usize];
            separators(&step.source, &step.pass, &mut halves);
            edge_separators(&step.source, gate, gate.normal, &mut halves);
            let may_reach = |bounds: &DAabb| gate.is_beyond(bounds) && halves.meet(bounds);
            self.gates_out[gate.to as usize].find(may_reach, &mut ahead);
            for &next in &ahead {
                if next != step.gate ^ 1
                    && self.may_enter(scratch, query, next)
                    && let Some(next) = self.step(index, &step, next, &halves)
                {
                    self.add(scratch, query, next);
                }
            }
        }
        scratch.ahead = ahead;
    }

    /// Whether a step through a gate can show anything new: the query may enter the space beyond,
    /// and no step stands for the whole source and the whole gate yet.
    fn may_enter(&self, scratch: &FlowScratch, query: &Query<'_>, gate: u32) -> bool {
        let to = self.gates[gate as usize].to as usize;
        (query.spaces.is_none() || scratch.allowed[to] == scratch.search)
            && scratch.at_gate[gate as usize].merges <= MERGES_MAX
    }

    /// The step from the last one through the next gate. None if no line passes both. `index` is
    /// the last step's, and `halves` separate its source from its pass.
    fn step(
        &self,
        index: u32,
        last: &FlowStep,
        next: u32,
        halves: &HalfSpaces,
    ) -> Option<FlowStep> {
        let (gate, before) = (&self.gates[next as usize], &self.gates[last.gate as usize]);
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
        back.push(gate.near_side());
        back.push(before.near_side());
        let parents = StepParents::one(index);
        back.cut(&mut source).then_some(FlowStep {
            is_covered: false,
            is_first: false,
            parents,
            gate: next,
            source,
            pass,
        })
    }

    /// Adds a step, unless it shows nothing new or lies outside the frustum.
    fn add(&self, scratch: &mut FlowScratch, query: &Query<'_>, mut step: FlowStep) {
        if query.frustum.iter().any(|half| !step.pass.meets(half)) || scratch.is_known(&step) {
            return;
        }
        let gate = &self.gates[step.gate as usize];
        let at = &mut scratch.at_gate[step.gate as usize];
        if at.steps.is_empty() {
            scratch.touched.push(step.gate);
        }
        if at.steps.len() >= STEPS_AT_GATE_MAX {
            at.merges += 1;
            for other in at.steps.drain(..) {
                let other = &mut scratch.steps[other as usize];
                other.is_covered = true;
                step.parents.add(&other.parents);
                step.source = step.source.union(&other.source);
                step.pass = step.pass.union(&other.pass);
            }
            if at.merges > MERGES_MAX {
                step.pass = gate.bounds;
                step.source = query.source;
                step.parents = StepParents::NONE;
            }
        }
        let index = scratch.steps.len() as u32;
        at.steps.push(index);
        scratch.steps.push(step);
        let distance_squared = query.source.distance_squared(&step.pass);
        scratch.waiting.push(QueuedStep { distance_squared, step: index });
    }
}
