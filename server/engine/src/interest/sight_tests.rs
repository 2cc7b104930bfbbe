//! Whether somebody in one region can see somebody in another: shafts between their boxes.
//!
//! What was found hidden stays so while both regions last, since walls do not move; what was found in
//! sight stays so while the line that was free still joins the two. So most ticks cost a comparison.
//! One line is tried first, and gates and cells are asked, between regions with something to spare. The rest, between what
//! regions are just now, has a budget, in units of work and not in time, so that the same inputs give
//! the same outputs. Where it does not suffice a pair counts as visible.

use std::sync::Arc;

use sightline_visibility::box_visibility::{
    BoxInSpaces, BoxScratch, BoxVisibility, Occluders, SightLine,
};
use sightline_world::geometry::Aabb;

use crate::{
    Engine,
    interest::candidates::Pair,
    interest::snapshot::{LiveAvatar, LiveAvatars, Snapshot},
    regions::cover_boxes::CoverBoxes,
    regions::footprints::RegionFootprint,
    regions::live_regions::{CoarseRegion, RegionKind},
    worker_pool::Workspace,
};

/// Ticks before a pair that could not be decided is looked at again.
const UNDECIDED_TICKS: u32 = 8;

/// Ticks before regions with more to spare are tried again where they did not help.
const SPARE_TICKS: u32 = 16;
/// What a look costs, about: by how much all looks that are due go beyond the budget tells the load.
const LOOK_UNITS: u32 = 200;
/// How much of the budget is there for those whom the viewer has not been told of.
const NEW_PER_CENT: u32 = 60;
/// One look costs no more than so many times an equal share of the budget; and where that is little, no
/// less than such a part of the most it may ever cost.
const SHARES: u32 = 8;

/// The regions, with what they have to spare, that something was found of: how often those of the
/// viewer's eyes, and those of the avatar's body, had changed by then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Regions {
    /// Which of [`SPARES`](crate::regions::live_regions::SPARES) they have.
    level: u8,
    eyes: u32,
    bodies: u32,
}

/// What is known of the lines from a viewer's eyes to an avatar's body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SightResult {
    /// Nothing.
    Unknown,
    /// That some may be free; it is tried again at that tick.
    Undecided {
        /// The tick.
        again: u32,
    },
    /// One is free, as far as occluders go.
    Free(SightLine),
    /// Both are in one convex space.
    Together,
    /// All are blocked, and stay so as long as these regions last.
    Hidden(Regions),
    /// All are blocked, and stay so while the eye can be in the one of these boxes only, and while the
    /// other's eye can in the other.
    HiddenIn([Aabb; 2]),
}

/// What two regions turned out to be to each other.
pub(crate) enum TestOutcome {
    Free(SightLine),
    Hidden,
    Undecided,
}

/// What blocks sight, ready to be asked.
#[derive(Clone, Debug)]
pub(crate) struct SightTester {
    occluders: Arc<Occluders>,
    scratch: BoxScratch,
}

impl SightTester {
    pub(crate) fn new(occluders: Arc<Occluders>) -> Self {
        Self { occluders, scratch: BoxScratch::default() }
    }

    /// Whether no gates lead from one to another.
    fn are_apart(&mut self, one: &RegionFootprint, other: &RegionFootprint) -> bool {
        let [one, other] = [one, other]
            .map(|ground| BoxInSpaces { bounds: &ground.around, spaces: &ground.spaces });
        self.occluders.are_apart(&mut self.scratch, one, other)
    }

    /// Looks from every part of the eyes to every part of the bodies, for no more than `most`, as
    /// far as the budget goes.
    pub(crate) fn between(
        &mut self,
        eyes: &CoverBoxes,
        bodies: &CoverBoxes,
        most: u32,
        budget: &mut u32,
    ) -> TestOutcome {
        let given = most.min(*budget);
        let mut left = given;
        let found = self.look(eyes, bodies, &mut left);
        *budget -= given - left;
        found
    }

    /// Whether a line is free, as far as gates and occluders tell.
    fn is_free(&mut self, line: &SightLine, budget: &mut u32) -> bool {
        let [from, to] = [line.from, line.to].map(|end| Aabb::new(end, end));
        let outcome = self.occluders.between(&mut self.scratch, &from, &to, budget);
        matches!(outcome, BoxVisibility::Visible(_))
    }

    fn look(&mut self, eyes: &CoverBoxes, bodies: &CoverBoxes, budget: &mut u32) -> TestOutcome {
        let mut found = TestOutcome::Hidden;
        for from in eyes.boxes() {
            for to in bodies.boxes() {
                match self.occluders.between(&mut self.scratch, from, to, budget) {
                    BoxVisibility::Visible(line) => return TestOutcome::Free(line),
                    BoxVisibility::Hidden => {}
                    // Another part may still be in sight for good.
                    BoxVisibility::Unknown => found = TestOutcome::Undecided,
                }
            }
        }
        found
    }
}

/// A pair that is to be looked at: the place of the viewer, and that of the pair among its own.
#[derive(Clone, Copy)]
struct Open {
    viewer: u32,
    at: u32,
}

impl Open {
    fn pair<'a>(&self, pairs: &'a [Vec<Pair>]) -> &'a Pair {
        &pairs[self.viewer as usize][self.at as usize]
    }
}

impl SightResult {
    /// Whether a pair is known to be hidden.
    pub(crate) fn is_hidden(&self) -> bool {
        match self {
            Self::Hidden(_) | Self::HiddenIn(_) => true,
            Self::Unknown | Self::Undecided { .. } | Self::Together | Self::Free(_) => false,
        }
    }

    /// Whether it was found that a pair may be in sight of each other.
    pub(crate) fn is_open(&self) -> bool {
        matches!(self, Self::Undecided { .. } | Self::Together | Self::Free(_))
    }
}

impl Engine {
    /// Looks at all pairs of live viewers for which something may have changed: first at those of
    /// whom the viewer will be told if nothing is found. A hard pair takes no more than a few times
    /// what there is for each. Where there is not enough, the next tick goes on.
    pub(crate) fn look(&mut self, scene: &mut Snapshot) {
        let Snapshot { lives, pairs } = scene;
        let all = self.crew.gather(pairs, |work, viewer, pairs, open| {
            let eyes = &lives.all()[viewer];
            for (at, pair) in (0..).zip(pairs) {
                if pair.concerns && self.is_open(work, eyes, lives.at(pair.slot), pair) {
                    open.push(Open { viewer: viewer as u32, at });
                }
            }
        });
        let count = u32::try_from(all.len()).unwrap_or(u32::MAX);
        let wanted = u64::from(count) * u64::from(LOOK_UNITS);
        let load = wanted / u64::from(self.config.sight_test_budget.max(1));
        self.load = load.clamp(1, u64::from(UNDECIDED_TICKS)) as u32;
        let each = self.config.sight_test_budget / count.max(1);
        let most =
            (SHARES * each).clamp(self.config.sight_test_max / SHARES, self.config.sight_test_max);
        let (held, new) = all.into_iter().partition(|open| open.pair(pairs).is_held);
        let mut budget = 0;
        for (place, open) in [new, held].into_iter().enumerate() {
            budget +=
                self.config.sight_test_budget / 100 * [NEW_PER_CENT, 100 - NEW_PER_CENT][place];
            self.look_from(place, open, (lives, &mut *pairs), most, &mut budget);
        }
    }

    /// Looks at pairs, beginning with those of the viewer at whom the budget was used up the last time: in
    /// rounds of no more than what is left is sure to suffice for, or twice as many. So what each may
    /// cost does not depend on what those beside it do.
    fn look_from(
        &mut self,
        place: usize,
        mut open: Vec<Open>,
        (lives, pairs): (&LiveAvatars, &mut [Vec<Pair>]),
        most: u32,
        budget: &mut u32,
    ) {
        let from = self.looked_to[place];
        let stand = |open: &Open| lives.all()[open.viewer as usize].stand;
        let first = open.partition_point(|open| stand(open) < from);
        open.rotate_left(first);
        let mut rest = &open[..];
        while let Some(next) = rest.first() {
            if *budget == 0 {
                self.looked_to[place] = stand(next);
                return;
            }
            let sure = usize::try_from(*budget / most.max(1)).unwrap_or(usize::MAX);
            let (round, later) = rest.split_at(rest.len().min(2 * sure + 1));
            // What comes of each, and what is left of what it may cost.
            let mut looks: Vec<(Option<SightResult>, u32)> = vec![(None, most); round.len()];
            self.crew.each(&mut looks, |work, place, (found, left)| {
                let viewer = &lives.all()[round[place].viewer as usize];
                let other = lives.at(round[place].pair(pairs).slot);
                *found = self.look_at(work, viewer, other, left);
            });
            for (open, (found, left)) in round.iter().zip(looks) {
                *budget = budget.saturating_sub(most - left);
                if let Some(found) = found {
                    pairs[open.viewer as usize][open.at as usize].look = found;
                }
            }
            rest = later;
        }
    }

    /// Whether a pair must be looked at: what was found of it is not true any more, and neither rooms nor
    /// gates nor cells tell, nor does a line through gates.
    fn is_open(
        &self,
        work: &mut Workspace,
        viewer: &LiveAvatar,
        other: &LiveAvatar,
        pair: &mut Pair,
    ) -> bool {
        let rules = self.rooms.can_rule_out();
        let [home, other_home] = [viewer, other].map(|live| live.near.home());
        if home.is_some() && home == other_home && !rules {
            // A space is convex, and nothing is in it.
            pair.look = SightResult::Together;
            return false;
        }
        if pair.look.is_open() && self.cells_hide(work, viewer, other, pair) {
            return false;
        }
        let holds = match pair.look {
            SightResult::Unknown | SightResult::Together | SightResult::Undecided { .. } => false,
            SightResult::HiddenIn(then) => {
                let now = eyes_of(viewer, other);
                then.iter().zip(&now).all(|(then, now)| then.contains_box(now))
            }
            SightResult::Hidden(then) => then == regions(viewer, other, then.level.into()),
            SightResult::Free(line) => {
                rules && self.is_closed(work, viewer, other, pair)
                    || self.joins(viewer, other, &line)
            }
        };
        if holds {
            return false;
        }
        if self.ticks >= pair.gates_from {
            // What was hidden will rather be hidden again; and rooms come before all else.
            let is_free_first = !rules && !pair.look.is_hidden();
            if is_free_first && self.is_free(work, viewer, other, pair) {
                self.cells_hide(work, viewer, other, pair);
                return false;
            }
            if self.is_hidden_by_cells(work, viewer, other, pair)
                || !is_free_first && self.is_free(work, viewer, other, pair)
            {
                return false;
            }
        }
        !matches!(pair.look, SightResult::Undecided { again } if self.ticks < again)
    }

    /// Whether no cells of a pair's regions see each other, where these have changed since it was asked. A line that
    /// was free may end where only walls keep an eye or a body from being by now; and nobody is told of whom cells
    /// hide, however much there is to do.
    fn cells_hide(
        &self,
        work: &mut Workspace,
        viewer: &LiveAvatar,
        other: &LiveAvatar,
        pair: &mut Pair,
    ) -> bool {
        let regions = regions(viewer, other, 0);
        let Some([eyes, bodies]) =
            (pair.seen != Some(regions)).then(|| self.grounds(work, viewer, other, 0)).flatten()
        else {
            return false;
        };
        let sees = eyes.sees(bodies, &self.world.cells, &self.sectors);
        if sees {
            pair.seen = Some(regions);
        } else {
            pair.look = SightResult::Hidden(regions);
        }
        !sees
    }

    /// Whether a line is free from where the viewer's eye will soon be to where the avatar will, as far as they
    /// go on so: where gates count at all.
    fn is_free(
        &self,
        work: &Workspace,
        viewer: &LiveAvatar,
        other: &LiveAvatar,
        pair: &mut Pair,
    ) -> bool {
        let ends = viewer.near.get(RegionKind::EYES).zip(other.near.get(viewer.near.shown));
        let Some(((from, Some(start)), (to, Some(goal)))) = ends.map(|(a, b)| (a.lead, b.lead))
        else {
            return false;
        };
        let (cells, line) = (&self.world.cells, SightLine { from, to });
        let spaces = [start, goal].map(|cell| cells.cells[cell.0 as usize].space);
        let is_free = self.config.sight_test_budget > 0
            && cells.sees(start, goal)
            && work.shafts.occluders.is_free_through_gates(&line, spaces);
        if is_free {
            pair.look = SightResult::Free(line);
        }
        is_free
    }

    /// Whether no gates lead from a pair's regions to each other, or no cells of theirs see each other:
    /// with much to spare, so that this lasts, unless it did not help a while ago; or with little.
    fn is_hidden_by_cells(
        &self,
        work: &mut Workspace,
        viewer: &LiveAvatar,
        other: &LiveAvatar,
        pair: &mut Pair,
    ) -> bool {
        if self.ticks >= pair.spare_from {
            if !self.may_see(work, viewer, other, 1) {
                pair.look = SightResult::Hidden(regions(viewer, other, 1));
                return true;
            }
            pair.spare_from = self.ticks + SPARE_TICKS;
        }
        let is_closed = self.is_closed(work, viewer, other, pair);
        if !is_closed && !matches!(pair.look, SightResult::Undecided { .. }) {
            pair.look = SightResult::Undecided { again: self.ticks };
        }
        is_closed
    }

    /// Whether the same is found of a pair's regions with little to spare, where these have changed. What was left
    /// open a moment ago stays so for some ticks where there is much to do.
    fn is_closed(
        &self,
        work: &mut Workspace,
        viewer: &LiveAvatar,
        other: &LiveAvatar,
        pair: &mut Pair,
    ) -> bool {
        if self.ticks < pair.gates_from {
            return false;
        }
        let regions = regions(viewer, other, 0);
        let is_closed = pair.open != Some(regions) && !self.may_see(work, viewer, other, 0);
        if is_closed {
            (pair.look, pair.gates_from) = (SightResult::Hidden(regions), 0);
        } else {
            (pair.open, pair.gates_from) = (Some(regions), self.ticks + self.load);
        }
        is_closed
    }

    /// Looks between what a pair's regions are just now; first along a line that will last. What
    /// remains undecided is tried again the later, the less there is for each.
    fn look_at(
        &self,
        work: &mut Workspace,
        viewer: &LiveAvatar,
        other: &LiveAvatar,
        left: &mut u32,
    ) -> Option<SightResult> {
        let hurry = self.config.sight_test_max / (*left).max(1);
        let eyes = self.exact(work, viewer, RegionKind::EYES)?;
        let bodies = self.exact(work, other, viewer.near.shown)?;
        Some(match work.shafts.between(eyes, bodies, u32::MAX, left) {
            TestOutcome::Hidden => SightResult::HiddenIn(eyes_of(viewer, other)),
            TestOutcome::Free(line) if work.shafts.is_free(&line, left) => SightResult::Free(line),
            TestOutcome::Free(_) | TestOutcome::Undecided => {
                SightResult::Undecided { again: self.ticks + UNDECIDED_TICKS * hurry.max(1) }
            }
        })
    }

    /// Whether somebody in one wide region, from which these cells can be seen, may see somebody in
    /// another, or be seen.
    pub(crate) fn may_meet(
        &self,
        work: &mut Workspace,
        one: &CoarseRegion,
        other: &CoarseRegion,
    ) -> bool {
        let Workspace { shafts, seen, .. } = work;
        let by_gates = self.config.sight_test_budget > 0;
        let ([eyes, bodies], [other_eyes, other_bodies]) = (&one.grounds, &other.grounds);
        let mut may = |eyes: &RegionFootprint, bodies: &RegionFootprint| {
            !(by_gates && shafts.are_apart(eyes, bodies))
        };
        let shows =
            |eyes: &RegionFootprint, bodies: &RegionFootprint| eyes.shows(bodies, &self.rooms);
        other_bodies.is_among(&seen[0]) && shows(eyes, other_bodies) && may(eyes, other_bodies)
            || other_eyes.is_among(&seen[1]) && shows(other_eyes, bodies) && may(other_eyes, bodies)
    }

    /// Whether a viewer may see an avatar as far as rooms, cells and gates tell.
    fn may_see(
        &self,
        work: &mut Workspace,
        viewer: &LiveAvatar,
        other: &LiveAvatar,
        level: usize,
    ) -> bool {
        let Some([eyes, bodies]) = self.grounds(work, viewer, other, level) else { return false };
        !(self.config.sight_test_budget > 0 && work.shafts.are_apart(eyes, bodies))
            && eyes.sees(bodies, &self.world.cells, &self.sectors)
            && eyes.shows(bodies, &self.rooms)
    }

    /// Where a viewer's eye and an avatar's body can be.
    fn grounds<'a>(
        &self,
        work: &mut Workspace,
        viewer: &'a LiveAvatar,
        other: &'a LiveAvatar,
        level: usize,
    ) -> Option<[&'a RegionFootprint; 2]> {
        let eyes = self.kept(work, viewer, RegionKind::EYES, level)?;
        let bodies = self.kept(work, other, viewer.near.shown, level)?;
        Some([&eyes.ground, &bodies.ground])
    }

    /// Whether a line goes from where the viewer's eye can be to where the avatar's body can be.
    fn joins(&self, viewer: &LiveAvatar, other: &LiveAvatar, line: &SightLine) -> bool {
        viewer.near.may_hold(RegionKind::EYES, line.from, &self.body)
            && other.near.may_hold(viewer.near.shown, line.to, &self.body)
    }
}

/// Where the eyes of both can be just now, whatever walls are there.
fn eyes_of(viewer: &LiveAvatar, other: &LiveAvatar) -> [Aabb; 2] {
    let within = |live: &LiveAvatar, part: RegionKind| {
        live.near.get(part).map_or(Aabb::EMPTY, |near| near.within)
    };
    [within(viewer, RegionKind::EYES), within(other, viewer.near.shown)]
}

/// Which regions a viewer and an avatar have.
fn regions(viewer: &LiveAvatar, other: &LiveAvatar, level: usize) -> Regions {
    let version = |live: &LiveAvatar, part: RegionKind| {
        live.near.get(part).map_or(0, |near| near.versions[level])
    };
    let eyes = version(viewer, RegionKind::EYES);
    Regions { level: level as u8, eyes, bodies: version(other, viewer.near.shown) }
}
