//! Which world is offered, and to whom. The two change together, so that every client hears of
//! every world, in order.

use std::{
    collections::BTreeMap,
    num::NonZeroU32,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use sightline_protocol::{
    message::{STATIONS_TOLD_MAX, ServerMessage, StationAddress},
    text::ChatLine,
};
use tokio::sync::watch;

use super::{admission::ConnectionId, client::ConnectedClient, served_world::ServedWorld};

/// What is told before the server says what it does.
const LOADING: &str = "the world is being loaded";

/// A world that is offered to clients.
#[derive(Clone, Debug)]
pub struct WorldOffer {
    /// Its number, from 1.
    pub number: u32,
    pub world: ServedWorld,
}

impl WorldOffer {
    fn message(&self) -> ServerMessage {
        let bytes = self.world.bytes().len() as u64;
        let head = self.world.pieces().and_then(|pieces| pieces.offer());
        ServerMessage::World { number: self.number, id: self.world.id().0, bytes, head }
    }
}

/// The offered world, and the clients that it is offered to.
pub struct Offers {
    audience: Mutex<Audience>,
    /// `None` until there is a world.
    offer: watch::Sender<Option<WorldOffer>>,
}

struct Audience {
    clients: BTreeMap<ConnectionId, Arc<ConnectedClient>>,
    /// What the server does until it has a world.
    loading: ChatLine,
    /// Where visitors reach other stations.
    stations: Vec<StationAddress>,
}

impl Default for Offers {
    fn default() -> Self {
        let loading = ChatLine::clipped(LOADING);
        let audience =
            Mutex::new(Audience { clients: BTreeMap::new(), loading, stations: Vec::new() });
        Self { audience, offer: watch::Sender::new(None) }
    }
}

impl Offers {
    /// Welcomes an admitted client, which hears of each world from now on.
    pub fn welcome(&self, client: &Arc<ConnectedClient>, tick_interval_us: NonZeroU32) {
        let mut audience = self.audience();
        audience.clients.insert(client.connection_id, client.clone());
        let avatar = client.avatar();
        client.outbox.push(&ServerMessage::Welcome { avatar, tick_interval_us });
        client.outbox.push(&match &*self.offer.borrow() {
            Some(offer) => offer.message(),
            None => ServerMessage::Loading { what: audience.loading.clone() },
        });
    }

    /// Tells a client of other stations, if there are any.
    pub fn tell_of_stations(&self, client: &ConnectedClient) {
        let audience = self.audience();
        if !audience.stations.is_empty() {
            client.outbox.push(&some_of(&audience.stations, client));
        }
    }

    /// Tells all clients of other stations.
    pub fn tell_stations(&self, stations: &[StationAddress]) {
        let mut audience = self.audience();
        if audience.stations != stations {
            audience.stations = stations.to_vec();
            let Audience { clients, stations, .. } = &*audience;
            clients.values().for_each(|client| client.outbox.push(&some_of(stations, client)));
        }
    }

    /// A client has left.
    pub fn release(&self, id: ConnectionId) {
        self.audience().clients.remove(&id);
    }

    /// The offered world; `None` until there is one.
    pub fn offer(&self) -> Option<WorldOffer> {
        self.offer.borrow().clone()
    }

    /// Tells of each new offer.
    pub fn offers(&self) -> watch::Receiver<Option<WorldOffer>> {
        self.offer.subscribe()
    }

    /// Offers a world to all clients in place of the one before. Returns its number.
    pub fn change_world(&self, world: ServedWorld) -> u32 {
        let audience = self.audience();
        let number = self.offer.borrow().as_ref().map_or(0, |before| before.number) + 1;
        let offer = WorldOffer { number, world };
        let message = offer.message();
        self.offer.send_replace(Some(offer));
        audience.clients.values().for_each(|client| client.outbox.leave_world(&message));
        number
    }

    /// Tells clients what the server does, unless there is a world.
    pub fn tell_loading(&self, what: &str) {
        let mut audience = self.audience();
        audience.loading = ChatLine::clipped(what);
        if self.offer.borrow().is_none() {
            let message = ServerMessage::Loading { what: audience.loading.clone() };
            audience.clients.values().for_each(|client| client.outbox.push(&message));
        }
    }

    fn audience(&self) -> MutexGuard<'_, Audience> {
        // Hold it only for a moment: every session needs it.
        self.audience.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// As many of the stations as a client is told of. Each client begins elsewhere in the list, so that
/// those of a station that is lost do not all go to the same one.
fn some_of(stations: &[StationAddress], client: &ConnectedClient) -> ServerMessage {
    let first = client.connection_id.0 as usize % stations.len().max(1);
    let others = stations.iter().cycle().skip(first).take(stations.len().min(STATIONS_TOLD_MAX));
    ServerMessage::Stations { others: others.copied().collect() }
}
