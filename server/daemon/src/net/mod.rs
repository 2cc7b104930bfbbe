//! The QUIC endpoint, admission and sessions: the only module of the server that knows QUIC.
//!
//! [`Server::bind`] starts everything. A server that [listens](Server::listen) without a world gets
//! it later from a [`WorldChanger`], which also replaces it. A thread of its own has the engine
//! (`engine_task`), one task accepts connections (`accept`), and each connection has a `session` of
//! its own. The engine's thread fills each client's `outbox` and never waits for a client. When it
//! cannot keep up, its rate falls (`pace`), newcomers are put off (`load`), and nobody present is
//! dropped. A session that panics or misbehaves ends alone. When the engine panics, its world
//! begins anew (`engine_faults`).
//!
//! What a client can occupy has limits ([`Limits`]): `serve --print-config` prints each with its
//! memory.

mod accept;
mod admission;
mod avatar_ids;
mod budget;
mod certificates;
mod changer;
mod client;
mod client_keys;
mod commands;
mod config;
mod endpoint;
mod engine_faults;
mod engine_task;
mod entrance;
mod kept_name;
mod kept_pieces;
mod load;
mod log_limits;
mod moderation;
mod names;
mod observer;
mod offers;
mod outbox;
mod pace;
mod place_notes;
mod places;
mod private_geometry;
mod served_pieces;
mod served_world;
mod session;
mod state;
mod survey;
#[cfg(test)]
mod test_clients;
mod transport;
mod visitors;
#[cfg(feature = "web")]
mod web_door;

use std::{
    io,
    net::SocketAddr,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use quinn::{Endpoint, VarInt};
use sightline_engine::Engine;
use sightline_protocol::{fingerprint::Fingerprint, message::StationAddress};
use tokio::{
    sync::{mpsc, watch},
    task::JoinHandle,
    time::timeout,
};

#[cfg(feature = "http")]
pub(crate) use budget::TokenBucket;
pub use changer::{ServerEnded, WorldChanger};
pub use config::{ConfigError, HttpAddress, Limits, Origin, ServeConfig, WebAddress};
pub use moderation::{Author, Moderation, ModerationError, VisitorInfo};
pub use observer::Observer;
#[cfg(feature = "web")]
pub(crate) use served_pieces::ServedPieces;
pub use served_world::ServedWorld;
pub use sightline_cli::identity::{Identity, IdentityError};
#[cfg(feature = "web")]
pub(crate) use transport::VISIT_PATH;
#[cfg(feature = "web")]
pub use web_door::WebDoor;

use crate::{
    bus::{Bus, BusLink},
    operate::{Metrics, ServerStats},
    people::{DatabaseError, People},
};
use certificates::Certificates;
#[cfg(feature = "web")]
pub use certificates::TlsFileError;
use engine_task::EngineTask;
use load::Load;
use offers::Offers;
use place_notes::PlaceNotes;
use served_pieces::Cutting;
use state::{Registry, ServerState};
use transport::Transport;

/// How long all goodbyes may take together.
const CLOSING_DEADLINE: Duration = Duration::from_secs(5);
/// How long the endpoint may take to send its last packets.
const IDLE_DEADLINE: Duration = Duration::from_millis(500);
/// How many connections of other listeners may wait to be accepted. Then those listeners wait.
const ARRIVALS_MAX: usize = 16;

/// Why a server does not start.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BindError {
    /// A number of the configuration is out of range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// There is no certificate.
    #[error(transparent)]
    Identity(#[from] IdentityError),
    /// There is no database of people.
    #[error(transparent)]
    People(#[from] DatabaseError),
    /// TLS rejects the certificate.
    #[error("cannot use the certificate: {0}")]
    Tls(#[from] rustls::Error),
    /// The operator's certificate for browsers cannot be used.
    #[cfg(feature = "web")]
    #[error(transparent)]
    TlsFiles(#[from] TlsFileError),
    /// The address is taken, or is not one of this machine.
    #[error("cannot listen on {address}: {source}; choose another address with --listen")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The system's reason.
        source: io::Error,
    },
}

/// A running server. Dropping it ends it without goodbyes; [`Server::shutdown`] says goodbye.
pub struct Server {
    endpoint: Endpoint,
    fingerprint: Fingerprint,
    state: Arc<ServerState>,
    /// Where other listeners bring connections.
    #[cfg_attr(not(feature = "web"), expect(dead_code, reason = "there is no other listener"))]
    arrivals: mpsc::Sender<Transport>,
    #[cfg(feature = "web")]
    certificates: Arc<Certificates>,
    close: watch::Sender<bool>,
    accepting: JoinHandle<()>,
    /// Cuts worlds into pieces.
    cutting: JoinHandle<()>,
    engine: JoinHandle<()>,
    /// The bus to other stations, and who tells clients of these.
    bus: Option<(BusLink, JoinHandle<()>)>,
    /// Becomes true when the engine's thread is to end.
    stop: Arc<AtomicBool>,
}

impl Server {
    /// Listens on the configured address, and serves a world from now on. Must be called within a
    /// tokio runtime.
    ///
    /// # Errors
    /// When the configuration is out of range, the certificate is unusable or the address is taken.
    pub fn bind(
        world: ServedWorld,
        config: ServeConfig,
        identity: &Identity,
    ) -> Result<Self, BindError> {
        Self::start(Some(world), config, identity, None)
    }

    /// Listens on the configured address. Clients are told to wait until
    /// [`Server::world_changer`] has brought a world. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// When the configuration is out of range, the certificate is unusable or the address is taken.
    pub fn listen(config: ServeConfig, identity: &Identity) -> Result<Self, BindError> {
        Self::start(None, config, identity, None)
    }

    /// As [`Server::listen`], as a station on a bus: its visitors meet those of the other stations
    /// that serve the same world.
    ///
    /// # Errors
    /// When the configuration is out of range, the certificate is unusable or the address is taken.
    pub fn listen_on_bus(
        config: ServeConfig,
        identity: &Identity,
        bus: Bus,
    ) -> Result<Self, BindError> {
        Self::start(None, config, identity, Some(bus))
    }

    fn start(
        world: Option<ServedWorld>,
        config: ServeConfig,
        identity: &Identity,
        bus: Option<Bus>,
    ) -> Result<Self, BindError> {
        config.check()?;
        let certificates = Arc::new(Certificates::new(&config, identity)?);
        let endpoint = endpoint::listen(&config, identity, certificates.clone())?;
        let people = Arc::new(People::open(config.data.as_deref(), config.chat_days)?);
        let started = Instant::now();
        let (events, received) = mpsc::channel(config.limits.events_max);
        let (close, closing) = watch::channel(false);
        let (end, link) = bus.map(|bus| (bus.end, bus.link)).unzip();
        let metrics = Arc::new(Metrics::new(link.as_ref().map(BusLink::counters)));
        let offers = Arc::new(Offers::default());
        let load = Arc::new(Load::new(config.limits.entering_max));
        let (told, counted) = (load.clone(), metrics.clone());
        let places = PlaceNotes::new(people.clone(), link.as_ref().map(BusLink::places));
        let mut task =
            EngineTask::new(&config, offers.clone(), started, told, counted, places, end);
        if let Some(world) = world {
            let world = Cutting::new(&config).prepare(world);
            let engine = Engine::new(world.world().clone(), config.engine());
            task.change(Box::new(engine), world);
        }
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let engine = tokio::task::spawn_blocking(move || task.run(received, &stopped));
        let registry = Arc::new(Mutex::new(Registry::new(&config, link.as_ref())));
        let places = link.as_ref().map(BusLink::places);
        let state = Arc::new(ServerState {
            config,
            offers,
            events,
            started,
            registry,
            people,
            places,
            handshakes: AtomicUsize::new(0),
            closing,
            load,
            metrics,
        });
        let (arrivals, arriving) = mpsc::channel(ARRIVALS_MAX);
        let accepting = tokio::spawn(accept::accept(endpoint.clone(), arriving, state.clone()));
        let cutting = Cutting::new(&state.config).cut_offered(state.offers.offers());
        let cutting = tokio::spawn(cutting);
        let fingerprint = identity.fingerprint();
        let bus = link.map(|mut link| {
            share_people(&mut link, &state);
            if let Some(address) = address_for_others(&state.config, &endpoint) {
                link.tell_address(StationAddress { address, fingerprint });
            }
            let telling = tokio::spawn(tell_stations(link.addresses(), state.offers.clone()));
            (link, telling)
        });
        Ok(Self {
            endpoint,
            fingerprint,
            state,
            arrivals,
            #[cfg(feature = "web")]
            certificates,
            close,
            accepting,
            cutting,
            engine,
            bus,
            stop,
        })
    }

    /// What gives this server its world, and other ones later.
    pub fn world_changer(&self) -> WorldChanger {
        let state = &self.state;
        let (config, offers) = (state.config.clone(), state.offers.clone());
        WorldChanger::new(config, offers, state.started, &state.events)
    }

    /// The world that it serves; `None` before the first.
    pub fn world(&self) -> Option<ServedWorld> {
        self.state.offers.offer().map(|offer| offer.world)
    }

    /// The address that it listens on.
    ///
    /// # Errors
    /// When the system does not tell.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        self.endpoint.local_addr()
    }

    /// The fingerprint of the certificate, by which clients know the server.
    pub fn fingerprint(&self) -> Fingerprint {
        self.fingerprint
    }

    /// The statistics at present.
    pub fn stats(&self) -> ServerStats {
        self.observer().stats()
    }

    /// What operators see of it.
    pub fn observer(&self) -> Observer {
        Observer::new(self.state.clone())
    }

    /// What a listener for browsers needs of it.
    #[cfg(feature = "web")]
    ///
    /// # Errors
    /// When the system does not tell the address of the endpoint.
    pub fn web_door(&self) -> io::Result<WebDoor> {
        let (state, arrivals) = (self.state.clone(), self.arrivals.clone());
        let port = self.local_addr()?.port();
        Ok(WebDoor::new(state, arrivals, self.certificates.clone(), port))
    }

    /// What moderators and operators may do to visitors.
    pub fn moderation(&self) -> Moderation {
        Moderation::new(&self.state)
    }

    /// Waits until the server ends by itself. Only a fault of the engine makes it do so.
    pub async fn failed(&mut self) {
        let _ = (&mut self.engine).await;
    }

    /// Says goodbye to every client, for at most 5 seconds, and ends.
    pub async fn shutdown(mut self) {
        self.close.send_replace(true);
        if timeout(CLOSING_DEADLINE, &mut self.accepting).await.is_err() {
            tracing::warn!("some clients did not receive their goodbye in time");
        }
        self.stop();
        let _ = (&mut self.engine).await;
        let _ = timeout(IDLE_DEADLINE, self.endpoint.wait_idle()).await;
        self.state.people.finish();
    }

    fn stop(&self) {
        self.endpoint.close(VarInt::from_u32(0), b"the server is closing");
        self.accepting.abort();
        self.cutting.abort();
        self.bus.iter().for_each(|(_, telling)| telling.abort());
        self.stop.store(true, Relaxed);
    }
}

/// Where visitors of other stations reach this one; `None` where only this machine knows.
fn address_for_others(config: &ServeConfig, endpoint: &Endpoint) -> Option<SocketAddr> {
    let own = endpoint.local_addr().ok().filter(|own| !own.ip().is_unspecified());
    config.bus_address.or(own)
}

/// Shares bans, mutes and roles with other stations.
#[cfg_attr(not(feature = "bus"), expect(unused_variables, reason = "there is no bus"))]
fn share_people(link: &mut BusLink, state: &ServerState) {
    #[cfg(feature = "bus")]
    {
        let moderation = Moderation::new(state);
        let on_ban = move |subject, reason: &str| moderation.remove_banned(subject, reason);
        link.share_people(state.people.clone(), Box::new(on_ban));
    }
}

/// Tells clients of other stations, whenever there are others.
async fn tell_stations(mut addresses: watch::Receiver<Vec<StationAddress>>, offers: Arc<Offers>) {
    loop {
        offers.tell_stations(&addresses.borrow_and_update());
        if addresses.changed().await.is_err() {
            return;
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop();
    }
}
