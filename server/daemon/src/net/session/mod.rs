//! One connection, from its first message to its last.

mod download;
mod end;
mod frames;
mod pieces;
mod writer;

use std::{
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU32, Ordering::Relaxed},
    },
    time::Duration,
};

use glam::Vec3;
use sightline_engine::Input;
use sightline_protocol::{
    VERSION,
    fingerprint::VisitorSecret,
    message::{ClientMessage, ServerMessage},
    pose_stream::ClientDatagram,
    quantise::WireReport,
    text::{ChatLine, Name},
};
use tokio::{
    sync::watch,
    time::{Instant, sleep_until, timeout, timeout_at},
};

use super::{
    admission::ConnectionId,
    budget::{BudgetDecision, MessageBudget, TokenBucket},
    client::{ConnectedClient, Hello},
    commands,
    engine_task::{EngineEvent, Newcomer},
    entrance::{self, Arrival},
    moderation::Moderation,
    offers::WorldOffer,
    places::place_in,
    state::ServerState,
    transport::{CloseCode, Transport},
};
use crate::operate::Reason;
use download::Downloads;
pub use end::SessionEnd;
use frames::FrameReader;
use writer::OutboxWriter;

/// How many more round trips a client may need until it has entered. Lost packets cost some.
const ENTER_ROUND_TRIPS: u32 = 12;
/// The longest round trip that counts for that.
const ROUND_TRIP_MAX: Duration = Duration::from_secs(1);
/// How often a client's silence is looked at, at least.
const LOOK_INTERVAL: Duration = Duration::from_secs(1);
/// A server that wakes later than this was stopped, or had no processor.
const WAKES_LATE: Duration = Duration::from_millis(500);
/// How long the last messages may take.
const FAREWELL_DEADLINE: Duration = Duration::from_secs(2);
/// How often a client may go back to a spawn point in a second; it is ignored more often.
const RESPAWNS_PER_SECOND: f64 = 0.5;
/// How many times it may do so at once.
const RESPAWNS_BURST: f64 = 3.0;

/// Serves a connection until it ends. The caller cleans up.
pub async fn run(state: &ServerState, transport: Transport, id: ConnectionId) -> SessionEnd {
    let end = serve(state, Arc::new(transport), id).await;
    end.refusal().into_iter().for_each(|reason| state.metrics.refusals.count(reason));
    end
}

async fn serve(state: &ServerState, transport: Arc<Transport>, id: ConnectionId) -> SessionEnd {
    let deadline = Instant::now() + Duration::from_secs_f64(state.config.hello_s);
    let mut closing = state.closing.clone();
    let greeted = tokio::select! {
        greeted = timeout_at(deadline, greet(state, &transport)) => greeted,
        _ = closing.wait_for(|is_closing| *is_closing) => {
            transport.close(CloseCode::Ended, "the server is closing");
            return SessionEnd::Closing;
        }
    };
    let Ok(greeted) = greeted else {
        transport.close(CloseCode::NoHello, "no hello in time");
        return SessionEnd::Limit(Reason::Hello, "no hello in time");
    };
    let Greeted { mut writer, frames, hello } = match greeted {
        Ok(greeted) => greeted,
        Err(end) => {
            transport.close(CloseCode::NoHello, &end.to_string());
            return end;
        }
    };
    let arrival = Arrival { id, transport: transport.clone(), hello };
    let client = match entrance::admit(state, arrival).await {
        Ok(client) => client,
        Err(refusal) => {
            let _ =
                timeout(FAREWELL_DEADLINE, writer.refuse(refusal, &state.metrics.traffic)).await;
            transport.close(CloseCode::Ended, "");
            return SessionEnd::Refused(refusal);
        }
    };
    let end = Session::new(state, client.clone()).talk(&mut writer, frames).await;
    if matches!(end, SessionEnd::Left) {
        // A client that comes again before the last words have arrived begins anew, with another
        // name perhaps.
        entrance::part(state, id, Some(&end)).await;
    }
    if !matches!(end, SessionEnd::Lost(_)) {
        let _ = timeout(FAREWELL_DEADLINE, writer.finish(&client)).await;
    }
    transport.close(CloseCode::Ended, "");
    end
}

/// A client's stream, once its hello has arrived.
struct Greeted {
    writer: OutboxWriter,
    frames: FrameReader,
    hello: Hello,
}

/// Waits for the stream and its first frame.
async fn greet(state: &ServerState, transport: &Transport) -> Result<Greeted, SessionEnd> {
    let (writer, reader) = transport.control().await?;
    let mut frames = FrameReader::new(reader);
    let first = frames.next().await?;
    state.metrics.traffic.frame_in(&first);
    // The rest of a hello of another version may have another form.
    let hello = if ClientMessage::version(&first)? != VERSION {
        let (name, invitation, key) = (Name::clipped(""), None, None);
        Hello { name, colour: [0; 3], invitation, key, is_foreign: true }
    } else {
        match ClientMessage::decode(&first)? {
            ClientMessage::Hello { name, colour, invitation, secret, .. } => {
                let key = match (transport.key(), secret) {
                    (Some(_), Some(_)) => {
                        return Err(SessionEnd::Breach("a certificate and a secret"));
                    }
                    (key, secret) => key.or(secret.as_ref().map(VisitorSecret::fingerprint)),
                };
                Hello { name, colour, invitation, key, is_foreign: false }
            }
            _ => return Err(SessionEnd::Breach("no hello")),
        }
    };
    let writer = OutboxWriter::new(writer, state.config.limits.write_s);
    Ok(Greeted { writer, frames, hello })
}

/// The conversation with an admitted client.
struct Session<'a> {
    state: &'a ServerState,
    client: Arc<ConnectedClient>,
    /// The number of the world that the client has entered; zero before.
    entered: AtomicU32,
    /// Reports made earlier on the client's clock are about another world.
    reports_from: AtomicU32,
    limits: Mutex<SessionLimits>,
}

struct SessionLimits {
    budget: MessageBudget,
    chat: TokenBucket,
    respawns: TokenBucket,
    /// When the client must have sent its next message; `None` while there is no world to enter.
    deadline: Option<Instant>,
}

impl<'a> Session<'a> {
    fn new(state: &'a ServerState, client: Arc<ConnectedClient>) -> Self {
        let now = state.now();
        let config = &state.config;
        let limits = SessionLimits {
            budget: MessageBudget::new(config.tick_hz, &config.limits, now),
            chat: TokenBucket::new(config.limits.chat_per_s, config.limits.chat_burst, now),
            respawns: TokenBucket::new(RESPAWNS_PER_SECOND, RESPAWNS_BURST, now),
            deadline: None,
        };
        let (entered, reports_from) = (AtomicU32::new(0), AtomicU32::new(0));
        Self { state, client, entered, reports_from, limits: Mutex::new(limits) }
    }

    /// Listens and sends, until something ends the session.
    async fn talk(&self, writer: &mut OutboxWriter, mut frames: FrameReader) -> SessionEnd {
        let mut closing = self.state.closing.clone();
        let end = tokio::select! {
            end = self.listen(&mut frames) => end,
            end = self.listen_to_datagrams() => end,
            end = self.watch_silence() => end,
            end = self.hand_out_pieces() => end,
            end = self.watch_offers(self.state.offers.offers()) => end,
            end = writer.run(&self.client) => end,
            _ = closing.wait_for(|closing| *closing) => SessionEnd::Closing,
        };
        if end.refusal().is_some() || matches!(end, SessionEnd::Closing) {
            let may_return = matches!(
                end,
                SessionEnd::Closing | SessionEnd::Limit(Reason::Silence | Reason::Enter, _)
            );
            self.client.outbox.end(&end.to_string(), may_return);
        }
        end
    }

    async fn listen(&self, frames: &mut FrameReader) -> SessionEnd {
        let mut downloads = Downloads::default();
        loop {
            let handled = match frames.next().await {
                Ok(frame) => self.handle_frame(&frame, &mut downloads).await,
                Err(end) => Err(end),
            };
            if let Err(end) = handled {
                return end;
            }
        }
    }

    async fn listen_to_datagrams(&self) -> SessionEnd {
        loop {
            let datagram = match self.client.transport.receive_datagram().await {
                Ok(datagram) => datagram,
                Err(error) => return error.into(),
            };
            if let Err(end) = self.handle_datagram(&datagram).await {
                return end;
            }
        }
    }

    /// Ends when the client has been silent for too long.
    async fn watch_silence(&self) -> SessionEnd {
        loop {
            let deadline = self.limits().deadline;
            if deadline.is_some_and(|deadline| deadline <= Instant::now()) {
                let has_entered = self.entered.load(Relaxed) > 0;
                let reason = if has_entered { Reason::Silence } else { Reason::Enter };
                return SessionEnd::Limit(reason, "silent for too long");
            }
            // The deadline may become an earlier one: that of a client in the world.
            let look = Instant::now() + LOOK_INTERVAL;
            let wake = deadline.map_or(look, |deadline| deadline.min(look));
            sleep_until(wake).await;
            // A server that wakes late was late in reading, too.
            let late = wake.elapsed();
            if late > WAKES_LATE
                && let Some(deadline) = &mut self.limits().deadline
            {
                *deadline += late + WAKES_LATE;
            }
        }
    }

    /// Gives the client its time to enter, for each world that is offered.
    async fn watch_offers(&self, mut offers: watch::Receiver<Option<WorldOffer>>) -> SessionEnd {
        offers.mark_changed();
        let limits = &self.state.config.limits;
        let patience = Duration::from_secs_f64(limits.enter_s);
        while offers.changed().await.is_ok() {
            // A browser fetches the world by HTTP, so nobody hears when it begins.
            let fetches_elsewhere = !self.client.transport.carries_worlds();
            let download =
                offers.borrow_and_update().as_ref().map(|offer| match fetches_elsewhere {
                    true => limits.download_time(offer.world.bytes().len()),
                    false => Duration::ZERO,
                });
            let trips = self.client.transport.round_trip().min(ROUND_TRIP_MAX) * ENTER_ROUND_TRIPS;
            self.limits().deadline =
                download.map(|download| Instant::now() + patience + download + trips);
        }
        SessionEnd::Closing
    }

    async fn handle_frame(
        &self,
        frame: &[u8],
        downloads: &mut Downloads,
    ) -> Result<(), SessionEnd> {
        self.client.count_frame_in(frame);
        if !self.is_within_budget(frame.len())? {
            return Ok(());
        }
        let avatar = self.client.avatar();
        match ClientMessage::decode(frame)? {
            ClientMessage::Hello { .. } => Err(SessionEnd::Breach("a second hello")),
            ClientMessage::FetchWorld { world } => self.send_world(world, downloads),
            ClientMessage::Enter { world, place, reports_from } => {
                self.enter(world, place.map(Into::into), reports_from).await
            }
            ClientMessage::Report { report, ack } => {
                self.client.outbox.acknowledge(ack);
                self.report(&report).await
            }
            ClientMessage::Chat { text } => {
                let now = self.state.now();
                if !self.limits().chat.take(1.0, now) {
                    self.client.count_refusal(Reason::Chat);
                    return Ok(());
                }
                if let Some(command) = text.as_str().strip_prefix('/') {
                    let moderation = Moderation::new(self.state);
                    self.tell(&commands::run(&moderation, self.client.visit.key, command));
                    return Ok(());
                }
                if self.state.people.standing(self.client.visit.key).is_muted {
                    self.tell(&["you are muted: nobody hears you".to_owned()]);
                    return Ok(());
                }
                let visit = &self.client.visit;
                self.state.people.note_chat(visit.key, &visit.name, &text);
                self.pass_on(Input::Chat { avatar, text: text.into() }).await
            }
            ClientMessage::Respawn => {
                let now = self.state.now();
                if !self.limits().respawns.take(1.0, now) {
                    return Ok(());
                }
                self.pass_on(Input::Respawn { avatar }).await
            }
            ClientMessage::Goodbye => Err(SessionEnd::Left),
        }
    }

    /// Tells the client something in words of the server.
    fn tell(&self, lines: &[String]) {
        for line in lines {
            let text = ChatLine::clipped(line);
            self.client.outbox.push(&ServerMessage::Notice { text });
        }
    }

    async fn handle_datagram(&self, datagram: &[u8]) -> Result<(), SessionEnd> {
        self.client.count_datagram_in(datagram.len());
        if !self.is_within_budget(datagram.len())? {
            return Ok(());
        }
        let ClientDatagram { ack, report } = ClientDatagram::decode(datagram)?;
        self.client.outbox.acknowledge(ack);
        match report {
            Some(report) => self.report(&report).await,
            None => Ok(()),
        }
    }

    async fn report(&self, report: &WireReport) -> Result<(), SessionEnd> {
        if report.made < self.reports_from.load(Relaxed) {
            return Ok(());
        }
        let report = report.report(self.state.config.tick_interval());
        self.pass_on(Input::Report { avatar: self.client.avatar(), report }).await
    }

    /// Whether a message is to be handled, or else ignored.
    fn is_within_budget(&self, bytes: usize) -> Result<bool, SessionEnd> {
        match self.limits().budget.charge(bytes, self.state.now()) {
            BudgetDecision::Accept => Ok(true),
            BudgetDecision::Ignore => {
                self.client.count_refusal(Reason::Messages);
                Ok(false)
            }
            BudgetDecision::Disconnect => {
                Err(SessionEnd::Limit(Reason::Flood, "too many messages"))
            }
        }
    }

    async fn enter(
        &self,
        world: u32,
        place: Option<Vec3>,
        reports_from: u32,
    ) -> Result<(), SessionEnd> {
        let Some(offer) = self.offer_of(world)? else { return Ok(()) };
        let before = self.entered.swap(world, Relaxed);
        if before == world {
            return Err(SessionEnd::Breach("entered twice"));
        }
        {
            let mut registry = self.state.registry();
            if self.client.is_replaced() {
                return Ok(());
            }
            if before == 0 && !registry.places.enter(self.client.connection_id) {
                return Err(SessionEnd::Limit(Reason::Clients, "the server is full"));
            }
        }
        self.reports_from.store(reports_from, Relaxed);
        self.extend_deadline();
        let client = self.client.clone();
        let place = place_in(self.state, &self.client.visit, &offer, place).await;
        let is_told = self.state.tell_newcomer(Newcomer { client, world, place }).await;
        is_told.then_some(()).ok_or(SessionEnd::Closing)
    }

    /// The offer with a number; `None` when another one has taken its place.
    fn offer_of(&self, world: u32) -> Result<Option<WorldOffer>, SessionEnd> {
        let offer = self.state.offers.offer();
        if offer.as_ref().is_none_or(|offer| offer.number < world) {
            return Err(SessionEnd::Breach("there is no such world"));
        }
        Ok(offer.filter(|offer| offer.number == world))
    }

    /// Passes on what a client in the world did. From a client that is not in it, it is ignored.
    async fn pass_on(&self, input: Input) -> Result<(), SessionEnd> {
        let entered = self.entered.load(Relaxed);
        let is_elsewhere = self.state.offers.offer().is_none_or(|offer| offer.number != entered);
        if is_elsewhere || self.client.is_replaced() {
            return Ok(());
        }
        self.extend_deadline();
        let is_told = self.state.tell_engine(EngineEvent::Input(input)).await;
        is_told.then_some(()).ok_or(SessionEnd::Closing)
    }

    /// Gives the client the time from now on that it may be silent.
    fn extend_deadline(&self) {
        let config = &self.state.config;
        // A quiet client need not say anything while its TBV is valid.
        let silence = Duration::from_secs_f64(config.silence_s + config.validity_max_s);
        self.limits().deadline = Some(Instant::now() + silence);
    }

    /// Starts the download of a world, which extends the time to enter it.
    fn send_world(&self, world: u32, downloads: &mut Downloads) -> Result<(), SessionEnd> {
        if !self.client.transport.carries_worlds() {
            return Err(SessionEnd::Breach("browsers fetch the world by HTTP"));
        }
        if self.state.config.private_geometry {
            self.client.count_refusal(Reason::PrivateGeometry);
            return Err(SessionEnd::Breach("this building is handed out in pieces only"));
        }
        let Some(offer) = self.offer_of(world)? else { return Ok(()) };
        if downloads.last() == world || self.entered.load(Relaxed) == world {
            return Err(SessionEnd::Breach("the world asked for twice"));
        }
        let bytes = offer.world.bytes().clone();
        if let Some(deadline) = &mut self.limits().deadline {
            *deadline += self.state.config.limits.download_time(bytes.len());
        }
        downloads.start(world, bytes, self.client.clone());
        Ok(())
    }

    fn limits(&self) -> MutexGuard<'_, SessionLimits> {
        self.limits.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
