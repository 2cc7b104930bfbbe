//! The HTTP listener for operators: metrics, health, and a live page.
//!
//! A slow or hostile client costs nothing. Connections have limits: in all, for each address, and
//! in time. Each connection is for one request, whose header must arrive in time and fit into 16
//! KiB. Only the body of a request with the owner's token is read. Requests have a rate in all.
//! However many ask, the engine is asked twice a second at most for all clients together.
//!
//! Whoever reaches the listener may look: it is on this machine's own address unless its operator
//! chooses another one. Only holders of the [`OwnerToken`] may act.

mod client;
mod connections;
mod desk;
mod metrics_text;
mod owner_token;
mod page;
mod plans;
mod routes;
mod snapshots;
mod stream;

use std::{io, net::SocketAddr, time::Duration};

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use tokio::{
    net::{TcpListener, TcpStream},
    task::{JoinHandle, JoinSet},
    time::{sleep, timeout},
};

pub use client::{AskError, ask_overview};
pub use owner_token::OwnerToken;

use crate::{
    net::{Limits, Observer, Server},
    operate::Reason,
};
pub(crate) use connections::{ConnectionPlace, Connections};
pub(crate) use routes::is_own_name;

/// Where the listener tells what the server does, as JSON.
const OVERVIEW_PATH: &str = "/overview.json";
/// How long the header of a request may take to arrive.
const HEADER_TIME: Duration = Duration::from_secs(5);
/// How long a connection may last. A page that is open connects again by itself.
const CONNECTION_TIME: Duration = Duration::from_secs(300);
/// The most bytes of a header, and of what waits to be sent.
const BUFFER_BYTES: usize = 16 * 1_024;
/// The most fields of a header.
const HEADERS_MAX: usize = 64;
/// How long the listener waits after the system has refused it a connection.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// A listener for operators. It ends when it is dropped.
pub struct HttpServer {
    address: SocketAddr,
    task: JoinHandle<()>,
}

impl HttpServer {
    /// Listens on an address for the operators of a server. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// When the address is taken, or is not one of this machine.
    pub async fn listen(
        address: SocketAddr,
        server: &Server,
        token: OwnerToken,
        limits: &Limits,
    ) -> io::Result<Self> {
        let listener = TcpListener::bind(address).await?;
        let address = listener.local_addr()?;
        let observer = server.observer();
        let desk = desk::router(server.moderation(), token);
        let router = routes::router(observer.clone(), desk, limits, address.ip());
        let connections = Connections::new(
            (limits.http_connections_max, Reason::HttpConnections),
            (limits.http_connections_per_address_max, Reason::HttpOfAddress),
        );
        let task = tokio::spawn(accept(listener, router, observer, connections));
        Ok(Self { address, task })
    }

    /// The address that it listens on.
    pub fn local_addr(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for HttpServer {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Accepts connections. They end with this.
async fn accept(
    listener: TcpListener,
    router: Router,
    observer: Observer,
    connections: Connections,
) {
    let mut tasks = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            Some(_) = tasks.join_next() => continue,
        };
        let (stream, peer) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::debug!(%error, "an HTTP connection cannot be accepted");
                sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        match connections.begin(peer.ip()) {
            Ok(place) => {
                let router = router.clone();
                tasks.spawn(async move {
                    converse(stream, router).await;
                    drop(place);
                });
            }
            Err(reason) => observer.metrics().refusals.count(reason),
        }
    }
}

/// Answers one request. Nobody learns of errors: they are the peer's.
async fn converse(stream: TcpStream, router: Router) {
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEADER_TIME)
        .max_headers(HEADERS_MAX)
        .max_buf_size(BUFFER_BYTES)
        .keep_alive(false)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
    let _ = timeout(CONNECTION_TIME, connection).await;
}
