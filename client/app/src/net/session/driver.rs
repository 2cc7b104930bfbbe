//! The task of a session: it talks with the server until the session ends.

use std::{sync::Arc, time::Duration};

use glam::Vec3;
use quinn::{SendDatagramError, VarInt};
use sightline_client_core::replica::{Event, Outgoing};
use sightline_protocol::{
    message::{ClientMessage, ServerMessage},
    text::ChatLine,
};
use sightline_world::{ContentId, motion::Pose};
use tokio::{
    sync::mpsc,
    time::{MissedTickBehavior, timeout},
};

use super::{
    super::{
        cache::WorldCache,
        control_stream::ControlStream,
        error::{ConnectError, lost},
        passage::{WorldOffer, offered_world},
    },
    state::SharedState,
};

/// The number of chat lines that may wait to be sent.
pub(super) const COMMANDS_MAX: usize = 16;
/// The time within which the server must give a place to a client that asks to enter.
const ANSWER_DEADLINE: Duration = Duration::from_secs(10);
/// The time within which the last messages must arrive.
pub(super) const FAREWELL_DEADLINE: Duration = Duration::from_secs(2);

/// What a session's methods ask of its task.
pub(super) enum SessionCommand {
    /// Say something to the others.
    Say(ChatLine),
    /// Say goodbye, and end.
    Leave,
}

/// The task of a session.
pub(super) struct Driver {
    control: ControlStream,
    cache: Arc<WorldCache>,
    shared: Arc<SharedState>,
    /// Where the client was when it was told of the world that it enters now.
    moves_from: Option<Pose>,
}

/// What comes of a message.
enum Heard {
    Nothing,
    /// Another world is offered.
    World(WorldOffer),
    /// The server said goodbye, for this reason.
    Goodbye(String),
}

impl Driver {
    /// The task of a session that has the first world, and has not entered it yet.
    pub(super) fn new(
        control: ControlStream,
        cache: Arc<WorldCache>,
        shared: Arc<SharedState>,
    ) -> Self {
        Self { control, cache, shared, moves_from: None }
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
        while self.shared.lock().replica.reporting_state().is_none() {
            let message = timeout(ANSWER_DEADLINE, self.control.receiver.receive()).await;
            let message = message
                .map_err(|_| ConnectError::Lost("the server gave no place in time".to_owned()))?;
            match self.handle(message?).await? {
                Heard::Nothing => {}
                Heard::World(offer) => self.move_to(offer).await?,
                Heard::Goodbye(reason) => return Err(ConnectError::Goodbye(reason)),
            }
        }
        Ok(())
    }

    /// Runs the session to its end, and records why it ended.
    pub(super) async fn run(
        mut self,
        mut inbox: mpsc::Receiver<SessionCommand>,
        tick_interval: Duration,
    ) {
        let end = match self.talk(&mut inbox, tick_interval).await {
            Ok(reason) => reason,
            Err(error) => self.last_words().await.unwrap_or_else(|| error.to_string()),
        };
        self.shared.lock().end.get_or_insert(end);
        self.shared.connection.close(VarInt::from_u32(0), b"");
    }

    async fn talk(
        &mut self,
        inbox: &mut mpsc::Receiver<SessionCommand>,
        tick_interval: Duration,
    ) -> Result<String, ConnectError> {
        let mut ticks = tokio::time::interval(tick_interval);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let connection = self.shared.connection.clone();
        loop {
            tokio::select! {
                message = self.control.receiver.receive() => match self.handle(message?).await? {
                    Heard::Nothing => {}
                    Heard::Goodbye(reason) => return Ok(reason),
                    Heard::World(offer) => tokio::select! {
                        moved = self.move_to(offer) => moved?,
                        () = told_to_leave(inbox) => return self.leave().await,
                    },
                },
                datagram = connection.read_datagram() => {
                    let datagram = datagram.map_err(lost)?;
                    self.shared.count_received(datagram.len());
                    let now = self.shared.now();
                    if let Err(error) = self.shared.lock().replica.datagram(now, &datagram) {
                        tracing::debug!(%error, "a datagram was ignored");
                    }
                }
                _ = ticks.tick() => self.tick().await?,
                command = inbox.recv() => match command {
                    Some(SessionCommand::Say(text)) => self.send(&ClientMessage::Chat { text }).await?,
                    Some(SessionCommand::Leave) | None => return self.leave().await,
                },
            }
        }
    }

    async fn leave(&mut self) -> Result<String, ConnectError> {
        self.send(&ClientMessage::Goodbye).await?;
        let _ = timeout(FAREWELL_DEADLINE, self.control.sender.finish()).await;
        Ok("left".to_owned())
    }

    /// Gets the offered world, or one that takes its place meanwhile, and asks to go on in it.
    async fn move_to(&mut self, offer: WorldOffer) -> Result<(), ConnectError> {
        let (offer, world) =
            offered_world(&mut self.control, &self.cache, Some(offer), None).await?;
        let (from, reports_from) = self.shared.lock().leave_world(world);
        self.moves_from = Some(from);
        let place = Some(from.eye.into());
        self.send(&ClientMessage::Enter { world: offer.number, place, reports_from }).await
    }

    /// The goodbye that arrived together with the end of the connection, if any. The end may be
    /// noticed first, while waiting for datagrams.
    async fn last_words(&mut self) -> Option<String> {
        self.shared.connection.close_reason()?;
        // Messages that arrived before the end are finite, and can still be read.
        while let Ok(message) = self.control.receiver.receive().await {
            if let Ok(Heard::Goodbye(goodbye)) = self.handle(message).await {
                return Some(goodbye);
            }
        }
        None
    }

    /// Applies a message to the replica, and answers it if the server asked.
    async fn handle(&mut self, message: ServerMessage) -> Result<Heard, ConnectError> {
        self.shared.count_received(self.control.receiver.frame_bytes());
        if let ServerMessage::World { number, id, bytes } = message {
            let mut state = self.shared.lock();
            let now = self.shared.now();
            state.move_on(now);
            (state.posed, state.is_moving_over) = (None, true);
            return Ok(Heard::World(WorldOffer { number, id: ContentId(id), bytes }));
        }
        let mut heard = Heard::Nothing;
        let answer = {
            let now = self.shared.now();
            let mut state = self.shared.lock();
            if let Some(mut event) = state.replica.message(now, message)? {
                match &mut event {
                    Event::Goodbye(reason) => heard = Heard::Goodbye(reason.clone()),
                    Event::Entered(pose) => {
                        if let Some(from) = self.moves_from.take() {
                            *pose = state.move_over(&from, *pose);
                        }
                    }
                    Event::Corrected(_) => state.posed = None,
                    Event::Chat { from, name, .. } if *from == state.replica.avatar() => {
                        *name = self.shared.name.to_string();
                    }
                    _ => {}
                }
                state.push_event(event);
            }
            state.move_on(now);
            state.replica.answer(now)
        };
        if let Some(answer) = answer {
            self.send(&answer).await?;
        }
        Ok(heard)
    }

    async fn tick(&mut self) -> Result<(), ConnectError> {
        let stats = self.shared.connection.stats();
        let outgoing = {
            let mut state = self.shared.lock();
            let now = self.shared.now();
            state.meter.read(now, [stats.udp_rx.bytes, stats.udp_tx.bytes]);
            state.move_on(now);
            state.replica.hear_losses(now, stats.path.lost_packets);
            state.replica.tick(now, stats.path.rtt)
        };
        match outgoing {
            None => Ok(()),
            Some(Outgoing::Message(message)) => self.send(&message).await,
            Some(Outgoing::Datagram(bytes)) => {
                self.shared.count_sent(bytes.len());
                match self.shared.connection.send_datagram(bytes.into()) {
                    // The path MTU has just shrunk: the datagram counts as lost.
                    Ok(()) | Err(SendDatagramError::TooLarge) => Ok(()),
                    Err(error) => Err(ConnectError::Lost(error.to_string())),
                }
            }
        }
    }

    async fn send(&mut self, message: &ClientMessage) -> Result<(), ConnectError> {
        let bytes = self.control.sender.send(message).await?;
        self.shared.count_sent(bytes);
        Ok(())
    }
}

/// Waits until the session is told to leave. What it is to say meanwhile is dropped: nobody hears.
async fn told_to_leave(inbox: &mut mpsc::Receiver<SessionCommand>) {
    while let Some(SessionCommand::Say(_)) = inbox.recv().await {}
}
