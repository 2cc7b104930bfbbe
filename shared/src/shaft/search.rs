//! The search: shafts are halved until each has an occluder of its own, or a line is free.

use std::ops::ControlFlow::{self, Break, Continue};

use glam::Vec3;

use super::{
    Line, Occluders, Outcome,
    convex::{Gap, corner},
};
use crate::geometry::Aabb;

/// Boxes narrower than this, in metres, are not halved again: what is still undecided then is a seam
/// between occluders that do not reach into each other, or a slit.
const NARROW_M: f32 = 0.005;
/// So many of the occluders that blocked a whole shaft last are tried before all others.
const RECENT_MAX: usize = 4;
/// So many lines from corner to corner are tried for each shaft, at most.
const CORNERS_MAX: usize = 2;
/// Of the budget: an occluder against all lines of a shaft, as against one line or a box of the tree.
const SHAFT_UNITS: u32 = 4;

/// What a search needs besides its answer, kept from one to the next to save allocations. It may be
/// used with any occluders: nothing in it lives on.
#[derive(Debug, Default)]
pub struct Scratch {
    /// Shafts to look into, each half of another: no more than there are halvings down to
    /// [`NARROW_M`], some hundreds for boxes of any size.
    open: Vec<Shaft>,
    recent: Vec<u32>,
}

/// All lines from the one box to the other.
#[derive(Clone, Copy, Debug)]
struct Shaft {
    from: Aabb,
    to: Aabb,
}

/// What blocks some lines of a shaft, but not all.
struct Partly {
    gap: Gap,
    /// Where along the line on which it was found, from 0 to 1.
    at: f64,
}

/// What is known of a shaft that is not halved.
enum Verdict {
    Blocked,
    Free(Line),
    Partly(Partly),
}

impl Occluders {
    /// Whether every line from a box of eyes to a box of bodies is blocked, both in own axes, as
    /// far as `budget` goes. What was spent is taken off: a unit for each box of the tree, and
    /// each occluder, compared with a line; four for an occluder compared with all lines.
    pub fn between(
        &self,
        scratch: &mut Scratch,
        eyes: &Aabb,
        bodies: &Aabb,
        budget: &mut u32,
    ) -> Outcome {
        let whole = Shaft { from: *eyes, to: *bodies };
        if !whole.is_sane() {
            return Outcome::Unknown;
        }
        scratch.recent.clear();
        scratch.open.clear();
        scratch.open.push(whole);
        while let Some(shaft) = scratch.open.pop() {
            if *budget == 0 {
                return Outcome::Unknown;
            }
            match self.judge(&mut scratch.recent, &shaft, budget) {
                Verdict::Blocked => {}
                Verdict::Free(line) => return Outcome::Visible(line),
                Verdict::Partly(partly) => match shaft.halves(partly.at) {
                    Some(halves) => scratch.open.extend(halves),
                    None => return Outcome::Unknown,
                },
            }
        }
        Outcome::Hidden
    }

    fn judge(&self, recent: &mut Vec<u32>, shaft: &Shaft, budget: &mut u32) -> Verdict {
        for place in 0..recent.len() {
            spend(budget, SHAFT_UNITS);
            let piece = &self.pieces[recent[place] as usize];
            if piece.blocks_all(&shaft.from, &shaft.to).is_ok() {
                recent[..=place].rotate_right(1);
                return Verdict::Blocked;
            }
        }
        let middle = Line { from: shaft.from.centre(), to: shaft.to.centre() };
        let mut best = match self.judge_along(recent, shaft, &middle, budget) {
            Verdict::Partly(best) => best,
            verdict => return verdict,
        };
        // The line that the best one misses by most is free, or meets what may be better.
        for _ in 0..CORNERS_MAX {
            let [from, to] = best.gap.corners;
            let line = Line { from: corner(&shaft.from, from), to: corner(&shaft.to, to) };
            match self.judge_along(recent, shaft, &line, budget) {
                Verdict::Partly(other) if other.gap.by < best.gap.by => best = other,
                Verdict::Partly(_) => break,
                verdict => return verdict,
            }
        }
        Verdict::Partly(best)
    }

    /// Looks for what blocks a whole shaft among all that one of its lines meets.
    fn judge_along(
        &self,
        recent: &mut Vec<u32>,
        shaft: &Shaft,
        line: &Line,
        budget: &mut u32,
    ) -> Verdict {
        let mut best: Option<Partly> = None;
        let mut spent = 0;
        let flow: ControlFlow<u32> = self.tree.along(line, &mut spent, |index, spent| {
            let piece = &self.pieces[index as usize];
            *spent += 1;
            let Some(at) = piece.meets(line.from, line.to) else { return Continue(()) };
            *spent += SHAFT_UNITS;
            match piece.blocks_all(&shaft.from, &shaft.to) {
                Ok(()) => return Break(index),
                Err(gap) if best.as_ref().is_none_or(|best| gap.by < best.gap.by) => {
                    best = Some(Partly { gap, at });
                }
                Err(_) => {}
            }
            Continue(())
        });
        spend(budget, spent);
        if let Break(index) = flow {
            recent.truncate(RECENT_MAX - 1);
            recent.insert(0, index);
            return Verdict::Blocked;
        }
        best.map_or(Verdict::Free(*line), Verdict::Partly)
    }
}

fn spend(budget: &mut u32, units: u32) {
    *budget = budget.saturating_sub(units);
}

impl Shaft {
    /// Whether both boxes hold a point and end somewhere.
    fn is_sane(&self) -> bool {
        [&self.from, &self.to]
            .iter()
            .all(|region| !region.is_empty() && region.min.is_finite() && region.max.is_finite())
    }

    /// Two that together are this one; none when it is narrow. The box is halved that is wider
    /// as seen from the other where the occluder is, `at` from 0 to 1 along the way.
    fn halves(&self, at: f64) -> Option<[Self; 2]> {
        let along = (self.to.centre() - self.from.centre()).normalize_or_zero();
        // Depth matters little, but not nothing.
        let across = (Vec3::ONE - along * along).max(Vec3::splat(0.01)).map(f32::sqrt);
        let at = (at as f32).clamp(0.05, 0.95);
        let widths = [self.from.size() * across * (1.0 - at), self.to.size() * across * at];
        let is_from = widths[0].max_element() >= widths[1].max_element();
        let widths = widths[usize::from(!is_from)];
        let axis = widths.max_position();
        let region = if is_from { &self.from } else { &self.to };
        if region.size()[axis] < NARROW_M {
            return None;
        }
        let (mut low, mut high) = (*region, *region);
        let middle = region.centre()[axis];
        (low.max[axis], high.min[axis]) = (middle, middle);
        Some([low, high].map(|half| {
            if is_from { Self { from: half, ..*self } } else { Self { to: half, ..*self } }
        }))
    }
}
