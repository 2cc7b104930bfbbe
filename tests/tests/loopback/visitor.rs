//! A visitor of any kind of connection, which says and hears single messages.

use std::{
    net::SocketAddr,
    time::{Duration, Instant},
};

use base64::{Engine, prelude::BASE64_STANDARD};
use futures_util::{SinkExt, StreamExt};
use quinn::{RecvStream, SendStream};
use sightline_protocol::{
    fingerprint::VisitorSecret,
    frame::{self, FrameBuffer},
    message::{ClientMessage, ServerMessage},
    pose_stream::PoseDecoder,
    quantise::{WirePose, WireReport},
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    time::timeout,
};
use tokio_tungstenite::{
    MaybeTlsStream, WebSocketStream, connect_async,
    tungstenite::{self, Message, client::IntoClientRequest, http::HeaderValue},
};

use url::Url;
use web_transport_quinn::{
    ClientBuilder, RecvStream as WebReceive, SendStream as WebSend, Session, proto::ConnectRequest,
};

use super::{PATIENCE, stranger::Stranger};

/// The kinds of connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Quic,
    WebTransport,
    WebSocket,
}

/// The addresses of a server.
#[derive(Clone, Copy, Debug)]
pub struct Doors {
    pub quic: SocketAddr,
    pub web: SocketAddr,
}

/// A visitor.
pub struct Visitor {
    link: Link,
    frames: FrameBuffer,
    /// What came while a message was awaited.
    datagrams: Vec<Vec<u8>>,
    /// How many orders it has heard.
    orders: u32,
    began: Instant,
    pub tick: Duration,
    pub pose: WirePose,
    /// Why the server has ended the connection, if it said so.
    last_words: String,
}

enum Link {
    Quic { stranger: Stranger, send: SendStream, receive: RecvStream },
    WebTransport(Box<(Session, WebSend, WebReceive)>),
    WebSocket(Box<WebSocketStream<MaybeTlsStream<TcpStream>>>),
}

/// What a visitor hears.
#[derive(Debug)]
pub enum Heard {
    Message(ServerMessage),
    Datagram(Vec<u8>),
    /// The connection has ended.
    End,
}

impl Visitor {
    pub async fn connect(kind: Kind, doors: Doors) -> Self {
        let link = match kind {
            Kind::Quic => {
                let stranger = Stranger::without_key(doors.quic).await;
                let (send, receive) = stranger.connection.open_bi().await.unwrap();
                Link::Quic { stranger, send, receive }
            }
            Kind::WebTransport => {
                let session = web_transport(doors, &format!("http://{}", doors.web)).await.unwrap();
                let (send, receive) = session.open_bi().await.unwrap();
                Link::WebTransport(Box::new((session, send, receive)))
            }
            Kind::WebSocket => {
                let socket = web_socket(doors.web, &format!("http://{}", doors.web)).await;
                Link::WebSocket(Box::new(socket.unwrap()))
            }
        };
        let (frames, datagrams) = Default::default();
        let (began, tick) = (Instant::now(), Duration::from_millis(50));
        let (pose, last_words) = Default::default();
        Self { link, frames, datagrams, orders: 0, began, tick, pose, last_words }
    }

    /// Connects and says hello, as the owner of a secret.
    pub async fn greet(kind: Kind, doors: Doors, name: &str, secret: u8) -> Self {
        let mut visitor = Self::connect(kind, doors).await;
        visitor.say(&hello(name, secret)).await;
        visitor
    }

    /// Says a message on the control stream.
    pub async fn say(&mut self, message: &ClientMessage) {
        let frame = frame::encode(message);
        match &mut self.link {
            // A server that has ended the connection said why, which is heard later.
            Link::Quic { send, .. } => drop(send.write_all(&frame).await),
            Link::WebTransport(web) => drop(web.1.write_all(&frame).await),
            Link::WebSocket(_) => {
                self.send_raw(Message::Binary([&[0], &frame[..]].concat().into())).await
            }
        }
    }

    /// Sends a datagram.
    pub async fn send(&mut self, datagram: &[u8]) {
        match &mut self.link {
            Link::Quic { stranger, .. } => {
                stranger.connection.send_datagram(datagram.to_vec().into()).unwrap();
            }
            Link::WebTransport(web) => {
                web.0.send_datagram(datagram.to_vec().into()).unwrap();
            }
            Link::WebSocket(_) => {
                self.send_raw(Message::Binary([&[1], datagram].concat().into())).await
            }
        }
    }

    /// A report of where it is now.
    pub fn report(&self) -> WireReport {
        let made = WireReport::made_at(self.began.elapsed(), self.tick);
        WireReport { made, orders: self.orders, pose: self.pose }
    }

    /// Does what is asked of a client that stands still.
    async fn answer(&mut self, message: &ServerMessage) {
        match message {
            ServerMessage::Welcome { tick_interval_us, .. } => {
                self.tick = Duration::from_micros(tick_interval_us.get().into());
            }
            ServerMessage::Entered { pose, .. } | ServerMessage::Correct { pose } => {
                self.pose = *pose;
            }
            ServerMessage::Ask | ServerMessage::Live { .. } => {
                let ack = PoseDecoder::new(self.tick).ack();
                self.say(&ClientMessage::Report { report: self.report(), ack }).await;
            }
            ServerMessage::Goodbye { reason, .. } => self.last_words = reason.as_str().to_owned(),
            _ => {}
        }
    }

    /// Sends a message of a WebSocket as it is.
    pub async fn send_raw(&mut self, message: Message) {
        let Link::WebSocket(socket) = &mut self.link else { panic!("no WebSocket") };
        let _ = socket.send(message).await;
    }

    /// What comes next.
    pub async fn hear(&mut self) -> Heard {
        timeout(PATIENCE, self.next()).await.expect("something comes in time")
    }

    async fn next(&mut self) -> Heard {
        loop {
            if let Some(frame) = self.frames.next_frame().unwrap() {
                let message = ServerMessage::decode(frame).unwrap();
                let is_order =
                    matches!(message, ServerMessage::Live { .. } | ServerMessage::Quiet { .. });
                self.orders += u32::from(is_order);
                self.answer(&message).await;
                return Heard::Message(message);
            }
            match &mut self.link {
                Link::Quic { stranger, receive, .. } => {
                    let mut piece = [0; 4_096];
                    tokio::select! {
                        read = receive.read(&mut piece) => match read {
                            Ok(Some(bytes)) => self.frames.push(&piece[..bytes]),
                            Ok(None) | Err(_) => return Heard::End,
                        },
                        Ok(datagram) = stranger.connection.read_datagram() => {
                            return Heard::Datagram(datagram.to_vec());
                        }
                    }
                }
                Link::WebTransport(web) => {
                    let (session, _, receive) = &mut **web;
                    let mut piece = [0; 4_096];
                    tokio::select! {
                        read = receive.read(&mut piece) => match read {
                            Ok(Some(bytes)) => self.frames.push(&piece[..bytes]),
                            Ok(None) | Err(_) => return Heard::End,
                        },
                        Ok(datagram) = session.read_datagram() => {
                            return Heard::Datagram(datagram.to_vec());
                        }
                    }
                }
                Link::WebSocket(socket) => match socket.next().await {
                    Some(Ok(Message::Binary(bytes))) if bytes[0] == 0 => {
                        self.frames.push(&bytes[1..]);
                        assert!(whole(&bytes[1..]), "a message has whole frames");
                    }
                    Some(Ok(Message::Binary(bytes))) if bytes[0] == 1 => {
                        return Heard::Datagram(bytes[1..].to_vec());
                    }
                    Some(Ok(Message::Ping(_))) => {}
                    Some(Ok(Message::Close(_)) | Err(_)) | None => return Heard::End,
                    Some(Ok(other)) => panic!("{other:?}"),
                },
            }
        }
    }

    /// Hears until a message is the one that is waited for. Datagrams are kept.
    pub async fn until<T>(&mut self, mut is_it: impl FnMut(ServerMessage) -> Option<T>) -> T {
        loop {
            match self.hear().await {
                Heard::Message(message) => {
                    if let Some(it) = is_it(message) {
                        return it;
                    }
                }
                Heard::Datagram(datagram) => self.datagrams.push(datagram),
                Heard::End => panic!("the connection has ended: {}", self.last_words),
            }
        }
    }

    /// The next datagram. Messages meanwhile are dropped.
    pub async fn datagram(&mut self) -> Vec<u8> {
        if !self.datagrams.is_empty() {
            return self.datagrams.remove(0);
        }
        loop {
            match self.hear().await {
                Heard::Datagram(datagram) => return datagram,
                Heard::Message(_) => {}
                Heard::End => panic!("the connection has ended: {}", self.last_words),
            }
        }
    }

    /// The messages until the connection ends.
    pub async fn rest(&mut self) -> Vec<ServerMessage> {
        let mut messages = Vec::new();
        loop {
            match self.hear().await {
                Heard::Message(message) => messages.push(message),
                Heard::Datagram(_) => {}
                Heard::End => return messages,
            }
        }
    }
}

/// The first message of the owner of a secret.
pub fn hello(name: &str, secret: u8) -> ClientMessage {
    ClientMessage::Hello {
        version: sightline_protocol::VERSION,
        name: sightline_protocol::text::Name::new(name).unwrap(),
        colour: [10, 20, 30],
        invitation: None,
        secret: Some(VisitorSecret([secret; 32])),
    }
}

/// Opens a session of WebTransport as a page of an origin does, which learns the hashes of
/// certificates.
pub async fn web_transport(doors: Doors, origin: &str) -> Option<Session> {
    let (_, _, join) = get(doors.web, "/join.json", "").await;
    let join: serde_json::Value = serde_json::from_slice(&join).unwrap();
    let hashes = join["webtransport"]["hashes"].as_array().unwrap().iter();
    let hashes = hashes.map(|hash| BASE64_STANDARD.decode(hash.as_str().unwrap()).unwrap());
    let client = ClientBuilder::new().with_server_certificate_hashes(hashes.collect()).unwrap();
    let url: Url = join["webtransport"]["url"].as_str().unwrap().parse().unwrap();
    let request = ConnectRequest::new(url)
        .with_header("origin".parse().unwrap(), HeaderValue::from_str(origin).unwrap());
    client.connect(request).await.ok()
}

/// Opens a WebSocket as a page of an origin does.
pub async fn web_socket(
    web: SocketAddr,
    origin: &str,
) -> Result<WebSocketStream<MaybeTlsStream<TcpStream>>, tungstenite::Error> {
    let mut request = format!("ws://{web}/visit").into_client_request().unwrap();
    request.headers_mut().insert("origin", HeaderValue::from_str(origin).unwrap());
    Ok(connect_async(request).await?.0)
}

/// Asks by HTTP. The status, the header in lower case, and the body.
pub async fn get(web: SocketAddr, path: &str, fields: &str) -> (u16, String, Vec<u8>) {
    let mut stream = TcpStream::connect(web).await.unwrap();
    let host = if fields.contains("Host:") { String::new() } else { format!("Host: {web}\r\n") };
    let request = format!("GET {path} HTTP/1.1\r\n{host}Connection: close\r\n{fields}\r\n");
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut said = Vec::new();
    let _ = timeout(PATIENCE, stream.read_to_end(&mut said)).await.expect("it closes");
    let end = said.windows(4).position(|bytes| bytes == b"\r\n\r\n").expect("a header");
    let header = String::from_utf8_lossy(&said[..end]).to_lowercase();
    let status = header.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap();
    (status, header, said.split_off(end + 4))
}

/// Whether bytes are whole frames.
fn whole(mut bytes: &[u8]) -> bool {
    while let [low, high, rest @ ..] = bytes {
        match rest.get(usize::from(u16::from_le_bytes([*low, *high]))..) {
            Some(next) => bytes = next,
            None => return false,
        }
    }
    bytes.is_empty()
}
