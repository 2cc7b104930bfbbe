//! The visibility engine: a pure state machine. Inputs and a clock in, outputs out.
//!
//! [`Engine::handle`] takes in what clients say, [`Engine::tick`], called at a fixed rate, gives what
//! they are to be told. The engine opens no socket, reads no clock and draws no random numbers: the
//! same calls give the same outputs, bit for bit. Time is what has passed since the server's start.
//!
//! An avatar is *live* while somebody may see it or it may see somebody; otherwise it is *quiet*
//! in a TBV (temporal bounding volume), and *asked* when that expires or is revealed. A client begins live.
//!
//! # A host's loop
//!
//! An [`Engine`] is made for a [`World`], which [`World::read`] takes from the file that `sightline-server compile`
//! makes. What then happens is told to it as it happens, as an [`Input`]:
//!
//! 1. [`Join`](Input::Join), by an id that is never used twice.
//! 2. [`RoundTrip`](Input::RoundTrip), whenever it is measured: how far ahead is decided follows from it.
//! 3. [`Report`](Input::Report), once the client was told that it is in: at every tick while it is live, and while it
//!    is quiet when it is asked, or when its TBV does not [hold](Tbv::holds) its next step.
//! 4. [`Relocate`](Input::Relocate), when the host itself puts somebody elsewhere; [`Chat`](Input::Chat).
//! 5. [`Leave`](Input::Leave).
//!
//! Every [`Config::tick`] follows a [`tick`](Engine::tick). Each [`Output`] goes [to](Output::to) one client, in order
//! and without loss. Only of an avatar's poses the earlier may be lost; the last may not, since who stands still has
//! no news:
//!
//! 1. [`Entered`](Output::Entered) comes first. [`Drop`](Output::Drop) comes last: the avatar is gone already.
//! 2. [`Live`](Output::Live), [`Quiet`](Output::Quiet) and [`Ask`](Output::Ask) say when to report: at every tick, in
//!    no case but those above, once.
//! 3. [`Correct`](Output::Correct) puts a client back whose claim cannot be true.
//! 4. [`Appear`](Output::Appear), then [`Poses`](Output::Poses), then [`Vanish`](Output::Vanish): an avatar may come into
//!    view, is here now, and cannot be seen any more.
//! 5. [`Chat`](Output::Chat) is what somebody in view said, or the client itself.
//!
//! [`Engine::explain`] says why somebody is told of somebody, or is not: which rule decided, where the one's eye and
//! the other's body can be, and the line between them that is free.
//!
//! ```
//! use std::{sync::Arc, time::Duration};
//!
//! use glam::Vec3;
//! use sightline_engine::{Config, Engine, Input, Output};
//! use sightline_world::motion::AvatarId;
//!
//! // Two rooms of 6 m side by side, and a door at one end of the wall between them, at x = 6.
//! let mut engine = Engine::new(Arc::new(sightline_fixtures::two_rooms::world()), Config::default());
//! let (ada, ben) = (AvatarId(1), AvatarId(2));
//! for (avatar, name, x) in [(ada, "Ada", 3.0), (ben, "Ben", 9.0)] {
//!     let (name, colour, place) = (name.to_owned(), [255, 0, 0], Some(Vec3::new(x, 1.6, 5.0)));
//!     engine.handle(Duration::ZERO, Input::Join { avatar, name, colour, place });
//! }
//! let mut outputs = Vec::new();
//! engine.tick(Duration::ZERO, &mut outputs);
//!
//! // Neither can see the other before long, so both are let in, and then may be silent.
//! assert_eq!(outputs.len(), 4);
//! assert!(outputs[..2].iter().all(|output| matches!(output, Output::Entered { .. })));
//! for output in &outputs[2..] {
//!     let Output::Quiet { to, tbv } = output else { panic!("{output:?}") };
//!     assert!(tbv.contains(engine.pose(*to).unwrap().eye));
//! }
//!
//! // Ben walks into the doorway. A client may always say more than it must.
//! outputs.clear();
//! let tick = engine.config().tick;
//! for step in 1..=80 {
//!     for (avatar, goal) in [(ada, Vec3::new(3.0, 1.6, 5.0)), (ben, Vec3::new(6.5, 1.6, 0.5))] {
//!         let mut pose = engine.pose(avatar).unwrap();
//!         pose.velocity = (goal - pose.eye).clamp_length_max(1.5); // In metres a second.
//!         pose.eye += pose.velocity * tick.as_secs_f32();
//!         engine.handle(tick * step, Input::Report { avatar, sequence: step, pose });
//!     }
//!     engine.tick(tick * step, &mut outputs);
//! }
//!
//! // Before they could see each other, each was told of the other.
//! let appear = |output: &&Output| matches!(output, Output::Appear { .. });
//! assert_eq!(outputs.iter().filter(appear).count(), 2);
//! assert!(engine.held_by(ada).eq([ben]) && engine.held_by(ben).eq([ada]));
//! println!("{}", engine.explain(ada, ben).unwrap());
//! ```
//!
//! The example `embed` goes on from there, with clients that keep to what they are told.
//!
//! # How far ahead
//!
//! Interest is decided for regions, not for points: where each eye and each body can be until the
//! word of the next tick stands at the viewer. What follows shows that this misses nothing, and what bounds it.
//!
#![doc = include_str!("timing/horizon.md")]

mod baselines;
mod bit_set;
mod claims;
mod config;
mod interest;
mod messages;
mod population;
mod regions;
mod session_events;
mod silence;
#[cfg(test)]
mod tests;
mod timing;
mod worker_pool;

use std::{sync::Arc, time::Duration};

use sightline_visibility::{box_visibility::Occluders, rooms::RoomIndex};
use sightline_world::{
    World,
    motion::{Agility, AvatarId, Body, Pose, ReportingState, Tbv},
};

pub use claims::movement_budget::{ClaimLimits, ClaimVerdict, MovementBudget};
pub use config::{Config, FaultInjection, Margin, Policy, PolicyError, TbvShape, Validity};
pub use interest::explain::{Explanation, Reason};
pub use messages::{Input, Output};

use baselines::partition::Partition;
use claims::walkability::Walkways;
use interest::sight_tests::SightTester;
use interest::snapshot::{Snapshot, SortKey};
use population::{Population, Slot};
use regions::footprints::{FootprintIndex, SectorIndex, Sectors};
use regions::reach::Scratch;
use silence::expiry_queue::ExpiryQueue;
use timing::horizon::Horizons;
use worker_pool::WorkerPool;

/// The end of time: ten thousand years.
const NOW_MAX: Duration = Duration::from_secs(10_000 * 365 * 86_400);

/// Decides who is told what and who is asked when.
#[derive(Clone, Debug)]
pub struct Engine {
    world: Arc<World>,
    config: Config,
    limits: ClaimLimits,
    horizons: Horizons,
    population: Population,
    places: Partition,
    agility: Agility,
    /// What the building's author says about who may see whom.
    rooms: RoomIndex,
    /// Every avatar's, in own axes.
    body: Body,
    /// The wide regions of live avatars, of their eyes and of their bodies, by cells.
    near: [SectorIndex; 2],
    sectors: Sectors,
    /// Where live avatars can be until a hidden one that they reveal can be told of.
    live_zones: FootprintIndex,
    /// The TBVs of quiet and asked avatars.
    hidden_zones: FootprintIndex,
    /// When each quiet avatar must be asked.
    expiries: ExpiryQueue,
    /// When each other avatar's silence must be looked into.
    patience: ExpiryQueue,
    /// What came of inputs since the last tick.
    pending: Vec<Output>,
    /// That of the last call.
    now: Duration,
    ticks: u32,
    joined: usize,
    stats: Stats,
    scratch: Scratch,
    /// What claims are held against.
    ways: Walkways,
    shafts: SightTester,
    crew: WorkerPool,
    /// Empty but for its memory.
    scene: Snapshot,
    /// How many times more looks were due at the last tick than there is a budget for, from 1 to 8.
    load: u32,
    /// At which viewers the budget for looks was used up: for new pairs, and for those that are told.
    looked_to: [SortKey; 2],
    /// At whom the budget for silences was used up.
    settled_to: AvatarId,
    /// What is left of this tick's [`Config::silence_budget`].
    silence_left: u32,
}

/// How often what happened, since the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Stats {
    /// TBVs that ended.
    pub expiries: u64,
    /// TBVs that came into view.
    pub reveals: u64,
    /// Asks that were repeated for want of an answer, and live clients asked for their silence.
    pub repeats: u64,
    /// Reports accepted.
    pub reports: u64,
    /// Times that the host put an avatar elsewhere, or pushed it: [`Input::Relocate`].
    pub impulses: u64,
    /// Reports refused.
    pub refusals: u64,
    /// Of these, those to which no way leads that is short enough: through walls.
    pub walls: u64,
    /// Clients dropped.
    pub drops: u64,
}

/// How many clients are in which state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counts {
    /// Reporting at every tick.
    pub live: usize,
    /// Silent.
    pub quiet: usize,
    /// About to answer.
    pub asked: usize,
}

impl Engine {
    /// An engine for a world, with nobody in it.
    pub fn new(world: Arc<World>, config: Config) -> Self {
        let config = config.bounded();
        let speed_max = config.speed_max.unwrap_or(world.speed_max);
        let sectors = Sectors::new(&world.cells);
        let occluders = Arc::new(Occluders::new(&world));
        let agility = Agility::of(&world.body, speed_max);
        Self {
            limits: ClaimLimits {
                confines: world.confines(),
                speed_max,
                fall_max: agility.fall_max,
                refusals_max: config.refusals_max,
                refusal_window: config.refusal_window,
            },
            horizons: Horizons::new(&config),
            agility,
            body: world.body.in_axes(&world.cells.axes),
            population: Population::default(),
            places: Partition::new(config.policy, &world),
            rooms: RoomIndex::new(&world),
            near: [0, 1].map(|_| SectorIndex::new(world.cells.cells.len())),
            live_zones: FootprintIndex::new(sectors.len()),
            hidden_zones: FootprintIndex::new(sectors.len()),
            sectors,
            expiries: ExpiryQueue::new(config.tick),
            patience: ExpiryQueue::new(config.tick),
            pending: Vec::new(),
            now: Duration::ZERO,
            ticks: 0,
            joined: 0,
            stats: Stats::default(),
            scratch: Scratch::default(),
            ways: Walkways::new(&world, agility.fall_max / speed_max),
            settled_to: AvatarId(0),
            silence_left: 0,
            crew: WorkerPool::new(config.threads, Arc::clone(&occluders)),
            scene: Snapshot::default(),
            load: 1,
            looked_to: [(None, AvatarId(0)); 2],
            shafts: SightTester::new(occluders),
            world,
            config,
        }
    }

    /// Takes in what happened at a moment; what comes of it is told at the next tick. A moment
    /// before that of an earlier call counts as that one.
    pub fn handle(&mut self, now: Duration, input: Input) {
        let now = self.latest(now);
        match input {
            Input::Join { avatar, name, colour, place } => {
                self.join(now, (avatar, name, colour), place);
            }
            Input::Leave { avatar } => self.remove(avatar),
            Input::Report { avatar, sequence, pose } => self.report(now, avatar, sequence, pose),
            Input::Relocate { avatar, pose } => self.relocate(now, avatar, pose),
            Input::RoundTrip { avatar, round_trip } => self.set_round_trip(avatar, round_trip),
            Input::Chat { avatar, text } => self.chat(avatar, &text),
        }
    }

    /// Decides for a moment and appends what every client is to be told: orders and corrections
    /// first, then what each viewer sees, by id. A moment before that of an earlier call counts as
    /// that one.
    pub fn tick(&mut self, now: Duration, outputs: &mut Vec<Output>) {
        let now = self.latest(now);
        self.ticks = self.ticks.wrapping_add(1);
        self.silence_left = self.config.silence_budget;
        outputs.append(&mut self.pending);
        self.expire(now, outputs);
        outputs.append(&mut self.pending);
        let live: Vec<Slot> = self.population.live().collect();
        if self.config.policy == Policy::Tbv {
            live.iter().for_each(|slot| self.reveal(now, *slot, outputs));
        }
        let mut scene = self.enter(now, &live);
        if self.config.policy.uses_cells() {
            self.place_near(now, &mut scene.lives);
            self.pair(&mut scene);
            self.look(&mut scene);
        }
        self.tell(&mut scene, outputs);
        self.leave(scene);
        self.settle_all(now, &live, outputs);
    }

    /// Time does not go back, and ends before sums of times overflow.
    fn latest(&mut self, now: Duration) -> Duration {
        self.now = self.now.max(now.min(NOW_MAX));
        self.now
    }

    /// Those that a viewer's client has been told of, by id.
    pub fn held_by(&self, viewer: AvatarId) -> impl Iterator<Item = AvatarId> + '_ {
        self.population.held_by(viewer)
    }

    /// What is expected of an avatar's client; `None` when there is no such avatar.
    pub fn state(&self, avatar: AvatarId) -> Option<ReportingState> {
        self.population.find(avatar).map(|a| a.state)
    }

    /// Where a quiet or asked avatar is sure to be.
    pub fn tbv(&self, avatar: AvatarId) -> Option<Tbv> {
        self.population.find(avatar).and_then(|a| a.tbv)
    }

    /// The last accepted pose of an avatar.
    pub fn pose(&self, avatar: AvatarId) -> Option<Pose> {
        self.population.find(avatar).map(|a| a.pose)
    }

    /// The round trip that the engine was told of an avatar's client last.
    pub fn round_trip(&self, avatar: AvatarId) -> Option<Duration> {
        self.population.find(avatar).map(|a| a.round_trip)
    }

    /// How much longer than half of that the client's messages are allowed to take.
    pub fn margin(&self, avatar: AvatarId) -> Option<Duration> {
        self.population.find(avatar).map(|a| a.jitter.margin())
    }

    /// Whether an avatar has moved otherwise than its claims allow, a short while before a moment.
    pub fn is_doubted(&self, now: Duration, avatar: AvatarId) -> bool {
        self.population.find(avatar).is_some_and(|a| !a.pledges.are_kept(now))
    }

    /// Everyone present, ascending.
    pub fn avatars(&self) -> impl Iterator<Item = AvatarId> + '_ {
        self.population.all().map(|(id, _)| id)
    }

    /// How many are in which state.
    pub fn counts(&self) -> Counts {
        let live = self.population.live_len();
        let quiet = self.expiries.len();
        Counts { live, quiet, asked: self.population.len() - live - quiet }
    }

    /// The number of the last tick; the first is 1.
    pub fn ticks(&self) -> u32 {
        self.ticks
    }

    /// How often what happened.
    pub fn stats(&self) -> Stats {
        self.stats
    }

    /// What it was made with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The world that it decides for.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// What every body is believed to be able to do.
    pub fn agility(&self) -> Agility {
        self.agility
    }

    /// What claims are held against.
    pub fn limits(&self) -> ClaimLimits {
        self.limits
    }

    /// No avatar is believed to move faster, in metres a second.
    pub fn speed_max(&self) -> f32 {
        self.agility.speed_max
    }
}
