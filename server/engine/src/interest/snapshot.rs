//! The live avatars of a tick, side by side: what is their own can be changed by one thread each while all
//! can be looked at.

use std::time::Duration;

use glam::Vec3;
use sightline_visibility::rooms::SealedRooms;
use sightline_world::motion::{AvatarId, Pose};

use crate::{
    Engine, claims::walkability::WalkState, interest::candidates::Pair, population::Slot,
    regions::live_regions::LiveRegions, timing::horizon::Link,
};

/// Where in the scene someone stands: by the space that it was in a tick ago, then by id.
pub(crate) type SortKey = (Option<u32>, AvatarId);

/// A live avatar, as all others may look at it.
#[derive(Clone, Debug)]
pub(crate) struct LiveAvatar {
    pub(crate) stand: SortKey,
    pub(crate) id: AvatarId,
    pub(crate) slot: Slot,
    pub(crate) pose: Pose,
    /// Counts accepted poses.
    pub(crate) version: u32,
    pub(crate) seal: SealedRooms,
    /// When the last accepted pose came in.
    pub(crate) heard: Duration,
    pub(crate) link: Link,
    /// It moves as it says.
    pub(crate) is_believed: bool,
    /// Where it was last, in own axes.
    pub(crate) from: Vec3,
    pub(crate) footing: WalkState,
    pub(crate) near: LiveRegions,
    /// If it has a new wide region, the cells that its eye could be in before, and those of its body.
    pub(crate) moved: Option<[Vec<u32>; 2]>,
}

/// All live avatars: neighbours side by side, since they have to do with the same others and the same gates, and so
/// find in a cache what they need to know.
#[derive(Clone, Debug, Default)]
pub(crate) struct LiveAvatars {
    all: Vec<LiveAvatar>,
    /// Of each slot that one of them has, which it is.
    of: Vec<u32>,
}

/// The live avatars, and the pairs that each has as a viewer, in the same order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Snapshot {
    pub(crate) lives: LiveAvatars,
    pub(crate) pairs: Vec<Vec<Pair>>,
}

impl LiveAvatars {
    pub(crate) fn all(&self) -> &[LiveAvatar] {
        &self.all
    }

    pub(crate) fn all_mut(&mut self) -> &mut [LiveAvatar] {
        &mut self.all
    }

    /// The place of a live avatar among all.
    pub(crate) fn place(&self, slot: Slot) -> usize {
        self.of[slot.0 as usize] as usize
    }

    /// A live avatar.
    pub(crate) fn at(&self, slot: Slot) -> &LiveAvatar {
        &self.all[self.place(slot)]
    }
}

impl Engine {
    /// Takes out of the population what a tick changes of its live avatars.
    pub(crate) fn enter(&mut self, now: Duration, live: &[Slot]) -> Snapshot {
        let mut scene = std::mem::take(&mut self.scene);
        let stand = |slot: Slot| {
            let avatar = self.population.at(slot);
            (avatar.near.home(), avatar.id)
        };
        let mut order: Vec<(SortKey, Slot)> =
            live.iter().map(|slot| (stand(*slot), *slot)).collect();
        order.sort_unstable_by_key(|(stand, _)| *stand);
        for ((stand, slot), place) in order.into_iter().zip(0..) {
            let avatar = self.population.at_mut(slot);
            scene.pairs.push(std::mem::take(&mut avatar.pairs));
            scene.lives.all.push(LiveAvatar {
                stand,
                id: avatar.id,
                slot,
                pose: avatar.pose,
                version: avatar.version,
                seal: avatar.seal,
                heard: avatar.heard,
                link: avatar.link(),
                is_believed: avatar.pledges.are_kept(now),
                from: self.world.cells.axes.own(avatar.pose.eye),
                footing: avatar.footing,
                near: std::mem::take(&mut avatar.near),
                moved: None,
            });
            let of = &mut scene.lives.of;
            if of.len() <= slot.0 as usize {
                of.resize(slot.0 as usize + 1, 0);
            }
            of[slot.0 as usize] = place;
        }
        scene
    }

    /// Puts all back.
    pub(crate) fn leave(&mut self, mut scene: Snapshot) {
        for (live, pairs) in scene.lives.all.drain(..).zip(scene.pairs.drain(..)) {
            let avatar = self.population.at_mut(live.slot);
            (avatar.near, avatar.pairs) = (live.near, pairs);
        }
        self.scene = scene;
    }
}
