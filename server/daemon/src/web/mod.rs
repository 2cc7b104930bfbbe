//! The listener for visitors with a browser: the page, the world's file or its pieces, and the
//! WebSocket.
//!
//! It is on the TCP port with the number of the UDP port, unless the operator chooses another one.
//! Connections have limits: in all, for each network, and in time. Requests have a rate for each
//! network, and downloads have the limits of clients that join. A header must arrive in time and
//! fit into 16 KiB, and no body is read. What becomes a visit has the limits of every other one
//! from then on.

mod connection;
mod download;
mod host;
mod join;
mod page;
mod pieces;
mod rates;
mod routes;
mod visit;
mod world;

use std::{
    io,
    net::{Ipv4Addr, SocketAddr},
    sync::Arc,
    time::Duration,
};

use socket2::{Domain, Protocol, SockRef, Socket, Type};
use tokio::{
    net::{TcpListener, TcpStream},
    task::{JoinHandle, JoinSet},
    time::{sleep, timeout},
};
use tokio_rustls::TlsAcceptor;

use crate::{http::Connections, net::WebDoor, operate::Reason};
use connection::converse;
use routes::Site;

/// How many connections may wait to be accepted.
const BACKLOG: i32 = 256;
/// How long the listener waits after the system has refused it a connection.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);
/// How long the handshake of HTTPS may take.
const TLS_TIME: Duration = Duration::from_secs(5);
/// How much the system takes of what cannot be sent yet, in bytes. There it grows old.
#[cfg(target_os = "linux")]
const UNSENT_BYTES: u32 = 16 * 1_024;

/// A listener for visitors with a browser. It ends when it is dropped; visits go on.
pub struct WebServer {
    address: SocketAddr,
    is_secure: bool,
    task: JoinHandle<()>,
}

impl WebServer {
    /// Listens on a TCP address. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// When the address is taken, or is not one of this machine.
    pub fn listen(address: SocketAddr, door: WebDoor) -> io::Result<Self> {
        let listener = match socket(address) {
            // On a machine without IPv6, every IPv4 address is meant.
            Err(_) if address.is_ipv6() && address.ip().is_unspecified() => {
                socket((Ipv4Addr::UNSPECIFIED, address.port()).into())?
            }
            bound => bound?,
        };
        let address = listener.local_addr()?;
        let https = door.https().map_err(io::Error::other)?;
        let https = https.map(|config| TlsAcceptor::from(Arc::new(config)));
        let is_secure = https.is_some();
        let site = Arc::new(Site::new(door, address, is_secure));
        Ok(Self { address, is_secure, task: tokio::spawn(accept(listener, https, site)) })
    }

    /// The scheme of its links: `https` with the operator's certificate, else `http`.
    pub fn scheme(&self) -> &'static str {
        if self.is_secure { "https" } else { "http" }
    }

    /// The address that it listens on.
    pub fn local_addr(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for WebServer {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// A listening socket. On an IPv6 address it is for IPv4, too.
fn socket(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = Socket::new(Domain::for_address(address), Type::STREAM, Some(Protocol::TCP))?;
    if address.is_ipv6() {
        socket.set_only_v6(false)?;
    }
    // A server that is started again finds its former connections closing.
    #[cfg(unix)]
    socket.set_reuse_address(true)?;
    socket.set_nonblocking(true)?;
    socket.bind(&address.into())?;
    socket.listen(BACKLOG)?;
    TcpListener::from_std(socket.into())
}

/// Accepts connections. They end with this, unless they have become visits.
async fn accept(listener: TcpListener, https: Option<TlsAcceptor>, site: Arc<Site>) {
    let limits = site.door.limits();
    let connections = Connections::new(
        (limits.web_connections_max, Reason::WebConnections),
        (limits.web_connections_per_address_max, Reason::WebOfAddress),
    );
    let mut tasks = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            Some(_) = tasks.join_next() => continue,
        };
        let (stream, peer) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::debug!(%error, "a connection of a browser cannot be accepted");
                sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        // A reverse proxy brings the connections of all.
        let place = if site.is_proxy(peer.ip()) {
            connections.begin_unlimited(peer.ip())
        } else {
            connections.begin(peer.ip())
        };
        match place {
            Ok(place) => {
                prepare(&stream);
                let (site, https) = (site.clone(), https.clone());
                tasks.spawn(async move {
                    match https {
                        Some(https) => {
                            if let Ok(Ok(stream)) = timeout(TLS_TIME, https.accept(stream)).await {
                                converse(stream, peer, site).await;
                            }
                        }
                        None => converse(stream, peer, site).await,
                    }
                    drop(place);
                });
            }
            Err(reason) => site.door.count_refusal(reason),
        }
    }
}

/// Has the system send small messages at once, and keep little that waits.
fn prepare(stream: &TcpStream) {
    let socket = SockRef::from(stream);
    // Without these the connection works, too.
    let _ = socket.set_tcp_nodelay(true);
    #[cfg(target_os = "linux")]
    let _ = socket.set_tcp_notsent_lowat(UNSENT_BYTES);
}
