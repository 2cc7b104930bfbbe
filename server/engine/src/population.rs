//! Who is present: the avatars, by slot and by id.

use std::{collections::BTreeMap, time::Duration};

use sightline_visibility::rooms::SealedRooms;
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose, ReportingState, Tbv},
};

use crate::{
    baselines::partition::Area,
    claims::consistency::ClaimConsistency,
    claims::movement_budget::MovementBudget,
    claims::walkability::WalkState,
    interest::candidates::Pair,
    regions::footprints::{HiddenFootprint, Member},
    regions::live_regions::LiveRegions,
    timing::horizon::Link,
    timing::jitter::Jitter,
};

/// Where an avatar is kept; free again when it has left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Slot(pub(crate) u32);

/// A participant, as seen and as seeing.
#[derive(Clone, Debug)]
pub(crate) struct Avatar {
    pub(crate) id: AvatarId,
    pub(crate) name: String,
    pub(crate) colour: [u8; 3],
    /// The last accepted one.
    pub(crate) pose: Pose,
    /// The sealed rooms that it is in there.
    pub(crate) seal: SealedRooms,
    /// Counts accepted poses.
    pub(crate) version: u32,
    /// When the last accepted pose came in.
    pub(crate) heard: Duration,
    pub(crate) round_trip: Duration,
    pub(crate) jitter: Jitter,
    pub(crate) ledger: MovementBudget,
    /// Where ways to its next place begin.
    pub(crate) footing: WalkState,
    pub(crate) pledges: ClaimConsistency,
    /// What is expected of its client.
    pub(crate) state: ReportingState,
    /// Where it is sure to be while it is quiet or asked; `None` while live.
    pub(crate) tbv: Option<Tbv>,
    /// Asks since the last accepted report.
    pub(crate) unanswered: u32,
    /// Whether the client's last order was to be quiet.
    pub(crate) told_quiet: bool,
    /// Not before this is it tried whether the avatar can be silent.
    pub(crate) silence_from: Duration,
    /// Where it can be, as the index of live or of hidden zones has it.
    pub(crate) zone: HiddenFootprint,
    /// What `zone` was made for, in own axes; `None` while hidden.
    pub(crate) zone_box: Option<Aabb>,
    /// Where its eye can be until a hidden one that it reveals can be told of, in own axes, if it is live.
    pub(crate) far: Aabb,
    /// The hidden ones that it meets in its zone, but not within `far`; some are not hidden any more.
    pub(crate) close: Vec<Member>,
    /// Who kept it from falling silent the last time.
    pub(crate) seen_by: Option<Member>,
    /// How long its TBV was made to last the last time.
    pub(crate) validity: Duration,
    /// When its last report was made, if it is hidden: when its TBV begins.
    pub(crate) hidden_from: Duration,
    /// Where it can be until the next tick's word stands; empty while hidden.
    pub(crate) near: LiveRegions,
    /// Where policies that divide the world take it to be.
    pub(crate) place: Area,
    /// Whom it has to do with as a viewer, by id.
    pub(crate) pairs: Vec<Pair>,
    /// How many clients have been told of it.
    pub(crate) watchers: u32,
}

impl Avatar {
    /// How long its client's messages take.
    pub(crate) fn link(&self) -> Link {
        Link { round_trip: self.round_trip, margin: self.jitter.margin() }
    }
}

/// All avatars.
#[derive(Clone, Debug, Default)]
pub(crate) struct Population {
    slots: Vec<Option<Avatar>>,
    free: Vec<Slot>,
    by_id: BTreeMap<AvatarId, Slot>,
    live: BTreeMap<AvatarId, Slot>,
}

impl Population {
    /// Whether somebody is there, and not live.
    pub(crate) fn is_hidden(&self, (id, slot): Member) -> bool {
        let avatar = self.slots.get(slot.0 as usize).and_then(Option::as_ref);
        avatar.is_some_and(|avatar| avatar.id == id && avatar.state != ReportingState::Live)
    }

    pub(crate) fn len(&self) -> usize {
        self.by_id.len()
    }

    pub(crate) fn slot(&self, id: AvatarId) -> Option<Slot> {
        self.by_id.get(&id).copied()
    }

    pub(crate) fn find(&self, id: AvatarId) -> Option<&Avatar> {
        self.slot(id).map(|slot| self.at(slot))
    }

    /// The avatar in a slot that was got from this population and has not been freed since.
    pub(crate) fn at(&self, slot: Slot) -> &Avatar {
        self.slots[slot.0 as usize].as_ref().expect("an index holds only slots in use")
    }

    /// As [`Population::at`].
    pub(crate) fn at_mut(&mut self, slot: Slot) -> &mut Avatar {
        self.slots[slot.0 as usize].as_mut().expect("an index holds only slots in use")
    }

    /// Whom an avatar's client has been told of, by id.
    pub(crate) fn held_by(&self, id: AvatarId) -> impl Iterator<Item = AvatarId> + '_ {
        let pairs = self.find(id).into_iter().flat_map(|viewer| &viewer.pairs);
        pairs.filter(|pair| pair.is_held).map(|pair| pair.id)
    }

    /// Everyone, by id.
    pub(crate) fn all(&self) -> impl Iterator<Item = (AvatarId, Slot)> + '_ {
        self.by_id.iter().map(|(id, slot)| (*id, *slot))
    }

    /// Those that are neither quiet nor asked, by id.
    pub(crate) fn live(&self) -> impl Iterator<Item = Slot> + '_ {
        self.live.values().copied()
    }

    pub(crate) fn live_len(&self) -> usize {
        self.live.len()
    }

    /// Takes in a live avatar whose id is not present.
    pub(crate) fn insert(&mut self, avatar: Avatar) -> Slot {
        let slot = self.free.pop().unwrap_or(Slot(self.slots.len() as u32));
        self.by_id.insert(avatar.id, slot);
        self.live.insert(avatar.id, slot);
        if slot.0 as usize == self.slots.len() {
            self.slots.push(None);
        }
        self.slots[slot.0 as usize] = Some(avatar);
        slot
    }

    /// Takes an avatar out and frees its slot.
    pub(crate) fn remove(&mut self, id: AvatarId) -> Option<(Slot, Avatar)> {
        let slot = self.by_id.remove(&id)?;
        self.live.remove(&id);
        self.free.push(slot);
        self.slots[slot.0 as usize].take().map(|avatar| (slot, avatar))
    }

    /// Has a hidden avatar report at every tick from now on.
    pub(crate) fn set_live(&mut self, slot: Slot) {
        let avatar = self.at_mut(slot);
        (avatar.state, avatar.tbv) = (ReportingState::Live, None);
        let id = avatar.id;
        self.live.insert(id, slot);
    }

    /// Silences a live avatar in a TBV.
    pub(crate) fn set_quiet(&mut self, slot: Slot, tbv: Tbv) {
        let avatar = self.at_mut(slot);
        debug_assert!(avatar.state == ReportingState::Live, "only live avatars are silenced");
        (avatar.state, avatar.tbv) = (ReportingState::Quiet, Some(tbv));
        let id = avatar.id;
        self.live.remove(&id);
    }

    /// Has a quiet avatar owe a report. Its TBV stands until the answer is there.
    pub(crate) fn set_asked(&mut self, slot: Slot) {
        let avatar = self.at_mut(slot);
        debug_assert!(avatar.tbv.is_some(), "only quiet avatars are asked");
        avatar.state = ReportingState::Asked;
    }
}
