//! The search: pairs of boxes are halved until each has an occluder of its own, or a line is free.

use std::ops::ControlFlow::{self, Break, Continue};

use glam::Vec3;
use sightline_world::geometry::Aabb;

use super::{
    convex_occluder::{Gap, corner},
    occluders::Occluders,
    portal_flood::FloodScratch,
    sight_line::{BoxInSpaces, BoxVisibility, SightLine},
};

/// Boxes narrower than this, in metres, are not halved again. What is undecided then is a slit, or
/// a seam between occluders that do not overlap.
const NARROW_M: f32 = 0.005;
/// The number of occluders that are tried first, because they blocked a pair of boxes recently.
const RECENT_MAX: usize = 4;
/// The number of pairs in a search for which gates are flooded. For smaller halves, occluders give
/// the same answer for less.
const FLOODS_MAX: u32 = 8;
/// The number of lines that are tried, anywhere between the boxes, before these are halved.
const SAMPLES: u32 = 24;
/// The most lines from corner to corner that are tried for each pair of boxes.
const CORNERS_MAX: usize = 2;
/// The units that it takes to compare an occluder with all lines of a pair. To compare it, or a box
/// of the tree, with one line takes one unit.
const PAIR_UNITS: u32 = 4;

/// The memory of a search, kept from one to the next to save allocations. It may be used with any
/// occluders, since no result outlives its search.
#[derive(Clone, Debug, Default)]
pub struct BoxScratch {
    /// Pairs that are still undecided. There are no more of them than halvings down to
    /// [`NARROW_M`]: some hundreds for boxes of any size.
    open: Vec<BoxPair>,
    /// Occluders that blocked a pair of this search, the latest first.
    recent: Vec<u32>,
    flood: FloodScratch,
    /// The number of floods of this search.
    floods: u32,
}

/// All lines from one box to another.
#[derive(Clone, Copy, Debug)]
struct BoxPair {
    from: Aabb,
    to: Aabb,
}

/// An occluder that blocks some lines of a pair of boxes, but not all.
struct PartialBlock {
    gap: Gap,
    /// The share of the line's length, from 0 to 1, at which the occluder was found.
    at: f64,
}

/// What is found about a pair of boxes before it is halved.
enum PairVerdict {
    Blocked,
    Free(SightLine),
    Partial(PartialBlock),
    /// The budget did not suffice.
    Unknown,
}

impl Occluders {
    /// Whether every line from a box of eyes to a box of bodies is blocked. Boxes are in own axes.
    ///
    /// What the search spends is taken off `budget`: one unit for each box of the tree or occluder
    /// that is compared with a line, and four for each occluder compared with all lines. When the
    /// budget is used up, the answer is [`BoxVisibility::Unknown`]. It is the answer, too, when a
    /// box is empty or not finite.
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
            PairVerdict::Unknown => return BoxVisibility::Unknown,
            PairVerdict::Partial(partial) => match whole.halves(&partial) {
                Some(halves) => scratch.open.extend(halves),
                None => return BoxVisibility::Unknown,
            },
        }
        // Halving goes into one corner first. Lines anywhere find what is wide open elsewhere.
        let free = (1..=SAMPLES).map(|i| whole.sample(i)).find(|line| self.is_free(line, budget));
        if let Some(line) = free {
            return BoxVisibility::Visible(line);
        }
        while let Some(pair) = scratch.open.pop() {
            if *budget == 0 {
                return BoxVisibility::Unknown;
            }
            match self.judge(scratch, &pair, budget) {
                PairVerdict::Blocked => {}
                PairVerdict::Free(line) => return BoxVisibility::Visible(line),
                PairVerdict::Unknown => return BoxVisibility::Unknown,
                PairVerdict::Partial(partial) => match pair.halves(&partial) {
                    Some(halves) => scratch.open.extend(halves),
                    None => return BoxVisibility::Unknown,
                },
            }
        }
        BoxVisibility::Hidden
    }

    /// Whether gates let no line pass from a box of eyes to a box of bodies, for eyes and bodies
    /// that are in the given spaces. It finds fewer hidden pairs than [`Occluders::between`] and
    /// takes a microsecond at most.
    pub fn are_apart(
        &self,
        scratch: &mut BoxScratch,
        eyes: BoxInSpaces<'_>,
        bodies: BoxInSpaces<'_>,
    ) -> bool {
        let pair = BoxPair { from: *eyes.bounds, to: *bodies.bounds };
        pair.is_sane() && self.flood.are_apart(&mut scratch.flood, eyes, bodies, &mut 0)
    }

    /// Whether no occluder blocks a line, at the cost of a budget. Without a budget, no line is
    /// known to be free.
    fn is_free(&self, line: &SightLine, budget: &mut u32) -> bool {
        let mut spent = 0;
        let is_blocked = *budget == 0 || self.blocks_counted(line, &mut spent);
        spend(budget, spent);
        !is_blocked
    }

    /// Tries to decide a pair of boxes as a whole: by recent occluders, by gates, and by all
    /// occluders on a few of its lines.
    fn judge(&self, scratch: &mut BoxScratch, pair: &BoxPair, budget: &mut u32) -> PairVerdict {
        let BoxScratch { recent, flood, floods, .. } = scratch;
        for place in 0..recent.len() {
            spend(budget, PAIR_UNITS);
            let piece = &self.pieces[recent[place] as usize];
            if piece.blocks_all(&pair.from, &pair.to).is_ok() {
                recent[..=place].rotate_right(1);
                return PairVerdict::Blocked;
            }
        }
        if *floods < FLOODS_MAX {
            *floods += 1;
            let mut visited = 0;
            let is_closed = self.flood.are_closed(flood, &pair.from, &pair.to, &mut visited);
            spend(budget, visited);
            if is_closed {
                return PairVerdict::Blocked;
            }
        }
        let middle = SightLine { from: pair.from.centre(), to: pair.to.centre() };
        let mut best = match self.judge_along(recent, pair, &middle, budget) {
            PairVerdict::Partial(best) => best,
            verdict => return verdict,
        };
        // The line that the best occluder misses by most is free, or it meets a better occluder.
        for _ in 0..CORNERS_MAX {
            let [from, to] = best.gap.corners;
            let line = SightLine { from: corner(&pair.from, from), to: corner(&pair.to, to) };
            match self.judge_along(recent, pair, &line, budget) {
                PairVerdict::Partial(other) if other.gap.by < best.gap.by => best = other,
                PairVerdict::Partial(_) => break,
                verdict => return verdict,
            }
        }
        PairVerdict::Partial(best)
    }

    /// Looks among the occluders that one of the lines meets for one that blocks all lines, as far
    /// as the budget goes.
    fn judge_along(
        &self,
        recent: &mut Vec<u32>,
        pair: &BoxPair,
        line: &SightLine,
        budget: &mut u32,
    ) -> PairVerdict {
        let mut best: Option<PartialBlock> = None;
        let (mut spent, most) = (0, *budget);
        let flow: ControlFlow<Option<u32>> = self.bvh.along(line, &mut spent, |index, spent| {
            if *spent >= most {
                return Break(None);
            }
            let piece = &self.pieces[index as usize];
            *spent += 1;
            let Some(at) = piece.meets(line.from, line.to) else { return Continue(()) };
            *spent += PAIR_UNITS;
            match piece.blocks_all(&pair.from, &pair.to) {
                Ok(()) => return Break(Some(index)),
                Err(gap) if best.as_ref().is_none_or(|best| gap.by < best.gap.by) => {
                    best = Some(PartialBlock { gap, at });
                }
                Err(_) => {}
            }
            Continue(())
        });
        spend(budget, spent);
        debug_assert!(recent.len() <= RECENT_MAX);
        match flow {
            Break(Some(index)) => {
                recent.truncate(RECENT_MAX - 1);
                recent.insert(0, index);
                PairVerdict::Blocked
            }
            Break(None) => PairVerdict::Unknown,
            Continue(()) => best.map_or(PairVerdict::Free(*line), PairVerdict::Partial),
        }
    }
}

fn spend(budget: &mut u32, units: u32) {
    *budget = budget.saturating_sub(units);
}

impl BoxPair {
    /// Whether both boxes hold a point and are finite.
    fn is_sane(&self) -> bool {
        [&self.from, &self.to]
            .iter()
            .all(|region| !region.is_empty() && region.min.is_finite() && region.max.is_finite())
    }

    /// One of the lines. Ascending numbers give lines that fill the pair evenly: a low-discrepancy
    /// sequence (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences").
    fn sample(&self, number: u32) -> SightLine {
        // The root of x⁷ = x + 1, as the golden section is the root of x² = x + 1.
        const ROOT: f64 = 1.112_775_684_278_705_5;
        let share = |power: i32| (0.5 + f64::from(number) / ROOT.powi(power)).fract() as f32;
        let shares = |first: i32| Vec3::new(share(first), share(first + 1), share(first + 2));
        let point = |region: &Aabb, at: Vec3| (region.min + region.size() * at).min(region.max);
        SightLine { from: point(&self.from, shares(1)), to: point(&self.to, shares(4)) }
    }

    /// Two pairs that together are this one. None if both boxes are narrow. Only along the axes of
    /// the gap can halving help. Among these, the box that is widest is halved, as seen from the
    /// other box and projected to where the occluder is.
    fn halves(&self, PartialBlock { gap, at }: &PartialBlock) -> Option<[Self; 2]> {
        let along = (self.to.centre() - self.from.centre()).normalize_or_zero();
        // Depth along the line matters little, but it does matter.
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
        debug_assert!(region.size()[axis] >= NARROW_M, "only wide boxes are halved");
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
        super::{convex_occluder::ConvexOccluder, portal_flood::PortalFlood},
        *,
    };

    /// Walls in the plane x = 0 that span the given parts of z. Each is `thick` metres thick.
    fn walls(spans: &[[f32; 2]], thick: f32) -> Occluders {
        let wall = |[from, to]: [f32; 2]| {
            let min = Vec3::new(-thick * 0.5, -9.0, from);
            Aabb::new(min, Vec3::new(thick * 0.5, 9.0, to))
        };
        let pieces: Vec<ConvexOccluder> =
            spans.iter().map(|span| ConvexOccluder::solid(&wall(*span))).collect();
        Occluders::from_pieces(pieces, PortalFlood::default())
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
    fn walls_that_overlap_hide_everything_and_walls_with_a_gap_or_a_seam_do_not() {
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
    fn nothing_is_known_without_a_budget_or_of_boxes_that_are_empty_or_not_finite() {
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
