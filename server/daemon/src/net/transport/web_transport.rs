//! A browser's connection: WebTransport, which is QUIC with a layer of HTTP/3.

use std::{net::SocketAddr, time::Duration};

use axum::http::{StatusCode, header};
use bytes::Bytes;
use quinn::{Connection, ConnectionError, SendDatagramError};
use sightline_protocol::frame::FRAME_BYTES_MAX;
use tokio::time::sleep;
use web_transport_quinn::{
    ReadError, RecvStream, Request, SendStream, Session, SessionError, WebTransportError,
    WriteError,
};

use super::{
    super::config::{Origin, ServeConfig},
    CloseCode, TransportError,
    quic::DATAGRAM_SPACE_MIN,
};

/// The path of the session, as of the WebSocket.
pub const VISIT_PATH: &str = "/visit";

/// How long a page has to read its last words, once its browser has them. What it has not read when
/// the session closes is lost.
const READING_TIME: Duration = Duration::from_millis(200);

/// A session of WebTransport, the only one of its connection.
pub struct WebTransport(Box<Session>);

/// The half of the control stream from the client.
pub struct WebTransportReader(RecvStream);

/// The half of the control stream to the client.
pub struct WebTransportWriter(SendStream);

impl WebTransport {
    /// Lets a page of the own host, or of a listed origin, open its session. `None` for anything
    /// else.
    pub async fn accept(connection: Connection, config: &ServeConfig) -> Option<Self> {
        let request = Request::accept(connection).await.ok()?;
        if request.url.path() != VISIT_PATH {
            let _ = request.reject(StatusCode::NOT_FOUND).await;
            return None;
        }
        let origin = request.headers.get(header::ORIGIN).and_then(|origin| origin.to_str().ok());
        let name = request.url.host_str();
        let is_own = |origin: &Origin| name.is_some_and(|name| origin.is_at(name));
        if !origin.is_some_and(|origin| config.allows_origin(origin, is_own)) {
            let _ = request.reject(StatusCode::FORBIDDEN).await;
            return None;
        }
        request.ok().await.ok().map(|session| Self(Box::new(session)))
    }

    pub(super) async fn control(
        &self,
    ) -> Result<(WebTransportWriter, WebTransportReader), TransportError> {
        let (send, receive) = self.0.accept_bi().await?;
        Ok((WebTransportWriter(send), WebTransportReader(receive)))
    }

    pub(super) fn datagram_room(&self) -> Option<usize> {
        let has_room = self.0.datagram_send_buffer_space() >= DATAGRAM_SPACE_MIN;
        Some(self.0.max_datagram_size()).filter(|bytes| has_room && *bytes > 0)
    }

    pub(super) fn send_datagram(&self, datagram: Vec<u8>) -> Result<(), TransportError> {
        match self.0.send_datagram(datagram.into()) {
            // The path has just become too narrow for it: it counts as lost.
            Ok(()) | Err(SessionError::SendDatagramError(SendDatagramError::TooLarge)) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    pub(super) async fn receive_datagram(&self) -> Result<Bytes, TransportError> {
        Ok(self.0.read_datagram().await?)
    }

    pub(super) fn remote_address(&self) -> SocketAddr {
        self.0.remote_address()
    }

    pub(super) fn round_trip(&self) -> Duration {
        self.0.rtt()
    }

    pub(super) fn close(&self, code: CloseCode, reason: &str) {
        self.0.close(code as u32, reason.as_bytes());
    }
}

impl WebTransportReader {
    pub(super) async fn read(&mut self) -> Result<Option<Bytes>, TransportError> {
        match self.0.read_chunk(FRAME_BYTES_MAX, true).await {
            Ok(Some(chunk)) => Ok(Some(chunk.bytes)),
            // A page that leaves says goodbye first.
            Ok(None) => Err(lost("the page closed it")),
            Err(ReadError::SessionError(error)) => Err(error.into()),
            Err(error) => Err(lost(error)),
        }
    }
}

impl WebTransportWriter {
    pub(super) async fn write(&mut self, frames: &[u8]) -> Result<usize, TransportError> {
        match self.0.write(frames).await {
            Ok(bytes) => Ok(bytes),
            Err(WriteError::SessionError(error)) => Err(error.into()),
            Err(error) => Err(lost(error)),
        }
    }

    pub(super) async fn finish(&mut self) {
        if self.0.finish().is_ok() {
            let _ = self.0.stopped().await;
            sleep(READING_TIME).await;
        }
    }
}

fn lost(error: impl ToString) -> TransportError {
    TransportError::Lost(error.to_string())
}

impl From<SessionError> for TransportError {
    fn from(error: SessionError) -> Self {
        match error {
            // The browser went away. A page that only closes its session is about to open another.
            SessionError::ConnectionError(
                ConnectionError::ApplicationClosed(_) | ConnectionError::ConnectionClosed(_),
            ) => Self::Closed,
            SessionError::WebTransportError(WebTransportError::Closed(..)) => {
                lost("the page closed it")
            }
            error => lost(error),
        }
    }
}
