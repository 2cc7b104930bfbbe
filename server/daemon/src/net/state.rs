//! What all sessions of a server share.

use std::{
    collections::BTreeMap,
    net::IpAddr,
    num::NonZeroU32,
    sync::{Arc, Mutex, MutexGuard, PoisonError, atomic::AtomicUsize},
    time::{Duration, Instant},
};

use sightline_protocol::{VERSION, message::Refusal, text::Name};
use sightline_world::motion::AvatarId;
use tokio::sync::{mpsc, watch};

use super::{
    admission::{NoPlace, PlaceLimits, Places},
    avatar_ids::AvatarIds,
    client::{ConnectedClient, Hello},
    config::ServeConfig,
    engine_task::{EngineEvent, TimedEvent},
    load::Load,
    log_limits::LogLimits,
    names::Names,
    offers::Offers,
};
use crate::operate::TickMetrics;

/// What all sessions of a server share.
pub struct ServerState {
    pub config: ServeConfig,
    pub offers: Arc<Offers>,
    /// Where events for the engine go.
    pub events: mpsc::Sender<TimedEvent>,
    /// When the server's time was zero.
    pub started: Instant,
    pub registry: Mutex<Registry>,
    /// How many connections are in their handshake.
    pub handshakes: AtomicUsize,
    /// Becomes true when the server closes.
    pub closing: watch::Receiver<bool>,
    pub load: Arc<Load>,
    pub metrics: Arc<TickMetrics>,
}

/// Connections that may exist beyond those of clients with an avatar: in their handshake, about to
/// be refused with a reason, or about to enter.
const CONNECTIONS_SPARE: usize = 64 + JOINING_MAX;
/// The most clients that are about to enter. They may download the world.
const JOINING_MAX: usize = 256;
/// The most of them that are of one network.
const JOINING_PER_NETWORK_MAX: usize = 4;

/// The most connections of a server for this number of clients.
pub fn connections_max(clients_max: usize) -> usize {
    clients_max + CONNECTIONS_SPARE
}

/// The admitted clients and the places of all connections.
pub struct Registry {
    pub clients: BTreeMap<AvatarId, Arc<ConnectedClient>>,
    pub places: Places,
    /// Each connection has an id of its own, used or not.
    pub ids: AvatarIds,
    pub names: Names,
    pub log: LogLimits,
}

impl Registry {
    /// The registry of a server without connections.
    pub fn new(config: &ServeConfig) -> Self {
        let limits = PlaceLimits {
            per_network: config.clients_per_address_max,
            joining_per_network: JOINING_PER_NETWORK_MAX,
            joining: JOINING_MAX,
            entered: config.clients_max,
        };
        Self {
            clients: BTreeMap::new(),
            places: Places::new(limits),
            ids: AvatarIds::new(connections_max(config.clients_max)),
            names: Names::default(),
            log: LogLimits::default(),
        }
    }
}

impl ServerState {
    /// The server's time.
    pub fn now(&self) -> Duration {
        self.started.elapsed()
    }

    /// The registry, locked. Hold it only for a moment: every session needs it.
    pub fn registry(&self) -> MutexGuard<'_, Registry> {
        self.registry.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells the engine's thread of an event that was read just now. Waits while too many do.
    /// Returns whether there is still an engine.
    pub async fn tell_engine(&self, event: EngineEvent) -> bool {
        let at = self.now();
        self.events.send(TimedEvent { at, event }).await.is_ok()
    }

    /// Admits a client and welcomes it, if it speaks this version and there is room. Returns the name
    /// that it has.
    pub fn admit(&self, client: &Arc<ConnectedClient>, hello: &Hello) -> Result<Name, Refusal> {
        if hello.is_foreign {
            return Err(Refusal::Version { server: VERSION });
        }
        if *self.closing.borrow() {
            return Err(Refusal::Closing);
        }
        let busy = |retry: Duration| Refusal::Busy { retry_ms: retry.as_millis() as u32 };
        if let Some(retry) = self.load.refuses() {
            return Err(busy(retry));
        }
        let address = client.address();
        let mut registry = self.registry();
        match registry.places.join(client.avatar, address) {
            Ok(()) => {}
            Err(NoPlace::Full) => return Err(Refusal::Full),
            Err(NoPlace::Busy) => return Err(busy(self.load.refuse())),
        }
        registry.clients.insert(client.avatar, client.clone());
        let name = registry.names.claim(client.avatar, &hello.name);
        let interval_us = self.config.tick_interval().as_micros() as u32;
        let interval_us = NonZeroU32::new(interval_us).unwrap_or(NonZeroU32::MIN);
        self.offers.welcome(client, interval_us);
        if registry.log.allows(address, self.now()) {
            tracing::info!(avatar = client.avatar.0, name = ?name.as_str(), "joined");
        }
        Ok(name)
    }

    /// Whether the log may have a line about a peer.
    pub fn may_log(&self, address: IpAddr) -> bool {
        self.registry().log.allows(address, self.now())
    }
}
