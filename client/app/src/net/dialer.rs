//! From an address to a session.

use std::{
    hash::{BuildHasher, RandomState},
    io,
    net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket},
    path::PathBuf,
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use quinn::{
    AckFrequencyConfig, Connection, ConnectionError, Endpoint, EndpointConfig, TokioRuntime,
    TransportConfig, VarInt,
};
use sightline_cli::identity::Identity;
use sightline_client_core::replica::ReplicaError;
use sightline_protocol::{
    VERSION,
    message::{ClientMessage, Refusal, ServerMessage},
    text::{ChatLine, Name},
};
use sightline_world::motion::AvatarId;
use socket2::{Domain, Protocol, Socket, Type};
use tokio::time::{Instant, sleep, timeout};

use super::{
    cache::WorldCache,
    control_stream::ControlStream,
    error::{ConnectError, lost},
    passage::{JoinProgress, ProgressListener, tell},
    returning::{Caller, Pauses},
    session::{Session, Welcomed},
    trust::{self, Trust},
};

/// The server acknowledges packets after this time, or after a round trip if that is less.
const ACK_DELAY_MAX: Duration = Duration::from_millis(100);
/// The time within which the server must answer.
const ANSWER_DEADLINE: Duration = Duration::from_secs(10);

/// What the system is asked to keep of what arrives while no processor is free, in bytes.
const SOCKET_BYTES: usize = 4 << 20;
/// A connection on which nothing arrives for this long counts as lost, in milliseconds, or for
/// three times what a probe may take.
const IDLE_MS_MAX: u32 = 5_000;
/// How often an idle connection is kept alive.
const KEEP_ALIVE: Duration = Duration::from_secs(2);
/// How long a client that comes for the first time tries to reach the server.
const REACH_DEADLINE: Duration = Duration::from_secs(15);
/// How often a connection may break on the way in.
const BREAKS_MAX: u32 = 2;
/// How long a client that a busy server puts off tries again.
const PATIENCE: Duration = Duration::from_secs(60);
/// The longest time that a server may put a client off at once.
const RETRY_MAX: Duration = Duration::from_secs(10);

/// How a client introduces itself, and which servers it trusts.
#[derive(Clone)]
pub struct ConnectOptions {
    /// The name that others see.
    pub name: Name,
    /// The colour of the avatar: red, green and blue in sRGB.
    pub colour: [u8; 3],
    /// The wished position of the eye; a spawn point when `None`.
    pub place: Option<glam::Vec3>,
    /// The trusted servers.
    pub trust: Trust,
    /// The visitor's key, by which the server knows it again.
    pub identity: Arc<Identity>,
    /// An invitation, where not everybody is let in.
    pub invitation: Option<ChatLine>,
    /// Whether the world may arrive in pieces while the client is in it, where the server offers
    /// that and the world is not here already: see [`Session::building`].
    pub in_pieces: bool,
    /// Called as the client comes nearer to the first world.
    pub progress: Option<ProgressListener>,
}

/// Makes sessions that share a socket and the worlds that they need. So do those of its copies.
#[derive(Clone, Debug)]
pub struct Dialer {
    /// One endpoint for IPv4 and one for IPv6, opened when first needed.
    endpoints: Arc<Mutex<[Option<Endpoint>; 2]>>,
    cache: Arc<WorldCache>,
}

impl Dialer {
    /// A dialer that keeps worlds in a folder, or only in memory when `None`.
    pub fn new(world_folder: Option<PathBuf>) -> Self {
        Self { endpoints: Arc::default(), cache: Arc::new(WorldCache::new(world_folder)) }
    }

    /// Connects, waits until the server has a world, fetches it unless it is in the cache, and
    /// enters it. Must be called within a tokio runtime, in which the session then runs. Where the
    /// server is busy and puts the client off, it comes again by itself, for up to a minute. Where
    /// the connection breaks on the way in, it tries twice more.
    ///
    /// # Errors
    /// When any step fails. The connection is closed then.
    pub async fn connect(
        &self,
        address: SocketAddr,
        options: &ConnectOptions,
    ) -> Result<Session, ConnectError> {
        let give_up = Instant::now() + PATIENCE;
        let mut breaks = 0;
        loop {
            let retry_ms = match self.connect_once(address, options).await {
                Err(ConnectError::Refused(Refusal::Busy { retry_ms })) => retry_ms,
                Err(ConnectError::Lost(_) | ConnectError::Goodbye { may_return: true, .. })
                    if breaks < BREAKS_MAX =>
                {
                    breaks += 1;
                    continue;
                }
                connected => return connected,
            };
            // Those who were put off together come again apart.
            let spread_ms = RandomState::new().hash_one(address) % u64::from(retry_ms.max(1));
            let wait = Duration::from_millis(u64::from(retry_ms) + spread_ms).min(RETRY_MAX);
            if Instant::now() + wait > give_up {
                return Err(ConnectError::Refused(Refusal::Busy { retry_ms }));
            }
            tell(options.progress.as_ref(), || {
                JoinProgress::Waiting("it has more to do than it can, for the moment".to_owned())
            });
            sleep(wait).await;
        }
    }

    async fn connect_once(
        &self,
        address: SocketAddr,
        options: &ConnectOptions,
    ) -> Result<Session, ConnectError> {
        let caller = Caller::new(self.clone(), address, options.clone());
        let give_up = Instant::now() + REACH_DEADLINE;
        let is_silent: fn(&ConnectError) -> bool = |e| matches!(e, ConnectError::NoAnswer(_));
        let (_, connection) = caller.reach(&mut Pauses::first(), give_up, is_silent).await?;
        let welcomed = self.greet(connection, address, options).await?;
        Session::start(welcomed, caller, self.cache.clone()).await
    }

    /// Connects to a server, which is not trusted yet.
    pub(super) async fn open(
        &self,
        address: SocketAddr,
        options: &ConnectOptions,
    ) -> Result<Connection, ConnectError> {
        let mut config = quinn::ClientConfig::new(Arc::new(trust::crypto(&options.identity)?));
        config.transport_config(Arc::new(transport()));
        let connecting = self
            .endpoint(address.is_ipv6())?
            .connect_with(config, address, "sightline")
            .map_err(|error| ConnectError::Address { address, reason: error.to_string() })?;
        match timeout(ANSWER_DEADLINE, connecting).await {
            Ok(Ok(connection)) => Ok(connection),
            Err(_) | Ok(Err(ConnectionError::TimedOut)) => Err(ConnectError::NoAnswer(address)),
            Ok(Err(error)) => Err(lost(error)),
        }
    }

    /// Checks that the server is a trusted one, says hello, and waits until it is welcome.
    pub(super) async fn greet(
        &self,
        connection: Connection,
        address: SocketAddr,
        options: &ConnectOptions,
    ) -> Result<Welcomed, ConnectError> {
        options.trust.check(&connection, address)?;
        let mut control = ControlStream::open(&connection).await?;
        let (name, colour) = (options.name.clone(), options.colour);
        let (invitation, secret) = (options.invitation.clone(), None);
        let hello = ClientMessage::Hello { version: VERSION, name, colour, invitation, secret };
        control.sender.send(&hello).await?;
        let (avatar, tick_interval) = welcome(&mut control).await?;
        Ok(Welcomed { control, avatar, tick_interval })
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
        let socket = socket(own).map_err(ConnectError::Socket)?;
        let runtime = Arc::new(TokioRuntime);
        let endpoint = Endpoint::new(EndpointConfig::default(), None, socket, runtime)
            .map_err(ConnectError::Socket)?;
        Ok(slot.insert(endpoint).clone())
    }
}

/// A socket with large buffers: many sessions may share it.
fn socket(own: SocketAddr) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::for_address(own), Type::DGRAM, Some(Protocol::UDP))?;
    // With smaller ones the client works, too.
    let _ = socket.set_recv_buffer_size(SOCKET_BYTES);
    let _ = socket.set_send_buffer_size(SOCKET_BYTES);
    socket.bind(&own.into())?;
    Ok(socket.into())
}

fn transport() -> TransportConfig {
    // The server need not say at each report that it has arrived: it says so with the next poses.
    let mut acks = AckFrequencyConfig::default();
    acks.ack_eliciting_threshold(VarInt::from_u32(8)).max_ack_delay(Some(ACK_DELAY_MAX));
    let mut transport = TransportConfig::default();
    transport
        .max_concurrent_bidi_streams(VarInt::from_u32(0))
        .max_concurrent_uni_streams(VarInt::from_u32(2))
        .stream_receive_window(VarInt::from_u32(4 << 20))
        .receive_window(VarInt::from_u32(4 << 20))
        .send_window(256 * 1_024)
        .datagram_receive_buffer_size(Some(256 * 1_024))
        .datagram_send_buffer_size(4 * 1_024)
        .ack_frequency_config(Some(acks))
        .keep_alive_interval(Some(KEEP_ALIVE))
        .max_idle_timeout(Some(VarInt::from_u32(IDLE_MS_MAX).into()));
    transport
}

async fn welcome(control: &mut ControlStream) -> Result<(AvatarId, Duration), ConnectError> {
    match answer(control).await? {
        ServerMessage::Welcome { avatar, tick_interval_us } => {
            Ok((avatar, Duration::from_micros(u64::from(tick_interval_us.get()))))
        }
        ServerMessage::Refused { reason } => Err(ConnectError::Refused(reason)),
        ServerMessage::Goodbye { reason, may_return } => {
            Err(ConnectError::Goodbye { reason: reason.into(), may_return })
        }
        _ => Err(ReplicaError::OutOfPlace.into()),
    }
}

async fn answer(control: &mut ControlStream) -> Result<ServerMessage, ConnectError> {
    timeout(ANSWER_DEADLINE, control.receiver.receive())
        .await
        .unwrap_or_else(|_| Err(ConnectError::Lost("no answer in time".to_owned())))
}
