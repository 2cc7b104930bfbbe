//! The visibility engine: a pure state machine. Inputs and a clock in, outputs out.
//!
//! [`Engine::handle`] takes in what clients say, [`Engine::tick`], called at a fixed rate, gives what
//! they are to be told. The engine opens no socket, reads no clock and draws no random numbers: the
//! same calls give the same outputs, bit for bit. Time is what has passed since the server's start.
//!
//! An avatar is *live* while somebody may see it or it may see somebody; otherwise it is *quiet*
//! in a TBV, and *asked* when that expires or is revealed. A client begins live. Why nothing is
//! missed and what bounds that is in [`horizon`](self#how-far-ahead).
//!
//! # How far ahead
//!
//! Interest is decided for regions, not for points: where each eye and each body can be until the
//! word of the next tick stands at the viewer. The proof that this misses nothing, and the exact
//! times, are at the head of `horizon.rs`.
//!
//! ```
//! # use std::{sync::Arc, time::Duration};
//! # use sightline_server::engine::{Config, Engine, Input};
//! # use sightline_shared::{motion::AvatarId, world::World};
//! fn one_visitor(world: Arc<World>) {
//!     let mut engine = Engine::new(world, Config::default());
//!     let (avatar, name) = (AvatarId(1), "Ada".to_owned());
//!     engine.handle(Duration::ZERO, Input::Join { avatar, name, colour: [255, 0, 0], place: None });
//!     let mut outputs = Vec::new();
//!     engine.tick(Duration::ZERO, &mut outputs);
//!     assert_eq!(outputs.len(), 2); // Entered; and Quiet, for nobody else is there.
//! }
//! ```

mod authority;
mod bits;
mod config;
mod crew;
mod expiry;
mod explain;
mod fit;
mod horizon;
mod interest;
mod jitter;
mod looks;
mod messages;
mod near;
mod pairs;
mod parts;
mod places;
mod pledge;
mod population;
mod presence;
mod reach;
mod scene;
mod silence;
#[cfg(test)]
mod tests;
mod validity;
mod ways;
mod zones;

use std::{sync::Arc, time::Duration};

use sightline_shared::{
    motion::{Agility, AvatarId, Body, Pose, Tbv},
    rooms::RoomIndex,
    shaft::Occluders,
    world::World,
};

pub use config::{Config, Margin, Policy, PolicyError, Sabotage, Shape, Validity};
pub use explain::{Explanation, Reason};
pub use messages::{Input, Output};
pub use population::ClientState;

use authority::Limits;
use crew::Crew;
use expiry::ExpiryQueue;
use horizon::Horizons;
use looks::Shafts;
use places::Places;
use population::{Population, Slot};
use reach::Scratch;
use scene::{Scene, Stand};
use ways::Ways;
use zones::{SectorIndex, Sectors, ZoneIndex};

/// The end of time: ten thousand years.
const NOW_MAX: Duration = Duration::from_secs(10_000 * 365 * 86_400);

/// Decides who is told what and who is asked when.
#[derive(Clone, Debug)]
pub struct Engine {
    world: Arc<World>,
    config: Config,
    limits: Limits,
    horizons: Horizons,
    population: Population,
    places: Places,
    agility: Agility,
    /// What the building's author says about who may see whom.
    rooms: RoomIndex,
    /// Every avatar's, in own axes.
    body: Body,
    /// The wide regions of live avatars, of their eyes and of their bodies, by cells.
    near: [SectorIndex; 2],
    sectors: Sectors,
    /// Where live avatars can be until a hidden one that they reveal can be told of.
    live_zones: ZoneIndex,
    /// The TBVs of quiet and asked avatars.
    hidden_zones: ZoneIndex,
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
    ways: Ways,
    shafts: Shafts,
    crew: Crew,
    /// Empty but for its memory.
    scene: Scene,
    /// How many times more looks were due at the last tick than there is a budget for, from 1 to 8.
    load: u32,
    /// At which viewers the budget for looks was used up: for new pairs, and for those that are told.
    looked_to: [Stand; 2],
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
    /// Of these, those of bodies that had moved as no body can by itself: pushed, or thrown.
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
            limits: Limits {
                confines: world.confines(),
                speed_max,
                fall_max: agility.fall_max,
                refusals_max: config.refusals_max,
                refusal_window: config.refusal_window,
            },
            horizons: Horizons::new(&config),
            agility,
            body: world.cells.axes.own_body(&world.body),
            population: Population::default(),
            places: Places::new(config.policy, &world),
            rooms: RoomIndex::new(&world),
            near: [0, 1].map(|_| SectorIndex::new(world.cells.cells.len())),
            live_zones: ZoneIndex::new(sectors.len()),
            hidden_zones: ZoneIndex::new(sectors.len()),
            sectors,
            expiries: ExpiryQueue::new(config.tick),
            patience: ExpiryQueue::new(config.tick),
            pending: Vec::new(),
            now: Duration::ZERO,
            ticks: 0,
            joined: 0,
            stats: Stats::default(),
            scratch: Scratch::default(),
            ways: Ways::new(&world, agility.fall_max / speed_max),
            settled_to: AvatarId(0),
            silence_left: 0,
            crew: Crew::new(config.threads, Arc::clone(&occluders)),
            scene: Scene::default(),
            load: 1,
            looked_to: [(None, AvatarId(0)); 2],
            shafts: Shafts::new(occluders),
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

    /// What an avatar's client does; `None` when there is no such avatar.
    pub fn state(&self, avatar: AvatarId) -> Option<ClientState> {
        self.population.find(avatar).map(|a| a.state)
    }

    /// Where a quiet or asked avatar is sure to be.
    pub fn tbv(&self, avatar: AvatarId) -> Option<Tbv> {
        self.population.find(avatar).and_then(|a| a.state.tbv().copied())
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

    /// No avatar is believed to move faster, in metres a second.
    pub fn speed_max(&self) -> f32 {
        self.agility.speed_max
    }
}
