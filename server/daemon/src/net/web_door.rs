//! Where visitors with a browser come in.

use std::{
    net::{IpAddr, SocketAddr},
    sync::Arc,
    time::Duration,
};

use axum::extract::ws::WebSocket;
use tokio::sync::mpsc;

use super::{
    config::{Limits, Origin},
    served_world::ServedWorld,
    state::ServerState,
    transport::{Transport, WebSocketTransport},
};
use crate::operate::Reason;

/// A socket on which nothing arrives for longer is lost. Browsers answer pings by themselves.
const SILENCE_MAX: Duration = Duration::from_secs(10);

/// What a listener for browsers needs of a server. Copies belong to the same server.
#[derive(Clone)]
pub struct WebDoor {
    state: Arc<ServerState>,
    arrivals: mpsc::Sender<Transport>,
}

impl WebDoor {
    pub(super) fn new(state: Arc<ServerState>, arrivals: mpsc::Sender<Transport>) -> Self {
        Self { state, arrivals }
    }

    /// Begins a visit on a socket. The server decides on it as on every other connection.
    pub(crate) async fn visit(&self, socket: WebSocket, address: SocketAddr) {
        let idle = Duration::from_secs_f64(self.state.config.limits.idle_s).min(SILENCE_MAX);
        let transport = Transport::WebSocket(WebSocketTransport::new(socket, address, idle));
        // A server that has ended takes nobody.
        let _ = self.arrivals.send(transport).await;
    }

    /// The world that is served; `None` before the first.
    pub(crate) fn world(&self) -> Option<ServedWorld> {
        self.state.offers.offer().map(|offer| offer.world)
    }

    /// How long the download of the world may take.
    pub(crate) fn download_time(&self) -> Duration {
        let bytes = self.world().map_or(0, |world| world.bytes().len());
        self.limits().download_time(bytes)
    }

    /// The server's limits.
    pub(crate) fn limits(&self) -> &Limits {
        &self.state.config.limits
    }

    /// The addresses of reverse proxies.
    pub(crate) fn proxies(&self) -> &[IpAddr] {
        &self.state.config.web_proxies
    }

    /// Whether the configuration lists an origin of this host.
    pub(crate) fn is_listed(&self, host: &str) -> bool {
        self.state.config.web_origins.iter().any(|origin| origin.is_of(host))
    }

    /// Whether pages of an origin may visit that were asked for by this host.
    pub(crate) fn allows_origin(&self, origin: &str, host: Option<&str>) -> bool {
        let Ok(origin) = origin.parse::<Origin>() else { return false };
        host.is_some_and(|host| origin.is_of(host))
            || self.state.config.web_origins.contains(&origin)
    }

    /// The server's time.
    pub(crate) fn now(&self) -> Duration {
        self.state.now()
    }

    /// Counts what was refused.
    pub(crate) fn count_refusal(&self, reason: Reason) {
        self.state.metrics.refusals.count(reason);
    }

    /// Counts a piece of the world file that was sent.
    pub(crate) fn count_world_out(&self, bytes: usize) {
        self.state.metrics.traffic.world_out(bytes);
    }
}
