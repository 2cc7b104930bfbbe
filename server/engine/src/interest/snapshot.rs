//! Tick snapshot: the live avatars of a tick, side by side.
//!
//! Each thread may change what belongs to one avatar while it reads all others.

use std::time::Duration;

use sightline_visibility::rooms::SealedRooms;
use sightline_world::motion::{AvatarId, Pose, Tolerance};

use crate::{
    baselines::Location,
    generation::Generation,
    pairs::Pairs,
    population::{Avatar, Population, Profile},
    regions::{LiveRegions, Motion, OccupantIndex, Occupied},
    slot::{Member, Slot},
    tick_context::TickContext,
    worker_pool::WorkerPool,
};

/// The nearest viewer of each avatar is found anew after this number of ticks.
const NEAREST_TICKS: u32 = 8;

/// Whether a tick is one of those, every [`NEAREST_TICKS`], that belong to a slot.
pub(super) fn is_in_turn(slot: Slot, round: u32) -> bool {
    slot.0.wrapping_add(round).is_multiple_of(NEAREST_TICKS)
}

/// The order of avatars in a snapshot: by the space that each was in a tick ago, then by id.
/// Neighbours are paired with the same avatars and use the same gates, so they share caches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct SortKey {
    pub(super) space: Option<u32>,
    pub(super) id: AvatarId,
}

impl SortKey {
    /// The key before all others.
    pub(crate) const FIRST: Self = Self { space: None, id: AvatarId(0) };
}

/// A live avatar, as all others may read it.
#[derive(Debug)]
pub(crate) struct LiveAvatar<'a> {
    pub(super) key: SortKey,
    pub(super) member: Member,
    /// Whether it belongs to another station. Then it is seen here, and its viewer is told there.
    pub(super) is_guest: bool,
    pub(super) profile: &'a Profile,
    /// Counts accepted poses.
    pub(super) version: Generation,
    /// Whether there is a new pose since the last tick.
    pub(super) has_news: bool,
    pub(super) sealed: SealedRooms,
    pub(super) location: Location,
    pub(super) motion: Motion,
    /// The pose that viewers are told.
    pub(super) shown: Pose,
    /// For how long that pose goes on as it does, if there is no news.
    pub(super) shown_for: Duration,
    /// By how much its client may be off course unsaid.
    pub(super) tolerance: Tolerance,
    pub(super) regions: &'a mut LiveRegions,
    /// The cells of the last coarse region, if this tick has made a new one.
    pub(super) old_cells: Option<Occupied>,
}

impl LiveAvatar<'_> {
    /// Whether this tick has made a new coarse region.
    pub(super) fn has_moved(&self) -> bool {
        self.old_cells.is_some()
    }
}

/// All live avatars, by [`SortKey`].
#[derive(Debug)]
pub(crate) struct LiveAvatars<'a> {
    all: Vec<LiveAvatar<'a>>,
    /// The index of the live avatar in each slot.
    index_of: Vec<u32>,
}

/// The live avatars, and the pairs that each has as a viewer, in the same order.
#[derive(Debug)]
pub(crate) struct Snapshot<'a> {
    pub(super) live: LiveAvatars<'a>,
    pub(super) pairs: Vec<&'a mut Pairs>,
}

impl<'a> LiveAvatars<'a> {
    pub(super) fn all(&self) -> &[LiveAvatar<'a>] {
        &self.all
    }

    /// The index of a live avatar among all.
    pub(super) fn index(&self, slot: Slot) -> usize {
        let index = self.index_of[slot.0 as usize] as usize;
        debug_assert_eq!(self.all[index].member.slot, slot, "only live avatars have an index");
        index
    }

    /// How many slots there are, with those that are free or hold hidden avatars.
    pub(super) fn slots(&self) -> usize {
        self.index_of.len()
    }

    pub(super) fn at(&self, slot: Slot) -> &LiveAvatar<'a> {
        &self.all[self.index(slot)]
    }
}

impl<'a> Snapshot<'a> {
    /// Takes the snapshot of a moment.
    pub(crate) fn take(context: TickContext<'_>, population: &'a mut Population) -> Self {
        let mut avatars: Vec<Option<&mut Avatar>> = population.slots_mut().collect();
        let mut order: Vec<(SortKey, Slot)> = Vec::with_capacity(avatars.len());
        for (avatar, slot) in avatars.iter().zip(0..) {
            if let Some(avatar) = avatar.as_ref().filter(|avatar| avatar.is_live()) {
                let key = SortKey { space: avatar.regions.space(), id: avatar.id };
                order.push((key, Slot(slot)));
            }
        }
        order.sort_unstable_by_key(|(key, _)| *key);
        let mut index_of = vec![u32::MAX; avatars.len()];
        let (mut all, mut pairs) =
            (Vec::with_capacity(order.len()), Vec::with_capacity(order.len()));
        for ((key, slot), index) in order.into_iter().zip(0..) {
            let Some(avatar) = avatars[slot.0 as usize].take() else { continue };
            index_of[slot.0 as usize] = index;
            let (motion, shown) = (avatar.motion(context), avatar.shown(context));
            let (shown_for, is_guest) = (avatar.shown_for(context), avatar.is_guest());
            pairs.push(&mut avatar.pairs);
            all.push(LiveAvatar {
                key,
                member: Member { id: avatar.id, slot },
                is_guest,
                profile: &avatar.profile,
                version: avatar.version,
                has_news: std::mem::take(&mut avatar.has_news),
                sealed: avatar.sealed,
                location: Location { eye: avatar.pose.eye, area: avatar.area },
                motion,
                shown,
                shown_for,
                tolerance: avatar.orders.in_force(),
                regions: &mut avatar.regions,
                old_cells: None,
            });
        }
        debug_assert_eq!(all.len(), pairs.len(), "pairs are in the order of avatars");
        Self { live: LiveAvatars { all, index_of }, pairs }
    }

    /// How far away some viewers are from the avatars that they hold, in metres, by the avatars'
    /// slots. Each viewer has its turn every [`NEAREST_TICKS`].
    pub(crate) fn distances(&self, round: u32) -> Vec<(Slot, f32)> {
        let viewers = self.live.all.iter().zip(&self.pairs);
        let in_turn = viewers.filter(|(viewer, _)| is_in_turn(viewer.member.slot, round));
        let distances = in_turn.flat_map(|(viewer, pairs)| {
            pairs.iter().filter(|pair| pair.is_held).map(|pair| {
                let avatar = self.live.at(pair.slot);
                (pair.slot, viewer.motion.from.distance(avatar.motion.from))
            })
        });
        distances.collect()
    }

    /// Brings the live regions up to date, and the index of coarse regions.
    pub(crate) fn update_regions(
        &mut self,
        context: TickContext<'_>,
        pool: &WorkerPool,
        index: &mut OccupantIndex,
    ) {
        let delays: Vec<Duration> = context.horizons.delays().collect();
        pool.each(&mut self.live.all, |workspace, _, avatar| {
            let LiveAvatar { regions, motion, .. } = avatar;
            avatar.old_cells = regions.update(context, &mut workspace.reach, motion, &delays);
        });
        for avatar in self.live.all() {
            if let Some((old, coarse)) = avatar.old_cells.as_ref().zip(avatar.regions.coarse()) {
                index.replace(avatar.member, old, &coarse.cells);
            }
        }
    }
}
