//! The QUIC endpoint, sessions and admission: the only place that knows QUIC.
//!
//! [`Server::bind`] starts everything: one task owns the engine (`hub`), one accepts connections,
//! and each connection has its own (`session`), with an `outbox` that the engine's task fills
//! without ever waiting. A session that panics or misbehaves ends alone.
//!
//! What one client can hold of the server's memory: a receive window of 256 KiB, 128 KiB of
//! datagram buffers, a send window of 256 KiB, 256 KiB of control messages that wait, 112 KiB of
//! poses that are not acknowledged, and what the engine keeps.

mod admission;
mod config;
mod hub;
mod identity;
mod outbox;
mod session;
mod stats;

use std::{
    collections::BTreeMap,
    io,
    net::{IpAddr, Ipv4Addr, SocketAddr},
    num::NonZeroU32,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU32, AtomicUsize, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use bytes::Bytes;
use quinn::{
    Connection, Endpoint, Incoming, TransportConfig, VarInt, crypto::rustls::QuicServerConfig,
};
use serde::Serialize;
use sightline_protocol::{
    ALPN, VERSION,
    fingerprint::Fingerprint,
    message::{Refusal, ServerMessage},
};
use sightline_world::{
    self as world, ContentId, ReadError, World,
    motion::{AvatarId, ReportingState},
};
use tokio::{
    sync::{mpsc, watch},
    task::{JoinHandle, JoinSet},
    time::timeout,
};

use admission::{AddressCounts, Bucket};
use hub::{Hub, ToHub};
use outbox::Outbox;
use session::{End, Hello};
use sightline_engine::{self as engine, Engine};
use stats::{Counters, Pulse};

pub use config::{ConfigError, ServeConfig};
pub use identity::{Identity, IdentityError};
pub use stats::{TickSummary, Traffic};

/// Connections beyond those of clients: in their handshake, or about to be refused with a reason.
const CONNECTIONS_SPARE: usize = 64;
/// When so many connections are in their handshake, newcomers must first prove their address.
const HANDSHAKES_BEFORE_RETRY: usize = 32;
/// How long goodbyes may take.
const CLOSING_DEADLINE: Duration = Duration::from_secs(5);
/// Lines about refused and failed connections, a second.
const LOG_LINES_PER_SECOND: f64 = 10.0;

/// A world and its file's bytes, ready to be served.
#[derive(Clone, Debug)]
pub struct ServedWorld {
    world: Arc<World>,
    bytes: Bytes,
    id: ContentId,
}

impl ServedWorld {
    /// Reads the bytes of a world file.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, ReadError> {
        let id = world::content_id(&bytes)?;
        let world = Arc::new(World::from_bytes(&bytes)?);
        Ok(Self { world, bytes: bytes.into(), id })
    }

    /// Writes the file of a world into memory.
    pub fn from_world(world: Arc<World>) -> Self {
        let bytes = world.to_bytes();
        let id = world::content_id(&bytes).expect("a world's own bytes are a world file");
        Self { world, bytes: bytes.into(), id }
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// The bytes of its file.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

/// Why a server does not start.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BindError {
    /// The configuration makes no sense.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// There is no certificate.
    #[error(transparent)]
    Identity(#[from] IdentityError),
    /// TLS refuses the certificate.
    #[error("cannot use the certificate: {0}")]
    Tls(#[from] rustls::Error),
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// Which.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
}

/// A server that runs. Dropping it ends it without goodbyes; see [`Server::shutdown`].
pub struct Server {
    endpoint: Endpoint,
    fingerprint: Fingerprint,
    context: Arc<Context>,
    close: watch::Sender<bool>,
    accepting: JoinHandle<()>,
    hub: JoinHandle<()>,
}

/// What [`Server::stats`] tells.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ServerStats {
    /// The clients that are connected, by avatar.
    pub clients: BTreeMap<u32, ClientStats>,
    /// How long ticks took.
    pub ticks: TickSummary,
    /// How many clients are in which state.
    #[serde(skip)]
    pub counts: engine::Counts,
    /// What the engine counted.
    #[serde(skip)]
    pub engine: engine::Stats,
}

/// What is counted of a client.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ClientStats {
    /// What went and came.
    pub traffic: Traffic,
    /// What is expected of it; `None` before it is in the world.
    #[serde(skip)]
    pub reporting_state: Option<ReportingState>,
    /// Its round trip, in milliseconds.
    pub round_trip_ms: f64,
}

impl Server {
    /// Listens, and serves a world from now on. Must be called within a tokio runtime.
    pub fn bind(
        world: ServedWorld,
        config: ServeConfig,
        identity: &Identity,
    ) -> Result<Self, BindError> {
        config.check()?;
        let endpoint = listen(&config, identity)?;
        let engine = Engine::new(world.world.clone(), config.engine());
        let started = Instant::now();
        let (hub_inputs, inputs) = mpsc::channel(hub::INPUTS_MAX);
        let (close, closing) = watch::channel(false);
        let pulse = Arc::new(Pulse::default());
        let hub = Hub::new(engine, started, pulse.clone()).run(inputs, config.tick_interval());
        let context = Arc::new(Context {
            config,
            world,
            hub: hub_inputs,
            started,
            registry: Mutex::default(),
            avatars: AtomicU32::new(0),
            handshakes: AtomicUsize::new(0),
            closing,
            pulse,
        });
        let hub = tokio::spawn(hub);
        let accepting = tokio::spawn(accept(endpoint.clone(), context.clone()));
        let fingerprint = identity.fingerprint();
        Ok(Self { endpoint, fingerprint, context, close, accepting, hub })
    }

    /// Where it listens.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        self.endpoint.local_addr()
    }

    /// What clients pin.
    pub fn fingerprint(&self) -> Fingerprint {
        self.fingerprint
    }

    /// What was counted up to now.
    pub fn stats(&self) -> ServerStats {
        let clients: Vec<_> = self.context.registry().clients.values().cloned().collect();
        let clients = clients.iter().map(|client| (client.avatar.0, client.stats())).collect();
        let (counts, engine) = self.context.pulse.engine();
        ServerStats { clients, ticks: self.context.pulse.ticks(), counts, engine }
    }

    /// Waits until the server ends by itself, which only a fault of the engine makes it do.
    pub async fn failed(&mut self) {
        let _ = (&mut self.hub).await;
    }

    /// Says goodbye to everybody, for 5 seconds at the most, and ends.
    pub async fn shutdown(mut self) {
        self.close.send_replace(true);
        if timeout(CLOSING_DEADLINE, &mut self.accepting).await.is_err() {
            tracing::warn!("some clients did not take their goodbye in time");
        }
        self.stop();
        let _ = (&mut self.hub).await;
        let _ = timeout(Duration::from_millis(500), self.endpoint.wait_idle()).await;
    }

    fn stop(&self) {
        self.endpoint.close(VarInt::from_u32(0), b"the server is closing");
        self.accepting.abort();
        self.hub.abort();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop();
    }
}

/// What all sessions share.
struct Context {
    config: ServeConfig,
    world: ServedWorld,
    hub: mpsc::Sender<ToHub>,
    started: Instant,
    registry: Mutex<Registry>,
    /// The id of the newest avatar; each connection has its own, used or not.
    avatars: AtomicU32,
    handshakes: AtomicUsize,
    closing: watch::Receiver<bool>,
    pulse: Arc<Pulse>,
}

#[derive(Default)]
struct Registry {
    clients: BTreeMap<AvatarId, Arc<Client>>,
    addresses: AddressCounts,
}

/// A client that was let in, as the hub and its session share it.
struct Client {
    avatar: AvatarId,
    outbox: Outbox,
    counters: Counters,
    connection: Connection,
}

impl Client {
    fn stats(&self) -> ClientStats {
        ClientStats {
            traffic: self.counters.traffic(),
            reporting_state: self.outbox.reporting_state(),
            round_trip_ms: self.connection.rtt().as_secs_f64() * 1e3,
        }
    }
}

impl Context {
    fn now(&self) -> Duration {
        self.started.elapsed()
    }

    fn registry(&self) -> MutexGuard<'_, Registry> {
        self.registry.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gives a client its place, if there is one.
    fn admit(&self, client: &Arc<Client>, hello: &Hello) -> Result<(), Refusal> {
        if hello.is_foreign {
            return Err(Refusal::Version { server: VERSION });
        }
        if *self.closing.borrow() {
            return Err(Refusal::Closing);
        }
        let mut registry = self.registry();
        if registry.clients.len() >= self.config.clients_max {
            return Err(Refusal::Full);
        }
        registry.clients.insert(client.avatar, client.clone());
        drop(registry);
        tracing::info!(avatar = client.avatar.0, name = ?hello.name.as_str(), "joined");
        Ok(())
    }

    fn welcome(&self, avatar: AvatarId) -> ServerMessage {
        let interval_us = self.config.tick_interval().as_micros() as u32;
        ServerMessage::Welcome {
            avatar,
            world: self.world.id.0,
            world_bytes: self.world.bytes.len() as u64,
            tick_interval_us: NonZeroU32::new(interval_us).unwrap_or(NonZeroU32::MIN),
        }
    }
}

fn listen(config: &ServeConfig, identity: &Identity) -> Result<Endpoint, BindError> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let mut tls = rustls::ServerConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .with_no_client_auth()
        .with_single_cert(vec![identity.certificate.clone()], identity.key.clone_key())?;
    tls.alpn_protocols = vec![ALPN.to_vec()];
    let crypto = QuicServerConfig::try_from(tls)
        .map_err(|error| rustls::Error::General(error.to_string()))?;
    let mut quic = quinn::ServerConfig::with_crypto(Arc::new(crypto));
    quic.transport_config(Arc::new(transport())).max_incoming(1_024);
    let address = config.listen;
    match Endpoint::server(quic.clone(), address) {
        // A machine without IPv6.
        Err(_) if address.is_ipv6() && address.ip().is_unspecified() => {
            Endpoint::server(quic, (Ipv4Addr::UNSPECIFIED, address.port()).into())
        }
        bound => bound,
    }
    .map_err(|source| BindError::Listen { address, source })
}

/// The limits of a connection; quinn's own are a thousand times as generous.
fn transport() -> TransportConfig {
    let mut transport = TransportConfig::default();
    transport
        .max_concurrent_bidi_streams(VarInt::from_u32(1))
        .max_concurrent_uni_streams(VarInt::from_u32(0))
        .stream_receive_window(VarInt::from_u32(64 * 1_024))
        .receive_window(VarInt::from_u32(256 * 1_024))
        .send_window(256 * 1_024)
        .datagram_receive_buffer_size(Some(64 * 1_024))
        .datagram_send_buffer_size(64 * 1_024)
        .max_idle_timeout(Some(VarInt::from_u32(10_000).into()));
    transport
}

/// Accepts connections until the server closes, then waits for all sessions to end.
async fn accept(endpoint: Endpoint, context: Arc<Context>) {
    let mut sessions = JoinSet::new();
    let mut closing = context.closing.clone();
    let mut log = Bucket::new(LOG_LINES_PER_SECOND, LOG_LINES_PER_SECOND, context.now());
    let connections_max = context.config.clients_max + CONNECTIONS_SPARE;
    loop {
        let incoming = tokio::select! {
            incoming = endpoint.accept() => incoming,
            _ = closing.wait_for(|closing| *closing) => break,
            Some(_) = sessions.join_next() => continue,
        };
        let Some(incoming) = incoming else { break };
        if must_prove_address(&context, &incoming) {
            let _ = incoming.retry();
            continue;
        }
        let address = incoming.remote_address().ip();
        let per_address = context.config.clients_per_address_max;
        if sessions.len() >= connections_max
            || !context.registry().addresses.admit(address, per_address)
        {
            if log.take(1.0, context.now()) {
                tracing::info!(%address, "too many connections: refused");
            }
            incoming.refuse();
            continue;
        }
        sessions.spawn(supervise(context.clone(), incoming, address));
    }
    while sessions.join_next().await.is_some() {}
}

fn must_prove_address(context: &Context, incoming: &Incoming) -> bool {
    context.handshakes.load(Relaxed) >= HANDSHAKES_BEFORE_RETRY
        && !incoming.remote_address_validated()
        && incoming.may_retry()
}

/// Runs a session in a task of its own, so that a panic ends it alone, and cleans up after it.
async fn supervise(context: Arc<Context>, incoming: Incoming, address: IpAddr) {
    let avatar = AvatarId(context.avatars.fetch_add(1, Relaxed).wrapping_add(1));
    let session = tokio::spawn(converse(context.clone(), incoming, avatar));
    let end = session.await;
    let was_in = {
        let mut registry = context.registry();
        registry.addresses.release(address);
        registry.clients.remove(&avatar).is_some()
    };
    match end {
        Ok(Some(end)) if was_in => {
            tracing::info!(avatar = avatar.0, end = ?end.to_string(), "gone");
        }
        Ok(end) => {
            let end = end.map(|end| end.to_string());
            tracing::debug!(avatar = avatar.0, ?end, "a connection came to nothing");
        }
        Err(panic) => tracing::error!(avatar = avatar.0, %panic, "a session failed"),
    }
    let _ = context.hub.send(ToHub::Leave(avatar)).await;
}

/// From the handshake to the end; `None` when there was not even a connection.
async fn converse(context: Arc<Context>, incoming: Incoming, avatar: AvatarId) -> Option<End> {
    context.handshakes.fetch_add(1, Relaxed);
    let deadline = Duration::from_secs_f64(context.config.hello_s);
    let connection = timeout(deadline, incoming).await;
    context.handshakes.fetch_sub(1, Relaxed);
    let connection = connection.ok()?.ok()?;
    let (outbox, counters) = (Outbox::default(), Counters::default());
    let client = Client { avatar, outbox, counters, connection: connection.clone() };
    Some(session::run(&context, connection, Arc::new(client)).await)
}
