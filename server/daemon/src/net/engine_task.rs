//! The thread that owns the engine: the inputs of all clients go in, outputs go to their outboxes.
//!
//! It shares no thread with the network. So a tick that takes long holds up no reading and no
//! sending, and events bear the time at which they were read.

use std::{
    collections::{BTreeMap, VecDeque},
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread,
    time::{Duration, Instant},
};

use glam::Vec3;
use sightline_engine::{Config, Engine, Input, Output, Stats};
use sightline_world::motion::{AvatarId, Tbv};
use tokio::sync::{
    mpsc::{self, error::TryRecvError},
    oneshot,
};

use super::{
    client::{ConnectedClient, FormerPlace},
    config::{Limits, ServeConfig},
    engine_faults::EngineFaults,
    load::Load,
    offers::Offers,
    pace::Pace,
    place_notes::PlaceNotes,
    private_geometry::Whereabouts,
    served_world::ServedWorld,
    survey::Survey,
};
use crate::{
    bus::engine_end::EngineEnd,
    operate::{Metrics, Stages},
};

/// How often the engine is told the clients' round trips.
const ROUND_TRIP_INTERVAL: Duration = Duration::from_secs(1);

/// What a client's task tells the engine's thread.
pub enum EngineEvent {
    /// Another engine takes over, or the first one.
    Change {
        /// An engine that has not ticked.
        engine: Box<Engine>,
        /// The world that it decides for.
        world: ServedWorld,
    },
    /// A client wants to enter a world.
    Join(Newcomer),
    /// A client in the world did something.
    Input(Input),
    /// The link to a client broke, or another client takes its place.
    Absent {
        /// The client.
        client: Arc<ConnectedClient>,
        /// Is told when it is known where the client was.
        noted: Option<oneshot::Sender<()>>,
    },
    /// A visitor has gone, whether or not it had entered.
    Leave(AvatarId),
    /// An operator wants to see all avatars.
    Survey(oneshot::Sender<Survey>),
    /// An operator wants to see what one viewer sees.
    Look {
        /// The viewer.
        viewer: AvatarId,
        /// Where its eye is, and the avatars that it holds; `None` when it is not in the world.
        reply: oneshot::Sender<Option<(Vec3, Vec<AvatarId>)>>,
    },
    /// It is asked where an avatar is, as far as its client has said.
    Whereabouts {
        /// The avatar.
        avatar: AvatarId,
        /// Is told; `None` when the avatar is not in the world.
        reply: oneshot::Sender<Option<Whereabouts>>,
    },
    /// A fault, injected by a test.
    #[cfg(test)]
    Fault,
}

/// A client that wants to enter a world.
pub struct Newcomer {
    /// The client.
    pub client: Arc<ConnectedClient>,
    /// The number of the world. Another one may have taken its place.
    pub world: u32,
    /// Where its eye is to be. A spawn point when `None`, or where it stood.
    pub place: Option<Vec3>,
}

/// An event, and the server's time at which it was read from the network.
pub struct TimedEvent {
    pub at: Duration,
    pub event: EngineEvent,
}

/// The engine, and the clients in its world.
pub struct EngineTask {
    /// `None` until there is a world.
    engine: Option<Box<Engine>>,
    /// The number of its world; zero before the first.
    world: u32,
    /// Its world, for an engine that takes over from one that failed.
    served: Option<ServedWorld>,
    engine_config: Config,
    faults: EngineFaults,
    offers: Arc<Offers>,
    clients: BTreeMap<AvatarId, Arc<ConnectedClient>>,
    /// Those who wait for their turn to enter.
    newcomers: VecDeque<Newcomer>,
    /// When the server's time was zero.
    started: Instant,
    /// When the engine is next told the clients' round trips.
    round_trips_due: Duration,
    pace: Pace,
    /// The sight-test budget at the full rate.
    sight_test_budget: u32,
    limits: Limits,
    load: Arc<Load>,
    metrics: Arc<Metrics>,
    /// What engines before this one counted.
    counted: Stats,
    places: PlaceNotes,
    /// The bus to other stations, if there is one.
    bus: Option<EngineEnd>,
    /// Kept from tick to tick for its memory only.
    outputs: Vec<Output>,
}

impl EngineTask {
    /// A task without a world, whose clock starts at `started`. Its engines have this
    /// configuration.
    pub fn new(
        config: &ServeConfig,
        offers: Arc<Offers>,
        started: Instant,
        load: Arc<Load>,
        metrics: Arc<Metrics>,
        places: PlaceNotes,
        bus: Option<EngineEnd>,
    ) -> Self {
        Self {
            clients: BTreeMap::new(),
            newcomers: VecDeque::new(),
            started,
            round_trips_due: Duration::ZERO,
            pace: Pace::new(config.tick_interval()),
            sight_test_budget: config.sight_test_budget,
            limits: config.limits.clone(),
            engine: None,
            world: 0,
            served: None,
            engine_config: config.engine(),
            faults: EngineFaults::default(),
            offers,
            load,
            metrics,
            counted: Stats::default(),
            places,
            bus,
            outputs: Vec::new(),
        }
    }

    /// Runs until it is told to stop, no sender of events is left, or the engine fails too often.
    pub fn run(mut self, mut events: mpsc::Receiver<TimedEvent>, stop: &AtomicBool) {
        let mut due = Instant::now();
        loop {
            thread::sleep(due.saturating_duration_since(Instant::now()));
            if stop.load(Relaxed) {
                return;
            }
            let begin = Instant::now();
            let late = begin.saturating_duration_since(due);
            let step = catch_unwind(AssertUnwindSafe(|| self.step(begin, &mut events)));
            let goes_on = step.unwrap_or_else(|_| self.begin_anew());
            if !goes_on {
                return;
            }
            let spent = begin.elapsed();
            if self.pace.take(spent.max(late / 2)) {
                self.change_pace();
            }
            // A tick that is late by more than its time is left out, so that the network is never
            // without a processor.
            due = (due + self.pace.interval()).max(begin + spent + self.pace.interval() / 8);
        }
    }

    /// Takes in what waits, and ticks. Returns whether any sender of events is left.
    fn step(&mut self, begin: Instant, events: &mut mpsc::Receiver<TimedEvent>) -> bool {
        let goes_on = self.take_all(events);
        if goes_on {
            self.tick(begin, begin.elapsed());
        }
        goes_on
    }

    /// The engine panicked: another one takes over, and visitors come back to where they were.
    /// Returns whether it does.
    fn begin_anew(&mut self) -> bool {
        self.metrics.count_engine_fault();
        let may = self.faults.take(self.now());
        let Some(world) = self.served.clone().filter(|_| may) else {
            tracing::error!("the engine failed");
            return false;
        };
        tracing::error!("the engine failed: the world begins anew");
        // An engine that has failed may fail again when it is asked where visitors are.
        let noted = catch_unwind(AssertUnwindSafe(|| self.note_places()));
        if noted.is_err() {
            tracing::warn!("where visitors were is not known: they begin at spawn points");
        }
        self.clients.clear();
        let engine = Engine::new(world.world().clone(), self.engine_config.clone());
        self.change(Box::new(engine), world);
        true
    }

    fn now(&self) -> Duration {
        self.started.elapsed()
    }

    /// Takes in all events that wait. Returns whether any sender is left.
    fn take_all(&mut self, events: &mut mpsc::Receiver<TimedEvent>) -> bool {
        // No more than these, or a flood of events would hold the tick up.
        for _ in 0..self.limits.events_max {
            match events.try_recv() {
                Ok(TimedEvent { at, event }) => {
                    self.hear_bus(self.started + at);
                    self.take(at, event);
                }
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => return false,
            }
        }
        self.hear_bus(Instant::now());
        let now = self.now();
        for _ in 0..self.limits.joins_per_tick {
            let Some(newcomer) = self.newcomers.pop_front() else { break };
            self.enter(now, newcomer);
        }
        true
    }

    /// Takes in what other stations have said up to a moment.
    fn hear_bus(&mut self, until: Instant) {
        if let (Some(bus), Some(engine)) = (&mut self.bus, &mut self.engine) {
            bus.hear(engine, self.started, until);
        }
    }

    fn take(&mut self, at: Duration, event: EngineEvent) {
        match event {
            EngineEvent::Change { engine, world } => self.change(engine, world),
            EngineEvent::Join(newcomer) => self.newcomers.push_back(newcomer),
            EngineEvent::Input(input) => {
                if let Some(engine) = &mut self.engine {
                    engine.handle(at, input);
                }
            }
            EngineEvent::Absent { client, noted } => {
                self.miss(at, &client);
                // Who waits for it may have gone meanwhile.
                noted.map(|noted| noted.send(()));
            }
            EngineEvent::Leave(avatar) => {
                self.forget_newcomers(|client| client.avatar() == avatar);
                let client = self.clients.remove(&avatar);
                if let Some(engine) = &mut self.engine {
                    if let Some(client) = client {
                        self.places.note_last(engine, &client);
                    }
                    engine.handle(at, Input::Leave { avatar });
                }
            }
            // Who asked may have gone meanwhile.
            EngineEvent::Survey(reply) => drop(reply.send(self.survey())),
            EngineEvent::Look { viewer, reply } => drop(reply.send(self.look(viewer))),
            EngineEvent::Whereabouts { avatar, reply } => {
                let _ = reply.send(self.whereabouts(avatar));
            }
            #[cfg(test)]
            EngineEvent::Fault => panic!("a fault, injected by a test"),
        }
    }

    /// The link to a client broke. Where it was is noted, so that it can go on there.
    fn miss(&mut self, at: Duration, client: &Arc<ConnectedClient>) {
        self.forget_newcomers(|newcomer| Arc::ptr_eq(newcomer, client));
        let avatar = client.avatar();
        let is_here = self.clients.get(&avatar).is_some_and(|here| Arc::ptr_eq(here, client));
        if is_here && let Some(engine) = &mut self.engine {
            self.clients.remove(&avatar);
            let region = engine.whereabouts(avatar);
            engine.handle(at, Input::Absent { avatar });
            note_place(engine, client, region, self.world);
            self.places.note_last(engine, client);
        }
    }

    /// Nobody waits any more for these clients to enter.
    fn forget_newcomers(&mut self, gone: impl Fn(&Arc<ConnectedClient>) -> bool) {
        let before = self.newcomers.len();
        self.newcomers.retain(|newcomer| !gone(&newcomer.client));
        self.load.entered(before - self.newcomers.len());
    }

    fn survey(&self) -> Survey {
        let interval = self.pace.interval();
        let engine = self.engine.as_ref();
        engine.map_or(Survey { interval, ..Survey::default() }, |engine| {
            Survey::take(engine, interval)
        })
    }

    fn look(&self, viewer: AvatarId) -> Option<(Vec3, Vec<AvatarId>)> {
        let engine = self.engine.as_ref()?;
        Some((engine.pose(viewer)?.eye, engine.held_by(viewer).collect()))
    }

    fn whereabouts(&self, avatar: AvatarId) -> Option<Whereabouts> {
        let engine = self.engine.as_ref()?;
        Some(Whereabouts { eye: engine.pose(avatar)?.eye, region: engine.whereabouts(avatar)? })
    }

    /// Ends the present world and begins another. All clients are told, and the server remembers
    /// where each was, so that it can go on there.
    pub fn change(&mut self, engine: Box<Engine>, world: ServedWorld) {
        self.note_places();
        self.clients.clear();
        let ticks = self.engine.as_ref().map_or(0, |engine| engine.ticks());
        self.counted += self.engine.as_ref().map_or(Stats::default(), |engine| engine.stats());
        let engine = match &mut self.bus {
            Some(bus) => bus.begin(*engine, world.id()),
            None => *engine,
        };
        let mut engine = engine.counting_from(ticks);
        engine.set_sight_test_budget(self.sight_test_budget / self.pace.factor());
        self.engine = Some(Box::new(engine));
        let title = world.world().title.clone();
        self.places.change_building(&title);
        self.served = Some(world.clone());
        self.world = self.offers.change_world(world);
        tracing::info!(world = self.world, title, "serving");
    }

    /// Notes where all visitors are, so that they can go on there.
    fn note_places(&self) {
        let Some(engine) = &self.engine else { return };
        for client in self.clients.values() {
            note_place(engine, client, engine.whereabouts(client.avatar()), self.world);
        }
    }

    fn enter(&mut self, now: Duration, newcomer: Newcomer) {
        let Newcomer { client, world, place } = newcomer;
        let visit = client.visit.clone();
        let avatar = visit.avatar;
        self.load.entered(1);
        // A client that comes for a world that is gone has been told of the next one. One that was
        // replaced while it waited would take the avatar back.
        let may_enter = world == self.world && !client.is_replaced();
        let Some(engine) = self.engine.as_mut().filter(|_| may_enter) else { return };
        // The handshake has measured the round trip already.
        let round_trip = client.transport.round_trip();
        self.offers.tell_of_stations(&client);
        self.clients.insert(avatar, client);
        visit.enter();
        let is_back = engine.state(avatar).is_some();
        engine.handle(
            now,
            match is_back {
                true => Input::Return { avatar, place },
                false => {
                    let (name, colour) = (visit.name.to_string(), visit.colour);
                    Input::Join { avatar, name, colour, place }
                }
            },
        );
        engine.handle(now, Input::RoundTrip { avatar, round_trip });
    }

    /// Ticks the engine, and hands out what it says. The events before took `taken`.
    fn tick(&mut self, begin: Instant, taken: Duration) {
        let now = self.now();
        self.tell_round_trips(now);
        let Some(engine) = &mut self.engine else { return };
        let mut outputs = std::mem::take(&mut self.outputs);
        debug_assert!(outputs.is_empty(), "every output was handed out");
        engine.tick(now, &mut outputs);
        if let Some(bus) = &mut self.bus {
            bus.say(engine);
        }
        let ticked = begin.elapsed();
        for output in outputs.drain(..) {
            if let Some(client) = self.clients.get(&output.to()) {
                client.outbox.tell(&output, now);
            }
        }
        let number = engine.ticks();
        let bytes_per_s = self.limits.bytes_per_s_of_each(self.clients.len());
        for client in self.clients.values() {
            client.outbox.flush(number, bytes_per_s);
        }
        self.places.note_all(now, engine, &self.clients);
        self.outputs = outputs;
        let stages = Stages { taken, ticked: ticked - taken, told: begin.elapsed() - ticked };
        let mut stats = self.counted;
        stats += engine.stats();
        self.metrics.ticks.record(stages, engine.counts(), stats);
    }

    /// Takes in that ticks are made at another rate.
    fn change_pace(&mut self) {
        let (step, interval) = (self.pace.step(), self.pace.interval());
        if let Some(engine) = &mut self.engine {
            engine.set_sight_test_budget(self.sight_test_budget / self.pace.factor());
        }
        let was = self.load.set_step(step);
        let tick_hz = 1.0 / interval.as_secs_f64();
        if step > was {
            tracing::warn!(tick_hz, "overload: ticks take too long, so the rate falls");
        } else {
            tracing::info!(tick_hz, "the rate rises again");
        }
    }

    fn tell_round_trips(&mut self, now: Duration) {
        let Some(engine) = &mut self.engine else { return };
        if now < self.round_trips_due {
            return;
        }
        self.round_trips_due = now + ROUND_TRIP_INTERVAL;
        for (&avatar, client) in &self.clients {
            let round_trip = client.transport.round_trip();
            engine.handle(now, Input::RoundTrip { avatar, round_trip });
        }
        let round_trips = self.clients.values().map(|client| client.transport.round_trip());
        self.metrics.ticks.record_round_trips(round_trips);
    }
}

/// Notes where a client is, so that it can go on there.
fn note_place(engine: &Engine, client: &ConnectedClient, region: Option<Tbv>, world: u32) {
    if let (Some(region), Some(pose)) = (region, engine.pose(client.avatar())) {
        client.visit.set_former(FormerPlace { eye: pose.eye, region, world });
    }
}

#[cfg(test)]
mod tests;
