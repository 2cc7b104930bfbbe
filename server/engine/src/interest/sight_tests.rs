//! Sight tests: whether a viewer in its region can see an avatar in its own.
//!
//! A hidden pair stays hidden while both regions last, since walls do not move. A visible pair
//! stays visible while the free line still joins the two regions. So at most ticks a pair costs one
//! comparison. A pair that was not hidden is first tested along one predicted line. Gates, cells
//! and rooms are then asked for regions with a margin. The rest is decided by box visibility
//! between the exact regions of this tick. Only that has a budget, in units of work and not in
//! time, so the same inputs give the same outputs. A pair that the budget does not decide counts as
//! visible.

use glam::Vec3;
use sightline_visibility::box_visibility::SightLine;

use super::{
    certificates::CertificateInputs,
    snapshot::{LiveAvatar, LiveAvatars, Snapshot, SortKey},
};
use crate::{
    pair::{EyeBoxes, Pair, RegionMargin, RegionVersions, SightResult},
    pairs::Pairs,
    regions::{BoxTest, LineEnd, RegionFootprint, RegionKind, scaled},
    tick_context::TickContext,
    worker_pool::{WorkerPool, Workspace},
};

/// Ticks before a pair that could not be decided is tested again. Where tests cost much, each
/// further try waits twice as long.
const UNDECIDED_TICKS: u32 = 8;
/// The least wait before a pair that could not be decided is tested again, in
/// [intervals](CertificateInputs::interval).
const INTERVALS: u32 = 4;
/// The most doublings of the wait of a pair that could not be decided.
const WAITS_MAX: u32 = 3;
/// The tests of a tick cost much when they cost more than the budget divided by this number. The
/// first test of a pair may then cost less, since most pairs that can be decided are decided soon.
const MUCH_PARTS: u32 = 4;
/// As [`MUCH_PARTS`], for crowds, where the many pairs cost enough by themselves.
const MUCH_PARTS_CROWDED: u32 = 32;
/// It is crowded when the number of pairs is such that an open one waits for this many ticks before
/// it is looked at again.
const CROWDED_INTERVAL: u32 = 4;
/// The most halvings of what the first test of a pair may cost.
const THRIFT_MAX: u32 = 6;
/// The most ticks before a pair is looked at again for which the budget did not suffice.
const QUEUE_TICKS_MAX: u32 = 16;
/// Ticks before regions with a large margin are tried again where they did not help.
const LARGE_MARGIN_TICKS: u32 = 16;
/// A free line that is moved along ends in the middle of the two regions: in boxes of this part of
/// their size. So it joins them for some ticks.
const WELL_INSIDE: f32 = 0.6;
/// What a sight test costs, about. From it follows by how much all tests that are due exceed the
/// budget, which is the load.
const TEST_UNITS: u32 = 200;
/// The part of the budget that is reserved for pairs that the viewer does not hold, in per cent.
const NEW_PER_CENT: u32 = 60;
/// One test costs no more than this many times an equal share of the budget. Where that is little,
/// it may still cost such a part of the most that a test may ever cost.
const SHARES: u32 = 8;

/// How sight tests are shared out over ticks.
#[derive(Clone, Debug)]
pub(crate) struct SightBudget {
    /// By how much the tests that were due at the last tick exceeded the budget, from 1 to 8.
    load: u32,
    /// How often the limit of one test is halved for the first test of a pair, from 0 to
    /// [`THRIFT_MAX`].
    thrift: u32,
    /// The viewer at whom the budget for pairs that are not held ran out.
    turn_new: SortKey,
    /// The viewer at whom the budget for held pairs ran out.
    turn_held: SortKey,
}

impl Default for SightBudget {
    fn default() -> Self {
        Self { load: 1, thrift: 0, turn_new: SortKey::FIRST, turn_held: SortKey::FIRST }
    }
}

/// A pair that must be tested.
#[derive(Clone, Copy)]
struct DuePair {
    /// The viewer's index in the snapshot.
    viewer: u32,
    /// The pair's index among the viewer's own.
    at: u32,
}

impl DuePair {
    fn of<'a>(&self, pairs: &'a [&mut Pairs]) -> &'a Pair {
        pairs[self.viewer as usize].at(self.at as usize)
    }
}

/// What a sight test of one pair came to.
#[derive(Clone)]
struct Tested {
    result: Option<SightResult>,
    /// What is left of what the test may cost.
    left: u32,
}

/// What sight tests read.
struct SightTests<'a> {
    context: TickContext<'a>,
    live: &'a LiveAvatars<'a>,
    load: u32,
    thrift: u32,
    interval: u32,
    /// Whether a crowd of pairs leaves less to spend on each.
    is_crowded: bool,
}

/// Tests all pairs whose last result no longer holds. Pairs that the viewer does not hold come
/// first. A hard pair gets no more than a few times an equal share. Where the budget does not
/// suffice, later ticks go on. Returns for how many ticks it would have to suffice for all.
pub(crate) fn test_pairs(
    context: TickContext<'_>,
    pool: &WorkerPool,
    inputs: &CertificateInputs,
    snapshot: &mut Snapshot<'_>,
    budget: &mut SightBudget,
) -> u32 {
    let Snapshot { live, pairs } = snapshot;
    let SightBudget { load, thrift, .. } = *budget;
    let interval = inputs.interval;
    let is_crowded = interval >= CROWDED_INTERVAL;
    let tests = SightTests { context, live, load, thrift, interval, is_crowded };
    let due = pool.gather(pairs, |workspace, index, pairs, due| {
        let viewer = &live.all()[index];
        if viewer.is_guest {
            return;
        }
        inputs.end(viewer, pairs);
        for at in 0..pairs.len() {
            if !pairs.may_need_test(at, context.tick) {
                continue;
            }
            let (pair, certificate) = pairs.at_mut(at);
            let other = live.at(pair.slot);
            if !pair.is_candidate {
                continue;
            }
            if certificate.until > context.tick {
                tests.check_cells(workspace, viewer, other, pair);
            } else if tests.try_cheap_tests(workspace, viewer, other, pair) {
                due.push(DuePair { viewer: index as u32, at: at as u32 });
            }
        }
    });
    let units = context.config.sight_test_budget;
    let count = u32::try_from(due.len()).unwrap_or(u32::MAX);
    let wanted = u64::from(count) * u64::from(TEST_UNITS);
    let load = wanted / u64::from(units.max(1));
    budget.load = load.clamp(1, u64::from(UNDECIDED_TICKS)) as u32;
    let test_max = context.config.sight_test_max;
    let most = (SHARES * (units / count.max(1))).clamp(test_max / SHARES, test_max);
    let (held, new) = due.into_iter().partition(|due| due.of(pairs).is_held);
    let mut left = units / 100 * NEW_PER_CENT;
    let mut round = Round { most, left: &mut left, turn: &mut budget.turn_new };
    let mut tested = tests.run(pool, pairs, new, &mut round);
    left += units / 100 * (100 - NEW_PER_CENT);
    let mut round = Round { most, left: &mut left, turn: &mut budget.turn_held };
    tested += tests.run(pool, pairs, held, &mut round);
    let spent = units - left.min(units);
    let much = units / if is_crowded { MUCH_PARTS_CROWDED } else { MUCH_PARTS };
    if spent > much {
        budget.thrift = (budget.thrift + 1).min(THRIFT_MAX);
    } else if spent < much / 2 {
        budget.thrift = budget.thrift.saturating_sub(1);
    }
    count.checked_div(tested).unwrap_or(1).clamp(1, QUEUE_TICKS_MAX)
}

/// What the tests of some pairs may cost.
struct Round<'a> {
    /// The most that one test may cost.
    most: u32,
    /// What is left of the budget.
    left: &'a mut u32,
    /// The viewer to begin with, and afterwards the one at whom the budget ran out.
    turn: &'a mut SortKey,
}

impl SightTests<'_> {
    /// Tests pairs, beginning with those of the viewer whose turn it is. Each round has as many
    /// pairs as the budget is sure to suffice for, or twice as many. So what each test may cost
    /// does not depend on its neighbours. Returns how many were tested.
    fn run(
        &self,
        pool: &WorkerPool,
        pairs: &mut [&mut Pairs],
        mut due: Vec<DuePair>,
        budget: &mut Round<'_>,
    ) -> u32 {
        let (most, turn) = (budget.most, *budget.turn);
        let key = |due: &DuePair| self.live.all()[due.viewer as usize].key;
        debug_assert!(due.is_sorted_by_key(key), "pairs come in the order of the snapshot");
        let first = due.partition_point(|due| key(due) < turn);
        due.rotate_left(first);
        let mut rest = &due[..];
        while let Some(next) = rest.first() {
            if *budget.left == 0 {
                *budget.turn = key(next);
                break;
            }
            let sure = usize::try_from(*budget.left / most.max(1)).unwrap_or(usize::MAX);
            let (round, later) = rest.split_at(rest.len().min(2 * sure + 1));
            let mut tested = vec![Tested { result: None, left: most }; round.len()];
            pool.each(&mut tested, |workspace, index, tested| {
                let viewer = &self.live.all()[round[index].viewer as usize];
                let pair = round[index].of(pairs);
                tested.result = self.test(workspace, viewer, pair, &mut tested.left);
            });
            for (due, Tested { result, left }) in round.iter().zip(tested) {
                debug_assert!(left <= most, "a test spends budget");
                *budget.left = budget.left.saturating_sub(most - left);
                if let Some(result) = result {
                    pairs[due.viewer as usize].at_mut(due.at as usize).0.sight = result;
                }
            }
            rest = later;
        }
        (due.len() - rest.len()) as u32
    }

    /// Tries what costs little: rooms, gates, cells and a predicted line. Returns whether they
    /// leave it undecided and the last result no longer holds, so that the pair must be tested.
    fn try_cheap_tests(
        &self,
        workspace: &mut Workspace,
        viewer: &LiveAvatar<'_>,
        other: &LiveAvatar<'_>,
        pair: &mut Pair,
    ) -> bool {
        let has_rules = self.context.building.rooms.can_rule_out();
        let [space, other_space] = [viewer, other].map(|avatar| avatar.regions.space());
        if space.is_some() && space == other_space && !has_rules {
            // A space is convex, and nothing in it blocks sight.
            pair.sight = SightResult::Together;
            return false;
        }
        if pair.sight.may_see() && self.try_cells(workspace, viewer, other, pair) {
            return false;
        }
        let holds = match pair.sight {
            SightResult::Unknown | SightResult::Together | SightResult::Undecided { .. } => false,
            SightResult::HiddenIn(then) => then.contain(&eye_boxes(viewer, other)),
            SightResult::Hidden(then) => then == versions(viewer, other, then.margin),
            SightResult::Free(line) => {
                has_rules && self.try_gates(workspace, viewer, other, pair)
                    || self.joins(viewer, other, &line)
            }
        };
        if holds {
            return false;
        }
        if self.context.tick >= pair.gates_again_at {
            // A hidden pair is more likely to be hidden again. Rooms come before all else.
            let is_line_first = !has_rules && !pair.sight.is_hidden();
            if is_line_first && self.try_line(viewer, other, pair) {
                self.try_cells(workspace, viewer, other, pair);
                return false;
            }
            if self.try_gates_with_margins(workspace, viewer, other, pair)
                || !is_line_first && self.try_line(viewer, other, pair)
            {
                return false;
            }
        }
        if pair.sight.is_hidden() {
            // That does not hold any more, and the budget may not suffice for a test.
            pair.sight = SightResult::Undecided { again: self.context.tick, tries: 0 };
        }
        !matches!(pair.sight, SightResult::Undecided { again, .. } if self.context.tick < again)
    }

    /// Makes sure that a viewer may be told news of an avatar, if the two are not tested at this
    /// tick. No viewer is told of an avatar that cells hide, whatever the load.
    fn check_cells(
        &self,
        workspace: &mut Workspace,
        viewer: &LiveAvatar<'_>,
        other: &LiveAvatar<'_>,
        pair: &mut Pair,
    ) {
        if matches!(pair.sight, SightResult::Free(_) | SightResult::Undecided { .. }) {
            self.try_cells(workspace, viewer, other, pair);
        }
    }

    /// Hides a pair if no cells of its regions see each other, where these have changed since that
    /// was asked. Returns whether it did. The end of a free line may by now be where only walls
    /// keep an eye or a body from being. And no viewer is told of an avatar that cells hide,
    /// whatever the load.
    fn try_cells(
        &self,
        workspace: &mut Workspace,
        viewer: &LiveAvatar<'_>,
        other: &LiveAvatar<'_>,
        pair: &mut Pair,
    ) -> bool {
        let regions = versions(viewer, other, RegionMargin::Small);
        if pair.cells_see_for == Some(regions) {
            return false;
        }
        let building = self.context.building;
        // Where both were last known to be is in their regions.
        if let Some((eye, body)) = viewer.regions.cell().zip(other.regions.cell())
            && building.sees(eye, body)
        {
            pair.cells_see_for = Some(regions);
            return false;
        }
        let Some(footprints) = self.footprints(workspace, viewer, other, RegionMargin::Small)
        else {
            return false;
        };
        let sees = footprints.eyes.sees(footprints.bodies, building);
        if sees {
            pair.cells_see_for = Some(regions);
        } else {
            pair.sight = SightResult::Hidden(regions);
        }
        !sees
    }

    /// Tries a line from where the viewer's eye is heading to where the avatar is, or else the last
    /// free line, moved to where the regions are now. Returns whether one is free. Does nothing
    /// where gates do not count.
    fn try_line(&self, viewer: &LiveAvatar<'_>, other: &LiveAvatar<'_>, pair: &mut Pair) -> bool {
        if self.context.config.sight_test_budget == 0 {
            return false;
        }
        let last = || match pair.sight {
            SightResult::Free(line) => self.moved(viewer, other, &line),
            _ => None,
        };
        let heading = || {
            let building = self.context.building;
            let heading =
                |of: &LiveAvatar<'_>, kind| of.regions.heading(building, &of.motion, kind);
            let from = heading(viewer, RegionKind::EYES)?;
            Some([from, heading(other, viewer.regions.shown())?])
        };
        let free = heading().filter(|ends| self.is_free(ends));
        let free = free.or_else(|| last().filter(|ends| self.is_free(ends)));
        if let Some([from, to]) = free {
            pair.sight = SightResult::Free(SightLine { from: from.point, to: to.point });
        }
        free.is_some()
    }

    /// The line nearest to one that was free whose ends are well inside the regions of a pair now.
    fn moved(
        &self,
        viewer: &LiveAvatar<'_>,
        other: &LiveAvatar<'_>,
        line: &SightLine,
    ) -> Option<[LineEnd; 2]> {
        let building = self.context.building;
        let body = &building.body;
        let end = |avatar: &LiveAvatar<'_>, kind: RegionKind, point: Vec3| {
            let bounds = avatar.regions.bounds(kind, body);
            let inside = scaled(&bounds, bounds.centre(), WELL_INSIDE);
            let point = point.clamp(inside.min, inside.max);
            let is_possible = avatar.regions.may_contain(kind, point, body);
            let cell = || building.cell_at(point, avatar.regions.cell());
            is_possible.then(|| LineEnd { point, cell: cell() })
        };
        let from = end(viewer, RegionKind::EYES, line.from)?;
        Some([from, end(other, viewer.regions.shown(), line.to)?])
    }

    /// Whether a line between two ends is free.
    fn is_free(&self, [from, to]: &[LineEnd; 2]) -> bool {
        let building = self.context.building;
        let cells = building.cells();
        let Some((start, goal)) = from.cell.zip(to.cell) else { return false };
        let spaces = [start, goal].map(|cell| cells.cells[cell.0 as usize].space);
        let line = SightLine { from: from.point, to: to.point };
        building.sees(start, goal) && building.occluders.is_free_through_gates(&line, spaces)
    }

    /// Hides a pair if gates, cells or rooms hide its regions from each other. Returns whether they
    /// do. Regions with a large margin come first, so that the result lasts, unless they did not
    /// help a while ago.
    fn try_gates_with_margins(
        &self,
        workspace: &mut Workspace,
        viewer: &LiveAvatar<'_>,
        other: &LiveAvatar<'_>,
        pair: &mut Pair,
    ) -> bool {
        if self.context.tick >= pair.large_margin_again_at {
            if !self.may_see(workspace, viewer, other, RegionMargin::Large) {
                pair.sight = SightResult::Hidden(versions(viewer, other, RegionMargin::Large));
                return true;
            }
            pair.large_margin_again_at = self.context.tick + LARGE_MARGIN_TICKS;
        }
        let are_hidden = self.try_gates(workspace, viewer, other, pair);
        if !are_hidden && !matches!(pair.sight, SightResult::Undecided { .. }) {
            pair.sight = SightResult::Undecided { again: self.context.tick, tries: 0 };
        }
        are_hidden
    }

    /// Hides a pair if gates, cells or rooms hide its regions with the small margin, where these
    /// have changed. Returns whether it did. Under load, a pair that was left open a moment ago
    /// stays so for some ticks.
    fn try_gates(
        &self,
        workspace: &mut Workspace,
        viewer: &LiveAvatar<'_>,
        other: &LiveAvatar<'_>,
        pair: &mut Pair,
    ) -> bool {
        if self.context.tick < pair.gates_again_at {
            return false;
        }
        let regions = versions(viewer, other, RegionMargin::Small);
        let are_hidden = pair.gates_undecided_for != Some(regions)
            && !self.may_see(workspace, viewer, other, RegionMargin::Small);
        if are_hidden {
            (pair.sight, pair.gates_again_at) = (SightResult::Hidden(regions), 0);
        } else {
            (pair.gates_undecided_for, pair.gates_again_at) =
                (Some(regions), self.context.tick + self.load);
        }
        are_hidden
    }

    /// Tests a pair's regions by box visibility. The more tests in a row do not decide a pair, the
    /// later comes the next, and the more it may cost.
    fn test(
        &self,
        workspace: &mut Workspace,
        viewer: &LiveAvatar<'_>,
        pair: &Pair,
        left: &mut u32,
    ) -> Option<SightResult> {
        let other = self.live.at(pair.slot);
        let tries = match pair.sight {
            SightResult::Undecided { tries, .. } => tries,
            _ => 0,
        };
        let halvings = self.thrift.saturating_sub(tries.min(WAITS_MAX) / 2);
        let most = (self.context.config.sight_test_max >> halvings).min(*left);
        let mut left_of_it = most;
        let result = match self.test_exact(workspace, viewer, other, &mut left_of_it)? {
            BoxTest::Hidden => SightResult::HiddenIn(eye_boxes(viewer, other)),
            BoxTest::Free(line) => SightResult::Free(line),
            BoxTest::Undecided => {
                let wait = UNDECIDED_TICKS.max(INTERVALS * self.interval);
                let again = self.context.tick + (wait << tries.min(WAITS_MAX));
                SightResult::Undecided { again, tries: tries + 1 }
            }
        };
        *left -= most - left_of_it;
        Some(result)
    }

    /// Tests the regions of a pair at this tick, without a margin. In a crowd, places that a body
    /// can get to only within a small margin may count as well.
    fn test_exact(
        &self,
        workspace: &mut Workspace,
        viewer: &LiveAvatar<'_>,
        other: &LiveAvatar<'_>,
        left: &mut u32,
    ) -> Option<BoxTest> {
        let Workspace { reach, sight, .. } = workspace;
        let (context, shown) = (self.context, viewer.regions.shown());
        let occluders = &context.building.occluders;
        let mut cover = |of: &LiveAvatar<'_>, kind| {
            if self.is_crowded {
                of.regions.close_cover(context, reach, &of.motion, kind)
            } else {
                of.regions.exact(context, reach, &of.motion, kind).cloned()
            }
        };
        let (eyes, bodies) = (cover(viewer, RegionKind::EYES)?, cover(other, shown)?);
        Some(match sight.test(occluders, &eyes, &bodies, left) {
            BoxTest::Free(line) if !sight.is_free(occluders, &line, left) => BoxTest::Undecided,
            result => result,
        })
    }

    /// Whether a viewer may see an avatar as far as gates, cells and rooms tell.
    fn may_see(
        &self,
        workspace: &mut Workspace,
        viewer: &LiveAvatar<'_>,
        other: &LiveAvatar<'_>,
        margin: RegionMargin,
    ) -> bool {
        let Some(Footprints { eyes, bodies }) = self.footprints(workspace, viewer, other, margin)
        else {
            return false;
        };
        let building = self.context.building;
        let are_apart = self.context.config.sight_test_budget > 0
            && workspace.sight.are_apart(&building.occluders, eyes, bodies);
        !are_apart && eyes.sees(bodies, building) && eyes.rooms_allow(bodies, &building.rooms)
    }

    /// The footprints of a pair's cached regions.
    fn footprints<'a>(
        &self,
        workspace: &mut Workspace,
        viewer: &'a LiveAvatar<'_>,
        other: &'a LiveAvatar<'_>,
        margin: RegionMargin,
    ) -> Option<Footprints<'a>> {
        let (context, reach) = (self.context, &mut workspace.reach);
        let shown = viewer.regions.shown();
        let eyes =
            viewer.regions.cached(context, reach, &viewer.motion, RegionKind::EYES, margin)?;
        let bodies = other.regions.cached(context, reach, &other.motion, shown, margin)?;
        Some(Footprints { eyes, bodies })
    }

    /// Whether a line goes from where the viewer's eye can be to where the avatar's body can be.
    fn joins(&self, viewer: &LiveAvatar<'_>, other: &LiveAvatar<'_>, line: &SightLine) -> bool {
        let body = &self.context.building.body;
        viewer.regions.may_contain(RegionKind::EYES, line.from, body)
            && other.regions.may_contain(viewer.regions.shown(), line.to, body)
    }
}

/// The footprints of a viewer's eye region and of an avatar's body region.
struct Footprints<'a> {
    eyes: &'a RegionFootprint,
    bodies: &'a RegionFootprint,
}

/// Where the eyes of a pair can be at this tick, whatever walls are in these boxes.
fn eye_boxes(viewer: &LiveAvatar<'_>, other: &LiveAvatar<'_>) -> EyeBoxes {
    EyeBoxes {
        viewer: viewer.regions.eyes(RegionKind::EYES),
        avatar: other.regions.eyes(viewer.regions.shown()),
    }
}

/// Which cached regions a pair has.
fn versions(
    viewer: &LiveAvatar<'_>,
    other: &LiveAvatar<'_>,
    margin: RegionMargin,
) -> RegionVersions {
    RegionVersions {
        margin,
        eyes: viewer.regions.version(RegionKind::EYES, margin),
        bodies: other.regions.version(viewer.regions.shown(), margin),
    }
}
