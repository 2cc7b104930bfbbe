//! Who comes, claims, speaks and goes.

use std::time::Duration;

use glam::Vec3;
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose, ReportingState},
    tolerance::AT_SPAWN_M,
};

use crate::{
    Engine, Output,
    baselines::partition::Area,
    claims::consistency::ClaimConsistency,
    claims::movement_budget::{ClaimVerdict, MovementBudget},
    population::{Avatar, Slot},
    regions::footprints::HiddenFootprint,
    regions::live_regions::LiveRegions,
    silence::search::FIRST,
    timing::jitter::Jitter,
};

/// A client that takes longer counts as one that takes so long: beyond all horizons.
const ROUND_TRIP_MAX: Duration = Duration::from_secs(60);

impl Engine {
    pub(crate) fn join(
        &mut self,
        now: Duration,
        who: (AvatarId, String, [u8; 3]),
        place: Option<Vec3>,
    ) {
        let (id, name, colour) = who;
        if self.population.slot(id).is_some() {
            return;
        }
        if self.population.len() >= self.config.avatars_max {
            self.pending.push(Output::Drop { to: id, reason: "the building is full".to_owned() });
            return;
        }
        let pose = self.first_pose(place);
        let round_trip = self.config.round_trip_initial;
        self.horizons.add(round_trip);
        self.population.insert(Avatar {
            id,
            name: name.chars().take(self.config.name_chars_max).collect(),
            colour,
            pose,
            seal: self.rooms.sealed_rooms_at(pose.eye),
            version: 0,
            heard: now,
            round_trip,
            jitter: Jitter::new(self.config.margin),
            ledger: MovementBudget::new(now),
            footing: self.ways.footing(&self.world, self.world.cells.axes.own(pose.eye)),
            pledges: ClaimConsistency::default(),
            state: ReportingState::Live,
            tbv: None,
            unanswered: 0,
            told_quiet: false,
            silence_from: now,
            zone: HiddenFootprint::default(),
            zone_box: None,
            far: Aabb::EMPTY,
            close: Vec::new(),
            seen_by: None,
            validity: self.config.validity.max(FIRST),
            hidden_from: now,
            near: LiveRegions::default(),
            place: self.places.place(&self.world, Area::None, pose.eye),
            pairs: Vec::new(),
            watchers: 0,
        });
        self.wait(now, id, self.config.stall);
        self.pending.push(Output::Entered { to: id, pose });
    }

    /// The place asked for, if an eye may be there, else the next spawn point in turn. Whoever asks for a spawn point
    /// looks as one does there.
    pub(crate) fn first_pose(&mut self, place: Option<Vec3>) -> Pose {
        let confines = self.world.confines();
        if let Some(eye) = place.filter(|p| p.is_finite() && confines.contains(*p)) {
            let mut spawns = self.world.spawns.iter();
            let spawn = spawns.find(|spawn| spawn.eye.distance(eye) < AT_SPAWN_M);
            return Pose { eye, yaw: spawn.map_or(0.0, |spawn| spawn.yaw), ..Pose::default() };
        }
        let spawns = &self.world.spawns;
        let turn = self.joined;
        self.joined = self.joined.wrapping_add(1);
        match spawns.get(turn % spawns.len().max(1)) {
            Some(spawn) => Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() },
            None => Pose { eye: confines.centre(), ..Pose::default() },
        }
    }

    /// Takes an avatar out; those who held it are told at the next tick.
    pub(crate) fn remove(&mut self, id: AvatarId) {
        let Some(slot) = self.population.slot(id) else { return };
        self.part(slot);
        self.expiries.cancel(id);
        self.patience.cancel(id);
        let Some((slot, gone)) = self.population.remove(id) else { return };
        self.horizons.remove(gone.round_trip);
        match gone.state {
            ReportingState::Live => self.live_zones.remove((id, slot), &gone.zone),
            _ => self.hidden_zones.remove((id, slot), &gone.zone),
        }
        for pair in gone.pairs.iter().filter(|pair| pair.is_held) {
            self.population.at_mut(pair.slot).watchers -= 1;
        }
    }

    pub(crate) fn report(&mut self, now: Duration, id: AvatarId, sequence: u32, pose: Pose) {
        let Some(slot) = self.population.slot(id) else { return };
        let avatar = self.population.at_mut(slot);
        let believed = (avatar.pose.eye, avatar.tbv.as_ref());
        let trip = avatar.round_trip;
        let (world, footing) = (&self.world, &mut avatar.footing);
        let lead = |way_m: f64| {
            let [from, to] = [believed.0, pose.eye].map(|eye| world.cells.axes.own(eye));
            let led = self.ways.lead(world, (from, *footing), to, way_m as f32);
            self.stats.walls += u64::from(led.is_none());
            let (space, led_m) = led?;
            *footing = space;
            Some(f64::from(led_m))
        };
        match avatar.ledger.judge(now, (sequence, &pose), believed, trip, &self.limits, lead) {
            ClaimVerdict::Old => {}
            ClaimVerdict::Accepted => {
                self.stats.reports += 1;
                if avatar.state == ReportingState::Live {
                    avatar.jitter.hear(now, sequence, self.config.tick);
                }
                self.accept(now, slot, pose);
            }
            ClaimVerdict::Refused { correct } => {
                self.stats.refusals += 1;
                let pose = avatar.pose;
                if correct {
                    self.pending.push(Output::Correct { to: id, pose });
                }
            }
            ClaimVerdict::Expelled => {
                self.stats.refusals += 1;
                self.expel(id, "its movements could not be believed");
            }
        }
    }

    /// Moves an avatar to a place that it is sure to be at.
    pub(crate) fn accept(&mut self, now: Duration, slot: Slot, pose: Pose) {
        let avatar = self.population.at_mut(slot);
        let velocity = avatar.ledger.plausible(pose.velocity, &self.limits);
        avatar.pose = Pose { velocity, ..pose };
        let slack = avatar.jitter.margin() + self.config.tick;
        avatar.pledges.keep(now, avatar.pose, &self.agility, slack);
        avatar.version = avatar.version.wrapping_add(1);
        avatar.place = self.places.place(&self.world, avatar.place, pose.eye);
        avatar.seal = self.rooms.sealed_rooms_at(pose.eye);
        avatar.heard = now;
        avatar.unanswered = 0;
        match (avatar.state, avatar.tbv) {
            (ReportingState::Quiet, Some(tbv)) => self.refresh(now, slot, &tbv),
            (ReportingState::Quiet | ReportingState::Asked, _) => self.wake(now, slot),
            (ReportingState::Live, _) => {}
        }
    }

    pub(crate) fn relocate(&mut self, now: Duration, id: AvatarId, pose: Pose) {
        let Some(slot) = self.population.slot(id) else { return };
        if !pose.is_finite() || !self.limits.confines.contains(pose.eye) {
            return;
        }
        let eye = self.world.cells.axes.own(pose.eye);
        let avatar = self.population.at_mut(slot);
        avatar.ledger.relocate(now, pose.velocity);
        avatar.footing = self.ways.footing(&self.world, eye);
        avatar.pledges.forget();
        self.stats.impulses += 1;
        let avatar = self.population.at_mut(slot);
        avatar.near.forget();
        avatar.zone_box = None;
        self.unlook(slot);
        let avatar = self.population.at_mut(slot);
        if avatar.state != ReportingState::Live {
            self.wake(now, slot);
        }
        self.accept(now, slot, pose);
    }

    pub(crate) fn set_round_trip(&mut self, id: AvatarId, round_trip: Duration) {
        let Some(slot) = self.population.slot(id) else { return };
        let avatar = self.population.at_mut(slot);
        let round_trip = round_trip.min(ROUND_TRIP_MAX);
        self.horizons.remove(avatar.round_trip);
        avatar.round_trip = round_trip;
        self.horizons.add(round_trip);
    }

    pub(crate) fn chat(&mut self, from: AvatarId, text: &str) {
        let Some(slot) = self.population.slot(from) else { return };
        let text: String = text.chars().take(self.config.chat_chars_max).collect();
        let seal = self.population.at(slot).seal;
        let hears = |a: &Avatar| {
            let pair = a.pairs.binary_search_by_key(&from, |pair| pair.id);
            // Since the last tick somebody may have gone into a sealed room.
            let holds = || pair.is_ok_and(|place| a.pairs[place].is_held);
            a.id == from || a.seal.agrees(&seal) && holds()
        };
        for (to, slot) in self.population.all() {
            if hears(self.population.at(slot)) {
                self.pending.push(Output::Chat { to, from, text: text.clone() });
            }
        }
    }

    /// Puts a client out for good.
    pub(crate) fn expel(&mut self, id: AvatarId, reason: &str) {
        self.stats.drops += 1;
        self.pending.push(Output::Drop { to: id, reason: reason.to_owned() });
        self.remove(id);
    }
}
