//! What can be seen through one gate.

use super::{
    Gate, Gates,
    bits::Bits,
    winding::{ON_PLANE, Plane, Winding, separators},
};

/// Longer sequences are not followed; what the flood allows beyond them is kept.
const DEPTH_MAX: usize = 512;

/// The gates that might be seen through a gate: reached from it by gates that are not wholly behind
/// it, and that it is not wholly beyond.
pub fn flood(gates: &Gates, source: &Gate) -> Bits {
    let mut found = Bits::none(gates.gates.len());
    let mut waiting = vec![source.to];
    let mut entered = vec![false; gates.out_of.len()];
    entered[source.to as usize] = true;
    while let Some(cell) = waiting.pop() {
        for &next in &gates.out_of[cell as usize] {
            let target = &gates.gates[next as usize];
            if found.has(next as usize) || !might_pass(source, target) {
                continue;
            }
            found.set(next as usize);
            if !std::mem::replace(&mut entered[target.to as usize], true) {
                waiting.push(target.to);
            }
        }
    }
    found
}

/// Whether some line could go through both gates, the right way, as far as their planes tell.
fn might_pass(source: &Gate, target: &Gate) -> bool {
    target.winding.corners().iter().any(|&c| source.plane.height(c) > ON_PLANE)
        && source.winding.corners().iter().any(|&c| target.plane.height(c) < -ON_PLANE)
}

/// The gates that can be seen through a gate, out of those that `might` be; all of these when that
/// takes more than `steps_max` steps. `known` bounds what each gate sees.
pub fn visible_through(
    gates: &Gates,
    known: &[Bits],
    source: &Gate,
    might: &Bits,
    steps_max: u32,
) -> Bits {
    let mut search = Search {
        steps_max,
        gates,
        known,
        source,
        seen: Bits::none(gates.gates.len()),
        levels: Vec::new(),
        steps: 0,
    };
    search.level(0);
    search.levels[0].might.clone_from(might);
    search.levels[0].source = source.winding;
    search.follow(0, source.to, &source.plane);
    if search.steps > steps_max { might.clone() } else { search.seen }
}

struct Search<'a> {
    gates: &'a Gates,
    known: &'a [Bits],
    source: &'a Gate,
    seen: Bits,
    levels: Vec<Level>,
    steps: u32,
    steps_max: u32,
}

/// One step of a portal sequence.
struct Level {
    /// What might still be seen by going on.
    might: Bits,
    /// The part of the source gate that can see through the sequence.
    source: Winding,
    /// The part of the last gate that the source can see; empty at the first level.
    pass: Winding,
}

impl Search<'_> {
    /// Makes sure that a level exists.
    fn level(&mut self, depth: usize) {
        while self.levels.len() <= depth {
            self.levels.push(Level {
                might: Bits::none(self.gates.gates.len()),
                source: Winding::EMPTY,
                pass: Winding::EMPTY,
            });
        }
    }

    /// Goes on from a cell that was entered through `plane`.
    fn follow(&mut self, depth: usize, cell: u32, plane: &Plane) {
        if depth + 1 >= DEPTH_MAX {
            self.seen.add_all(&self.levels[depth].might);
            return;
        }
        self.level(depth + 1);
        for &next in &self.gates.out_of[cell as usize] {
            if self.steps > self.steps_max {
                return;
            }
            if self.levels[depth].might.has(next as usize) {
                self.step(depth, next as usize, plane);
            }
        }
    }

    /// Tries to see through one more gate.
    fn step(&mut self, depth: usize, next: usize, entered: &Plane) {
        self.steps += 1;
        let gate = &self.gates.gates[next];
        let (here, above) = self.levels.split_at_mut(depth + 1);
        let (here, above) = (&here[depth], &mut above[0]);
        above.might.set_intersection(&here.might, &self.known[next]);
        if self.seen.has(next) && above.might.is_within(&self.seen) {
            return;
        }
        // A convex cell cannot be left through the plane by which it was entered.
        if gate.plane.normal.dot(entered.normal).abs() > 0.5
            && gate.winding.corners().iter().all(|&c| entered.height(c).abs() <= ON_PLANE)
        {
            return;
        }
        above.pass.copy_from(&gate.winding);
        above.pass.keep_front(&self.source.plane);
        above.source.copy_from(&here.source);
        above.source.keep_front(&gate.plane.flipped());
        if above.pass.is_empty() || above.source.is_empty() {
            return;
        }
        if !here.pass.is_empty() && !cut_by_separators(here, above) {
            return;
        }
        self.seen.set(next);
        self.follow(depth + 1, gate.to, &gate.plane);
    }
}

/// Cuts the next gate to what the source sees through the last one, and the source to what the
/// next gate sees; false when nothing is left.
fn cut_by_separators(here: &Level, above: &mut Level) -> bool {
    let Level { source, pass, .. } = above;
    // Lines go from the source through the last gate: beyond it they stay in front of each plane
    // that has the source behind and the last gate in front, and likewise, with the roles changed,
    // behind each that has the last gate behind and the source in front.
    separators(source, &here.pass, |plane| {
        pass.keep_front(plane);
        !pass.is_empty()
    });
    separators(&here.pass, source, |plane| {
        pass.keep_front(&plane.flipped());
        !pass.is_empty()
    });
    if pass.is_empty() {
        return false;
    }
    separators(pass, &here.pass, |plane| {
        source.keep_front(plane);
        !source.is_empty()
    });
    separators(&here.pass, pass, |plane| {
        source.keep_front(&plane.flipped());
        !source.is_empty()
    });
    !source.is_empty()
}
