//! The task of a session: it talks with the server until the session ends.

use std::{sync::Arc, time::Duration};

use quinn::{SendDatagramError, VarInt};
use sightline_client_core::replica::{Event, Outgoing};
use sightline_protocol::{
    message::{ClientMessage, ServerMessage},
    text::ChatLine,
};
use tokio::{
    sync::mpsc,
    time::{MissedTickBehavior, timeout},
};

use super::{
    super::{
        control_stream::ControlStream,
        error::{ConnectError, lost},
    },
    state::SharedState,
};

/// The number of chat lines that may wait to be sent.
pub(super) const COMMANDS_MAX: usize = 16;
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
    shared: Arc<SharedState>,
}

impl Driver {
    /// The task of a session that has been welcomed, and has no place yet.
    pub(super) fn new(control: ControlStream, shared: Arc<SharedState>) -> Self {
        Self { control, shared }
    }

    /// Waits until the server gives a place.
    pub(super) async fn wait_for_place(&mut self) -> Result<(), ConnectError> {
        while self.shared.lock().replica.reporting_state().is_none() {
            let message = self.control.receive().await?;
            if let ServerMessage::Goodbye { reason } = message {
                return Err(ConnectError::Goodbye(reason.into()));
            }
            self.handle(message).await?;
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
                message = self.control.receive() => {
                    if let Some(goodbye) = self.handle(message?).await? {
                        return Ok(goodbye);
                    }
                }
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
                    Some(SessionCommand::Leave) | None => {
                        self.send(&ClientMessage::Goodbye).await?;
                        let _ = timeout(FAREWELL_DEADLINE, self.control.finish()).await;
                        return Ok("left".to_owned());
                    }
                },
            }
        }
    }

    /// The goodbye that arrived together with the end of the connection, if any. The end may be
    /// noticed first, while waiting for datagrams.
    async fn last_words(&mut self) -> Option<String> {
        self.shared.connection.close_reason()?;
        // Messages that arrived before the end are finite, and can still be read.
        while let Ok(message) = self.control.receive().await {
            if let Ok(Some(goodbye)) = self.handle(message).await {
                return Some(goodbye);
            }
        }
        None
    }

    /// Applies a message to the replica, and answers it if the server asked. Returns the reason of
    /// a goodbye.
    async fn handle(&mut self, message: ServerMessage) -> Result<Option<String>, ConnectError> {
        self.shared.count_received(self.control.frame_bytes());
        let mut goodbye = None;
        let answer = {
            let now = self.shared.now();
            let mut state = self.shared.lock();
            if let Some(mut event) = state.replica.message(now, message)? {
                match &mut event {
                    Event::Goodbye(reason) => goodbye = Some(reason.clone()),
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
        Ok(goodbye)
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
        let bytes = self.control.send(message).await?;
        self.shared.count_sent(bytes);
        Ok(())
    }
}
