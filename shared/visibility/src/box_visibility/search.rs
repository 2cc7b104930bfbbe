//! The search: shafts are halved until each has an occluder of its own, or a line is free.

use std::ops::ControlFlow::{self, Break, Continue};

use glam::Vec3;

use super::{
    BoxInSpaces, BoxVisibility, Occluders, SightLine,
    convex_occluder::{Gap, corner},
    portal_flood::FloodScratch,
};
use sightline_world::geometry::Aabb;

/// Boxes narrower than this, in metres, are not halved again: what is still undecided then is a seam
/// between occluders that do not reach into each other, or a slit.
const NARROW_M: f32 = 0.005;
/// So many of the occluders that blocked a whole shaft last are tried before all others.
const RECENT_MAX: usize = 4;
/// In so many shafts of a search it is looked whether gates lead through them. For halves of halves,
/// occluders do it at a lower price.
const FLOODS_MAX: u32 = 8;
/// So many lines anywhere in the whole shaft are tried before it is halved.
const SAMPLES: u32 = 24;
/// So many lines from corner to corner are tried for each shaft, at most.
const CORNERS_MAX: usize = 2;
/// Of the budget: an occluder against all lines of a shaft, as against one line or a box of the tree.
const SHAFT_UNITS: u32 = 4;

/// What a search needs besides its answer, kept from one to the next to save allocations. It may be
/// used with any occluders: nothing in it lives on.
#[derive(Clone, Debug, Default)]
pub struct BoxScratch {
    /// Shafts to look into, each half of another: no more than there are halvings down to
    /// [`NARROW_M`], some hundreds for boxes of any size.
    open: Vec<BoxPair>,
    recent: Vec<u32>,
    steps: FloodScratch,
    /// How often gates have been gone through for this answer.
    floods: u32,
}

/// All lines from the one box to the other.
#[derive(Clone, Copy, Debug)]
struct BoxPair {
    from: Aabb,
    to: Aabb,
}

/// What blocks some lines of a shaft, but not all.
struct PartialBlock {
    gap: Gap,
    /// Where along the line on which it was found, from 0 to 1.
    at: f64,
}

/// What is known of a shaft that is not halved.
enum PairVerdict {
    Blocked,
    Free(SightLine),
    PartialBlock(PartialBlock),
}

impl Occluders {
    /// Whether every line from a box of eyes to a box of bodies is blocked, both in own axes, as
    /// far as `budget` goes. What was spent is taken off: a unit for each box of the tree, and
    /// each occluder, compared with a line; four for an occluder compared with all lines.
    pub fn between(
        &self,
        scratch: &mut BoxScratch,
        eyes: &Aabb,
        bodies: &Aabb,
        budget: &mut u32,
    ) -> BoxVisibility {
        let whole = BoxPair { from: *eyes, to: *bodies };
        if !whole.is_sane() || *budget == 0 {
            return BoxVisibility::Unknown;
        }
        scratch.recent.clear();
        scratch.floods = 0;
        scratch.open.clear();
        match self.judge(scratch, &whole, budget) {
            PairVerdict::Blocked => return BoxVisibility::Hidden,
            PairVerdict::Free(line) => return BoxVisibility::Visible(line),
            PairVerdict::PartialBlock(partly) => match whole.halves(&partly) {
                Some(halves) => scratch.open.extend(halves),
                None => return BoxVisibility::Unknown,
            },
        }
        // Halving goes into one corner first; what is wide open elsewhere is found by lines anywhere.
        let free = (1..=SAMPLES).map(|i| whole.sample(i)).find(|line| !self.meets(line, budget));
        if let Some(line) = free {
            return BoxVisibility::Visible(line);
        }
        while let Some(shaft) = scratch.open.pop() {
            if *budget == 0 {
                return BoxVisibility::Unknown;
            }
            match self.judge(scratch, &shaft, budget) {
                PairVerdict::Blocked => {}
                PairVerdict::Free(line) => return BoxVisibility::Visible(line),
                PairVerdict::PartialBlock(partly) => match shaft.halves(&partly) {
                    Some(halves) => scratch.open.extend(halves),
                    None => return BoxVisibility::Unknown,
                },
            }
        }
        BoxVisibility::Hidden
    }

    /// Whether no gates lead from a box of eyes to another box, both in own axes: for eyes and bodies
    /// that are in certain spaces, given by their indices. It says less than [`Occluders::between`]
    /// and costs a microsecond at most.
    pub fn are_apart(
        &self,
        scratch: &mut BoxScratch,
        eyes: BoxInSpaces<'_>,
        bodies: BoxInSpaces<'_>,
    ) -> bool {
        let shaft = BoxPair { from: *eyes.bounds, to: *bodies.bounds };
        shaft.is_sane() && self.passages.are_apart(&mut scratch.steps, eyes, bodies, &mut 0)
    }

    /// As [`Occluders::blocks`], at the cost of a budget; when that is used up, it is blocked.
    fn meets(&self, line: &SightLine, budget: &mut u32) -> bool {
        let mut spent = 0;
        let is_blocked = *budget == 0 || self.meets_counted(line, &mut spent);
        spend(budget, spent);
        is_blocked
    }

    fn judge(&self, scratch: &mut BoxScratch, shaft: &BoxPair, budget: &mut u32) -> PairVerdict {
        let BoxScratch { recent, steps, floods, .. } = scratch;
        for place in 0..recent.len() {
            spend(budget, SHAFT_UNITS);
            let piece = &self.pieces[recent[place] as usize];
            if piece.blocks_all(&shaft.from, &shaft.to).is_ok() {
                recent[..=place].rotate_right(1);
                return PairVerdict::Blocked;
            }
        }
        if *floods < FLOODS_MAX {
            *floods += 1;
            let mut looked = 0;
            let is_closed = self.passages.are_closed(steps, &shaft.from, &shaft.to, &mut looked);
            spend(budget, looked);
            if is_closed {
                return PairVerdict::Blocked;
            }
        }
        let middle = SightLine { from: shaft.from.centre(), to: shaft.to.centre() };
        let mut best = match self.judge_along(recent, shaft, &middle, budget) {
            PairVerdict::PartialBlock(best) => best,
            verdict => return verdict,
        };
        // The line that the best one misses by most is free, or meets what may be better.
        for _ in 0..CORNERS_MAX {
            let [from, to] = best.gap.corners;
            let line = SightLine { from: corner(&shaft.from, from), to: corner(&shaft.to, to) };
            match self.judge_along(recent, shaft, &line, budget) {
                PairVerdict::PartialBlock(other) if other.gap.by < best.gap.by => best = other,
                PairVerdict::PartialBlock(_) => break,
                verdict => return verdict,
            }
        }
        PairVerdict::PartialBlock(best)
    }

    /// Looks for what blocks a whole shaft among all that one of its lines meets.
    fn judge_along(
        &self,
        recent: &mut Vec<u32>,
        shaft: &BoxPair,
        line: &SightLine,
        budget: &mut u32,
    ) -> PairVerdict {
        let mut best: Option<PartialBlock> = None;
        let mut spent = 0;
        let flow: ControlFlow<u32> = self.tree.along(line, &mut spent, |index, spent| {
            let piece = &self.pieces[index as usize];
            *spent += 1;
            let Some(at) = piece.meets(line.from, line.to) else { return Continue(()) };
            *spent += SHAFT_UNITS;
            match piece.blocks_all(&shaft.from, &shaft.to) {
                Ok(()) => return Break(index),
                Err(gap) if best.as_ref().is_none_or(|best| gap.by < best.gap.by) => {
                    best = Some(PartialBlock { gap, at });
                }
                Err(_) => {}
            }
            Continue(())
        });
        spend(budget, spent);
        if let Break(index) = flow {
            recent.truncate(RECENT_MAX - 1);
            recent.insert(0, index);
            return PairVerdict::Blocked;
        }
        best.map_or(PairVerdict::Free(*line), PairVerdict::PartialBlock)
    }
}

fn spend(budget: &mut u32, units: u32) {
    *budget = budget.saturating_sub(units);
}

impl BoxPair {
    /// Whether both boxes hold a point and end somewhere.
    fn is_sane(&self) -> bool {
        [&self.from, &self.to]
            .iter()
            .all(|region| !region.is_empty() && region.min.is_finite() && region.max.is_finite())
    }

    /// One of its lines: those of ascending numbers fill it evenly.
    fn sample(&self, number: u32) -> SightLine {
        // Powers of the root of x⁷ = x + 1, as the golden section is that of x² = x + 1.
        const ROOT: f64 = 1.112_775_684_278_705_5;
        let share = |power: i32| (0.5 + f64::from(number) / ROOT.powi(power)).fract() as f32;
        let shares = |first: i32| Vec3::new(share(first), share(first + 1), share(first + 2));
        let point = |region: &Aabb, at: Vec3| (region.min + region.size() * at).min(region.max);
        SightLine { from: point(&self.from, shares(1)), to: point(&self.to, shares(4)) }
    }

    /// Two that together are this one; none when it is narrow. Of the boxes and axes that the gap
    /// leaves, that is halved which is widest as seen from the other box where the occluder is.
    fn halves(&self, PartialBlock { gap, at }: &PartialBlock) -> Option<[Self; 2]> {
        let along = (self.to.centre() - self.from.centre()).normalize_or_zero();
        // Depth matters little, but not nothing.
        let across = (Vec3::ONE - along * along).max(Vec3::splat(0.01)).map(f32::sqrt);
        let at = (*at as f32).clamp(0.05, 0.95);
        let widths = [self.from.size() * across * (1.0 - at), self.to.size() * across * at];
        let regions = [&self.from, &self.to];
        let choices = [0, 1].into_iter().flat_map(|side| (0..3).map(move |axis| (side, axis)));
        let wide =
            choices.filter(|&(side, axis): &(usize, usize)| regions[side].size()[axis] >= NARROW_M);
        let (side, axis) = wide.max_by(|a, b| {
            let key = |&(side, axis): &(usize, usize)| (gap.axes >> axis & 1, widths[side][axis]);
            let (a, b) = (key(a), key(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        })?;
        let region = regions[side];
        let (mut low, mut high) = (*region, *region);
        let middle = region.centre()[axis];
        (low.max[axis], high.min[axis]) = (middle, middle);
        Some([low, high].map(|half| match side {
            0 => Self { from: half, ..*self },
            _ => Self { to: half, ..*self },
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{bvh::Bvh, convex_occluder::ConvexOccluder, portal_flood::PortalFlood},
        *,
    };

    /// Walls across x = 0 that span these parts of z, each `thick`.
    fn walls(spans: &[[f32; 2]], thick: f32) -> Occluders {
        let wall = |[from, to]: [f32; 2]| {
            let min = Vec3::new(-thick * 0.5, -9.0, from);
            Aabb::new(min, Vec3::new(thick * 0.5, 9.0, to))
        };
        let pieces: Vec<ConvexOccluder> =
            spans.iter().map(|span| ConvexOccluder::solid(&wall(*span))).collect();
        let boxes: Vec<Aabb> = pieces.iter().map(|piece| *piece.bounds()).collect();
        Occluders { tree: Bvh::new(&boxes), pieces, passages: PortalFlood::default() }
    }

    fn ends() -> [Aabb; 2] {
        [-4.0, 4.0].map(|x| Aabb::around(Vec3::new(x, 0.0, 0.3), 1.0))
    }

    #[track_caller]
    fn check(spans: &[[f32; 2]], mut budget: u32, expected: fn(&BoxVisibility) -> bool) -> u32 {
        let ([eyes, bodies], occluders) = (ends(), walls(spans, 0.2));
        let mut scratch = BoxScratch::default();
        let (all, mut again) = (budget, budget);
        let outcome = occluders.between(&mut scratch, &eyes, &bodies, &mut budget);
        assert!(expected(&outcome), "{outcome:?}");
        assert_eq!(occluders.between(&mut scratch, &eyes, &bodies, &mut again), outcome);
        assert_eq!(again, budget, "the same question costs the same");
        if let BoxVisibility::Visible(line) = outcome {
            assert!(line.joins(&eyes, &bodies) && !occluders.blocks(&line));
        }
        all - budget
    }

    #[test]
    fn walls_that_overlap_hide_all_and_those_with_a_gap_or_a_seam_do_not() {
        let is_hidden = |outcome: &BoxVisibility| *outcome == BoxVisibility::Hidden;
        let is_visible = |outcome: &BoxVisibility| matches!(outcome, BoxVisibility::Visible(_));
        let whole = check(&[[-9.0, 9.0]], 10_000, is_hidden);
        let parts = check(&[[-9.0, 0.4], [0.1, 9.0]], 10_000, is_hidden);
        assert!(parts > whole);
        check(&[[-9.0, 0.1], [0.4, 9.0]], 10_000, is_visible);
        for beyond in [0.21, 0.2] {
            let spans = [[-9.0, 0.2], [beyond, 9.0]];
            check(&spans, 100_000, |outcome| *outcome != BoxVisibility::Hidden);
        }
        check(&[], 10_000, is_visible);
    }

    #[test]
    fn without_a_budget_or_with_boxes_that_are_none_nothing_is_known() {
        let is_unknown = |outcome: &BoxVisibility| *outcome == BoxVisibility::Unknown;
        check(&[[-9.0, 9.0]], 0, is_unknown);
        check(&[[-9.0, 0.4], [0.3, 9.0]], 40, is_unknown);
        let occluders = walls(&[[-9.0, 9.0]], 0.2);
        let [eyes, bodies] = ends();
        let none = [f32::NAN, f32::INFINITY].map(|x| Aabb::new(eyes.min, Vec3::splat(x)));
        for none in [none[0], none[1], Aabb::EMPTY] {
            for [from, to] in [[none, bodies], [eyes, none]] {
                let outcome = occluders.between(&mut BoxScratch::default(), &from, &to, &mut 99);
                assert_eq!(outcome, BoxVisibility::Unknown);
            }
        }
    }
}
