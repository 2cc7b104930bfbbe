//! Who is present: the avatars, by slot and by id.

use std::{collections::BTreeMap, time::Duration};

use sightline_visibility::rooms::SealedRooms;
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose, ReportingState, Tbv},
};

use super::{
    authority::MovementBudget,
    horizon::Link,
    jitter::Jitter,
    near::Whereabouts,
    pairs::Pair,
    places::Place,
    pledge::Pledges,
    ways::Footing,
    zones::{Member, Zone},
};

/// Where an avatar is kept; free again when it has left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Slot(pub(super) u32);

/// A participant, as seen and as seeing.
#[derive(Clone, Debug)]
pub(super) struct Avatar {
    pub(super) id: AvatarId,
    pub(super) name: String,
    pub(super) colour: [u8; 3],
    /// The last accepted one.
    pub(super) pose: Pose,
    /// The sealed rooms that it is in there.
    pub(super) seal: SealedRooms,
    /// Counts accepted poses.
    pub(super) version: u32,
    /// When the last accepted pose came in.
    pub(super) heard: Duration,
    pub(super) round_trip: Duration,
    pub(super) jitter: Jitter,
    pub(super) ledger: MovementBudget,
    /// Where ways to its next place begin.
    pub(super) footing: Footing,
    pub(super) pledges: Pledges,
    /// What is expected of its client.
    pub(super) state: ReportingState,
    /// Where it is sure to be while it is quiet or asked; `None` while live.
    pub(super) tbv: Option<Tbv>,
    /// Asks since the last accepted report.
    pub(super) unanswered: u32,
    /// Whether the client's last order was to be quiet.
    pub(super) told_quiet: bool,
    /// Not before this is it tried whether the avatar can be silent.
    pub(super) silence_from: Duration,
    /// Where it can be, as the index of live or of hidden zones has it.
    pub(super) zone: Zone,
    /// What `zone` was made for, in own axes; `None` while hidden.
    pub(super) zone_box: Option<Aabb>,
    /// Where its eye can be until a hidden one that it reveals can be told of, in own axes, if it is live.
    pub(super) far: Aabb,
    /// The hidden ones that it meets in its zone, but not within `far`; some are not hidden any more.
    pub(super) close: Vec<Member>,
    /// Who kept it from falling silent the last time.
    pub(super) seen_by: Option<Member>,
    /// How long its TBV was made to last the last time.
    pub(super) validity: Duration,
    /// When its last report was made, if it is hidden: when its TBV begins.
    pub(super) hidden_from: Duration,
    /// Where it can be until the next tick's word stands; empty while hidden.
    pub(super) near: Whereabouts,
    /// Where policies that divide the world take it to be.
    pub(super) place: Place,
    /// Whom it has to do with as a viewer, by id.
    pub(super) pairs: Vec<Pair>,
    /// How many clients have been told of it.
    pub(super) watchers: u32,
}

impl Avatar {
    /// How long its client's messages take.
    pub(super) fn link(&self) -> Link {
        Link { round_trip: self.round_trip, margin: self.jitter.margin() }
    }
}

/// All avatars.
#[derive(Clone, Debug, Default)]
pub(super) struct Population {
    slots: Vec<Option<Avatar>>,
    free: Vec<Slot>,
    by_id: BTreeMap<AvatarId, Slot>,
    live: BTreeMap<AvatarId, Slot>,
}

impl Population {
    /// Whether somebody is there, and not live.
    pub(super) fn is_hidden(&self, (id, slot): Member) -> bool {
        let avatar = self.slots.get(slot.0 as usize).and_then(Option::as_ref);
        avatar.is_some_and(|avatar| avatar.id == id && avatar.state != ReportingState::Live)
    }

    pub(super) fn len(&self) -> usize {
        self.by_id.len()
    }

    pub(super) fn slot(&self, id: AvatarId) -> Option<Slot> {
        self.by_id.get(&id).copied()
    }

    pub(super) fn find(&self, id: AvatarId) -> Option<&Avatar> {
        self.slot(id).map(|slot| self.at(slot))
    }

    /// The avatar in a slot that was got from this population and has not been freed since.
    pub(super) fn at(&self, slot: Slot) -> &Avatar {
        self.slots[slot.0 as usize].as_ref().expect("an index holds only slots in use")
    }

    /// As [`Population::at`].
    pub(super) fn at_mut(&mut self, slot: Slot) -> &mut Avatar {
        self.slots[slot.0 as usize].as_mut().expect("an index holds only slots in use")
    }

    /// Whom an avatar's client has been told of, by id.
    pub(super) fn held_by(&self, id: AvatarId) -> impl Iterator<Item = AvatarId> + '_ {
        let pairs = self.find(id).into_iter().flat_map(|viewer| &viewer.pairs);
        pairs.filter(|pair| pair.is_held).map(|pair| pair.id)
    }

    /// Everyone, by id.
    pub(super) fn all(&self) -> impl Iterator<Item = (AvatarId, Slot)> + '_ {
        self.by_id.iter().map(|(id, slot)| (*id, *slot))
    }

    /// Those that are neither quiet nor asked, by id.
    pub(super) fn live(&self) -> impl Iterator<Item = Slot> + '_ {
        self.live.values().copied()
    }

    pub(super) fn live_len(&self) -> usize {
        self.live.len()
    }

    /// Takes in a live avatar whose id is not present.
    pub(super) fn insert(&mut self, avatar: Avatar) -> Slot {
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
    pub(super) fn remove(&mut self, id: AvatarId) -> Option<(Slot, Avatar)> {
        let slot = self.by_id.remove(&id)?;
        self.live.remove(&id);
        self.free.push(slot);
        self.slots[slot.0 as usize].take().map(|avatar| (slot, avatar))
    }

    /// Has a hidden avatar report at every tick from now on.
    pub(super) fn set_live(&mut self, slot: Slot) {
        let avatar = self.at_mut(slot);
        (avatar.state, avatar.tbv) = (ReportingState::Live, None);
        let id = avatar.id;
        self.live.insert(id, slot);
    }

    /// Silences a live avatar in a TBV.
    pub(super) fn set_quiet(&mut self, slot: Slot, tbv: Tbv) {
        let avatar = self.at_mut(slot);
        debug_assert!(avatar.state == ReportingState::Live, "only live avatars are silenced");
        (avatar.state, avatar.tbv) = (ReportingState::Quiet, Some(tbv));
        let id = avatar.id;
        self.live.remove(&id);
    }

    /// Has a quiet avatar owe a report. Its TBV stands until the answer is there.
    pub(super) fn set_asked(&mut self, slot: Slot) {
        let avatar = self.at_mut(slot);
        debug_assert!(avatar.tbv.is_some(), "only quiet avatars are asked");
        avatar.state = ReportingState::Asked;
    }
}
