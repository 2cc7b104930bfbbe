//! The population: the avatars that are present, by slot and by id.

use std::{collections::BTreeMap, time::Duration};

use sightline_visibility::rooms::SealedRooms;
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose, ReportingState, Tbv, Tolerance},
};

use crate::{
    baselines::Area,
    claims::{ClaimConsistency, MovementBudget, WalkState},
    generation::Generation,
    orders::Orders,
    pairs::Pairs,
    regions::{HiddenFootprint, LiveRegions, Motion},
    slot::{Member, Slot},
    sphere::Sphere,
    stations::{Guest, Relay, RelayKey, RelayOrder},
    tick_context::TickContext,
    timing::{Arrivals, LastKnown, Link},
};

/// Ages are rounded up to steps, and a tick has this number of steps. So the regions of an avatar
/// that stands still do not change with every small change of an age.
const AGE_PARTS: u32 = 8;
/// A report must follow when the course of a live client ends, at a wall or at its keep-alive. The
/// client is asked when that report is late by this number of ticks.
const OVERDUE_TICKS: u32 = 3;

/// A participant, as seen and as seeing.
#[derive(Clone, Debug)]
pub(crate) struct Avatar {
    pub(crate) id: AvatarId,
    pub(crate) profile: Profile,
    /// The last accepted pose. The course begins with it.
    pub(crate) pose: Pose,
    /// When the client made the report of that pose, on its own clock; `None` where the server
    /// itself put the avatar there, so that the client follows no course yet.
    pub(crate) report_made: Option<Duration>,
    /// For how long the course may be followed: until walls are in its way, or the client is
    /// overdue.
    pub(crate) course_for: Duration,
    /// The sealed rooms that the avatar is in at that pose.
    pub(crate) sealed: SealedRooms,
    /// Counts accepted poses.
    pub(crate) version: Generation,
    /// Whether the last tick's snapshot does not have the last accepted pose.
    pub(crate) has_news: bool,
    /// When the last accepted pose arrived.
    pub(crate) heard_at: Duration,
    pub(crate) round_trip: Duration,
    pub(crate) arrivals: Arrivals,
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
    /// Whether nobody hears it: its client's link is broken.
    pub(crate) is_absent: bool,
    /// Asks since the last accepted report.
    pub(crate) unanswered: u32,
    /// How many ticks there had been at the last ask.
    pub(crate) asked_round: u32,
    /// What its client was told last, and what that means.
    pub(crate) orders: Orders,
    /// When its client was last told to be live.
    pub(crate) ordered_at: Duration,
    /// The distance to the nearest viewer that holds the avatar, in metres; infinite while nobody
    /// does. Found anew every few ticks.
    pub(crate) nearest_m: f32,
    /// The distance to the nearest of the viewers that were looked at since then.
    pub(crate) nearest_m_so_far: f32,
    /// The engine does not try to silence the avatar before this.
    pub(crate) silence_again_at: Duration,
    /// Where the avatar can be, as the index of live or of hidden footprints has it.
    pub(crate) footprint: HiddenFootprint,
    /// The box of eye positions that `footprint` was made for, in own axes; `None` while hidden,
    /// and where no footprint was made for where the eye can be now.
    pub(crate) footprint_box: Option<Aabb>,
    /// Where the eye of a live avatar can be until a hidden one that it reveals can be told of, in
    /// own axes.
    pub(crate) reveal_box: Aabb,
    /// Hidden avatars that this one may see from its footprint, but not from `reveal_box`. Some are
    /// not hidden any more.
    pub(crate) nearby_hidden: Vec<Member>,
    /// Counts the changes of `footprint`.
    pub(crate) footprint_version: Generation,
    /// What kept the avatar from falling silent the last time.
    pub(crate) prevented: Option<Prevented>,
    /// How long the last TBV was made to last.
    pub(crate) validity: Duration,
    /// When the TBV of a hidden avatar begins: when its last report was made.
    pub(crate) hidden_from: Duration,
    /// Where a hidden avatar was when it was hidden.
    pub(crate) hidden_at: Pose,
    /// Where the avatar can be until the next tick takes effect; empty while hidden.
    pub(crate) regions: LiveRegions,
    /// Where policies that divide the world count the avatar.
    pub(crate) area: Area,
    /// What it has to do with other avatars as a viewer, by their ids.
    pub(crate) pairs: Pairs,
    /// How many clients have been told of the avatar.
    pub(crate) watchers: u32,
    /// Of an avatar that belongs to another station: which one, and what was heard from there.
    pub(crate) guest: Option<Guest>,
    /// What other stations have been told of an avatar of this one, by station.
    pub(crate) relays: Vec<Relay>,
    /// The version of the footprint at which it was last asked which stations to tell.
    pub(crate) relayed_footprint: Option<Generation>,
}

/// What the silence of a client means: at a time after its last report its avatar was on course.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownCourse {
    /// Where the avatar was then, if it was off course by nothing.
    pub pose: Pose,
    /// How long after the last report that was, on the client's clock.
    pub after: Duration,
    /// What the client may have left unsaid then.
    pub tolerance: Tolerance,
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
        Link { round_trip: self.round_trip, margin: self.arrivals.margin() }
    }

    /// What is known of how the avatar moves, at the present tick.
    pub(crate) fn motion(&self, context: TickContext<'_>) -> Motion {
        let TickContext { building, now, .. } = context;
        let known = self.last_known(context);
        let (pose, tolerance) = match self.course_until(&known, context) {
            Some(KnownCourse { pose, tolerance, .. }) => (pose, tolerance.along(&pose)),
            None => (self.pose, Tolerance::NONE),
        };
        Motion {
            pose,
            from: building.axes().own(pose.eye),
            age: rounded_up(known.age, context.config.tick / AGE_PARTS),
            tolerance,
            walk: self.walk,
            round_trip: self.round_trip,
            is_believed: self.consistency.is_consistent(now),
        }
    }

    /// The present time of those who hear its client, and how long ago that is.
    fn clock(&self, context: TickContext<'_>) -> (Duration, Duration) {
        self.guest.map_or((context.now, Duration::ZERO), |guest| (guest.until, guest.age))
    }

    pub(crate) fn is_guest(&self) -> bool {
        self.guest.is_some()
    }

    /// What a report of the avatar to another station depends on.
    pub(crate) fn relay_key(&self, now: Duration) -> RelayKey {
        let is_understood = self.orders.is_understood();
        RelayKey {
            version: self.version,
            tolerance: if is_understood { self.orders.in_force() } else { Tolerance::NONE },
            is_believed: self.consistency.is_consistent(now),
            is_absent: self.is_absent,
            round_trip: self.round_trip,
        }
    }

    /// The finest tolerance that other stations ask for.
    pub(crate) fn asked_abroad(&self) -> Option<Tolerance> {
        let asked = self.relays.iter().filter_map(|relay| match relay.order {
            RelayOrder::Live(tolerance) => tolerance,
            RelayOrder::Quiet(_) => None,
        });
        asked.reduce(|one, other| Tolerance {
            metres: one.metres.min(other.metres),
            radians: one.radians.min(other.radians),
            ahead: one.ahead.max(other.ahead),
        })
    }

    /// What the silence of the client means at the present tick; `None` while it means nothing.
    pub(crate) fn known_course(&self, context: TickContext<'_>) -> Option<KnownCourse> {
        self.course_until(&self.last_known(context), context)
    }

    fn course_until(&self, known: &LastKnown, context: TickContext<'_>) -> Option<KnownCourse> {
        let after = known.after;
        let pose = || self.pose.on_course(after, &context.building.agility);
        let tolerance = self.orders.in_force();
        (!after.is_zero()).then(|| KnownCourse { pose: pose(), after, tolerance })
    }

    /// The last moment at which the avatar is known to have been on its course.
    fn last_known(&self, context: TickContext<'_>) -> LastKnown {
        let TickContext { config, horizons, .. } = context;
        let (now, late) = self.clock(context);
        let one_way = horizons.one_way(self.round_trip);
        let margin = self.arrivals.margin();
        // An absent avatar stands by the server's word.
        let silence =
            if self.is_absent { Duration::ZERO } else { now.saturating_sub(self.heard_at) };
        let Some(made) = self.report_made.filter(|_| self.orders.is_understood()) else {
            return LastKnown { after: Duration::ZERO, age: silence + one_way + margin + late };
        };
        let known = self.arrivals.last_known(now, made, config.tick);
        // A client's clock that runs ahead gains it no more than the margin.
        let after = known.after.min(self.course_for).min(silence + margin);
        LastKnown { after, age: known.age + (known.after - after) + late }
    }

    /// The pose that viewers are told at the present tick: where the avatar was when its client
    /// made what arrives now, if it is on course.
    pub(crate) fn shown(&self, context: TickContext<'_>) -> Pose {
        let agility = &context.building.agility;
        let now = self.clock(context).0;
        let after = self.report_made.map_or(Duration::ZERO, |made| self.arrivals.after(now, made));
        let pose = self.pose.on_course(after.min(self.course_for), agility);
        Pose { velocity: agility.sustained(pose.velocity), ..pose }
    }

    /// For how long the [shown](Avatar::shown) pose goes on as it does. Afterwards it stands.
    pub(crate) fn shown_for(&self, context: TickContext<'_>) -> Duration {
        let now = self.clock(context).0;
        let after = self.report_made.map(|made| self.arrivals.after(now, made));
        after.map_or(Duration::ZERO, |after| self.course_for.saturating_sub(after))
    }

    /// For how long the client may be silent before it is asked.
    pub(crate) fn patience(&self, context: TickContext<'_>) -> Duration {
        let TickContext { config, horizons, .. } = context;
        if self.report_made.is_none() || !self.orders.is_understood() {
            return config.stall;
        }
        let late = self.arrivals.margin() + horizons.one_way(self.round_trip);
        self.course_for + late + OVERDUE_TICKS * config.tick
    }

    pub(crate) fn is_live(&self) -> bool {
        self.state == ReportingState::Live
    }

    /// Takes in that one more client has been told of the avatar.
    pub(crate) fn gain_watcher(&mut self, away_m: f32) {
        self.watchers += 1;
        self.see_from(away_m);
    }

    /// Takes in that a client that held the avatar does not any more.
    pub(crate) fn lose_watcher(&mut self) {
        debug_assert!(self.watchers > 0, "who holds an avatar is counted");
        self.watchers -= 1;
        if self.watchers == 0 {
            (self.nearest_m, self.nearest_m_so_far) = (f32::INFINITY, f32::INFINITY);
        }
    }

    /// Takes in how far away a viewer is that holds the avatar, in metres.
    pub(crate) fn see_from(&mut self, away_m: f32) {
        self.nearest_m = self.nearest_m.min(away_m);
        self.nearest_m_so_far = self.nearest_m_so_far.min(away_m);
    }
}

/// A time rounded up to a multiple of a step.
fn rounded_up(time: Duration, step: Duration) -> Duration {
    let steps = time.as_nanos().div_ceil(step.as_nanos().max(1));
    step * u32::try_from(steps).unwrap_or(u32::MAX)
}

/// What kept an avatar from falling silent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Prevented {
    /// The avatar that may see it, or be seen by it.
    pub(crate) by: Member,
    /// The footprints of both then.
    pub(crate) versions: [Generation; 2],
    /// Where the eyes of both could soon be then.
    pub(crate) boxes: [Aabb; 2],
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
        self.get(member).is_some_and(|avatar| !avatar.is_live())
    }

    /// The avatar of a member, if it is still present.
    pub(crate) fn get(&self, member: Member) -> Option<&Avatar> {
        let avatar = self.slots.get(member.slot.0 as usize).and_then(Option::as_ref);
        avatar.filter(|avatar| avatar.id == member.id)
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
        let pairs = self.find(id).into_iter().flat_map(|viewer| viewer.pairs.iter());
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

    /// The avatars of this station, by id.
    pub(crate) fn own(&self) -> impl Iterator<Item = Member> + '_ {
        self.all().filter(|member| !self.at(member.slot).is_guest())
    }

    /// The avatars of other stations, by id.
    pub(crate) fn guests(&self) -> impl Iterator<Item = Member> + '_ {
        self.all().filter(|member| self.at(member.slot).is_guest())
    }

    /// The round trips of all clients of this station whose avatars are hidden.
    pub(crate) fn hidden_round_trips(&self) -> impl Iterator<Item = Duration> + '_ {
        let present = self.by_id.values().map(|slot| self.at(*slot));
        present.filter(|avatar| !avatar.is_live() && !avatar.is_guest()).map(|a| a.round_trip)
    }

    /// Whether at least one of two avatars belongs to this station. It has nothing to do with two
    /// others.
    pub(crate) fn is_one_own(&self, one: Slot, other: Slot) -> bool {
        !self.at(one).is_guest() || !self.at(other).is_guest()
    }

    /// Whether all avatars are live.
    pub(crate) fn is_nobody_hidden(&self) -> bool {
        self.live.len() == self.by_id.len()
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

    /// Makes a hidden avatar live. Its TBV ends.
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
