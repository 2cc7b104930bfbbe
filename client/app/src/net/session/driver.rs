//! The task of a session: it talks with the server until the session ends.

use std::{sync::Arc, time::Duration};

use glam::Vec3;
use quinn::{SendDatagramError, VarInt};
use sightline_client_core::{
    presence::{Heard, WorldOffer},
    replica::Outgoing,
};
use sightline_protocol::{
    message::{ClientMessage, ServerMessage},
    text::ChatLine,
};
use tokio::{
    sync::mpsc,
    task::JoinSet,
    time::{Instant, MissedTickBehavior, timeout},
};

use super::{
    super::{
        cache::WorldCache,
        control_stream::ControlStream,
        error::{ConnectError, lost},
        passage::{ArrivedOffer, Ways, offered_world},
        piece_traffic::{PieceStream, PieceTraffic, carry},
        returning::{Caller, PATIENCE, Pauses},
    },
    Welcomed,
    state::SharedState,
};

/// The number of commands that may wait.
pub(super) const COMMANDS_MAX: usize = 16;
/// The time within which the server must give a place to a client that asks to enter.
const ANSWER_DEADLINE: Duration = Duration::from_secs(10);
/// The time within which the last messages must arrive.
pub(super) const FAREWELL_DEADLINE: Duration = Duration::from_secs(2);

/// A client that can go to another server asks after this silence whether its own is there, and
/// then so often. Without an answer for so long it goes.
const SILENT_MAX: Duration = Duration::from_secs(1);
const ASK_INTERVAL: Duration = Duration::from_millis(400);
const UNANSWERED_MAX: Duration = Duration::from_secs(2);

/// Why a session ended whose client was told to leave.
const LEFT: &str = "left";

/// What a session's methods ask of its task.
pub(super) enum SessionCommand {
    /// Say something to the others.
    Say(ChatLine),
    /// Ask to be put back to a spawn point.
    Respawn,
    /// Say goodbye, and end.
    Leave,
    /// End for a reason.
    GiveUp(String),
}

/// The task of a session.
pub(super) struct Driver {
    control: ControlStream,
    caller: Caller,
    cache: Arc<WorldCache>,
    shared: Arc<SharedState>,
    /// Brings the pieces of the world, where it comes in pieces.
    carrying: JoinSet<ConnectError>,
    silence: Silence,
}

/// For how long nothing has come from the server.
struct Silence {
    /// How many UDP datagrams came on the connection.
    received: u64,
    /// When the last of them came, as far as it was noticed.
    heard: Instant,
    /// When the client first asked since whether the server is there, and when it last did.
    asked: Option<[Instant; 2]>,
}

/// What to do about a silence.
enum SilenceStep {
    /// Nothing yet.
    Wait,
    /// Send something that the server acknowledges.
    Ask,
    /// The server is lost.
    GiveUp,
}

impl Silence {
    fn new() -> Self {
        Self { received: 0, heard: Instant::now(), asked: None }
    }

    /// Takes in how many UDP datagrams came so far.
    fn note(&mut self, now: Instant, received: u64) -> SilenceStep {
        if self.received != received {
            *self = Self { received, heard: now, asked: None };
        }
        match self.asked {
            Some([first, _]) if now >= first + UNANSWERED_MAX => SilenceStep::GiveUp,
            Some([_, last]) if now < last + ASK_INTERVAL => SilenceStep::Wait,
            None if now < self.heard + SILENT_MAX => SilenceStep::Wait,
            asked => {
                self.asked = Some([asked.map_or(now, |[first, _]| first), now]);
                SilenceStep::Ask
            }
        }
    }
}

impl Driver {
    /// The task of a session that has the first world, and has not entered it yet.
    pub(super) fn new(
        control: ControlStream,
        caller: Caller,
        cache: Arc<WorldCache>,
        shared: Arc<SharedState>,
    ) -> Self {
        let (carrying, silence) = (JoinSet::new(), Silence::new());
        Self { control, caller, cache, shared, carrying, silence }
    }

    /// Begins to bring the pieces of an offered world, and ends with those of the one before.
    pub(super) fn carry(
        &mut self,
        world: u32,
        pieces: Option<(Arc<PieceTraffic>, Option<PieceStream>)>,
    ) {
        self.carrying.abort_all();
        self.carrying = JoinSet::new();
        if let Some((traffic, stream)) = pieces {
            let connection = self.control.connection.clone();
            self.carrying.spawn(carry(connection, world, traffic, stream));
        }
    }

    /// Gets a world that is offered, as it may come.
    async fn offered(&mut self, offer: Option<WorldOffer>) -> Result<ArrivedOffer, ConnectError> {
        let present = self.shared.lock().pieces.clone();
        let in_pieces = self.caller.options.in_pieces;
        let present = present.as_ref();
        let ways = Ways { cache: &self.cache, in_pieces, present, progress: None };
        offered_world(&mut self.control, ways, offer).await
    }

    /// Asks to enter the first world, and waits until the server gives a place in it, or in another
    /// one that takes its place.
    pub(super) async fn enter(
        &mut self,
        world: u32,
        place: Option<Vec3>,
    ) -> Result<(), ConnectError> {
        let place = place.map(Into::into);
        self.send(&ClientMessage::Enter { world, place, reports_from: 0 }).await?;
        while self.shared.lock().presence.replica.reporting_state().is_none() {
            let message = timeout(ANSWER_DEADLINE, self.control.receiver.receive()).await;
            let message = message
                .map_err(|_| ConnectError::Lost("the server gave no place in time".to_owned()))?;
            match self.handle(message?).await? {
                Heard::Nothing => {}
                Heard::World(offer) => self.move_to(offer).await?,
                Heard::Goodbye { reason, may_return } => {
                    return Err(ConnectError::Goodbye { reason, may_return });
                }
            }
        }
        Ok(())
    }

    /// Runs the session to its end, and records why it ended. Whenever its link breaks, it comes
    /// back, unless it is out of the world for too long.
    pub(super) async fn run(mut self, mut inbox: mpsc::Receiver<SessionCommand>) {
        let mut pauses = Pauses::returning();
        let mut give_up = Instant::now();
        let end = loop {
            let error = match self.talk(&mut inbox).await {
                Ok(end) => break end,
                Err(error) => self.last_words().await.unwrap_or(error),
            };
            if !error.may_pass() {
                break error.to_string();
            }
            if self.lose(&error) {
                pauses.reset();
                give_up = Instant::now() + PATIENCE;
            }
            let back = tokio::select! {
                back = self.come_back(&mut pauses, give_up) => back,
                () = told_to_leave(&mut inbox) => break LEFT.to_owned(),
            };
            match back {
                Err(error) if !error.may_pass() || Instant::now() >= give_up => {
                    break error.to_string();
                }
                // What breaks on the way in breaks again, and is taken in there.
                _ => {}
            }
        };
        let mut state = self.shared.lock();
        state.end.get_or_insert(end);
        state.connection.close(VarInt::from_u32(0), b"");
    }

    /// Takes in that the link broke. Returns whether the client was in the world until then.
    fn lose(&self, error: &ConnectError) -> bool {
        tracing::info!(%error, "the link broke");
        let now = self.shared.now();
        self.shared.lock().presence.lose(now, error.to_string())
    }

    /// Connects again, gets the world that is offered, and asks to go on in it.
    async fn come_back(
        &mut self,
        pauses: &mut Pauses,
        give_up: Instant,
    ) -> Result<(), ConnectError> {
        self.caller.others = self.shared.lock().presence.stations().to_vec();
        let welcomed = self.caller.call(pauses, give_up).await?;
        let Welcomed { control, avatar, tick_interval } = welcomed;
        self.control = control;
        self.silence = Silence::new();
        let ArrivedOffer { number, world, pieces } = self.offered(None).await?;
        let enters = {
            let mut state = self.shared.lock();
            state.change_connection(self.control.connection.clone());
            state.pieces = pieces.as_ref().map(|(traffic, _)| traffic.clone());
            state.presence.reconnect(avatar, tick_interval, number, world)
        };
        self.carry(number, pieces);
        self.send(&enters).await
    }

    async fn talk(
        &mut self,
        inbox: &mut mpsc::Receiver<SessionCommand>,
    ) -> Result<String, ConnectError> {
        let tick_interval = self.shared.lock().presence.replica.tick_interval();
        let mut ticks = tokio::time::interval(tick_interval);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let connection = self.control.connection.clone();
        loop {
            tokio::select! {
                message = self.control.receiver.receive() => match self.handle(message?).await? {
                    Heard::Nothing => {}
                    Heard::Goodbye { reason, may_return } => {
                    return Err(ConnectError::Goodbye { reason, may_return });
                }
                    Heard::World(offer) => tokio::select! {
                        moved = self.move_to(offer) => moved?,
                        () = told_to_leave(inbox) => return self.leave().await,
                    },
                },
                datagram = connection.read_datagram() => {
                    let datagram = datagram.map_err(lost)?;
                    self.shared.count_received(datagram.len());
                    let now = self.shared.now();
                    if let Err(error) = self.shared.lock().presence.replica.datagram(now, &datagram) {
                        tracing::debug!(%error, "a datagram was ignored");
                    }
                }
                Some(Ok(error)) = self.carrying.join_next() => return Err(error),
                due = ticks.tick() => self.tick(due).await?,
                command = inbox.recv() => match command {
                    Some(SessionCommand::Say(text)) => self.send(&ClientMessage::Chat { text }).await?,
                    Some(SessionCommand::Respawn) => self.send(&ClientMessage::Respawn).await?,
                    Some(SessionCommand::GiveUp(reason)) => return Ok(reason),
                    Some(SessionCommand::Leave) | None => return self.leave().await,
                },
            }
        }
    }

    async fn leave(&mut self) -> Result<String, ConnectError> {
        self.send(&ClientMessage::Goodbye).await?;
        let _ = timeout(FAREWELL_DEADLINE, self.control.sender.finish()).await;
        Ok(LEFT.to_owned())
    }

    /// Gets the offered world, or one that takes its place meanwhile, and asks to go on in it.
    async fn move_to(&mut self, offer: WorldOffer) -> Result<(), ConnectError> {
        let ArrivedOffer { number, world, pieces } = self.offered(Some(offer)).await?;
        let enters = {
            let mut state = self.shared.lock();
            state.pieces = pieces.as_ref().map(|(traffic, _)| traffic.clone());
            state.presence.leave_world(number, world)
        };
        self.carry(number, pieces);
        self.send(&enters).await
    }

    /// The goodbye that arrived together with the end of the connection, if any. The end may be
    /// noticed first, while waiting for datagrams.
    async fn last_words(&mut self) -> Option<ConnectError> {
        self.control.connection.close_reason()?;
        // Messages that arrived before the end are finite, and can still be read.
        while let Ok(message) = self.control.receiver.receive().await {
            if let Ok(Heard::Goodbye { reason, may_return }) = self.handle(message).await {
                return Some(ConnectError::Goodbye { reason, may_return });
            }
        }
        None
    }

    /// Takes in a message, and answers it if the server asked.
    async fn handle(&mut self, message: ServerMessage) -> Result<Heard, ConnectError> {
        self.shared.count_received(self.control.receiver.frame_bytes());
        let now = self.shared.now();
        let (heard, answer) = self.shared.lock().presence.hear(now, message)?;
        if let Some(answer) = answer {
            self.send(&answer).await?;
        }
        Ok(heard)
    }

    /// Takes the client through the tick that was due at a moment, which may be a while ago.
    async fn tick(&mut self, due: Instant) -> Result<(), ConnectError> {
        let stats = self.control.connection.stats();
        self.look_for_server(stats.udp_rx.datagrams)?;
        let outgoing = {
            let mut state = self.shared.lock();
            let now = self.shared.now();
            let udp_bytes = state.udp_bytes();
            state.meter.read(now, udp_bytes);
            let due = self.shared.time_of(due.into_std());
            state.presence.tick(due, stats.path.rtt, stats.path.lost_packets)
        };
        match outgoing {
            None => Ok(()),
            Some(Outgoing::Message(message)) => self.send(&message).await,
            Some(Outgoing::Datagram(bytes)) => {
                self.shared.count_sent(bytes.len());
                match self.control.connection.send_datagram(bytes.into()) {
                    // The path MTU has just shrunk: the datagram counts as lost.
                    Ok(()) | Err(SendDatagramError::TooLarge) => Ok(()),
                    Err(error) => Err(ConnectError::Lost(error.to_string())),
                }
            }
        }
    }

    /// Notices early that the server is lost, where there is another one to go to.
    fn look_for_server(&mut self, received: u64) -> Result<(), ConnectError> {
        let step = self.silence.note(Instant::now(), received);
        let state = self.shared.lock();
        if state.presence.stations().is_empty() {
            return Ok(());
        }
        match step {
            SilenceStep::Wait => {}
            SilenceStep::Ask => {
                let bytes = state.presence.replica.probe();
                self.shared.count_sent(bytes.len());
                // One that cannot be sent says that the connection has ended, as its reader hears.
                let _ = self.control.connection.send_datagram(bytes.into());
            }
            SilenceStep::GiveUp => {
                return Err(ConnectError::Lost("the server does not answer".to_owned()));
            }
        }
        Ok(())
    }

    async fn send(&mut self, message: &ClientMessage) -> Result<(), ConnectError> {
        let bytes = self.control.sender.send(message).await?;
        self.shared.count_sent(bytes);
        Ok(())
    }
}

/// Waits until the session is told to leave. Anything else is dropped meanwhile: nobody hears.
async fn told_to_leave(inbox: &mut mpsc::Receiver<SessionCommand>) {
    while let Some(SessionCommand::Say(_) | SessionCommand::Respawn) = inbox.recv().await {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_is_lost_when_it_does_not_answer_and_not_because_the_client_slept() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut silence = Silence { received: 0, heard: start, asked: None };
        let mut step = |ms: u64, received: u64| match silence.note(at(ms), received) {
            SilenceStep::Wait => "wait",
            SilenceStep::Ask => "ask",
            SilenceStep::GiveUp => "give up",
        };
        assert_eq!((step(900, 5), step(1_800, 5), step(1_950, 5)), ("wait", "wait", "ask"));
        assert_eq!((step(2_100, 5), step(2_400, 5), step(2_450, 6)), ("wait", "ask", "wait"));
        assert_eq!((step(60_000, 6), step(60_100, 6)), ("ask", "wait"), "it slept");
        assert_eq!((step(61_000, 6), step(62_100, 6)), ("ask", "give up"));
    }
}
