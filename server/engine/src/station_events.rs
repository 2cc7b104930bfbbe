//! Station events: what other stations say, and what they are told.

use std::time::Duration;

use sightline_world::motion::{AvatarId, KEEP_ALIVE, Tolerance};

use crate::{
    acuity::Acuity,
    bus::{GuestReport, StationId, StationMessage, StationWord, Stay},
    claims::{ClaimConsistency, WalkState},
    config::StationFault,
    engine::Engine,
    interest::forget_results,
    messages::{Input, Output},
    orders::Orders,
    population::{Avatar, Profile},
    regions::MotionBound,
    slot::{Member, Slot},
    stations::{Guest, Receipt, Relay, RelayOrder},
    tick_context::TickContext,
    timing::Arrivals,
};

/// An avatar that cannot be where another station subscribes any more stays announced for so long.
const LEAVE_AFTER: Duration = Duration::from_secs(2);
/// The longest time in a report of another station.
const TIME_MAX: Duration = Duration::from_secs(100 * 365 * 86_400);
/// The longest notice, and the longest time ahead, that another station may name.
const NOTICE_MAX: Duration = Duration::from_secs(20);
/// The largest length in a report of another station, in metres.
const LENGTH_MAX_M: f32 = 1e6;
/// The largest difference of two clocks in a report of another station, in microseconds.
const LAG_MAX_US: i64 = 1 << 60;

impl Engine {
    /// Takes in what another station says. What comes of it is told at the next tick. A station
    /// that says what cannot be true, or too much, is cut off, and its avatars leave.
    pub fn handle_station(&mut self, now: Duration, from: StationId, message: &StationMessage) {
        let now = self.advance(now);
        match self.stations.receive(now, from, self.config.bus_margin, message) {
            Receipt::Stale => return,
            Receipt::Good => {}
            Receipt::Void => self.forget_station(from),
            Receipt::Lost => return self.forget_station(from),
            Receipt::Flood => return self.cut_off(from),
        }
        if self.take_word(now, from, &message.word).is_none() {
            self.cut_off(from);
        }
    }

    pub(crate) fn cut_off(&mut self, station: StationId) {
        self.stations.cut_off(station);
        self.forget_station(station);
    }

    /// Forgets all that had to do with a station: its avatars leave, and it knows of none.
    fn forget_station(&mut self, station: StationId) {
        let is_its = |member: &Member| {
            self.population.at(member.slot).guest.is_some_and(|guest| guest.station == station)
        };
        self.stations.owe_whole();
        let gone: Vec<AvatarId> =
            self.population.guests().filter(is_its).map(|member| member.id).collect();
        gone.into_iter().for_each(|id| self.remove(id));
        let own: Vec<Member> = self.population.own().collect();
        for member in own {
            let avatar = self.population.at_mut(member.slot);
            avatar.relays.retain(|relay| relay.station != station);
            avatar.relayed_footprint = None;
        }
    }

    /// Takes in what a station says. `None` when it cannot be true.
    fn take_word(&mut self, now: Duration, from: StationId, word: &StationWord) -> Option<()> {
        match word {
            StationWord::Heartbeat(_) => Some(()),
            StationWord::Subscribe { number, added, removed } => {
                let sectors = self.building.sectors.len();
                let exists = |sector: &u32| (*sector as usize) < sectors;
                let link = self.stations.link_mut(from)?;
                if added.len() > sectors || removed.len() > sectors {
                    return None;
                }
                if !added.iter().chain(removed).all(exists) {
                    return None;
                }
                removed.iter().for_each(|sector| link.wants.remove(*sector));
                added.iter().for_each(|sector| link.wants.insert(*sector));
                link.asked = Some(*number);
                Some(())
            }
            StationWord::Synced { number } => {
                self.stations.link_mut(from)?.synced = *number;
                Some(())
            }
            StationWord::Announce { avatar, name, colour, stay, report } => {
                let profile = Profile { name: name.clone(), colour: *colour };
                self.announced(now, from, *avatar, profile, stay.as_ref(), report)
            }
            StationWord::Report { avatar, report } => {
                let slot = self.guest_of(from, *avatar)?;
                self.check(report)?;
                self.take_report(slot, from, report);
                self.silencing().hear_guest(slot, report.orders);
                Some(())
            }
            StationWord::Leave { avatar } => {
                self.guest_of(from, *avatar)?;
                self.remove(*avatar);
                Some(())
            }
            StationWord::Ask { avatar, tolerance } => self.asked(from, *avatar, *tolerance),
            StationWord::Quiet { avatar, stay } => self.told_to_stay(from, *avatar, stay),
            StationWord::Chat { avatar, text } => {
                self.guest_of(from, *avatar)?;
                self.chat(*avatar, text);
                Some(())
            }
        }
    }

    fn guest_of(&self, station: StationId, id: AvatarId) -> Option<Slot> {
        let slot = self.population.slot(id)?;
        let guest = self.population.at(slot).guest?;
        (guest.station == station).then_some(slot)
    }

    /// Whether a report can be true. Otherwise `None`.
    fn check(&self, report: &GuestReport) -> Option<()> {
        let limits = &self.building.limits;
        let GuestReport { pose, tolerance, lags, .. } = report;
        let speed_max = 2.0 * limits.speed_max.max(limits.fall_max);
        let times = [report.made.unwrap_or_default(), report.heard, report.round_trip, lags.margin];
        let is_short = |metres: f32| (0.0..=LENGTH_MAX_M).contains(&metres);
        let spaces = self.building.cells().spaces.len();
        let is_possible = pose.is_finite()
            && limits.confines.contains(pose.eye)
            && pose.velocity.length() <= speed_max
            && is_short(tolerance.metres)
            && is_short(tolerance.radians)
            && tolerance.ahead <= NOTICE_MAX
            && times.iter().all(|time| *time <= TIME_MAX)
            && report.space.is_none_or(|space| (space as usize) < spaces)
            && [lags.least_us, lags.slowest_us, lags.quickest_us]
                .iter()
                .all(|lag| (-LAG_MAX_US..=LAG_MAX_US).contains(lag));
        is_possible.then_some(())
    }

    /// Takes in an avatar of another station.
    fn announced(
        &mut self,
        now: Duration,
        from: StationId,
        id: AvatarId,
        profile: Profile,
        stay: Option<&Stay>,
        report: &GuestReport,
    ) -> Option<()> {
        self.check(report)?;
        if let Some(stay) = stay {
            check_stay(stay)?;
        }
        let link = self.stations.link_mut(from)?;
        if self.population.slot(id).is_some() || link.guests.len() >= self.config.avatars_max {
            return None;
        }
        link.guests.insert(id);
        let mut avatar = self.newcomer(now, id, profile, report.pose);
        avatar.guest = Some(Guest { station: from, until: now, age: Duration::ZERO });
        avatar.orders = Orders::to_station(self.tolerance_untold());
        let slot = self.population.insert(avatar);
        self.take_report(slot, from, report);
        self.follow_clock(slot);
        if let Some(stay) = stay {
            self.silencing().let_stay(slot, stay);
        }
        Some(())
    }

    /// What another station takes to be wanted of an avatar before it is asked.
    fn tolerance_untold(&self) -> Tolerance {
        let Acuity { metres, radians } = Acuity::unseen(&self.building.world);
        Tolerance { metres, radians, ahead: Duration::ZERO }
    }

    /// Takes in what is known of an avatar of another station.
    fn take_report(&mut self, slot: Slot, from: StationId, report: &GuestReport) {
        let told = self.tolerance_untold();
        let bus = self.stations.link(from).map_or(Duration::ZERO, |link| link.delay());
        let round_trip = self.horizons.guest_round_trip(report.round_trip, bus);
        let Self { building, population, .. } = self;
        let avatar = population.at_mut(slot);
        avatar.pose = report.pose;
        avatar.report_made = report.made;
        avatar.heard_at = report.heard;
        avatar.course_for = report.course_for.min(KEEP_ALIVE);
        avatar.walk = WalkState::relayed(report.space, report.is_stuck);
        avatar.arrivals = Arrivals::relayed(&report.lags);
        avatar.consistency = ClaimConsistency::relayed(report.is_believed);
        avatar.is_absent = report.is_absent;
        avatar.round_trip = round_trip;
        avatar.orders.relay(report.orders, report.tolerance, told);
        avatar.version.advance();
        avatar.has_news = true;
        avatar.area = building.partition.area_of(&building.world, avatar.area, report.pose.eye);
        avatar.sealed = building.rooms.sealed_rooms_at(report.pose.eye);
        if report.made.is_none() {
            avatar.regions.forget();
            avatar.footprint_box = None;
            forget_results(population, slot);
        }
    }

    /// Another station asks for an avatar of this one.
    fn asked(&mut self, from: StationId, id: AvatarId, tolerance: Tolerance) -> Option<()> {
        let is_length = |length: f32| (0.0..=LENGTH_MAX_M).contains(&length);
        if !is_length(tolerance.metres) || !is_length(tolerance.radians) {
            return None;
        }
        let finest = Acuity::at(&self.building.world, 0.0);
        let tolerance = Tolerance {
            metres: tolerance.metres.max(finest.metres),
            radians: tolerance.radians.max(finest.radians),
            ahead: tolerance.ahead.min(NOTICE_MAX),
        };
        // It may have left in the meantime.
        let Some(slot) = self.population.slot(id) else { return Some(()) };
        let avatar = self.population.at_mut(slot);
        let Some(relay) = avatar.relays.iter_mut().find(|relay| relay.station == from) else {
            return Some(());
        };
        relay.orders = relay.orders.wrapping_add(1);
        let last = std::mem::replace(&mut relay.order, RelayOrder::Live(Some(tolerance)));
        if !matches!(last, RelayOrder::Live(Some(_))) {
            relay.told = None;
        }
        if !avatar.is_live() {
            self.silencing().ask_to_be_live(slot);
        }
        self.relay(slot);
        Some(())
    }

    /// Another station wants no word of an avatar of this one while it stays.
    fn told_to_stay(&mut self, from: StationId, id: AvatarId, stay: &Stay) -> Option<()> {
        check_stay(stay)?;
        let Some(slot) = self.population.slot(id) else { return Some(()) };
        let relays = &mut self.population.at_mut(slot).relays;
        let Some(relay) = relays.iter_mut().find(|relay| relay.station == from) else {
            return Some(());
        };
        relay.orders = relay.orders.wrapping_add(1);
        relay.order = RelayOrder::Quiet(*stay);
        self.relay(slot);
        Some(())
    }

    /// Whether an input is about an avatar of another station. Only that one may speak for it.
    pub(crate) fn is_of_guest(&self, input: &Input) -> bool {
        let (Input::Join { avatar, .. }
        | Input::Absent { avatar }
        | Input::Return { avatar, .. }
        | Input::Leave { avatar }
        | Input::Report { avatar, .. }
        | Input::Relocate { avatar, .. }
        | Input::Respawn { avatar }
        | Input::RoundTrip { avatar, .. }
        | Input::Chat { avatar, .. }) = input;
        self.stations.are_several()
            && self.population.find(*avatar).is_some_and(|avatar| avatar.is_guest())
    }

    /// Before a tick: forgets stations that are gone, and takes in how far away the others are.
    pub(crate) fn hear_stations(&mut self) {
        if !self.stations.is_station() {
            return;
        }
        for station in self.stations.remove_gone(self.now()) {
            self.forget_station(station);
        }
        let abroad = self.stations.are_several().then(|| self.stations.abroad());
        self.horizons.set_abroad(abroad);
        if abroad.is_some() {
            let guests: Vec<Member> = self.population.guests().collect();
            guests.into_iter().for_each(|guest| self.follow_clock(guest.slot));
        }
    }

    /// Takes in up to which moment all is known that another station has said of an avatar.
    fn follow_clock(&mut self, slot: Slot) {
        let now = self.now();
        let avatar = self.population.at_mut(slot);
        if let Some(guest) = &mut avatar.guest
            && let Some(link) = self.stations.link(guest.station)
        {
            (guest.until, guest.age) = link.known_until(now);
            if self.config.faults.station == Some(StationFault::BusIgnored) {
                (guest.until, guest.age) = (guest.until + guest.age, Duration::ZERO);
            }
        }
    }

    /// After a tick: tells other stations what this one wants of their avatars, to which sectors it
    /// subscribes, and what they must know of its own. `outputs` from `first` on are of this tick;
    /// those for avatars of other stations are taken out.
    pub(crate) fn tell_stations(&mut self, outputs: &mut Vec<Output>, first: usize) {
        if !self.stations.is_station() {
            return;
        }
        let now = self.now();
        if self.stations.are_several() {
            let of_tick = outputs.split_off(first);
            for output in of_tick {
                match self.population.find(output.to()).and_then(|avatar| avatar.guest) {
                    Some(guest) => self.order_guest(guest.station, output),
                    None => outputs.push(output),
                }
            }
            self.update_subscription();
            self.announce_all();
            let own: Vec<Member> = self.population.own().collect();
            own.iter().for_each(|member| self.relay(member.slot));
        }
        let [slowest, silent] = self.horizons.own_round_trips();
        self.stations.beat(now, slowest, silent);
    }

    /// Passes on what would be told to the client of an avatar, if it were of this station.
    fn order_guest(&mut self, station: StationId, output: Output) {
        let word = match output {
            Output::Live { to, tolerance } => StationWord::Ask { avatar: to, tolerance },
            Output::Quiet { to, tbv } => {
                let stay = Stay { within: tbv.within, notice: tbv.notice };
                StationWord::Quiet { avatar: to, stay }
            }
            _ => return,
        };
        self.stations.send(self.now(), station, word);
    }

    /// Subscribes to the sectors that this station's own avatars may see.
    fn update_subscription(&mut self) {
        let now = self.now();
        let Self { building, config, population, stations, .. } = self;
        for Member { id, slot } in population.own() {
            let Avatar { footprint, footprint_version, regions, .. } = population.at(slot);
            if config.faults.station == Some(StationFault::LateSubscription) {
                let here: Vec<u32> = regions.space().into_iter().collect();
                let seen = building.sectors.visible_from(&building.sectors.of(&here));
                stations.subscription.set(id, *footprint_version, seen.iter().collect());
            } else if !stations.subscription.is_current(id, *footprint_version) {
                let seen = building.sectors.visible_from(&footprint.sectors.eyes);
                stations.subscription.set(id, *footprint_version, seen.iter().collect());
            }
        }
        stations.publish_subscription(now);
    }

    /// Announces the avatars that may be where others subscribe, and says of those that cannot be
    /// there any more that they leave.
    fn announce_all(&mut self) {
        let asked = self.stations.ready().any(|(_, link)| link.asked.is_some());
        let ready: Vec<StationId> = self.stations.ready().map(|(station, _)| station).collect();
        let own: Vec<Member> = self.population.own().collect();
        for Member { slot, .. } in own {
            let avatar = self.population.at_mut(slot);
            let is_old = avatar.relayed_footprint == Some(avatar.footprint_version);
            let is_leaving = || avatar.relays.iter().any(|relay| relay.outside_since.is_some());
            if is_old && !asked && !is_leaving() {
                continue;
            }
            avatar.relayed_footprint = Some(avatar.footprint_version);
            ready.iter().for_each(|station| self.announce(slot, *station));
        }
        for station in ready {
            let number = self.stations.link_mut(station).and_then(|link| link.asked.take());
            if let Some(number) = number {
                self.stations.send(self.now(), station, StationWord::Synced { number });
            }
        }
    }

    /// Announces an avatar to a station, or takes it back, if where it can be has changed that.
    fn announce(&mut self, slot: Slot, station: StationId) {
        let now = self.now();
        let avatar = self.population.at(slot);
        let Some(link) = self.stations.link(station) else { return };
        let is_there =
            avatar.footprint.sectors.bodies.iter().any(|sector| link.wants.contains(*sector));
        let place = avatar.relays.iter().position(|relay| relay.station == station);
        match (is_there, place) {
            (true, Some(place)) => self.population.at_mut(slot).relays[place].outside_since = None,
            (true, None) => self.introduce(slot, station),
            (false, Some(place)) => {
                let avatar = self.population.at_mut(slot);
                let since = *avatar.relays[place].outside_since.get_or_insert(now);
                if since + LEAVE_AFTER <= now {
                    avatar.relays.remove(place);
                    let word = StationWord::Leave { avatar: avatar.id };
                    self.stations.send(now, station, word);
                }
            }
            (false, None) => {}
        }
    }

    fn introduce(&mut self, slot: Slot, station: StationId) {
        let now = self.now();
        let avatar = self.population.at(slot);
        let stay = avatar.tbv.map(|tbv| Stay { within: tbv.within, notice: tbv.notice });
        // An avatar that stays has been ordered to, in effect.
        let orders = u32::from(stay.is_some());
        let report = match stay {
            Some(_) => GuestReport {
                pose: avatar.hidden_at,
                made: None,
                space: None,
                tolerance: Tolerance::NONE,
                ..report_of(avatar, orders, self.context())
            },
            None => report_of(avatar, orders, self.context()),
        };
        let Profile { name, colour } = avatar.profile.clone();
        let word = StationWord::Announce { avatar: avatar.id, name, colour, stay, report };
        let relay = Relay {
            station,
            orders,
            order: stay.map_or(RelayOrder::Live(None), RelayOrder::Quiet),
            told: Some(avatar.relay_key(now)),
            outside_since: None,
        };
        let relays = &mut self.population.at_mut(slot).relays;
        relays.push(relay);
        relays.sort_unstable_by_key(|relay| relay.station);
        self.stations.send(now, station, word);
    }

    /// Tells the stations that follow an avatar what is new of it, and those for which it was to
    /// stay in a box that it may leave that.
    pub(crate) fn relay(&mut self, slot: Slot) {
        let avatar = self.population.at(slot);
        if avatar.relays.is_empty() || !avatar.is_live() {
            return;
        }
        let (now, key) = (self.now(), avatar.relay_key(self.now()));
        let mut told: Vec<(StationId, u32)> = Vec::new();
        let leaves = avatar.relays.iter().any(|relay| matches!(relay.order, RelayOrder::Quiet(_)));
        let motion = leaves.then(|| avatar.motion(self.context()));
        // The host may have put it behind a wall, in the same box.
        let was_put = avatar.report_made.is_none();
        let is_left = |stay: &Stay| {
            let Some(motion) = motion.as_ref().filter(|_| !was_put) else { return true };
            if self.config.faults.station == Some(StationFault::LeavingUnsaid) {
                return false;
            }
            let time = motion.age + self.config.tick + stay.notice;
            let bound = MotionBound::new(&self.building, motion, motion.is_believed, time);
            stay.notice.is_zero() || !stay.within.contains_box(&bound.eyes)
        };
        let left: Vec<bool> = avatar
            .relays
            .iter()
            .map(|relay| matches!(&relay.order, RelayOrder::Quiet(stay) if is_left(stay)))
            .collect();
        for (relay, left) in self.population.at_mut(slot).relays.iter_mut().zip(left) {
            if left {
                relay.order = RelayOrder::Live(None);
                relay.told = None;
            }
            if matches!(relay.order, RelayOrder::Live(_)) && relay.told != Some(key) {
                relay.told = Some(key);
                told.push((relay.station, relay.orders));
            }
        }
        for (station, orders) in told {
            let avatar = self.population.at(slot);
            let report = report_of(avatar, orders, self.context());
            self.stations.send(now, station, StationWord::Report { avatar: avatar.id, report });
        }
    }

    /// Passes on what an avatar says to the stations that follow it.
    pub(crate) fn relay_chat(&mut self, slot: Slot, text: String) {
        let (now, avatar) = (self.now(), self.population.at(slot));
        for relay in &avatar.relays {
            if matches!(relay.order, RelayOrder::Live(_)) {
                let word = StationWord::Chat { avatar: avatar.id, text: text.clone() };
                self.stations.send(now, relay.station, word);
            }
        }
    }

    /// Says of an avatar that it has left, or forgets one of another station.
    pub(crate) fn tell_leave(&mut self, slot: Slot) {
        let (now, avatar) = (self.now(), self.population.at(slot));
        if let Some(guest) = avatar.guest {
            if let Some(link) = self.stations.link_mut(guest.station) {
                link.guests.remove(&avatar.id);
            }
            return;
        }
        for relay in &avatar.relays {
            self.stations.send(now, relay.station, StationWord::Leave { avatar: avatar.id });
        }
        self.stations.subscription.remove(avatar.id);
    }
}

/// Whether another station may name a box. Otherwise `None`.
fn check_stay(stay: &Stay) -> Option<()> {
    let Stay { within, notice } = stay;
    (within.min.is_finite() && within.max.is_finite() && *notice <= NOTICE_MAX).then_some(())
}

/// What another station is told of an avatar.
fn report_of(avatar: &Avatar, orders: u32, context: TickContext<'_>) -> GuestReport {
    let (space, is_stuck) = avatar.walk.parts();
    let key = avatar.relay_key(context.now);
    GuestReport {
        orders,
        pose: avatar.pose,
        made: avatar.report_made,
        heard: avatar.heard_at,
        course_for: avatar.course_for,
        tolerance: key.tolerance,
        space,
        is_stuck,
        is_believed: key.is_believed,
        is_absent: avatar.is_absent,
        round_trip: avatar.round_trip,
        lags: avatar.arrivals.lags(),
    }
}
