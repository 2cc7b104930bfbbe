//! A session: it listens, answers and reports by itself.

use std::{
    collections::VecDeque,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use quinn::{Connection, RecvStream, SendDatagramError, SendStream, VarInt};
use sightline_protocol::{
    frame::{self, FRAME_BYTES_MAX, FrameBuffer},
    message::{ClientMessage, ServerMessage},
    text::{ChatLine, Name, TextError},
};
use sightline_world::{
    World,
    geometry::Aabb,
    motion::{AvatarId, Pose, ReportingState},
};
use tokio::{
    runtime::Runtime,
    sync::mpsc,
    task::JoinHandle,
    time::{MissedTickBehavior, timeout},
};

use super::dialer::{ConnectError, lost};
use sightline_client_core::replica::{
    AvatarSource, Event, HeldAvatar, Outgoing, Replica, Update, VisibleAvatar,
};

/// Events that nobody collects: the oldest go.
const EVENTS_MAX: usize = 1_024;
/// Lines of chat that may wait to be sent.
const COMMANDS_MAX: usize = 16;
/// How long the last words may take.
const FAREWELL_DEADLINE: Duration = Duration::from_secs(2);

/// A client in a world. Its methods never wait for the network and may be called on any thread.
/// Dropping it ends the connection; [`Session::leave`] also says goodbye.
pub struct Session {
    shared: Arc<Shared>,
    world: Arc<World>,
    commands: mpsc::Sender<Command>,
    task: JoinHandle<()>,
    /// Of a session for a thread that has none.
    runtime: Option<Runtime>,
}

/// What [`Session::stats`] tells.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SessionStats {
    /// What the server expects of this client; `None` before it is in the world.
    pub reporting_state: Option<ReportingState>,
    /// How many may be in view.
    pub visible: usize,
    /// Application messages that came: control messages and datagrams.
    pub messages_in: u64,
    /// Application messages that went.
    pub messages_out: u64,
    /// Their bytes, without QUIC's own.
    pub bytes_in: u64,
    /// Their bytes, without QUIC's own.
    pub bytes_out: u64,
    /// UDP payload that came, QUIC and the world's download included, in bytes.
    pub udp_bytes_in: u64,
    /// UDP payload that went, in bytes.
    pub udp_bytes_out: u64,
    /// UDP payload over the last second, in bytes a second.
    pub udp_rate_in: f64,
    /// UDP payload over the last second, in bytes a second.
    pub udp_rate_out: f64,
    /// How long silence was expected, since the start.
    pub quiet: Duration,
    /// Since the start.
    pub elapsed: Duration,
    /// The round trip.
    pub round_trip: Duration,
}

enum Command {
    Say(ChatLine),
    Leave,
}

struct Shared {
    connection: Connection,
    started: Instant,
    name: Name,
    state: Mutex<State>,
    messages_in: AtomicU64,
    messages_out: AtomicU64,
    bytes_in: AtomicU64,
    bytes_out: AtomicU64,
}

struct State {
    replica: Replica,
    events: VecDeque<Event>,
    /// Why it ended.
    end: Option<String>,
    meter: Meter,
}

/// Bytes at the start of this second and the last.
#[derive(Default)]
struct Meter {
    at: Duration,
    bytes: (u64, u64),
    rate: (f64, f64),
}

impl Session {
    /// Waits until the server gives a place, then lets the session run by itself.
    pub(super) async fn start(
        wire: Wire,
        replica: Replica,
        world: Arc<World>,
        name: Name,
    ) -> Result<Self, ConnectError> {
        let tick_interval = replica.tick_interval();
        let (events, meter) = (VecDeque::new(), Meter::default());
        let shared = Arc::new(Shared {
            connection: wire.connection.clone(),
            started: Instant::now(),
            name,
            state: Mutex::new(State { replica, events, end: None, meter }),
            messages_in: AtomicU64::new(0),
            messages_out: AtomicU64::new(0),
            bytes_in: AtomicU64::new(0),
            bytes_out: AtomicU64::new(0),
        });
        let mut driver = Driver { wire, shared: shared.clone() };
        while shared.state().replica.reporting_state().is_none() {
            let message = driver.wire.receive().await?;
            if let ServerMessage::Goodbye { reason } = message {
                return Err(ConnectError::Goodbye(reason.into()));
            }
            driver.hear(message).await?;
        }
        let (commands, inbox) = mpsc::channel(COMMANDS_MAX);
        let task = tokio::spawn(driver.run(inbox, tick_interval));
        Ok(Self { shared, world, commands, task, runtime: None })
    }

    pub(super) fn with_runtime(mut self, runtime: Runtime) -> Self {
        self.runtime = Some(runtime);
        self
    }

    /// The building.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// Who the own avatar is.
    pub fn avatar(&self) -> AvatarId {
        self.shared.state().replica.avatar()
    }

    /// Tells where the own avatar is; at each frame. The session reports it when it has to.
    pub fn set_pose(&self, pose: Pose) {
        self.shared.state().replica.set_pose(pose);
    }

    /// Where the own avatar is, as far as the session knows: where it entered or was corrected to,
    /// until [`Session::set_pose`].
    pub fn pose(&self) -> Pose {
        self.shared.state().replica.pose()
    }

    /// Everybody that may be in view, where it is to be drawn now.
    pub fn visible(&self) -> Vec<VisibleAvatar> {
        let now = self.shared.now();
        self.shared.state().replica.visible(now)
    }

    /// What the server's clock says of the moment that is drawn now: see [`Replica::server_time`].
    pub fn server_time(&self) -> Duration {
        let now = self.shared.now();
        self.shared.state().replica.server_time(now)
    }

    /// Everybody that may be in view, as last told of.
    pub fn held(&self) -> Vec<HeldAvatar> {
        let now = self.shared.now();
        self.shared.state().replica.held(now).collect()
    }

    /// Says something to those who may see the own avatar. Too much at once is not said.
    ///
    /// # Errors
    /// When the text is empty, too long, or cannot be shown.
    pub fn chat(&self, text: &str) -> Result<(), TextError> {
        let line = ChatLine::new(text)?;
        let _ = self.commands.try_send(Command::Say(line));
        Ok(())
    }

    /// What happened since the last call.
    pub fn events(&self) -> Vec<Event> {
        self.shared.state().events.drain(..).collect()
    }

    /// Why the session ended; `None` while it runs.
    pub fn end(&self) -> Option<String> {
        self.shared.state().end.clone()
    }

    /// What was counted up to now.
    pub fn stats(&self) -> SessionStats {
        let now = self.shared.now();
        let quic = self.shared.connection.stats();
        let state = self.shared.state();
        SessionStats {
            reporting_state: state.replica.reporting_state(),
            visible: state.replica.held_len(),
            messages_in: self.shared.messages_in.load(Relaxed),
            messages_out: self.shared.messages_out.load(Relaxed),
            bytes_in: self.shared.bytes_in.load(Relaxed),
            bytes_out: self.shared.bytes_out.load(Relaxed),
            udp_bytes_in: quic.udp_rx.bytes,
            udp_bytes_out: quic.udp_tx.bytes,
            udp_rate_in: state.meter.rate.0,
            udp_rate_out: state.meter.rate.1,
            quiet: state.replica.quiet_time(now),
            elapsed: now,
            round_trip: quic.path.rtt,
        }
    }

    /// Says goodbye and waits, for 2 seconds at the most, until it arrived.
    pub async fn leave(mut self) {
        let _ = self.commands.try_send(Command::Leave);
        let _ = timeout(FAREWELL_DEADLINE, &mut self.task).await;
    }

    /// The same from a thread without a runtime, for a session made by
    /// [`connect_blocking`](super::connect_blocking).
    pub fn leave_blocking(mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.block_on(self.leave());
            runtime.shutdown_background();
        }
    }
}

impl AvatarSource for &Session {
    fn updates(&mut self) -> Vec<(AvatarId, Update)> {
        self.shared.state().replica.updates()
    }

    fn path(&self, avatar: AvatarId, now: Duration, until: Duration) -> Option<(Pose, Aabb)> {
        self.shared.state().replica.path(avatar, now, until)
    }

    fn shown(&self, avatar: AvatarId, now: Duration) -> Option<VisibleAvatar> {
        self.shared.state().replica.shown(avatar, now)
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.task.abort();
        self.shared.connection.close(VarInt::from_u32(0), b"");
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

impl Shared {
    fn now(&self) -> Duration {
        self.started.elapsed()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Nothing that holds the lock leaves the state half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn came(&self, bytes: usize) {
        self.messages_in.fetch_add(1, Relaxed);
        self.bytes_in.fetch_add(bytes as u64, Relaxed);
    }

    fn went(&self, bytes: usize) {
        self.messages_out.fetch_add(1, Relaxed);
        self.bytes_out.fetch_add(bytes as u64, Relaxed);
    }
}

impl Meter {
    fn read(&mut self, now: Duration, bytes: (u64, u64)) {
        let passed = now.saturating_sub(self.at).as_secs_f64();
        if passed >= 1.0 {
            let rate = |new: u64, old: u64| new.saturating_sub(old) as f64 / passed;
            self.rate = (rate(bytes.0, self.bytes.0), rate(bytes.1, self.bytes.1));
            (self.at, self.bytes) = (now, bytes);
        }
    }
}

/// The task of a session.
struct Driver {
    wire: Wire,
    shared: Arc<Shared>,
}

impl Driver {
    async fn run(mut self, mut inbox: mpsc::Receiver<Command>, tick_interval: Duration) {
        let end = match self.talk(&mut inbox, tick_interval).await {
            Ok(reason) => reason,
            Err(error) => self.last_words().await.unwrap_or_else(|| error.to_string()),
        };
        self.shared.state().end.get_or_insert(end);
        self.shared.connection.close(VarInt::from_u32(0), b"");
    }

    async fn talk(
        &mut self,
        inbox: &mut mpsc::Receiver<Command>,
        tick_interval: Duration,
    ) -> Result<String, ConnectError> {
        let mut ticks = tokio::time::interval(tick_interval);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let connection = self.shared.connection.clone();
        loop {
            tokio::select! {
                message = self.wire.receive() => {
                    if let Some(goodbye) = self.hear(message?).await? {
                        return Ok(goodbye);
                    }
                }
                datagram = connection.read_datagram() => {
                    let datagram = datagram.map_err(lost)?;
                    self.shared.came(datagram.len());
                    let now = self.shared.now();
                    if let Err(error) = self.shared.state().replica.datagram(now, &datagram) {
                        tracing::debug!(%error, "a datagram was of no use");
                    }
                }
                _ = ticks.tick() => self.tick().await?,
                command = inbox.recv() => match command {
                    Some(Command::Say(text)) => self.send(&ClientMessage::Chat { text }).await?,
                    Some(Command::Leave) | None => {
                        self.send(&ClientMessage::Goodbye).await?;
                        let _ = timeout(FAREWELL_DEADLINE, self.wire.finish()).await;
                        return Ok("left".to_owned());
                    }
                },
            }
        }
    }

    /// The goodbye that arrived together with the end of the connection, if one did: who waits for
    /// datagrams may hear of the end first.
    async fn last_words(&mut self) -> Option<String> {
        self.shared.connection.close_reason()?;
        // What had arrived before the end is finite, and can still be read.
        while let Ok(message) = self.wire.receive().await {
            if let Ok(Some(goodbye)) = self.hear(message).await {
                return Some(goodbye);
            }
        }
        None
    }

    /// Takes in a message and answers it if it was an ask; tells the goodbye if it was one.
    async fn hear(&mut self, message: ServerMessage) -> Result<Option<String>, ConnectError> {
        self.shared.came(self.wire.frame_bytes);
        let mut goodbye = None;
        let answer = {
            let now = self.shared.now();
            let mut state = self.shared.state();
            if let Some(mut event) = state.replica.message(now, message)? {
                match &mut event {
                    Event::Goodbye(reason) => goodbye = Some(reason.clone()),
                    Event::Chat { from, name, .. } if *from == state.replica.avatar() => {
                        *name = self.shared.name.to_string();
                    }
                    _ => {}
                }
                if state.events.len() >= EVENTS_MAX {
                    state.events.pop_front();
                }
                state.events.push_back(event);
            }
            state.replica.answer()
        };
        if let Some(answer) = answer {
            self.send(&answer).await?;
        }
        Ok(goodbye)
    }

    async fn tick(&mut self) -> Result<(), ConnectError> {
        let stats = self.shared.connection.stats();
        let outgoing = {
            let mut state = self.shared.state();
            state.meter.read(self.shared.now(), (stats.udp_rx.bytes, stats.udp_tx.bytes));
            state.replica.tick(stats.path.rtt)
        };
        match outgoing {
            None => Ok(()),
            Some(Outgoing::Message(message)) => self.send(&message).await,
            Some(Outgoing::Datagram(bytes)) => {
                self.shared.went(bytes.len());
                match self.shared.connection.send_datagram(bytes.into()) {
                    // The path became narrower this very moment: as good as lost.
                    Ok(()) | Err(SendDatagramError::TooLarge) => Ok(()),
                    Err(error) => Err(ConnectError::Lost(error.to_string())),
                }
            }
        }
    }

    async fn send(&mut self, message: &ClientMessage) -> Result<(), ConnectError> {
        let bytes = self.wire.send(message).await?;
        self.shared.went(bytes);
        Ok(())
    }
}

/// The stream of control messages.
pub(super) struct Wire {
    connection: Connection,
    send: SendStream,
    receive: RecvStream,
    buffer: FrameBuffer,
    /// How long the frame was that was received last.
    frame_bytes: usize,
}

impl Wire {
    pub async fn open(connection: &Connection) -> Result<Self, ConnectError> {
        let (send, receive) = connection.open_bi().await.map_err(lost)?;
        let (connection, buffer) = (connection.clone(), FrameBuffer::default());
        Ok(Self { connection, send, receive, buffer, frame_bytes: 0 })
    }

    pub fn connection(&self) -> &Connection {
        &self.connection
    }

    /// Sends a message and tells how many bytes it took.
    pub async fn send(&mut self, message: &ClientMessage) -> Result<usize, ConnectError> {
        let frame = frame::encode(message);
        match self.send.write_all(&frame).await {
            Ok(()) => Ok(frame.len()),
            Err(quinn::WriteError::ConnectionLost(error)) => Err(lost(error)),
            Err(error) => Err(ConnectError::Lost(error.to_string())),
        }
    }

    /// The next message. What was read is kept when it is interrupted.
    pub async fn receive(&mut self) -> Result<ServerMessage, ConnectError> {
        let mut piece = [0; FRAME_BYTES_MAX];
        loop {
            if let Some(frame) = self.buffer.next_frame()? {
                self.frame_bytes = frame.len() + 2;
                return Ok(ServerMessage::decode(frame)?);
            }
            match self.receive.read(&mut piece).await {
                Ok(Some(bytes)) => self.buffer.push(piece.get(..bytes).unwrap_or_default()),
                Ok(None) => return Err(ConnectError::Lost("the server ended it".to_owned())),
                Err(quinn::ReadError::ConnectionLost(error)) => return Err(lost(error)),
                Err(error) => return Err(ConnectError::Lost(error.to_string())),
            }
        }
    }

    /// Waits until all that was sent has arrived.
    async fn finish(&mut self) {
        if self.send.finish().is_ok() {
            let _ = self.send.stopped().await;
        }
    }
}
