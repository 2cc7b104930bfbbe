//! The task that has a WebSocket.

use std::{sync::Arc, time::Duration};

use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use bytes::Bytes;
use futures_util::{
    SinkExt, StreamExt,
    stream::{SplitSink, SplitStream},
};
use tokio::{
    sync::{mpsc, watch},
    time::{Instant, MissedTickBehavior, interval, sleep, timeout},
};

use super::{
    super::{CloseCode, TransportError},
    CONTROL, DATAGRAM, Link, Outgoing,
};

/// How often the round trip is measured. What arrives in answer shows that the link stands, too.
const PING_INTERVAL: Duration = Duration::from_secs(2);
/// How long the client may take to close the socket in answer.
const CLOSING_TIME: Duration = Duration::from_secs(2);
/// The most bytes of a reason to close (RFC 6455, section 5.5).
const REASON_BYTES_MAX: usize = 123;

/// What the task of a socket needs.
pub(super) struct Pump {
    link: Arc<Link>,
    outgoing: mpsc::Receiver<Outgoing>,
    incoming: mpsc::Sender<Bytes>,
    idle: Duration,
    started: Instant,
}

impl Pump {
    pub(super) fn new(
        link: Arc<Link>,
        outgoing: mpsc::Receiver<Outgoing>,
        incoming: mpsc::Sender<Bytes>,
        idle: Duration,
    ) -> Self {
        Self { link, outgoing, incoming, idle, started: Instant::now() }
    }

    /// Sends and receives until the socket ends.
    pub(super) async fn run(self, socket: WebSocket) {
        let Self { link, mut outgoing, incoming, idle, started } = self;
        let (mut sink, stream) = socket.split();
        let mut closing = link.closing.subscribe();
        let is_closing = closing.wait_for(Option::is_some);
        let end = tokio::select! {
            end = read(&link, stream, &incoming, idle, started) => end,
            error = write(&link, &mut sink, &mut outgoing, started) => lost(error),
            () = overdue(is_closing) => TransportError::Lost("closed by the server".to_owned()),
        };
        link.ended.send_replace(Some(end));
    }
}

/// Waits until the client has had its time to close the socket.
async fn overdue<T>(is_closing: impl Future<Output = T>) {
    is_closing.await;
    sleep(CLOSING_TIME).await;
}

/// Takes in what the client sends, until it ends the socket.
async fn read(
    link: &Link,
    mut stream: SplitStream<WebSocket>,
    incoming: &mpsc::Sender<Bytes>,
    idle: Duration,
    started: Instant,
) -> TransportError {
    loop {
        let message = match timeout(idle, stream.next()).await {
            Ok(Some(Ok(message))) => message,
            Ok(Some(Err(error))) => return lost(error),
            Ok(None) => return lost("the socket broke"),
            Err(_) => return lost("timed out"),
        };
        match message {
            Message::Binary(bytes) => match bytes.first() {
                Some(&CONTROL) => {
                    // A session that is over listens no more.
                    let _ = incoming.send(bytes.slice(1..)).await;
                }
                Some(&DATAGRAM) => link.receive(bytes.slice(1..)),
                _ => return TransportError::Breach("a message of an unknown kind"),
            },
            Message::Text(_) => return TransportError::Breach("a message of text"),
            Message::Pong(payload) => {
                if let Ok(sent_us) = payload.as_ref().try_into().map(u64::from_le_bytes)
                    && let Some(took) =
                        started.elapsed().checked_sub(Duration::from_micros(sent_us))
                {
                    link.round_trip.send_modify(|known| *known = Some(smoothed(*known, took)));
                }
            }
            Message::Ping(_) => {}
            Message::Close(frame) => return closed_by_client(frame.as_ref()),
        }
    }
}

/// A round trip with another measurement: one that is out of the ordinary counts little.
fn smoothed(known: Option<Duration>, took: Duration) -> Duration {
    known.map_or(took, |known| (known * 3 + took) / 4)
}

/// A browser that goes away leaves. A page that leaves says goodbye first; one that only closes the
/// socket is about to open another one.
fn closed_by_client(frame: Option<&CloseFrame>) -> TransportError {
    match frame {
        Some(frame) if frame.code == close_code::AWAY => TransportError::Closed,
        _ => lost("the page closed it"),
    }
}

/// Sends what is to be sent. Ends when the socket breaks.
async fn write(
    link: &Link,
    sink: &mut SplitSink<WebSocket, Message>,
    outgoing: &mut mpsc::Receiver<Outgoing>,
    started: Instant,
) -> axum::Error {
    let mut closing = link.closing.subscribe();
    let mut pings = interval(PING_INTERVAL);
    pings.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let sent = tokio::select! {
            biased;
            Some(next) = outgoing.recv() => match next {
                Outgoing::Message(bytes) => sink.send(Message::Binary(bytes.into())).await,
                Outgoing::Flush(flushed) => {
                    let _ = flushed.send(());
                    Ok(())
                }
            },
            message = close_message(&mut closing) => {
                let _ = sink.send(message).await;
                // The answer of the client ends the socket, or its time.
                std::future::pending().await
            }
            _ = pings.tick() => {
                let now_us = started.elapsed().as_micros() as u64;
                sink.send(Message::Ping(now_us.to_le_bytes().to_vec().into())).await
            }
            () = link.has_poses.notified() => send_poses(link, sink).await,
        };
        if let Err(error) = sent {
            return error;
        }
    }
}

async fn send_poses(
    link: &Link,
    sink: &mut SplitSink<WebSocket, Message>,
) -> Result<(), axum::Error> {
    let waiting = {
        let mut poses = link.poses();
        poses.are_sent = true;
        std::mem::take(&mut poses.waiting)
    };
    for datagram in waiting {
        sink.send(Message::Binary(datagram.into())).await?;
    }
    link.poses().are_sent = false;
    Ok(())
}

/// Waits until the socket is to be closed.
async fn close_message(closing: &mut watch::Receiver<Option<(CloseCode, String)>>) -> Message {
    let closing = closing.wait_for(Option::is_some).await;
    let said = closing.ok().and_then(|closing| closing.clone());
    let (code, mut reason) = said.unwrap_or((CloseCode::Ended, String::new()));
    let code = match code {
        CloseCode::Ended => close_code::NORMAL,
        CloseCode::NoHello => close_code::POLICY,
        CloseCode::Refused => close_code::AGAIN,
        CloseCode::Failed => close_code::ERROR,
    };
    while reason.len() > REASON_BYTES_MAX {
        reason.pop();
    }
    Message::Close(Some(CloseFrame { code, reason: reason.into() }))
}

fn lost(error: impl ToString) -> TransportError {
    TransportError::Lost(error.to_string())
}
