//! Who is silent: TBVs are made, expire and are revealed here.

use std::time::Duration;

use sightline_world::{
    motion::{AvatarId, ReportingState, Tbv},
    tolerance::WIRE_POSE_M,
};

use crate::{
    Engine, Output, Policy,
    population::{Avatar, Slot},
    regions::footprints::{HiddenFootprint, Member},
    regions::live_regions::{MotionBound, ahead},
    regions::reach::{Reach, Start},
    silence::search::{End, Silence},
    timing::horizon::SILENT_MAX,
};

/// How much larger than it must be the zone of a live avatar is made, in metres.
const ZONE_SPARE_M: f32 = 0.5;

impl Engine {
    /// Asks those whose TBV would expire unwatched, and looks into other silences.
    pub(crate) fn expire(&mut self, now: Duration, outputs: &mut Vec<Output>) {
        for id in self.expiries.due(now) {
            if let Some(slot) = self.population.slot(id) {
                self.stats.expiries += 1;
                self.ended(now, slot, End::Expired);
                self.ask(now, slot);
                outputs.push(Output::Ask { to: id });
            }
        }
        for id in self.patience.due(now) {
            if let Some(slot) = self.population.slot(id) {
                self.look_into(now, slot, outputs);
            }
        }
    }

    /// Deals with a client that should have been heard of. A live one that has reported since the
    /// deadline was set gets another.
    fn look_into(&mut self, now: Duration, slot: Slot, outputs: &mut Vec<Output>) {
        let avatar = self.population.at_mut(slot);
        let (id, live) = (avatar.id, avatar.state == ReportingState::Live);
        let silence = now.saturating_sub(avatar.heard);
        if live && silence + self.config.tick < self.config.stall {
            self.wait(now, id, self.config.stall - silence);
            return;
        }
        if avatar.unanswered >= self.config.asks_max {
            self.expel(id, "it does not answer");
            return;
        }
        avatar.unanswered += 1;
        let trip = avatar.round_trip;
        self.stats.repeats += 1;
        outputs.push(Output::Ask { to: id });
        self.wait(now, id, trip + self.config.ask_timeout);
    }

    /// Sets when a client's silence will be looked into.
    pub(crate) fn wait(&mut self, now: Duration, id: AvatarId, patience: Duration) {
        self.patience.set(id, now, now + patience, usize::MAX);
    }

    /// From quiet to asked. The order itself is the caller's to send.
    fn ask(&mut self, now: Duration, slot: Slot) {
        let avatar = self.population.at_mut(slot);
        if avatar.state != ReportingState::Quiet {
            return;
        }
        avatar.unanswered = 1;
        let (id, trip) = (avatar.id, avatar.round_trip);
        self.expiries.cancel(id);
        self.wait(now, id, trip + self.config.ask_timeout);
        self.population.set_asked(slot);
    }

    /// From hidden to live: there is fresh word of the avatar. The next tick decides whether it
    /// stays so.
    pub(crate) fn wake(&mut self, now: Duration, slot: Slot) {
        let avatar = self.population.at_mut(slot);
        avatar.silence_from = now;
        avatar.jitter.restart();
        let (id, zone) = (avatar.id, std::mem::take(&mut avatar.zone));
        self.hidden_zones.remove((id, slot), &zone);
        self.expiries.cancel(id);
        self.wait(now, id, self.config.stall);
        self.population.set_live(slot);
    }

    /// A quiet client reported unasked: when it is about to leave, or would be asked at the next tick, it
    /// is heard; otherwise nothing changes, since it was not told yet, when it spoke, that it was quiet.
    pub(crate) fn refresh(&mut self, now: Duration, slot: Slot, tbv: &Tbv) {
        let avatar = self.population.at(slot);
        let lead = self.horizons.lead(avatar.link());
        // What the client knows of its region is a little smaller, by rounding.
        let stays = tbv.grown(-WIRE_POSE_M).holds(&avatar.pose, self.config.tick, &self.agility);
        if !stays || now + lead + self.config.tick >= tbv.expiry {
            self.wake(now, slot);
        }
    }

    /// Brings up to date where a live avatar can be before long, and asks every quiet avatar that it can
    /// see from there, or be seen by. Its zone is made a little larger than it must be, so that it lasts
    /// for several ticks; those whom it meets are looked at again at each of them, and no others.
    pub(crate) fn reveal(&mut self, now: Duration, slot: Slot, outputs: &mut Vec<Output>) {
        let avatar = self.population.at(slot);
        let age = now.saturating_sub(avatar.heard);
        let is_believed = avatar.pledges.are_kept(now);
        let far = self.horizons.far(age, avatar.link());
        let leeway = self.leeway(&avatar.pose, is_believed, far);
        let lasts = avatar.zone_box.is_some_and(|spare| spare.contains_box(&leeway.within));
        self.population.at_mut(slot).far = leeway.within;
        if !lasts {
            self.place_zone(slot, &leeway);
        }
        if self.population.at(slot).close.is_empty() {
            return;
        }
        let close = std::mem::take(&mut self.population.at_mut(slot).close);
        let hidden = close.into_iter().filter(|member| self.population.is_hidden(*member));
        let (close, zone) = (hidden.collect::<Vec<Member>>(), self.zone_now(slot));
        let (found, close) =
            close.into_iter().partition(|(_, other)| self.may_see_each_other(&zone, *other));
        self.population.at_mut(slot).close = close;
        self.ask_to_stay(now, found, outputs);
    }

    /// Works out a live avatar's zone, and which hidden ones it meets.
    fn place_zone(&mut self, slot: Slot, leeway: &MotionBound) {
        let avatar = self.population.at(slot);
        let step = self.world.cells.axes.own(avatar.pose.velocity) * self.config.tick.as_secs_f32();
        let spare = ahead(&leeway.within, step, ZONE_SPARE_M);
        let fit = self.ways.fit_of(avatar.footing);
        let start = Start { cells: &self.world.cells, fit, from: leeway.from };
        let reach = Reach::within(&mut self.scratch, &start, &spare);
        let zone = HiddenFootprint::of(&reach, &self.world, &self.rooms, &self.sectors);
        let avatar = self.population.at_mut(slot);
        avatar.zone_box = Some(spare);
        if zone == avatar.zone {
            return;
        }
        let member = (avatar.id, slot);
        let old = std::mem::take(&mut avatar.zone);
        let mut close = Vec::new();
        self.hidden_zones.meeting(&self.sectors, &zone, &mut close);
        close.sort_unstable();
        close.dedup();
        close.retain(|(_, other)| self.may_see_each_other(&zone, *other));
        self.live_zones.remove(member, &old);
        self.live_zones.insert(member, &zone);
        let avatar = self.population.at_mut(slot);
        (avatar.zone, avatar.close) = (zone, close);
    }

    /// Orders hidden clients to report from now on.
    fn ask_to_stay(&mut self, now: Duration, found: Vec<Member>, outputs: &mut Vec<Output>) {
        for (to, slot) in found {
            if self.population.at(slot).state == ReportingState::Quiet {
                self.stats.reveals += 1;
                self.ended(now, slot, End::Revealed);
                self.ask(now, slot);
            }
            let avatar = self.population.at_mut(slot);
            if std::mem::take(&mut avatar.told_quiet) {
                outputs.push(Output::Live { to });
            }
        }
    }

    /// Has all live ones look at each tick at somebody who has just been hidden, as long as it is in their zones.
    fn watch(&mut self, member: Member) {
        let zone = std::mem::take(&mut self.population.at_mut(member.1).zone);
        let mut found = Vec::new();
        self.live_zones.meeting(&self.sectors, &zone, &mut found);
        found.sort_unstable();
        found.dedup();
        for (_, live) in found {
            let spare = std::mem::take(&mut self.population.at_mut(live).zone);
            if self.lets_see(&zone, (&spare, &spare.parts)) {
                self.population.at_mut(live).close.push(member);
            }
            self.population.at_mut(live).zone = spare;
        }
        self.population.at_mut(member.1).zone = zone;
    }

    /// Settles all live clients, beginning with the one at whom the budget was used up the last time: those
    /// who try in vain again and again must not keep others from being tried.
    pub(crate) fn settle_all(&mut self, now: Duration, live: &[Slot], outputs: &mut Vec<Output>) {
        let id = |engine: &Self, slot: Slot| engine.population.at(slot).id;
        let first = live.partition_point(|slot| id(self, *slot) < self.settled_to);
        let has_budget = self.silence_left > 0;
        let mut is_used_up = false;
        for slot in live[first..].iter().chain(&live[..first]) {
            if has_budget && self.silence_left == 0 && !is_used_up {
                self.settled_to = id(self, *slot);
                is_used_up = true;
            }
            self.settle(now, *slot, is_used_up, outputs);
        }
    }

    /// Silences a live client if nobody can see it and it can see nobody, unless that cannot be looked into
    /// any more; otherwise sees to it that it knows that it is live.
    fn settle(&mut self, now: Duration, slot: Slot, is_used_up: bool, outputs: &mut Vec<Output>) {
        if !is_used_up && self.may_fall_silent(now, self.population.at(slot)) {
            let zone = self.zone_now(slot);
            let silent = self.without(slot, |engine| engine.silence(now, slot, &zone));
            if let Some(silence) = silent {
                let tbv = silence.tbv;
                self.hide(now, slot, silence);
                outputs.push(Output::Quiet { to: self.population.at(slot).id, tbv });
                return;
            }
            self.population.at_mut(slot).silence_from = now + self.config.silence_retry;
        }
        let avatar = self.population.at_mut(slot);
        if std::mem::take(&mut avatar.told_quiet) {
            outputs.push(Output::Live { to: avatar.id });
        }
    }

    fn may_fall_silent(&self, now: Duration, avatar: &Avatar) -> bool {
        let fresh = now.saturating_sub(avatar.heard) <= 2 * self.config.tick;
        self.config.policy == Policy::Tbv
            && fresh
            && now >= avatar.silence_from
            && avatar.watchers == 0
            && !avatar.pairs.iter().any(|pair| pair.is_held)
            && self.horizons.may_be_silent(avatar.link())
    }

    /// Does something while a live avatar's zone is not among those of the others.
    fn without<T>(&mut self, slot: Slot, what: impl FnOnce(&mut Self) -> T) -> T {
        let avatar = self.population.at_mut(slot);
        let (member, zone) = ((avatar.id, slot), std::mem::take(&mut avatar.zone));
        self.live_zones.remove(member, &zone);
        let done = what(self);
        self.live_zones.insert(member, &zone);
        self.population.at_mut(slot).zone = zone;
        done
    }

    /// From live to quiet.
    fn hide(&mut self, now: Duration, slot: Slot, silence: Silence) {
        let Silence { tbv, zone, validity } = silence;
        self.part(slot);
        let made = self.made_at(slot);
        let avatar = self.population.at_mut(slot);
        let member = (avatar.id, slot);
        avatar.pairs = Vec::new();
        avatar.zone_box = None;
        avatar.close = Vec::new();
        avatar.told_quiet = true;
        (avatar.validity, avatar.hidden_from) = (validity, made);
        let link = avatar.link();
        let old = std::mem::replace(&mut avatar.zone, zone);
        self.live_zones.remove(member, &old);
        self.hidden_zones.insert(member, &self.population.at(slot).zone);
        self.population.set_quiet(slot, tbv);
        self.watch(member);
        self.patience.cancel(member.0);
        let late = self.config.faults.expiry_late;
        let deadline = (tbv.expiry + late).saturating_sub(self.horizons.lead(link));
        self.expiries.set(member.0, now, deadline, self.expiries_max());
    }

    /// Expiries in one tick that leave room for the whole population within the time that a slow
    /// client's TBV needs.
    fn expiries_max(&self) -> usize {
        let ticks = SILENT_MAX.as_nanos() / self.config.tick.as_nanos().max(1);
        let needed = 2 * self.population.len() / usize::try_from(ticks).unwrap_or(1).max(1);
        self.config.expiries_max.max(needed)
    }
}
