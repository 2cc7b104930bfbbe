//! Candidates: the pairs of avatars that may see each other by their coarse regions.
//!
//! Two live avatars have a pair each, one as the viewer of the other, while their coarse regions
//! may see each other: by an index of cells, then by rooms, and by the gates between them. Pairs
//! are updated only for avatars with a new coarse region. Most people in a building have no pair
//! with each other, and cost nothing until one of them has moved some way. [Sight
//! tests](super::sight_tests) decide what pairs leave open.

use sightline_world::motion::AvatarId;

use super::snapshot::{LiveAvatars, Snapshot};
use crate::{
    messages::Output,
    pair::Pair,
    pairs::Pairs,
    population::Population,
    regions::{CoarseRegion, OccupantIndex, RegionFootprint},
    slot::{Member, Slot},
    tick_context::TickContext,
    worker_pool::{WorkerPool, Workspace},
};

/// An avatar with a new coarse region.
struct Moved {
    /// Its index in the snapshot.
    index: usize,
    /// The avatars that it may see or be seen by. Of those that have moved too, only later ones.
    met: Vec<Member>,
}

/// What the search for candidates reads.
struct Candidates<'a> {
    context: TickContext<'a>,
    index: &'a OccupantIndex,
    live: &'a LiveAvatars<'a>,
}

/// Makes and ends pairs after coarse regions have changed.
pub(crate) fn update_pairs(
    context: TickContext<'_>,
    pool: &WorkerPool,
    index: &OccupantIndex,
    snapshot: &mut Snapshot<'_>,
) {
    let Snapshot { live, pairs } = snapshot;
    let all = live.all().iter().enumerate();
    let mut moved: Vec<Moved> = all
        .filter(|(_, avatar)| avatar.has_moved())
        .map(|(index, _)| Moved { index, met: Vec::new() })
        .collect();
    let candidates = Candidates { context, index, live };
    pool.each(&mut moved, |workspace, _, moved| {
        moved.met = candidates.met_by(workspace, moved.index, pairs[moved.index]);
    });
    let mut found: Vec<Vec<Member>> = vec![Vec::new(); moved.len()];
    for (position, one) in moved.iter().enumerate() {
        let member = live.all()[one.index].member;
        for other in &one.met {
            let other = live.index(other.slot);
            if live.all()[other].has_moved()
                && let Ok(later) = moved.binary_search_by_key(&other, |moved| moved.index)
            {
                found[later].push(member);
            }
        }
        found[position].extend(&one.met);
    }
    for (one, mut found) in moved.iter().zip(found) {
        found.sort_unstable();
        replace_pairs(live, pairs, one.index, found);
    }
}

impl Candidates<'_> {
    /// Finds all avatars that one with a new coarse region may see or be seen by, except those
    /// before it that have moved too.
    fn met_by(&self, workspace: &mut Workspace, index: usize, own: &Pairs) -> Vec<Member> {
        let mut found: Vec<Member> = Vec::new();
        let all = self.live.all();
        let Some(coarse) = all[index].regions.coarse() else { return found };
        let building = self.context.building;
        let Workspace { seen_by_eyes, seeing_bodies, .. } = workspace;
        seen_by_eyes.clear();
        seeing_bodies.clear();
        coarse.eye_footprint.add_visible(building, seen_by_eyes);
        coarse.body_footprint.add_visible(building, seeing_bodies);
        self.index.meeting(seen_by_eyes, seeing_bodies, &mut found);
        found.sort_unstable();
        found.dedup();
        found.retain(|member| {
            let other = self.live.index(member.slot);
            if other == index || other < index && all[other].has_moved() {
                return false;
            }
            if all[index].is_guest && all[other].is_guest {
                return false;
            }
            // What gates leave open between smaller regions they leave open between coarse ones.
            let is_open = |pair: &Pair| pair.is_candidate && !pair.sight.is_surely_hidden();
            if own.get(member.id).is_some_and(is_open) {
                return true;
            }
            all[other].regions.coarse().is_some_and(|other| self.may_meet(workspace, coarse, other))
        });
        found
    }

    /// Whether an avatar in one coarse region, whose visible cells are in the workspace, may see or
    /// be seen by an avatar in another.
    fn may_meet(
        &self,
        workspace: &mut Workspace,
        one: &CoarseRegion,
        other: &CoarseRegion,
    ) -> bool {
        let building = self.context.building;
        let has_budget = self.context.config.sight_test_budget > 0;
        let Workspace { sight, seen_by_eyes, seeing_bodies, .. } = workspace;
        let cells = building.cells();
        let mut may_see = |eyes: &RegionFootprint, bodies: &RegionFootprint| {
            eyes.rooms_allow(bodies, &building.rooms)
                && !(has_budget && sight.are_apart(&building.occluders, eyes, bodies))
        };
        other.body_footprint.touches(cells, seen_by_eyes)
            && may_see(&one.eye_footprint, &other.body_footprint)
            || other.eye_footprint.touches(cells, seeing_bodies)
                && may_see(&other.eye_footprint, &one.body_footprint)
    }
}

/// Gives an avatar with a new coarse region pairs with just these avatars, and them pairs with it.
/// Others that have moved too replace their own pairs.
fn replace_pairs(
    live: &LiveAvatars<'_>,
    pairs: &mut [&mut Pairs],
    index: usize,
    found: Vec<Member>,
) {
    debug_assert!(found.is_sorted_by(|one, other| one < other), "an avatar is found once");
    let member = live.all()[index].member;
    let old = &pairs[index];
    let is_known = |id: AvatarId| old.get(id).is_some_and(|pair| pair.is_candidate);
    let others_with = |slots: &mut dyn Iterator<Item = Slot>| -> Vec<usize> {
        let others = slots.map(|slot| live.index(slot));
        others.filter(|other| !live.all()[*other].has_moved()).collect()
    };
    let new = found.iter().filter(|other| !is_known(other.id));
    let started = others_with(&mut new.map(|other| other.slot));
    let is_gone = |pair: &&Pair| {
        pair.is_candidate && found.binary_search(&Member { id: pair.id, slot: pair.slot }).is_err()
    };
    let ended = others_with(&mut old.iter().filter(is_gone).map(|pair| pair.slot));
    pairs[index].match_to(found);
    started.into_iter().for_each(|other| pairs[other].start(member));
    ended.into_iter().for_each(|other| pairs[other].end(member.id));
}

/// Forgets what sight tests have found of all pairs with an avatar.
pub(crate) fn forget_results(population: &mut Population, slot: Slot) {
    let avatar = population.at(slot);
    let id = avatar.id;
    let others: Vec<Slot> = avatar.pairs.iter().map(|pair| pair.slot).collect();
    others.into_iter().for_each(|viewer| population.at_mut(viewer).pairs.forget(id));
    population.at_mut(slot).pairs.forget_all();
}

/// Ends all pairs with an avatar that leaves or is silenced, and removes its live regions. Clients
/// that hold it are told at the next tick.
pub(crate) fn end_pairs(
    context: TickContext<'_>,
    population: &mut Population,
    index: &mut OccupantIndex,
    slot: Slot,
    pending: &mut Vec<Output>,
) {
    let avatar = population.at_mut(slot);
    let id = avatar.id;
    if let Some(coarse) = avatar.regions.coarse() {
        index.remove(Member { id, slot }, &coarse.cells);
    }
    avatar.regions = Default::default();
    let viewers: Vec<Slot> = if context.config.policy.uses_cells() {
        avatar.pairs.iter().map(|pair| pair.slot).collect()
    } else {
        population.live().collect()
    };
    for viewer in viewers {
        let viewer = population.at_mut(viewer);
        if viewer.pairs.remove(id).is_some_and(|pair| pair.is_held) {
            pending.push(Output::Vanish { to: viewer.id, avatar: id });
            population.at_mut(slot).lose_watcher();
        }
    }
}
