//! From an address to a session.

use std::{
    io,
    net::{Ipv4Addr, Ipv6Addr, SocketAddr},
    path::PathBuf,
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use quinn::{Connection, ConnectionError, Endpoint, RecvStream, TransportConfig, VarInt};
use sightline_protocol::{
    DecodeError, VERSION,
    message::{ClientMessage, Refusal, ServerMessage},
    text::Name,
};
use sightline_world::{
    ContentId, ReadError,
    motion::{Agility, AvatarId},
};
use tokio::time::timeout;

use super::{
    cache::WorldCache,
    session::{Session, Wire},
    trust::{self, Trust, TrustError},
};
use sightline_client_core::replica::{Replica, ReplicaError};

/// An answer that takes longer does not come.
const ANSWER_DEADLINE: Duration = Duration::from_secs(10);
/// A piece of the world that takes longer does not come.
const PIECE_DEADLINE: Duration = Duration::from_secs(20);
/// No world file is larger: 1 GiB.
const WORLD_BYTES_MAX: u64 = 1 << 30;

/// Is told how many bytes of a world have come, and of how many.
pub type DownloadProgress = Arc<dyn Fn(u64, u64) + Send + Sync>;

/// How to come in.
#[derive(Clone)]
pub struct ConnectOptions {
    /// How to be called.
    pub name: Name,
    /// sRGB.
    pub colour: [u8; 3],
    /// Where to stand; a spawn point when `None`.
    pub place: Option<glam::Vec3>,
    /// Which servers to trust.
    pub trust: Trust,
    /// Whom to tell how the download gets on.
    pub progress: Option<DownloadProgress>,
}

/// Why there is no session.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// There is no socket to be had.
    #[error("cannot open a socket: {0}")]
    Socket(#[source] io::Error),
    /// TLS cannot be set up.
    #[error("cannot set up TLS: {0}")]
    Tls(#[from] rustls::Error),
    /// The address is of no use.
    #[error("cannot connect to {address}: {reason}")]
    Address {
        /// Which.
        address: SocketAddr,
        /// Why.
        reason: String,
    },
    /// Nobody answered in time.
    #[error("no answer from {0}")]
    NoAnswer(SocketAddr),
    /// The server took no connection.
    #[error("the server takes no more connections (from this address)")]
    NotTaken,
    /// It is not the right server.
    #[error(transparent)]
    Trust(#[from] TrustError),
    /// The server said no.
    #[error("{0}")]
    Refused(Refusal),
    /// The server said goodbye.
    #[error("the server said goodbye: {0}")]
    Goodbye(String),
    /// The connection ended.
    #[error("connection lost: {0}")]
    Lost(String),
    /// The server sent what no server sends.
    #[error("the server sent a {0}")]
    Junk(#[from] DecodeError),
    /// The server did what no server does.
    #[error(transparent)]
    OutOfPlace(#[from] ReplicaError),
    /// The world is not whole, or not the one announced.
    #[error("cannot use the server's world: {0}")]
    World(#[from] ReadError),
    /// No world is so large.
    #[error("the server's world has {0} bytes, which is more than any may have")]
    WorldTooLarge(u64),
}

/// Makes sessions that share a socket and the worlds they need.
#[derive(Debug)]
pub struct Dialer {
    /// One for each family of addresses, made when needed.
    endpoints: Mutex<[Option<Endpoint>; 2]>,
    cache: WorldCache,
}

impl Dialer {
    /// A dialer that keeps worlds in a folder; only in memory when `None`.
    pub fn new(world_folder: Option<PathBuf>) -> Self {
        Self { endpoints: Mutex::default(), cache: WorldCache::new(world_folder) }
    }

    /// Connects, fetches the world if it is not at hand, and comes in. Must be called within a
    /// tokio runtime, in which the session then runs.
    ///
    /// # Errors
    /// When any step fails; then nothing is left behind.
    pub async fn connect(
        &self,
        address: SocketAddr,
        options: &ConnectOptions,
    ) -> Result<Session, ConnectError> {
        let connection = self.open(address).await?;
        let joined = async {
            options.trust.check(&connection, address)?;
            self.join(&connection, options).await
        };
        let joined = joined.await;
        if joined.is_err() {
            connection.close(VarInt::from_u32(0), b"");
        }
        joined
    }

    async fn open(&self, address: SocketAddr) -> Result<Connection, ConnectError> {
        let connecting = self
            .endpoint(address.is_ipv6())?
            .connect(address, "sightline")
            .map_err(|error| ConnectError::Address { address, reason: error.to_string() })?;
        match timeout(ANSWER_DEADLINE, connecting).await {
            Ok(Ok(connection)) => Ok(connection),
            Err(_) | Ok(Err(ConnectionError::TimedOut)) => Err(ConnectError::NoAnswer(address)),
            Ok(Err(error)) => Err(lost(error)),
        }
    }

    async fn join(
        &self,
        connection: &Connection,
        options: &ConnectOptions,
    ) -> Result<Session, ConnectError> {
        let mut wire = Wire::open(connection).await?;
        let (name, colour) = (options.name.clone(), options.colour);
        wire.send(&ClientMessage::Hello { version: VERSION, name, colour }).await?;
        let (avatar, id, world_bytes, tick_interval) = welcome(&mut wire).await?;
        let fetch = fetch(&mut wire, world_bytes, options.progress.as_ref());
        let world = self.cache.get(id, fetch).await?;
        wire.send(&ClientMessage::Enter { place: options.place.map(Into::into) }).await?;
        let agility = Agility::of(&world.body, world.speed_max);
        let replica = Replica::new(avatar, tick_interval, agility);
        let entered = Session::start(wire, replica, world, options.name.clone());
        timeout(ANSWER_DEADLINE, entered)
            .await
            .unwrap_or_else(|_| Err(ConnectError::Lost("no place was given in time".to_owned())))
    }

    fn endpoint(&self, is_v6: bool) -> Result<Endpoint, ConnectError> {
        let mut endpoints = self.endpoints.lock().unwrap_or_else(PoisonError::into_inner);
        let slot = if is_v6 { &mut endpoints[1] } else { &mut endpoints[0] };
        if let Some(endpoint) = slot {
            return Ok(endpoint.clone());
        }
        let own = if is_v6 {
            SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0))
        } else {
            SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0))
        };
        let mut endpoint = Endpoint::client(own).map_err(ConnectError::Socket)?;
        let mut config = quinn::ClientConfig::new(Arc::new(trust::crypto()?));
        config.transport_config(Arc::new(transport()));
        endpoint.set_default_client_config(config);
        Ok(slot.insert(endpoint).clone())
    }
}

/// Connects as [`Dialer::connect`] does, from a thread without a runtime. The session brings its
/// own.
///
/// # Errors
/// When any step fails.
pub fn connect_blocking(
    address: SocketAddr,
    options: &ConnectOptions,
    world_folder: Option<PathBuf>,
) -> Result<Session, ConnectError> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
        .map_err(ConnectError::Socket)?;
    let session =
        runtime.block_on(async { Dialer::new(world_folder).connect(address, options).await })?;
    Ok(session.with_runtime(runtime))
}

pub(super) fn lost(error: ConnectionError) -> ConnectError {
    match error {
        ConnectionError::ConnectionClosed(close)
            if u64::from(close.error_code) == CONNECTION_REFUSED =>
        {
            ConnectError::NotTaken
        }
        error => ConnectError::Lost(error.to_string()),
    }
}

/// QUIC's code of a server that takes no more connections (RFC 9000, section 20.1).
const CONNECTION_REFUSED: u64 = 2;

fn transport() -> TransportConfig {
    let mut transport = TransportConfig::default();
    transport
        .max_concurrent_bidi_streams(VarInt::from_u32(0))
        .max_concurrent_uni_streams(VarInt::from_u32(1))
        .stream_receive_window(VarInt::from_u32(4 << 20))
        .receive_window(VarInt::from_u32(4 << 20))
        .send_window(256 * 1_024)
        .datagram_receive_buffer_size(Some(256 * 1_024))
        .datagram_send_buffer_size(16 * 1_024)
        .keep_alive_interval(Some(Duration::from_secs(3)))
        .max_idle_timeout(Some(VarInt::from_u32(10_000).into()));
    transport
}

async fn welcome(wire: &mut Wire) -> Result<(AvatarId, ContentId, u64, Duration), ConnectError> {
    match answer(wire).await? {
        ServerMessage::Welcome { avatar, world, world_bytes, tick_interval_us } => {
            let tick_interval = Duration::from_micros(u64::from(tick_interval_us.get()));
            Ok((avatar, ContentId(world), world_bytes, tick_interval))
        }
        ServerMessage::Refused { reason } => Err(ConnectError::Refused(reason)),
        ServerMessage::Goodbye { reason } => Err(ConnectError::Goodbye(reason.into())),
        _ => Err(ReplicaError::OutOfPlace.into()),
    }
}

async fn answer(wire: &mut Wire) -> Result<ServerMessage, ConnectError> {
    timeout(ANSWER_DEADLINE, wire.receive())
        .await
        .unwrap_or_else(|_| Err(ConnectError::Lost("no answer in time".to_owned())))
}

async fn fetch(
    wire: &mut Wire,
    world_bytes: u64,
    progress: Option<&DownloadProgress>,
) -> Result<Vec<u8>, ConnectError> {
    if world_bytes > WORLD_BYTES_MAX {
        return Err(ConnectError::WorldTooLarge(world_bytes));
    }
    wire.send(&ClientMessage::FetchWorld).await?;
    let connection = wire.connection().clone();
    // A server that would rather say goodbye says it on the other stream.
    let stream = tokio::select! {
        stream = timeout(ANSWER_DEADLINE, connection.accept_uni()) => stream,
        message = wire.receive() => return Err(match message? {
            ServerMessage::Goodbye { reason } => ConnectError::Goodbye(reason.into()),
            _ => ReplicaError::OutOfPlace.into(),
        }),
    };
    let stream = stream.map_err(|_| ConnectError::Lost("no world in time".to_owned()))?;
    download(stream.map_err(lost)?, world_bytes, progress).await
}

async fn download(
    mut stream: RecvStream,
    world_bytes: u64,
    progress: Option<&DownloadProgress>,
) -> Result<Vec<u8>, ConnectError> {
    // Memory grows with what has come, not with what was announced.
    let mut bytes = Vec::new();
    loop {
        let piece = timeout(PIECE_DEADLINE, stream.read_chunk(usize::MAX, true))
            .await
            .map_err(|_| ConnectError::Lost("the world stopped coming".to_owned()))?
            .map_err(|error| ConnectError::Lost(error.to_string()))?;
        let Some(piece) = piece else { break };
        bytes.extend_from_slice(&piece.bytes);
        if bytes.len() as u64 > world_bytes {
            return Err(ConnectError::World(ReadError::Damaged));
        }
        if let Some(progress) = progress {
            progress(bytes.len() as u64, world_bytes);
        }
    }
    Ok(bytes)
}
