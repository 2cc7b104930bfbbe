//! The population: the avatars that are present, by slot and by id.

use std::{collections::BTreeMap, time::Duration};

use sightline_visibility::rooms::SealedRooms;
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose, ReportingState, Tbv},
};

use crate::{
    baselines::Area,
    claims::{ClaimConsistency, MovementBudget, WalkState},
    generation::Generation,
    pair::Pair,
    regions::{HiddenFootprint, LiveRegions},
    slot::{Member, Slot},
    sphere::Sphere,
    timing::{Jitter, Link},
};

/// A participant, as seen and as seeing.
#[derive(Clone, Debug)]
pub(crate) struct Avatar {
    pub(crate) id: AvatarId,
    pub(crate) profile: Profile,
    /// The last accepted pose.
    pub(crate) pose: Pose,
    /// The sealed rooms that the avatar is in at that pose.
    pub(crate) sealed: SealedRooms,
    /// Counts accepted poses.
    pub(crate) version: Generation,
    /// When the last accepted pose arrived.
    pub(crate) heard: Duration,
    pub(crate) round_trip: Duration,
    pub(crate) jitter: Jitter,
    pub(crate) budget: MovementBudget,
    /// Where ways to its next place begin.
    pub(crate) walk: WalkState,
    pub(crate) consistency: ClaimConsistency,
    /// What is expected of its client. Set by [`Population`] only.
    pub(crate) state: ReportingState,
    /// Where the avatar is sure to be while it is quiet or asked; `None` while it is live.
    pub(crate) tbv: Option<Tbv>,
    /// The ball that bounds the avatar as well, if its TBV is a sphere.
    pub(crate) sphere: Option<Sphere>,
    /// Asks since the last accepted report.
    pub(crate) unanswered: u32,
    /// Whether the client's last order was to be quiet.
    pub(crate) told_quiet: bool,
    /// The engine does not try to silence the avatar before this.
    pub(crate) silence_from: Duration,
    /// Where the avatar can be, as the index of live or of hidden footprints has it.
    pub(crate) footprint: HiddenFootprint,
    /// The box of eye positions that `footprint` was made for, in own axes; `None` while hidden.
    pub(crate) footprint_box: Option<Aabb>,
    /// Where the eye of a live avatar can be until a hidden one that it reveals can be told of, in
    /// own axes.
    pub(crate) reveal_box: Aabb,
    /// Hidden avatars that this one may see from its footprint, but not from `reveal_box`. Some are
    /// not hidden any more.
    pub(crate) nearby_hidden: Vec<Member>,
    /// The avatar that kept this one from falling silent the last time.
    pub(crate) seen_by: Option<Member>,
    /// How long the last TBV was made to last.
    pub(crate) validity: Duration,
    /// When the TBV of a hidden avatar begins: when its last report was made.
    pub(crate) hidden_from: Duration,
    /// Where the avatar can be until the next tick's word stands; empty while hidden.
    pub(crate) regions: LiveRegions,
    /// Where policies that divide the world count the avatar.
    pub(crate) area: Area,
    /// What it has to do with other avatars as a viewer, by their ids.
    pub(crate) pairs: Vec<Pair>,
    /// How many clients have been told of the avatar.
    pub(crate) watchers: u32,
}

/// How an avatar is shown to people.
#[derive(Clone, Debug)]
pub(crate) struct Profile {
    pub(crate) name: String,
    /// sRGB.
    pub(crate) colour: [u8; 3],
}

impl Avatar {
    /// How long its client's messages take.
    pub(crate) fn link(&self) -> Link {
        Link { round_trip: self.round_trip, margin: self.jitter.margin() }
    }

    pub(crate) fn is_live(&self) -> bool {
        self.state == ReportingState::Live
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
    /// Whether a member is still present, and not live.
    pub(crate) fn is_hidden(&self, member: Member) -> bool {
        let avatar = self.slots.get(member.slot.0 as usize).and_then(Option::as_ref);
        avatar.is_some_and(|avatar| avatar.id == member.id && !avatar.is_live())
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

    /// The avatar in a slot, which this population gave and has not freed since.
    pub(crate) fn at(&self, slot: Slot) -> &Avatar {
        self.slots[slot.0 as usize].as_ref().expect("an index holds only slots in use")
    }

    /// The avatar in a slot, which this population gave and has not freed since.
    pub(crate) fn at_mut(&mut self, slot: Slot) -> &mut Avatar {
        self.slots[slot.0 as usize].as_mut().expect("an index holds only slots in use")
    }

    /// All avatars by slot; `None` for free slots.
    pub(crate) fn slots_mut(&mut self) -> impl Iterator<Item = Option<&mut Avatar>> {
        self.slots.iter_mut().map(Option::as_mut)
    }

    /// The avatars that a viewer's client has been told of, by id.
    pub(crate) fn held_by(&self, id: AvatarId) -> impl Iterator<Item = AvatarId> + '_ {
        let pairs = self.find(id).into_iter().flat_map(|viewer| &viewer.pairs);
        pairs.filter(|pair| pair.is_held).map(|pair| pair.id)
    }

    /// All avatars, by id.
    pub(crate) fn all(&self) -> impl Iterator<Item = Member> + '_ {
        self.by_id.iter().map(|(id, slot)| Member { id: *id, slot: *slot })
    }

    /// All live avatars, by id.
    pub(crate) fn live(&self) -> impl Iterator<Item = Slot> + '_ {
        self.live.values().copied()
    }

    pub(crate) fn live_len(&self) -> usize {
        self.live.len()
    }

    /// Adds a live avatar, whose id must not be present.
    pub(crate) fn insert(&mut self, avatar: Avatar) -> Slot {
        assert!(!self.by_id.contains_key(&avatar.id), "an id is present once");
        assert!(avatar.is_live() && avatar.tbv.is_none(), "every avatar begins live");
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
        debug_assert!(self.by_id.len() + self.free.len() == self.slots.len(), "no slot is lost");
        self.slots[slot.0 as usize].take().map(|avatar| (slot, avatar))
    }

    /// Has a hidden avatar report at every tick from now on.
    pub(crate) fn set_live(&mut self, slot: Slot) {
        let avatar = self.at_mut(slot);
        assert!(avatar.tbv.is_some(), "only hidden avatars wake");
        (avatar.state, avatar.tbv, avatar.sphere) = (ReportingState::Live, None, None);
        let id = avatar.id;
        self.live.insert(id, slot);
    }

    /// Silences a live avatar in a TBV, and in a ball if the TBV is a sphere.
    pub(crate) fn set_quiet(&mut self, slot: Slot, tbv: Tbv, sphere: Option<Sphere>) {
        let avatar = self.at_mut(slot);
        assert!(avatar.is_live(), "only live avatars are silenced");
        debug_assert_eq!(avatar.watchers, 0, "nobody is silenced whom somebody holds");
        (avatar.state, avatar.tbv, avatar.sphere) = (ReportingState::Quiet, Some(tbv), sphere);
        let id = avatar.id;
        self.live.remove(&id);
    }

    /// Has a quiet avatar owe a report. Its TBV stands until the answer arrives.
    pub(crate) fn set_asked(&mut self, slot: Slot) {
        let avatar = self.at_mut(slot);
        assert_eq!(avatar.state, ReportingState::Quiet, "only quiet avatars are asked");
        avatar.state = ReportingState::Asked;
    }
}
