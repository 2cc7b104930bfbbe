//! The engine's end of the bus: what other stations say goes in, and what they are told comes out.

use std::{
    collections::BTreeMap,
    sync::Arc,
    time::{Duration, Instant},
};

use sightline_engine::{Engine, StationId, StationOutput};
use sightline_protocol::bus::Parcels;
use sightline_world::ContentId;
use tokio::sync::mpsc;

use super::{Arrived, Outgoing, Served, world_name};
use crate::operate::{BusCounters, BusDrop, BusGauges};

/// The engine's end of the bus. It never waits.
pub(crate) struct EngineEnd {
    station: StationId,
    outgoing: mpsc::Sender<Outgoing>,
    incoming: mpsc::Receiver<Arrived>,
    /// What came in, and whose turn it is not yet.
    next: Option<Arrived>,
    served: Served,
    /// Whether the other end has been told of that world.
    is_told: bool,
    counters: Arc<BusCounters>,
}

impl EngineEnd {
    pub(super) fn new(
        station: StationId,
        outgoing: mpsc::Sender<Outgoing>,
        incoming: mpsc::Receiver<Arrived>,
        counters: Arc<BusCounters>,
    ) -> Self {
        let served = Served::default();
        Self { station, outgoing, incoming, next: None, served, is_told: true, counters }
    }

    /// Makes an engine that has not ticked a station that serves a world, which takes the place of
    /// the one before.
    pub fn begin(&mut self, engine: Engine, world: &ContentId) -> Engine {
        self.served = Served { number: self.served.number + 1, name: world_name(world) };
        self.is_told = false;
        engine.as_station(self.station)
    }

    /// Takes in what other stations have said up to a moment, in the order of arrival. `started` is
    /// when the engine's time was zero.
    pub fn hear(&mut self, engine: &mut Engine, started: Instant, until: Instant) {
        while let Some(arrived) = self.next.take().or_else(|| self.incoming.try_recv().ok()) {
            if arrived.at > until {
                self.next = Some(arrived);
                return;
            }
            if arrived.world == self.served.number {
                let at = arrived.at.saturating_duration_since(started);
                self.take(engine, at, arrived);
            }
        }
    }

    fn take(&self, engine: &mut Engine, at: Duration, arrived: Arrived) {
        let Arrived { from, messages, .. } = arrived;
        let Some(messages) = messages else {
            tracing::warn!(station = from.0, "another station was cut off: it sends no messages");
            return engine.cut_station(from);
        };
        for (message, bytes) in messages {
            self.counters.received(message.word.kind_number(), bytes);
            engine.handle_station(at, from, &message);
        }
    }

    /// Sends what other stations must be told. To be called after each tick.
    pub fn say(&mut self, engine: &mut Engine) {
        if !self.is_told {
            let world = Outgoing::World(self.served.clone());
            self.is_told = self.outgoing.try_send(world).is_ok();
        }
        let mut parcels: BTreeMap<Option<StationId>, Parcels> = BTreeMap::new();
        for StationOutput { to, message } in engine.take_station_outputs() {
            let bytes = parcels.entry(to).or_default().push(&message);
            self.counters.sent(message.word.kind_number(), bytes);
        }
        let at = Instant::now();
        for (to, parcels) in parcels {
            for parcel in parcels.take() {
                let parcel = Outgoing::Parcel { to, parcel, at };
                if !self.is_told || self.outgoing.try_send(parcel).is_err() {
                    self.counters.drop_parcel(BusDrop::Full);
                }
            }
        }
        let [sectors, subscribed] = engine.sectors();
        let (mut guests, mut live) = (0, 0);
        for (_, is_live) in engine.guests() {
            guests += 1;
            live += usize::from(is_live);
        }
        self.counters.set(&BusGauges {
            stations: engine.neighbours().count(),
            cut: engine.cut_stations().count(),
            guests,
            guests_live: live,
            sectors,
            subscribed,
            delay: engine.bus_delay(),
        });
    }
}
