//! What all sessions of a server share.

use std::{
    collections::HashMap,
    net::IpAddr,
    sync::{Arc, Mutex, MutexGuard, PoisonError, atomic::AtomicUsize},
    time::{Duration, Instant},
};

use sightline_world::motion::AvatarId;
use tokio::{
    sync::{mpsc, oneshot, watch},
    time::timeout,
};

use super::{
    admission::{ConnectionId, PlaceLimits, Places},
    avatar_ids::AvatarIds,
    client::ConnectedClient,
    config::ServeConfig,
    engine_task::{EngineEvent, Newcomer, TimedEvent},
    load::Load,
    log_limits::LogLimits,
    names::Names,
    offers::Offers,
    private_geometry::Whereabouts,
    visitors::Visitors,
};
use crate::{
    bus::{BusLink, place_shares::PlaceShares},
    operate::{Metrics, Reason},
    people::People,
};

/// How long the engine may take to say where an avatar is.
const PATIENCE: Duration = Duration::from_secs(2);

/// What all sessions of a server share.
pub struct ServerState {
    pub config: ServeConfig,
    pub offers: Arc<Offers>,
    /// Where events for the engine go.
    pub events: mpsc::Sender<TimedEvent>,
    /// When the server's time was zero.
    pub started: Instant,
    pub registry: Arc<Mutex<Registry>>,
    pub people: Arc<People>,
    /// What shares last places with other stations, if there are any.
    pub places: Option<PlaceShares>,
    /// How many connections are in their handshake.
    pub handshakes: AtomicUsize,
    /// Becomes true when the server closes.
    pub closing: watch::Receiver<bool>,
    pub load: Arc<Load>,
    pub metrics: Arc<Metrics>,
}

/// The visitors, and the places of all connections.
pub struct Registry {
    /// The clients that were let in, by their connections. One may have lost its avatar to another.
    pub clients: HashMap<ConnectionId, Arc<ConnectedClient>>,
    pub visitors: Visitors,
    pub places: Places,
    pub ids: AvatarIds,
    /// The number of the last connection.
    connections: u64,
    pub names: Names,
    pub log: LogLimits,
}

impl Registry {
    /// The registry of a server, or of a station, without connections.
    pub fn new(config: &ServeConfig, bus: Option<&BusLink>) -> Self {
        let limits = PlaceLimits {
            per_network: config.clients_per_address_max,
            joining_per_network: config.limits.joining_per_address_max,
            joining: config.limits.joining_max,
            entered: config.clients_max,
        };
        Self {
            clients: HashMap::new(),
            visitors: Visitors::default(),
            places: Places::new(limits),
            ids: AvatarIds::new(config.connections_max(), bus.map(BusLink::station)),
            names: Names::at_all_stations(bus.map(BusLink::names)),
            log: LogLimits::new(config.limits.log_lines_per_s, config.limits.log_networks_max),
            connections: 0,
        }
    }

    /// The number of a new connection.
    pub fn number(&mut self) -> ConnectionId {
        self.connections += 1;
        ConnectionId(self.connections)
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

    /// Where an avatar is, as far as its client has said; `None` when it is not in the world, or the
    /// engine does not answer.
    pub async fn whereabouts(&self, avatar: AvatarId) -> Option<Whereabouts> {
        let (reply, answer) = oneshot::channel();
        let answered = async {
            self.tell_engine(EngineEvent::Whereabouts { avatar, reply }).await.then_some(())?;
            answer.await.ok()?
        };
        timeout(PATIENCE, answered).await.ok()?
    }

    /// Tells the engine's thread of a client that wants to enter, and that counts as waiting from
    /// then on. Waits while there are too many events. Returns whether there is still an engine.
    pub async fn tell_newcomer(&self, newcomer: Newcomer) -> bool {
        let Ok(permit) = self.events.reserve().await else { return false };
        // A session may end at any await, and who waits must reach the engine's thread.
        self.load.waits();
        permit.send(TimedEvent { at: self.now(), event: EngineEvent::Join(newcomer) });
        true
    }

    /// Whether the log may have a line about a peer.
    pub fn may_log(&self, address: IpAddr) -> bool {
        let is_logged = self.registry().log.allows(address, self.now());
        self.counts_line(is_logged)
    }

    /// Counts a line that is not logged. Returns whether it is.
    pub fn counts_line(&self, is_logged: bool) -> bool {
        if !is_logged {
            self.metrics.refusals.count(Reason::LogLine);
        }
        is_logged
    }
}
