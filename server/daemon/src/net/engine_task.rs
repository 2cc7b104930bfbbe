//! The task that owns the engine: the inputs of all clients go in, outputs go to their outboxes.

use std::{
    collections::BTreeMap,
    sync::Arc,
    time::{Duration, Instant},
};

use glam::Vec3;
use sightline_engine::{Engine, Input, Output};
use sightline_world::motion::AvatarId;
use tokio::{sync::mpsc, time::MissedTickBehavior};

use super::client::ConnectedClient;
use crate::operate::TickMetrics;

/// The most events that may wait for the engine. A client whose event finds no room waits, so that
/// its own stream stops and nobody else's.
pub const EVENTS_MAX: usize = 4_096;
/// How often the engine is told the clients' round trips.
const ROUND_TRIP_INTERVAL: Duration = Duration::from_secs(1);

/// What a client's task tells the engine's task.
pub enum EngineEvent {
    /// A client wants to enter the world.
    Join {
        /// The client.
        client: Arc<ConnectedClient>,
        /// The name that others see.
        name: String,
        /// The avatar's colour, sRGB.
        colour: [u8; 3],
        /// Where it wants its eye; a spawn point when `None`.
        place: Option<Vec3>,
    },
    /// A client in the world did something.
    Input(Input),
    /// A client has gone, whether or not it had entered.
    Leave(AvatarId),
}

/// The engine, and the clients in the world.
pub struct EngineTask {
    engine: Engine,
    clients: BTreeMap<AvatarId, Arc<ConnectedClient>>,
    /// When the server's time was zero.
    started: Instant,
    tick: u32,
    /// When the engine is next told the clients' round trips.
    round_trips_due: Duration,
    metrics: Arc<TickMetrics>,
    /// Kept from tick to tick for its memory only.
    outputs: Vec<Output>,
}

impl EngineTask {
    /// A task whose clock starts at `started`.
    pub fn new(engine: Engine, started: Instant, metrics: Arc<TickMetrics>) -> Self {
        let (clients, round_trips_due) = (BTreeMap::new(), Duration::ZERO);
        Self { engine, clients, started, tick: 0, round_trips_due, metrics, outputs: Vec::new() }
    }

    /// Runs until no sender of events is left. The engine ticks once each `interval`.
    pub async fn run(mut self, mut events: mpsc::Receiver<EngineEvent>, interval: Duration) {
        let mut ticks = tokio::time::interval(interval);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        loop {
            // Ticks come first, so that no flood of events holds them up.
            tokio::select! {
                biased;
                _ = ticks.tick() => self.tick(),
                event = events.recv() => match event {
                    Some(event) => self.take(event),
                    None => return,
                },
            }
        }
    }

    fn now(&self) -> Duration {
        self.started.elapsed()
    }

    fn take(&mut self, event: EngineEvent) {
        let now = self.now();
        match event {
            EngineEvent::Join { client, name, colour, place } => {
                let avatar = client.avatar;
                // The handshake has measured the round trip already.
                let round_trip = client.connection.rtt();
                let before = self.clients.insert(avatar, client);
                debug_assert!(before.is_none(), "a session enters once");
                self.engine.handle(now, Input::Join { avatar, name, colour, place });
                self.engine.handle(now, Input::RoundTrip { avatar, round_trip });
            }
            EngineEvent::Input(input) => self.engine.handle(now, input),
            EngineEvent::Leave(avatar) => {
                if self.clients.remove(&avatar).is_some() {
                    self.engine.handle(now, Input::Leave { avatar });
                }
            }
        }
    }

    fn tick(&mut self) {
        let begin = Instant::now();
        let now = self.now();
        self.tell_round_trips(now);
        self.tick = self.tick.wrapping_add(1);
        let mut outputs = std::mem::take(&mut self.outputs);
        debug_assert!(outputs.is_empty(), "every output was handed out");
        self.engine.tick(now, &mut outputs);
        for output in outputs.drain(..) {
            if let Some(client) = self.clients.get(&output.to()) {
                client.outbox.tell(&output, now);
            }
        }
        for client in self.clients.values() {
            client.outbox.flush(self.tick);
        }
        self.outputs = outputs;
        self.metrics.record(begin.elapsed(), self.engine.counts(), self.engine.stats());
    }

    fn tell_round_trips(&mut self, now: Duration) {
        if now < self.round_trips_due {
            return;
        }
        self.round_trips_due = now + ROUND_TRIP_INTERVAL;
        for (&avatar, client) in &self.clients {
            let round_trip = client.connection.rtt();
            self.engine.handle(now, Input::RoundTrip { avatar, round_trip });
        }
    }
}
