//! One connection, from its first message to its last.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::Duration,
};

use quinn::{Connection, ReadError, RecvStream, SendDatagramError, SendStream};
use sightline_protocol::{
    DecodeError, VERSION,
    frame::{FRAME_BYTES_MAX, FrameBuffer},
    message::{ClientMessage, Refusal, ServerMessage},
    pose_stream::ClientDatagram,
    text::Name,
};
use sightline_world::{motion::Pose, tolerance::WIRE_POSE_M};
use tokio::{
    task::JoinSet,
    time::{Instant, sleep_until, timeout, timeout_at},
};

use super::{
    Client, Context,
    admission::{Bucket, Budget, Verdict},
    hub::ToHub,
    outbox::Batch,
};
use sightline_engine::Input;

/// A client that has the world, or needs none, has so long to come in.
const ENTER_DEADLINE: Duration = Duration::from_secs(30);
/// A download that is slower than this, in bytes a second, is given up.
const DOWNLOAD_RATE_MIN: u64 = 32 * 1_024;
/// A stream that takes nothing for so long is given up.
const WRITE_DEADLINE: Duration = Duration::from_secs(10);
/// How long the last words may take.
const FAREWELL_DEADLINE: Duration = Duration::from_secs(2);
/// Lines of chat a second, and at once; more are ignored.
const CHAT: (f64, f64) = (1.0, 5.0);

/// Why a session ended.
#[derive(Debug, thiserror::Error)]
pub enum End {
    /// The connection is gone.
    #[error("connection lost: {0}")]
    Lost(String),
    /// It said goodbye.
    #[error("left")]
    Left,
    /// It was refused.
    #[error("refused: {0}")]
    Refused(Refusal),
    /// Its last words are in the outbox.
    #[error("told to go")]
    Told,
    /// It sent what no client sends.
    #[error("{0}")]
    Junk(#[from] DecodeError),
    /// It did what no client does.
    #[error("{0}")]
    Breach(&'static str),
}

/// Serves a connection until it ends. The caller cleans up.
pub async fn run(context: &Context, connection: Connection, client: Arc<Client>) -> End {
    let deadline = Instant::now() + Duration::from_secs_f64(context.config.hello_s);
    let mut closing = context.closing.clone();
    let greeted = tokio::select! {
        greeted = timeout_at(deadline, greet(&connection)) => greeted,
        _ = closing.wait_for(|is_closing| *is_closing) => {
            connection.close(0u32.into(), b"the server is closing");
            return End::Breach("the server is closing");
        }
    };
    let Ok(greeted) = greeted else {
        connection.close(1u32.into(), b"no hello in time");
        return End::Breach("no hello in time");
    };
    let (mut writer, frames, hello) = match greeted {
        Ok(greeted) => greeted,
        Err(end) => {
            connection.close(1u32.into(), end.to_string().as_bytes());
            return end;
        }
    };
    let end = match context.admit(&client, &hello) {
        Ok(()) => {
            Session::new(context, &connection, client.clone(), hello)
                .talk(&mut writer, frames)
                .await
        }
        Err(refusal) => {
            client.outbox.push(&ServerMessage::Refused { reason: refusal });
            End::Refused(refusal)
        }
    };
    if !matches!(end, End::Lost(_)) {
        let _ = timeout(FAREWELL_DEADLINE, writer.farewell(&client)).await;
    }
    connection.close(0u32.into(), b"");
    end
}

/// Who comes.
pub struct Hello {
    pub name: Name,
    pub colour: [u8; 3],
    /// The client's version of the protocol is another one.
    pub is_foreign: bool,
}

/// Waits for the stream and its first frame.
async fn greet(connection: &Connection) -> Result<(Writer, Frames, Hello), End> {
    let (send, receive) =
        connection.accept_bi().await.map_err(|error| End::Lost(error.to_string()))?;
    let mut frames = Frames::new(receive);
    let first = frames.next().await?;
    let hello = if ClientMessage::version(&first)? != VERSION {
        Hello { name: Name::clipped(""), colour: [0; 3], is_foreign: true }
    } else {
        match ClientMessage::decode(&first)? {
            ClientMessage::Hello { name, colour, .. } => Hello { name, colour, is_foreign: false },
            _ => return Err(End::Breach("no hello")),
        }
    };
    Ok((Writer { send, unsent: Vec::new(), written: 0 }, frames, hello))
}

/// What is going on with a client that was let in.
struct Session<'a> {
    context: &'a Context,
    connection: &'a Connection,
    client: Arc<Client>,
    hello: Hello,
    has_entered: AtomicBool,
    limits: Mutex<Limits>,
}

struct Limits {
    budget: Budget,
    chat: Bucket,
    /// When the client has to have said something.
    deadline: Instant,
}

impl<'a> Session<'a> {
    fn new(
        context: &'a Context,
        connection: &'a Connection,
        client: Arc<Client>,
        hello: Hello,
    ) -> Self {
        let now = context.now();
        let limits = Limits {
            budget: Budget::new(context.config.tick_hz, now),
            chat: Bucket::new(CHAT.0, CHAT.1, now),
            deadline: Instant::now() + ENTER_DEADLINE,
        };
        let (has_entered, limits) = (AtomicBool::new(false), Mutex::new(limits));
        Self { context, connection, client, hello, has_entered, limits }
    }

    /// Listens and tells until one of many things ends it.
    async fn talk(&self, writer: &mut Writer, mut frames: Frames) -> End {
        self.client.outbox.push(&self.context.welcome(self.client.avatar));
        let mut closing = self.context.closing.clone();
        let end = tokio::select! {
            end = self.listen(&mut frames) => end,
            end = self.listen_to_datagrams() => end,
            end = self.watch() => end,
            end = writer.run(&self.client, self.connection) => end,
            _ = closing.wait_for(|closing| *closing) => End::Breach("the server is closing"),
        };
        if let End::Junk(_) | End::Breach(_) = end {
            self.client.outbox.end(&end.to_string());
        }
        end
    }

    async fn listen(&self, frames: &mut Frames) -> End {
        let mut download = JoinSet::new();
        loop {
            let heard = match frames.next().await {
                Ok(frame) => self.hear(&frame, &mut download).await,
                Err(end) => Err(end),
            };
            if let Err(end) = heard {
                return end;
            }
        }
    }

    async fn listen_to_datagrams(&self) -> End {
        loop {
            let datagram = match self.connection.read_datagram().await {
                Ok(datagram) => datagram,
                Err(error) => return End::Lost(error.to_string()),
            };
            if let Err(end) = self.hear_datagram(&datagram).await {
                return end;
            }
        }
    }

    /// Ends when the client is silent for too long.
    async fn watch(&self) -> End {
        loop {
            let deadline = self.limits().deadline;
            if deadline <= Instant::now() {
                return End::Breach("silent for too long");
            }
            sleep_until(deadline).await;
        }
    }

    async fn hear(&self, frame: &[u8], download: &mut JoinSet<()>) -> Result<(), End> {
        self.client.counters.frame_in(frame.len() + 2);
        if !self.may_go_on(frame.len())? {
            return Ok(());
        }
        let avatar = self.client.avatar;
        match ClientMessage::decode(frame)? {
            ClientMessage::Hello { .. } => Err(End::Breach("a second hello")),
            ClientMessage::FetchWorld => self.send_world(download),
            ClientMessage::Enter { place } => self.enter(place.map(Into::into)).await,
            ClientMessage::Report { sequence, pose } => {
                self.tell(Input::Report { avatar, sequence, pose: Pose::from(pose) }).await
            }
            ClientMessage::Chat { text } => {
                let now = self.context.now();
                if !self.limits().chat.take(1.0, now) {
                    return Ok(());
                }
                self.tell(Input::Chat { avatar, text: text.into() }).await
            }
            ClientMessage::Goodbye => Err(End::Left),
        }
    }

    async fn hear_datagram(&self, datagram: &[u8]) -> Result<(), End> {
        self.client.counters.datagram_in(datagram.len());
        if !self.may_go_on(datagram.len())? {
            return Ok(());
        }
        let ClientDatagram { ack, report } = ClientDatagram::decode(datagram)?;
        self.client.outbox.acknowledge(ack);
        match report {
            Some((sequence, pose)) => {
                let (avatar, pose) = (self.client.avatar, Pose::from(pose));
                self.tell(Input::Report { avatar, sequence, pose }).await
            }
            None => Ok(()),
        }
    }

    /// Whether a message is to be listened to.
    fn may_go_on(&self, bytes: usize) -> Result<bool, End> {
        match self.limits().budget.judge(bytes, self.context.now()) {
            Verdict::Take => Ok(true),
            Verdict::Ignore => Ok(false),
            Verdict::Kick => Err(End::Breach("too many messages")),
        }
    }

    /// Whether a place that a client asks for is one of those that everybody can have.
    fn may_enter_at(&self, place: glam::Vec3) -> bool {
        let spawns = &self.context.world.world().spawns;
        self.context.config.free_entry
            || spawns.iter().any(|spawn| spawn.eye.distance(place) <= WIRE_POSE_M)
    }

    async fn enter(&self, place: Option<glam::Vec3>) -> Result<(), End> {
        if self.has_entered.swap(true, Relaxed) {
            return Err(End::Breach("entered twice"));
        }
        self.heard();
        let (name, colour) = (self.hello.name.clone().into(), self.hello.colour);
        let client = self.client.clone();
        let place = place.filter(|place| self.may_enter_at(*place));
        self.send_to_hub(ToHub::Join { client, name, colour, place }).await
    }

    /// Passes on what a client in the world did; from one that is not in, it is of no interest.
    async fn tell(&self, input: Input) -> Result<(), End> {
        if !self.has_entered.load(Relaxed) {
            return Ok(());
        }
        self.heard();
        self.send_to_hub(ToHub::Input(input)).await
    }

    async fn send_to_hub(&self, message: ToHub) -> Result<(), End> {
        self.context.hub.send(message).await.map_err(|_| End::Breach("the server is closing"))
    }

    fn heard(&self) {
        let config = &self.context.config;
        // A quiet client may well say nothing for as long as its TBV holds.
        let silence = Duration::from_secs_f64(config.silence_s + config.validity_max_s);
        self.limits().deadline = Instant::now() + silence;
    }

    /// Sends the world beside the conversation; once, and no slower than it is worth.
    fn send_world(&self, download: &mut JoinSet<()>) -> Result<(), End> {
        if !download.is_empty() || self.has_entered.load(Relaxed) {
            return Err(End::Breach("the world asked for twice"));
        }
        let world = self.context.world.bytes.clone();
        let allowed = Duration::from_secs(world.len() as u64 / DOWNLOAD_RATE_MIN);
        self.limits().deadline += allowed;
        let (connection, client) = (self.connection.clone(), self.client.clone());
        download.spawn(async move {
            let Ok(mut stream) = connection.open_uni().await else { return };
            // Control messages go first.
            let _ = stream.set_priority(-1);
            for piece in world.chunks(64 * 1_024) {
                let piece = world.slice_ref(piece);
                let bytes = piece.len();
                if stream.write_chunk(piece).await.is_err() {
                    return;
                }
                client.counters.world_out(bytes);
            }
            let _ = stream.finish();
            // The stream must live until all of it has arrived.
            let _ = stream.stopped().await;
        });
        Ok(())
    }

    fn limits(&self) -> std::sync::MutexGuard<'_, Limits> {
        self.limits.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whole frames from a stream.
struct Frames {
    stream: RecvStream,
    buffer: FrameBuffer,
}

impl Frames {
    fn new(stream: RecvStream) -> Self {
        Self { stream, buffer: FrameBuffer::default() }
    }

    async fn next(&mut self) -> Result<Vec<u8>, End> {
        let mut piece = [0; FRAME_BYTES_MAX];
        loop {
            if let Some(frame) = self.buffer.next_frame()? {
                return Ok(frame.to_vec());
            }
            match self.stream.read(&mut piece).await {
                Ok(Some(bytes)) => self.buffer.push(piece.get(..bytes).unwrap_or_default()),
                Ok(None) | Err(ReadError::Reset(_)) => return Err(End::Left),
                Err(error) => return Err(End::Lost(error.to_string())),
            }
        }
    }
}

/// Empties an outbox. May be interrupted anywhere and goes on where it was.
struct Writer {
    send: SendStream,
    unsent: Vec<u8>,
    written: usize,
}

impl Writer {
    async fn run(&mut self, client: &Client, connection: &Connection) -> End {
        loop {
            let space = connection.datagram_send_buffer_space();
            // Poses wait for the path here, where newer ones take their place, not in QUIC's queue.
            let bytes_max = connection.max_datagram_size().filter(|_| space >= 16 * 1_024);
            let batch = client.outbox.take(bytes_max);
            let is_last = batch.is_last;
            if let Err(end) = self.send(client, connection, batch).await {
                return end;
            }
            if is_last {
                return End::Told;
            }
            client.outbox.filled().await;
        }
    }

    async fn send(
        &mut self,
        client: &Client,
        connection: &Connection,
        batch: Batch,
    ) -> Result<(), End> {
        client.counters.frames_out(batch.frames, batch.control.len());
        self.unsent.extend_from_slice(&batch.control);
        for datagram in batch.datagrams {
            client.counters.datagram_out(datagram.len());
            match connection.send_datagram(datagram.into()) {
                // The path became narrower this very moment: as good as lost.
                Ok(()) | Err(SendDatagramError::TooLarge) => {}
                Err(error) => return Err(End::Lost(error.to_string())),
            }
        }
        self.drain().await
    }

    /// Writes what is unsent.
    async fn drain(&mut self) -> Result<(), End> {
        while let Some(rest) = self.unsent.get(self.written..).filter(|rest| !rest.is_empty()) {
            let written = timeout(WRITE_DEADLINE, self.send.write(rest)).await;
            match written {
                Ok(Ok(bytes)) => self.written += bytes,
                Ok(Err(error)) => return Err(End::Lost(error.to_string())),
                Err(_) => return Err(End::Breach("it does not read")),
            }
        }
        self.unsent.clear();
        self.written = 0;
        Ok(())
    }

    /// Sends what is left in the outbox and waits until it arrived.
    async fn farewell(&mut self, client: &Client) {
        let batch = client.outbox.take(None);
        client.counters.frames_out(batch.frames, batch.control.len());
        self.unsent.extend_from_slice(&batch.control);
        if self.drain().await.is_ok() && self.send.finish().is_ok() {
            let _ = self.send.stopped().await;
        }
    }
}
