//! Session events: participants join, claim, move, speak and leave.

use std::time::Duration;

use glam::Vec3;
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, KEEP_ALIVE, Pose, Report, ReportingState},
    tolerance::AT_SPAWN_M,
};

use crate::{
    baselines::Area,
    building::Building,
    claims::{Arrival, Claim, ClaimConsistency, ClaimVerdict, MovementBudget, OnCourse, Walk},
    engine::Engine,
    generation::Generation,
    interest::{end_pairs, forget_results},
    messages::Output,
    newcomers,
    orders::Orders,
    pairs::Pairs,
    population::{Avatar, Profile},
    regions::{HiddenFootprint, LiveRegions},
    silence::VALIDITY_FIRST,
    slot::{Member, Slot},
    timing::Arrivals,
};

impl Avatar {
    /// Where the avatar was at its client's last tick before a report, by the client's silence.
    /// `None` without such a tick since the report before.
    fn before_report(
        &self,
        report: &Report,
        building: &Building,
        tick: Duration,
    ) -> Option<OnCourse> {
        let made = self.report_made.filter(|_| self.orders.is_understood())?;
        let ticks = report.made.as_nanos().saturating_sub(1) / tick.as_nanos().max(1);
        let last_tick = tick * u32::try_from(ticks).unwrap_or(u32::MAX);
        let after = last_tick.checked_sub(made).filter(|after| *after <= self.course_for)?;
        let pose = self.pose.on_course(after, &building.agility);
        let before = report.made.saturating_sub(last_tick);
        Some(OnCourse { pose, before, tolerance: self.orders.in_force().along(&pose) })
    }
}

impl Avatar {
    /// Where the silence of a live client has put its avatar by its last tick before a report: on
    /// its course, and at the end of it after that.
    fn course_before(&self, report: &Report, building: &Building, tick: Duration) -> Option<Vec3> {
        let made = self.report_made.filter(|_| self.is_live())?;
        let after = report.made.saturating_sub(made).saturating_sub(tick).min(self.course_for);
        Some(self.pose.on_course(after, &building.agility).eye)
    }
}

/// How much longer than a straight line the way of a client that comes back may have been. It may
/// have gone around corners.
const DETOUR: f32 = 2.0;
/// By how many metres that way may be longer in any case.
const DETOUR_M: f32 = 1.0;
/// The longest round trip, beyond all horizons. A client with a longer one counts as having this.
const ROUND_TRIP_MAX: Duration = Duration::from_secs(60);

/// A pose at rest.
fn standing(pose: Pose) -> Pose {
    Pose { velocity: Vec3::ZERO, yaw_rate: 0.0, falls: false, ..pose }
}

impl Engine {
    /// Adds a participant, at a place of its choice if an eye may be there.
    pub(crate) fn join(
        &mut self,
        now: Duration,
        id: AvatarId,
        profile: Profile,
        eye: Option<Vec3>,
    ) {
        if self.population.slot(id).is_some() {
            return;
        }
        let guests = self.stations.guests();
        if self.population.len() >= self.config.avatars_max + guests {
            self.pending.push(Output::Drop { to: id, reason: "the building is full".to_owned() });
            return;
        }
        let pose = self.first_pose(eye);
        self.horizons.add(self.config.round_trip_initial);
        let avatar = self.newcomer(now, id, profile, pose);
        self.population.insert(avatar);
        self.deadlines.wait(now, id, self.config.stall);
        self.pending.push(Output::Entered { to: id, pose, tick: self.ticks() + 1 });
    }

    /// An avatar at a pose, of which nothing else is known.
    pub(crate) fn newcomer(
        &self,
        now: Duration,
        id: AvatarId,
        profile: Profile,
        pose: Pose,
    ) -> Avatar {
        let round_trip = self.config.round_trip_initial;
        let building = &self.building;
        let name = profile.name.chars().take(self.config.name_chars_max).collect();
        Avatar {
            id,
            profile: Profile { name, ..profile },
            pose,
            sealed: building.rooms.sealed_rooms_at(pose.eye),
            version: Generation::default(),
            has_news: true,
            heard_at: now,
            round_trip,
            arrivals: Arrivals::new(self.config.margin),
            report_made: None,
            course_for: Duration::ZERO,
            budget: MovementBudget::new(now),
            walk: building.walkways.state_at(&building.world, building.axes().own(pose.eye)),
            consistency: ClaimConsistency::default(),
            state: ReportingState::Live,
            tbv: None,
            sphere: None,
            is_absent: false,
            unanswered: 0,
            asked_round: 0,
            orders: Orders::default(),
            ordered_at: now,
            nearest_m: f32::INFINITY,
            nearest_m_so_far: f32::INFINITY,
            silence_again_at: now,
            footprint: HiddenFootprint::default(),
            footprint_box: None,
            reveal_box: Aabb::EMPTY,
            nearby_hidden: Vec::new(),
            footprint_version: Generation::default(),
            prevented: None,
            validity: self.config.validity.max(VALIDITY_FIRST),
            hidden_from: now,
            hidden_at: pose,
            regions: LiveRegions::default(),
            area: building.partition.area_of(&building.world, Area::None, pose.eye),
            pairs: Pairs::default(),
            watchers: 0,
            guest: None,
            relays: Vec::new(),
            relayed_footprint: None,
        }
    }

    /// The pose at the place that was asked for, if an eye may be there, or else at the next spawn
    /// point in turn, or beside it. An avatar at a spawn point faces as the spawn point says.
    fn first_pose(&mut self, eye: Option<Vec3>) -> Pose {
        let world = &self.building.world;
        let confines = world.confines();
        if let Some(eye) = eye.filter(|eye| eye.is_finite() && confines.contains(*eye)) {
            let mut spawns = world.spawns.iter();
            let spawn = spawns.find(|spawn| spawn.eye.distance(eye) < AT_SPAWN_M);
            return Pose { eye, yaw: spawn.map_or(0.0, |spawn| spawn.yaw), ..Pose::default() };
        }
        let turn = self.joined;
        self.joined = self.joined.wrapping_add(1);
        match newcomers::place(world, turn) {
            Some(spawn) => Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() },
            None => Pose { eye: confines.centre(), ..Pose::default() },
        }
    }

    /// Removes an avatar. Clients that held it are told at the next tick.
    pub(crate) fn remove(&mut self, id: AvatarId) {
        let Some(slot) = self.population.slot(id) else { return };
        self.tell_leave(slot);
        let silencing = self.silencing();
        let coarse = &mut silencing.indices.coarse;
        end_pairs(silencing.context, silencing.population, coarse, slot, silencing.pending);
        self.deadlines.cancel(id);
        let Some((slot, gone)) = self.population.remove(id) else { return };
        if !gone.is_guest() {
            self.horizons.remove(gone.round_trip);
        }
        let index = if gone.is_live() { &mut self.indices.live } else { &mut self.indices.hidden };
        index.remove(Member { id, slot }, &gone.footprint.sectors);
        for pair in gone.pairs.iter().filter(|pair| pair.is_held) {
            self.population.at_mut(pair.slot).lose_watcher();
        }
    }

    /// Takes in a client's report.
    pub(crate) fn report(&mut self, now: Duration, id: AvatarId, report: &Report) {
        let Some(slot) = self.population.slot(id) else { return };
        let Self { building, config, horizons, population, workspace, stats, pending, .. } = self;
        let avatar = population.at_mut(slot);
        let pose = report.pose;
        let claim = Claim {
            tbv: avatar.tbv.as_ref(),
            sphere: avatar.sphere,
            course: avatar.course_before(report, building, config.tick),
            late: avatar.arrivals.lateness(now, report.made),
            ..Claim::new(report.made, &pose, avatar.pose.eye, avatar.round_trip)
        };
        let [from, to] = [claim.from, pose.eye].map(|eye| building.axes().own(eye));
        let walk = Walk { from, state: avatar.walk, to };
        let find_way = |longest_m: f64| {
            let (world, ways) = (&building.world, &mut workspace.ways);
            let way = building.walkways.find_way(ways, world, &walk, longest_m as f32);
            stats.walls += u64::from(way.is_none());
            avatar.walk = way?.state;
            Some(f64::from(way?.length_m))
        };
        match avatar.budget.judge(now, &claim, &building.limits, find_way) {
            ClaimVerdict::Old => {}
            ClaimVerdict::Accepted => {
                stats.reports += 1;
                let one_way = horizons.one_way(avatar.round_trip);
                avatar.arrivals.hear(now, report.made, config.tick, one_way);
                self.accept(now, slot, pose, Some(report));
            }
            ClaimVerdict::Refused { correct } => {
                stats.refusals += 1;
                // The client is not on the course that is known.
                avatar.report_made = None;
                if correct {
                    pending.push(Output::Correct { to: id, pose: avatar.pose });
                }
            }
            ClaimVerdict::Expelled => {
                stats.refusals += 1;
                self.expel(id, "its movements could not be believed");
            }
        }
    }

    /// Moves an avatar to a pose that is believed: by a report, or else by the host's word.
    fn accept(&mut self, now: Duration, slot: Slot, pose: Pose, report: Option<&Report>) {
        let Self { building, config, workspace, .. } = self;
        let avatar = self.population.at_mut(slot);
        let velocity = avatar.budget.plausible(pose.velocity, &building.limits);
        let silent = report.and_then(|report| avatar.before_report(report, building, config.tick));
        let departs = silent.as_ref().is_some_and(|c| c.departs(&pose, &building.agility));
        self.stats.departures += u64::from(departs && avatar.is_live());
        avatar.pose = Pose { velocity, ..pose };
        let slack = avatar.arrivals.margin() + config.tick;
        let late = report.map_or(Duration::ZERO, |r| avatar.arrivals.lateness(now, r.made));
        let arrival = Arrival { now, late };
        avatar.consistency.check(arrival, avatar.pose, silent.as_ref(), &building.agility, slack);
        avatar.report_made = report.map(|report| report.made);
        report.iter().for_each(|report| avatar.orders.hear(report.orders));
        let (from, course) = (building.axes().own(pose.eye), avatar.pose);
        let at = |time| building.axes().own(course.on_course(time, &building.agility).eye);
        let start = Walk { from, state: avatar.walk, to: from };
        let (walkways, ways) = (&building.walkways, &mut workspace.ways);
        avatar.course_for = walkways.time_ahead(ways, &building.world, &start, KEEP_ALIVE, at);
        avatar.version.advance();
        avatar.has_news = true;
        avatar.area = building.partition.area_of(&building.world, avatar.area, pose.eye);
        avatar.sealed = building.rooms.sealed_rooms_at(pose.eye);
        avatar.heard_at = now;
        avatar.unanswered = 0;
        let id = avatar.id;
        match (avatar.state, avatar.tbv) {
            (ReportingState::Quiet, Some(tbv)) => self.silencing().hear_quiet(slot, &tbv),
            (ReportingState::Quiet | ReportingState::Asked, _) => self.silencing().wake(slot),
            (ReportingState::Live, _) => {
                let patience = self.population.at(slot).patience(self.context());
                self.deadlines.wait(now, id, patience);
            }
        }
        self.relay(slot);
    }

    /// Puts an avatar elsewhere, or pushes it, by the host's word.
    pub(crate) fn relocate(&mut self, now: Duration, id: AvatarId, pose: Pose) {
        let Some(slot) = self.population.slot(id) else { return };
        if pose.is_finite() && self.building.limits.confines.contains(pose.eye) {
            self.stats.impulses += 1;
            self.put(now, slot, pose);
        }
    }

    /// Puts an avatar elsewhere. What its client said before counts no more.
    fn put(&mut self, now: Duration, slot: Slot, pose: Pose) {
        let Self { building, population, .. } = self;
        let avatar = population.at_mut(slot);
        avatar.budget.relocate(now, pose.velocity);
        avatar.walk = building.walkways.state_at(&building.world, building.axes().own(pose.eye));
        avatar.consistency.forget();
        avatar.regions.forget();
        avatar.footprint_box = None;
        let is_live = avatar.is_live();
        forget_results(population, slot);
        if !is_live {
            self.silencing().wake(slot);
        }
        self.accept(now, slot, pose, None);
    }

    /// Lets an avatar stand where it is until its client comes back.
    pub(crate) fn part(&mut self, now: Duration, id: AvatarId) {
        let Some(slot) = self.population.slot(id) else { return };
        let shown = self.population.at(slot).shown(self.context());
        self.put(now, slot, standing(shown));
        self.population.at_mut(slot).is_absent = true;
        self.relay(slot);
        self.deadlines.cancel(id);
    }

    /// Gives an avatar to a client that knows nothing of it.
    pub(crate) fn come_back(&mut self, now: Duration, id: AvatarId, eye: Option<Vec3>) {
        let Some(slot) = self.population.slot(id) else { return };
        let confines = self.building.world.confines();
        let stood = standing(self.population.at(slot).pose);
        let eye = eye.filter(|eye| eye.is_finite() && confines.contains(*eye));
        let eye = eye.filter(|eye| self.may_have_walked(slot, *eye));
        let pose = Pose { eye: eye.unwrap_or(stood.eye), ..stood };
        self.put(now, slot, pose);
        let margin = self.config.margin;
        let avatar = self.population.at_mut(slot);
        avatar.is_absent = false;
        avatar.budget = MovementBudget::new(now);
        avatar.arrivals = Arrivals::new(margin);
        (avatar.orders, avatar.ordered_at, avatar.unanswered) = (Orders::default(), now, 0);
        let held = avatar.pairs.release();
        held.into_iter().for_each(|other| self.population.at_mut(other).lose_watcher());
        self.deadlines.wait(now, id, self.config.stall);
        // What was to be told to the client before is not for this one.
        self.pending.retain(|output| output.to() != id);
        self.pending.push(Output::Entered { to: id, pose, tick: self.ticks() + 1 });
    }

    /// Whether a way on foot leads an avatar to where its client says that it has got to since it
    /// was heard last.
    fn may_have_walked(&mut self, slot: Slot, eye: Vec3) -> bool {
        let Self { building, population, workspace, .. } = self;
        let avatar = population.at(slot);
        let [from, to] = [avatar.pose.eye, eye].map(|eye| building.axes().own(eye));
        let walk = Walk { from, state: avatar.walk, to };
        let longest_m = DETOUR * from.distance(to) + DETOUR_M;
        building.walkways.find_way(&mut workspace.ways, &building.world, &walk, longest_m).is_some()
    }

    /// Puts an avatar back to a spawn point, as its client asked.
    pub(crate) fn respawn(&mut self, now: Duration, id: AvatarId) {
        if self.population.slot(id).is_none() {
            return;
        }
        let pose = self.first_pose(None);
        self.relocate(now, id, pose);
        self.pending.push(Output::Correct { to: id, pose });
    }

    /// Takes in a measured round trip.
    pub(crate) fn set_round_trip(&mut self, id: AvatarId, round_trip: Duration) {
        let Some(slot) = self.population.slot(id) else { return };
        let avatar = self.population.at_mut(slot);
        self.horizons.remove(avatar.round_trip);
        avatar.round_trip = round_trip.min(ROUND_TRIP_MAX);
        self.horizons.add(avatar.round_trip);
    }

    /// Passes on what an avatar says to all clients that hold it, and to its own.
    pub(crate) fn chat(&mut self, from: AvatarId, text: &str) {
        let Some(slot) = self.population.slot(from) else { return };
        let text: String = text.chars().take(self.config.chat_chars_max).collect();
        let sealed = self.population.at(slot).sealed;
        let hears = |avatar: &Avatar| {
            let holds = || avatar.pairs.get(from).is_some_and(|pair| pair.is_held);
            // An avatar may have entered a sealed room since the last tick.
            avatar.id == from || avatar.sealed.agrees(&sealed) && holds()
        };
        for Member { id, slot } in self.population.all() {
            if hears(self.population.at(slot)) {
                self.pending.push(Output::Chat { to: id, from, text: text.clone() });
            }
        }
        self.relay_chat(slot, text);
    }

    /// Drops a client for good.
    pub(crate) fn expel(&mut self, id: AvatarId, reason: &str) {
        self.stats.drops += 1;
        self.pending.push(Output::Drop { to: id, reason: reason.to_owned() });
        self.remove(id);
    }
}
