//! The task that owns the engine: inputs from all clients in, outputs to their outboxes.

use std::{
    collections::BTreeMap,
    sync::Arc,
    time::{Duration, Instant},
};

use glam::Vec3;
use sightline_world::motion::AvatarId;
use tokio::{sync::mpsc, time::MissedTickBehavior};

use super::{Client, stats::Pulse};
use sightline_engine::{Engine, Input, Output};

/// Inputs that may wait for the engine. A client whose input finds no place waits itself, so that
/// its own stream stops and nobody else's.
pub const INPUTS_MAX: usize = 4_096;
/// Round trips are told to the engine so often.
const ROUND_TRIP_INTERVAL: Duration = Duration::from_secs(1);

/// What clients' tasks tell the engine's.
pub enum ToHub {
    /// A client wants in.
    Join {
        /// The client.
        client: Arc<Client>,
        /// How it is called.
        name: String,
        /// sRGB.
        colour: [u8; 3],
        /// Where it wants its eye.
        place: Option<Vec3>,
    },
    /// Something that a client in the world did.
    Input(Input),
    /// A client is gone, whether it was in or not.
    Leave(AvatarId),
}

/// The engine and those who are in.
pub struct Hub {
    engine: Engine,
    clients: BTreeMap<AvatarId, Arc<Client>>,
    started: Instant,
    tick: u32,
    round_trips_at: Duration,
    pulse: Arc<Pulse>,
    /// Kept from tick to tick for its memory only.
    outputs: Vec<Output>,
}

impl Hub {
    /// A hub whose clock starts at `started`.
    pub fn new(engine: Engine, started: Instant, pulse: Arc<Pulse>) -> Self {
        let (clients, round_trips_at) = (BTreeMap::new(), Duration::ZERO);
        Self { engine, clients, started, tick: 0, round_trips_at, pulse, outputs: Vec::new() }
    }

    /// Runs until nobody can tell it anything any more.
    pub async fn run(mut self, mut inputs: mpsc::Receiver<ToHub>, interval: Duration) {
        let mut ticks = tokio::time::interval(interval);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        loop {
            // Ticks first, so that no flood of inputs holds them up.
            tokio::select! {
                biased;
                _ = ticks.tick() => self.tick(),
                input = inputs.recv() => match input {
                    Some(input) => self.take(input),
                    None => return,
                },
            }
        }
    }

    fn now(&self) -> Duration {
        self.started.elapsed()
    }

    fn take(&mut self, input: ToHub) {
        let now = self.now();
        match input {
            ToHub::Join { client, name, colour, place } => {
                let avatar = client.avatar;
                // The handshake has measured it already.
                let round_trip = client.connection.rtt();
                self.clients.insert(avatar, client);
                self.engine.handle(now, Input::Join { avatar, name, colour, place });
                self.engine.handle(now, Input::RoundTrip { avatar, round_trip });
            }
            ToHub::Input(input) => self.engine.handle(now, input),
            ToHub::Leave(avatar) => {
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
        self.pulse.record(begin.elapsed(), self.engine.counts(), self.engine.stats());
    }

    fn tell_round_trips(&mut self, now: Duration) {
        if now < self.round_trips_at {
            return;
        }
        self.round_trips_at = now + ROUND_TRIP_INTERVAL;
        for (&avatar, client) in &self.clients {
            let round_trip = client.connection.rtt();
            self.engine.handle(now, Input::RoundTrip { avatar, round_trip });
        }
    }
}
