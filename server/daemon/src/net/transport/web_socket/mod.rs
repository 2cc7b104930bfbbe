//! A browser's connection where there is no WebTransport: a WebSocket.
//!
//! Each message is binary. Its first byte says what follows: whole frames of the control stream, or
//! one datagram. All share one ordered stream, so poses wait in the outbox until the socket has
//! taken those before. A slow reader gets fewer of them, and none that grew old in a queue.

mod pump;

use std::{
    collections::VecDeque,
    net::SocketAddr,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use axum::extract::ws::WebSocket;
use bytes::Bytes;
use sightline_protocol::pose_stream::DATAGRAM_BYTES_MAX;
use tokio::sync::{Notify, mpsc, oneshot, watch};

use super::{CloseCode, TransportError};
use pump::Pump;

/// The first byte of a message with frames of the control stream.
const CONTROL: u8 = 0;
/// The first byte of a message with a datagram.
const DATAGRAM: u8 = 1;
/// How many datagrams of the client may wait. The oldest are dropped first.
const DATAGRAMS_MAX: usize = 16;
/// How many messages of the client's control stream may wait. Then the socket is not read.
const CONTROL_MESSAGES_MAX: usize = 4;

/// A WebSocket. A task of its own has the socket, and ends soon after this is dropped.
pub struct WebSocketTransport {
    link: Arc<Link>,
    /// The halves of the control stream, until the session takes them.
    control: Mutex<Option<(WebSocketWriter, WebSocketReader)>>,
}

/// The half of the control stream from the client.
pub struct WebSocketReader {
    link: Arc<Link>,
    messages: mpsc::Receiver<Bytes>,
}

/// The half of the control stream to the client.
pub struct WebSocketWriter {
    link: Arc<Link>,
    messages: mpsc::Sender<Outgoing>,
}

/// What is to be done with the socket, in order.
enum Outgoing {
    /// Send a message.
    Message(Vec<u8>),
    /// Tell when all messages before have been sent.
    Flush(oneshot::Sender<()>),
}

/// What the task and the session share.
struct Link {
    address: SocketAddr,
    /// Datagrams from the client.
    received: Mutex<VecDeque<Bytes>>,
    has_received: Notify,
    poses: Mutex<Poses>,
    has_poses: Notify,
    /// `None` until it was measured.
    round_trip: watch::Sender<Option<Duration>>,
    /// Why the socket is to be closed.
    closing: watch::Sender<Option<(CloseCode, String)>>,
    /// Why the socket has ended.
    ended: watch::Sender<Option<TransportError>>,
}

/// Datagrams for the client.
#[derive(Default)]
struct Poses {
    /// Messages that the socket has not taken.
    waiting: Vec<Vec<u8>>,
    /// Whether the socket is taking some just now.
    are_sent: bool,
}

impl WebSocketTransport {
    /// The transport of a socket that is open. What is silent for longer than `idle` is lost. Must
    /// be called within a tokio runtime.
    pub fn new(socket: WebSocket, address: SocketAddr, idle: Duration) -> Self {
        let (frames, outgoing) = mpsc::channel(1);
        let (incoming, messages) = mpsc::channel(CONTROL_MESSAGES_MAX);
        let link = Arc::new(Link::new(address));
        let writer = WebSocketWriter { link: link.clone(), messages: frames };
        let reader = WebSocketReader { link: link.clone(), messages };
        tokio::spawn(Pump::new(link.clone(), outgoing, incoming, idle).run(socket));
        Self { link, control: Mutex::new(Some((writer, reader))) }
    }

    pub(super) async fn control(
        &self,
    ) -> Result<(WebSocketWriter, WebSocketReader), TransportError> {
        // The client answers the first ping before anything is judged by its round trip.
        let mut measured = self.link.round_trip.subscribe();
        tokio::select! {
            _ = measured.wait_for(Option::is_some) => {}
            error = self.link.ended() => return Err(error),
        }
        let halves = self.control.lock().unwrap_or_else(PoisonError::into_inner).take();
        halves.ok_or(TransportError::Closed)
    }

    pub(super) fn datagram_room(&self) -> Option<usize> {
        let poses = self.link.poses();
        (poses.waiting.is_empty() && !poses.are_sent).then_some(DATAGRAM_BYTES_MAX)
    }

    pub(super) fn send_datagram(&self, datagram: &[u8]) -> Result<(), TransportError> {
        if let Some(error) = &*self.link.ended.borrow() {
            return Err(error.clone());
        }
        self.link.poses().waiting.push(message(DATAGRAM, datagram));
        self.link.has_poses.notify_one();
        Ok(())
    }

    pub(super) async fn receive_datagram(&self) -> Result<Bytes, TransportError> {
        loop {
            if let Some(datagram) = self.link.received().pop_front() {
                return Ok(datagram);
            }
            tokio::select! {
                () = self.link.has_received.notified() => {}
                error = self.link.ended() => return Err(error),
            }
        }
    }

    pub(super) fn remote_address(&self) -> SocketAddr {
        self.link.address
    }

    pub(super) fn round_trip(&self) -> Duration {
        self.link.round_trip.borrow().unwrap_or_default()
    }

    pub(super) fn close(&self, code: CloseCode, reason: &str) {
        self.link.closing.send_if_modified(|closing| {
            let is_first = closing.is_none();
            if is_first {
                *closing = Some((code, reason.to_owned()));
            }
            is_first
        });
    }
}

impl Drop for WebSocketTransport {
    fn drop(&mut self) {
        self.close(CloseCode::Ended, "");
    }
}

impl WebSocketReader {
    pub(super) async fn read(&mut self) -> Result<Option<Bytes>, TransportError> {
        match self.messages.recv().await {
            Some(frames) => Ok(Some(frames)),
            None => Err(self.link.ended().await),
        }
    }
}

impl WebSocketWriter {
    pub(super) async fn write(&mut self, frames: &[u8]) -> Result<usize, TransportError> {
        match self.messages.reserve().await {
            Ok(place) => place.send(Outgoing::Message(message(CONTROL, frames))),
            Err(_) => return Err(self.link.ended().await),
        }
        Ok(frames.len())
    }

    pub(super) async fn finish(&mut self) {
        let (flushed, is_flushed) = oneshot::channel();
        if self.messages.send(Outgoing::Flush(flushed)).await.is_ok() {
            // The socket may have ended.
            let _ = is_flushed.await;
        }
    }
}

impl Link {
    fn new(address: SocketAddr) -> Self {
        Self {
            address,
            received: Mutex::default(),
            has_received: Notify::new(),
            poses: Mutex::default(),
            has_poses: Notify::new(),
            round_trip: watch::Sender::new(None),
            closing: watch::Sender::new(None),
            ended: watch::Sender::new(None),
        }
    }

    /// Waits until the socket has ended.
    async fn ended(&self) -> TransportError {
        let mut ended = self.ended.subscribe();
        let error = ended.wait_for(Option::is_some).await.ok().and_then(|error| error.clone());
        error.unwrap_or(TransportError::Closed)
    }

    /// Takes in a datagram from the client.
    fn receive(&self, datagram: Bytes) {
        let mut received = self.received();
        if received.len() >= DATAGRAMS_MAX {
            received.pop_front();
        }
        received.push_back(datagram);
        drop(received);
        self.has_received.notify_one();
    }

    fn received(&self) -> MutexGuard<'_, VecDeque<Bytes>> {
        self.received.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn poses(&self) -> MutexGuard<'_, Poses> {
        self.poses.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A message of a kind.
fn message(kind: u8, bytes: &[u8]) -> Vec<u8> {
    let mut message = Vec::with_capacity(1 + bytes.len());
    message.push(kind);
    message.extend_from_slice(bytes);
    message
}

#[cfg(test)]
mod tests;
