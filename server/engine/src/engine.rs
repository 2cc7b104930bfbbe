//! The engine's parts, and the stages of a tick.

use std::{sync::Arc, time::Duration};

use sightline_world::{
    World,
    geometry::Aabb,
    motion::{Agility, AvatarId, Pose, ReportingState, Tbv, Tolerance},
};

use crate::{
    acuity::Acuity,
    building::Building,
    bus::{StationId, StationOutput},
    claims::ClaimLimits,
    config::{Config, Policy},
    interest::{self, CertificateInputs, Explanation, SightBudget, Snapshot},
    messages::{Input, Output},
    population::{KnownCourse, Population, Profile},
    regions::Indices,
    silence::{Deadlines, SilenceBudget, Silencing},
    slot::Slot,
    stations::Stations,
    stats::{Counts, Stats},
    tick_context::TickContext,
    timing::Horizons,
    worker_pool::{WorkerPool, Workspace},
};

/// The time that the report of a departure may be on its way when the host asks where an avatar is,
/// in seconds.
const ON_ITS_WAY_S: f32 = 0.25;
/// The end of time: ten thousand years.
const NOW_MAX: Duration = Duration::from_secs(10_000 * 365 * 86_400);

/// The most numbers of ticks that one call skips: an hour at 20 ticks a second.
const SKIPPED_MAX: u32 = 72_000;

/// Decides which avatars each client is told of, and which client is asked when.
#[derive(Clone, Debug)]
pub struct Engine {
    /// What never changes.
    pub(crate) building: Building,
    pub(crate) config: Config,
    /// The avatars that are present.
    pub(crate) population: Population,
    /// How long regions must hold, given the round trips of the population.
    pub(crate) horizons: Horizons,
    /// Which avatars can be where.
    pub(crate) indices: Indices,
    /// When clients are asked, or looked into.
    pub(crate) deadlines: Deadlines,
    /// The other stations.
    pub(crate) stations: Stations,
    sight_budget: SightBudget,
    pub(crate) silence_budget: SilenceBudget,
    pool: WorkerPool,
    /// The memory of the calling thread's algorithms.
    pub(crate) workspace: Workspace,
    /// What came of inputs since the last tick.
    pub(crate) pending: Vec<Output>,
    pub(crate) stats: Stats,
    /// How many avatars have begun at a spawn point.
    pub(crate) joined: usize,
    /// The time of the last call.
    now: Duration,
    /// When the first tick was.
    first_tick: Option<Duration>,
    /// The number of the last tick. It follows the time, so a late call skips numbers.
    tick: u32,
    /// How many ticks there have been.
    rounds: u32,
}

impl Engine {
    /// An engine for a world, with nobody in it.
    pub fn new(world: Arc<World>, config: Config) -> Self {
        let config = config.bounded();
        let building = Building::new(world, &config);
        Self {
            population: Population::default(),
            horizons: Horizons::new(&config),
            indices: Indices::new(&building),
            deadlines: Deadlines::new(config.tick),
            stations: Stations::default(),
            sight_budget: SightBudget::default(),
            silence_budget: SilenceBudget::default(),
            pool: WorkerPool::new(config.threads),
            workspace: Workspace::default(),
            pending: Vec::new(),
            stats: Stats::default(),
            joined: 0,
            now: Duration::ZERO,
            first_tick: None,
            tick: 0,
            rounds: 0,
            building,
            config,
        }
    }

    /// Counts on from the ticks of an engine that this one replaces: the next tick has the number
    /// after `ticks`, and other stations notice the change. To be called before the first tick, and
    /// after [`Engine::as_station`].
    pub fn counting_from(mut self, ticks: u32) -> Self {
        debug_assert_eq!(self.tick, 0, "the engine has not ticked");
        self.stations.count_from(ticks);
        Self { tick: ticks, ..self }
    }

    /// The engine as a station with this name, which no other station on its bus has. What other
    /// stations say comes by [`Engine::handle_station`]. Without any, an engine decides as one that
    /// is no station.
    pub fn as_station(self, station: StationId) -> Self {
        Self { stations: Stations::new(station), ..self }
    }

    /// Takes what other stations must be told, in order. To be called after each other call.
    pub fn take_station_outputs(&mut self) -> Vec<StationOutput> {
        self.stations.take_outputs()
    }

    /// Cuts another station off for good, since what it sends is no message of a station. Its
    /// avatars leave.
    pub fn cut_station(&mut self, station: StationId) {
        self.cut_off(station);
    }

    /// Takes in what happened at a moment. What comes of it is told at the next tick. A moment
    /// before that of an earlier call counts as that one.
    pub fn handle(&mut self, now: Duration, input: Input) {
        let now = self.advance(now);
        if self.is_of_guest(&input) {
            return;
        }
        match input {
            Input::Join { avatar, name, colour, place } => {
                self.join(now, avatar, Profile { name, colour }, place);
            }
            Input::Absent { avatar } => self.part(now, avatar),
            Input::Return { avatar, place } => self.come_back(now, avatar, place),
            Input::Leave { avatar } => self.remove(avatar),
            Input::Report { avatar, report } => self.report(now, avatar, &report),
            Input::Relocate { avatar, pose } => self.relocate(now, avatar, pose),
            Input::Respawn { avatar } => self.respawn(now, avatar),
            Input::RoundTrip { avatar, round_trip } => self.set_round_trip(avatar, round_trip),
            Input::Chat { avatar, text } => self.chat(avatar, &text),
        }
    }

    /// Decides for a moment, and appends what every client is to be told. Orders and corrections
    /// come first, then what each viewer sees, by viewer. A moment before that of an earlier call
    /// counts as that one.
    ///
    /// Ticks are numbered by time, one for each [`Config::tick`]. A call that comes late skips the
    /// numbers of those that were left out, so a host that cannot keep up may call less often.
    pub fn tick(&mut self, now: Duration, outputs: &mut Vec<Output>) {
        let now = self.advance(now);
        self.tick = self.number_at(now);
        self.rounds = self.rounds.wrapping_add(1);
        self.silence_budget.left = self.config.silence_budget;
        let first = outputs.len();
        self.hear_stations();
        outputs.append(&mut self.pending);
        for id in self.silencing().expire(outputs) {
            self.expel(id, "it does not answer");
        }
        outputs.append(&mut self.pending);
        let live: Vec<Slot> = self.population.live().collect();
        self.horizons.count_silent(self.population.hidden_round_trips());
        if self.config.policy == Policy::Tbv {
            let mut silencing = self.silencing();
            live.iter().for_each(|slot| silencing.reveal(*slot, outputs));
        }
        self.update_interest(outputs);
        self.silencing().settle_all(&live, outputs);
        self.tell_stations(outputs, first);
    }

    /// Decides who is told of whom at this tick.
    fn update_interest(&mut self, outputs: &mut Vec<Output>) {
        let Self { building, config, horizons, stations, population, pool, indices, .. } = self;
        let (now, tick, rounds) = (self.now, self.tick, self.rounds);
        let context = TickContext { building, config, horizons, stations, now, tick, rounds };
        let mut snapshot = Snapshot::take(context, population);
        if config.policy.uses_cells() {
            snapshot.update_regions(context, pool, &mut indices.coarse);
            interest::update_pairs(context, pool, &indices.coarse, &mut snapshot);
        }
        let mut inputs = CertificateInputs::new(context, &snapshot);
        if config.policy.uses_cells() {
            let budget = &mut self.sight_budget;
            let ticks = interest::test_pairs(context, pool, &inputs, &mut snapshot, budget);
            inputs.queue_for(ticks);
        }
        let told = interest::notify(context, pool, &inputs, &mut snapshot);
        let distances = snapshot.distances(context.rounds);
        interest::update_nearest(population, context.rounds, &distances);
        interest::count_watchers(population, &told);
        outputs.extend(told);
    }

    /// The number of a tick at a moment: that of the nearest moment at which a tick is due.
    fn number_at(&mut self, now: Duration) -> u32 {
        let first = *self.first_tick.get_or_insert(now);
        let passed = now.saturating_sub(first) + self.config.tick / 2;
        let due = passed.as_nanos() / self.config.tick.as_nanos().max(1);
        let due = u32::try_from(due).unwrap_or(u32::MAX - 1) + 1;
        let next = self.tick.saturating_add(1);
        due.clamp(next, next.saturating_add(SKIPPED_MAX))
    }

    /// Moves time forward. It never goes back, and ends before sums of times overflow.
    pub(crate) fn advance(&mut self, now: Duration) -> Duration {
        self.now = self.now.max(now.min(NOW_MAX));
        debug_assert!(self.now <= NOW_MAX, "sums of times do not overflow");
        self.now
    }

    /// The time of the last call.
    pub(crate) fn now(&self) -> Duration {
        self.now
    }

    pub(crate) fn context(&self) -> TickContext<'_> {
        let Self { building, config, horizons, stations, now, tick, rounds, .. } = self;
        TickContext {
            building,
            config,
            horizons,
            stations,
            now: *now,
            tick: *tick,
            rounds: *rounds,
        }
    }

    /// What changes when avatars are silenced, asked and woken.
    pub(crate) fn silencing(&mut self) -> Silencing<'_> {
        let Self { building, config, horizons, stations, now, tick, rounds, .. } = self;
        let (now, tick, rounds) = (*now, *tick, *rounds);
        Silencing {
            context: TickContext { building, config, horizons, stations, now, tick, rounds },
            population: &mut self.population,
            indices: &mut self.indices,
            deadlines: &mut self.deadlines,
            workspace: &mut self.workspace,
            budget: &mut self.silence_budget,
            stats: &mut self.stats,
            pending: &mut self.pending,
        }
    }
}

/// Questions about the present state.
impl Engine {
    /// Why a viewer is told of an avatar, or is not, as of the last tick; `None` when one of the
    /// two is not present.
    pub fn explain(&self, viewer: AvatarId, avatar: AvatarId) -> Option<Explanation> {
        interest::explain(self.context(), &self.population, viewer, avatar)
    }

    /// The avatars that a viewer's client has been told of, by id.
    pub fn held_by(&self, viewer: AvatarId) -> impl Iterator<Item = AvatarId> + '_ {
        self.population.held_by(viewer)
    }

    /// What is expected of an avatar's client; `None` when the avatar is not present.
    pub fn state(&self, avatar: AvatarId) -> Option<ReportingState> {
        self.population.find(avatar).map(|avatar| avatar.state)
    }

    /// By how much an avatar may be off the course that its client reported, as far as the engine
    /// knows what the client has been told.
    pub fn tolerance(&self, avatar: AvatarId) -> Option<Tolerance> {
        self.population.find(avatar).map(|avatar| avatar.orders.in_force())
    }

    /// Until when an avatar's client is taken to have said, by its silence, that its avatar is on
    /// course; `None` when it is taken to have said nothing since its last report.
    pub fn known_course(&self, avatar: AvatarId) -> Option<KnownCourse> {
        self.population.find(avatar).and_then(|avatar| avatar.known_course(self.context()))
    }

    /// By how much a viewer may be shown an avatar at a distance off the course that its client
    /// reported. Both are in metres.
    pub fn acuity_m(&self, viewer: AvatarId, away_m: f32) -> f32 {
        let crowd = self.population.find(viewer).map_or(0, |viewer| viewer.pairs.len());
        Acuity::in_crowd(&self.building.world, away_m, crowd).metres
    }

    /// Where a quiet or asked avatar is sure to be.
    pub fn tbv(&self, avatar: AvatarId) -> Option<Tbv> {
        self.population.find(avatar).and_then(|avatar| avatar.tbv)
    }

    /// Where an avatar's eye is, as far as its client has said: in its TBV, or else near where its
    /// course has led it, up to a wall. It holds for the time of the last call. `None` when the
    /// avatar is not present.
    pub fn whereabouts(&self, avatar: AvatarId) -> Option<Tbv> {
        let known = self.population.find(avatar)?;
        let near_course = || {
            let (axes, agility) = (*self.building.axes(), &self.building.agility);
            let silent = self.now.saturating_sub(known.heard_at).min(known.course_for);
            let course = known.pose.on_course(silent, agility);
            let way = Aabb::from_points([known.pose.eye, course.eye].map(|eye| axes.own(eye)));
            let within = way.grown(agility.speed_max * ON_ITS_WAY_S);
            Tbv { within, axes, expiry: self.now, notice: Duration::ZERO }
        };
        Some(known.tbv.unwrap_or_else(near_course))
    }

    /// The last accepted pose of an avatar.
    pub fn pose(&self, avatar: AvatarId) -> Option<Pose> {
        self.population.find(avatar).map(|avatar| avatar.pose)
    }

    /// When the last accepted pose of an avatar came in, on the clock of the station that the
    /// avatar belongs to.
    pub fn heard(&self, avatar: AvatarId) -> Option<Duration> {
        self.population.find(avatar).map(|avatar| avatar.heard_at)
    }

    /// The round trip of an avatar's client that the engine was told last.
    pub fn round_trip(&self, avatar: AvatarId) -> Option<Duration> {
        self.population.find(avatar).map(|avatar| avatar.round_trip)
    }

    /// By how much messages of an avatar's client may take longer than half of its round trip.
    pub fn margin(&self, avatar: AvatarId) -> Option<Duration> {
        self.population.find(avatar).map(|avatar| avatar.arrivals.margin())
    }

    /// A viewer and an avatar that count as hidden from each other although what was found of them
    /// does not hold any more. There is none, unless a test injects a fault.
    #[doc(hidden)]
    pub fn stale_pair(&self) -> Option<[AvatarId; 2]> {
        interest::find_stale(&self.population)
    }

    /// Whether an avatar has moved against its own claims, a short while before a moment.
    pub fn is_doubted(&self, now: Duration, avatar: AvatarId) -> bool {
        let avatar = self.population.find(avatar);
        avatar.is_some_and(|avatar| !avatar.consistency.is_consistent(now))
    }

    /// All avatars of this station, by id.
    pub fn avatars(&self) -> impl Iterator<Item = AvatarId> + '_ {
        self.population.own().map(|member| member.id)
    }

    /// The avatars of other stations that this one knows of, by id, and whether it follows their
    /// courses.
    pub fn guests(&self) -> impl Iterator<Item = (AvatarId, bool)> + '_ {
        let is_live = |slot| self.population.at(slot).is_live();
        self.population.guests().map(move |member| (member.id, is_live(member.slot)))
    }

    /// The other stations that take in what this one says, by name.
    pub fn neighbours(&self) -> impl Iterator<Item = StationId> + '_ {
        self.stations.ready().map(|(station, _)| station)
    }

    /// The stations that were cut off, because they lied or flooded.
    pub fn cut_stations(&self) -> impl Iterator<Item = StationId> + '_ {
        self.stations.cut()
    }

    /// How long a message to or from the farthest other station takes at most.
    pub fn bus_delay(&self) -> Duration {
        self.stations.abroad().bus
    }

    /// How many sectors there are, and to how many of them this station subscribes.
    pub fn sectors(&self) -> [usize; 2] {
        [self.building.sectors.len(), self.stations.subscription.len()]
    }

    /// How many clients of this station are in each reporting state.
    pub fn counts(&self) -> Counts {
        if self.stations.are_several() {
            let mut counts = Counts::default();
            for member in self.population.own() {
                match self.population.at(member.slot).state {
                    ReportingState::Live => counts.live += 1,
                    ReportingState::Quiet => counts.quiet += 1,
                    ReportingState::Asked => counts.asked += 1,
                }
            }
            return counts;
        }
        let live = self.population.live_len();
        let quiet = self.deadlines.expiries.len();
        assert!(live + quiet <= self.population.len(), "every client is in one state");
        Counts { live, quiet, asked: self.population.len() - live - quiet }
    }

    /// Sets what all sight tests of a tick may cost from now on: see
    /// [`Config::sight_test_budget`]. A host that cannot keep up lowers it.
    pub fn set_sight_test_budget(&mut self, units: u32) {
        self.config = std::mem::take(&mut self.config).with_sight_test_budget(units).bounded();
    }

    /// The number of the last tick; the first is 1. A late tick skips numbers.
    pub fn ticks(&self) -> u32 {
        self.tick
    }

    /// How often each event has happened.
    pub fn stats(&self) -> Stats {
        self.stats
    }

    /// The configuration, with all values in range.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The world that the engine decides for.
    pub fn world(&self) -> &Arc<World> {
        &self.building.world
    }

    /// What every body is believed to be able to do.
    pub fn agility(&self) -> Agility {
        self.building.agility
    }

    /// What claims are held against.
    pub fn limits(&self) -> ClaimLimits {
        self.building.limits
    }

    /// The top speed of avatars, in metres a second.
    pub fn speed_max(&self) -> f32 {
        self.building.agility.speed_max
    }
}
