//! Where visitors with a browser come in.

use std::{
    net::{IpAddr, SocketAddr},
    sync::Arc,
    time::Duration,
};

use axum::extract::ws::WebSocket;
use rustls::crypto::ring::default_provider;
use sightline_protocol::fingerprint::VisitorSecret;
use tokio::sync::mpsc;

use super::{
    certificates::Certificates,
    config::Limits,
    served_pieces::ServedPieces,
    served_world::ServedWorld,
    state::ServerState,
    transport::{Transport, VISIT_PATH, WebSocketTransport},
};
use crate::operate::Reason;

/// A socket on which nothing arrives for longer is lost. Browsers answer pings by themselves.
const SILENCE_MAX: Duration = Duration::from_secs(10);

/// What a listener for browsers needs of a server. Copies belong to the same server.
#[derive(Clone)]
pub struct WebDoor {
    state: Arc<ServerState>,
    arrivals: mpsc::Sender<Transport>,
    certificates: Arc<Certificates>,
    udp_port: u16,
}

impl WebDoor {
    pub(super) fn new(
        state: Arc<ServerState>,
        arrivals: mpsc::Sender<Transport>,
        certificates: Arc<Certificates>,
        udp_port: u16,
    ) -> Self {
        Self { state, arrivals, certificates, udp_port }
    }

    /// Begins a visit on a socket. The server decides on it as on every other connection.
    pub(crate) async fn visit(&self, socket: WebSocket, address: SocketAddr) {
        let idle = Duration::from_secs_f64(self.state.config.limits.idle_s).min(SILENCE_MAX);
        let transport = Transport::WebSocket(WebSocketTransport::new(socket, address, idle));
        // A server that has ended takes nobody.
        let _ = self.arrivals.send(transport).await;
    }

    /// Where WebTransport is for a page that was asked for by this name.
    pub(crate) fn web_transport_url(&self, name: &str) -> String {
        format!("https://{name}:{}{VISIT_PATH}", self.udp_port)
    }

    /// The SHA-256 hashes of the certificates that a page may accept; none where browsers accept
    /// them by their issuer.
    pub(crate) fn hashes(&self) -> Vec<[u8; 32]> {
        self.certificates.hashes()
    }

    /// What HTTPS is spoken with; `None` where it is not.
    pub(crate) fn https(&self) -> Result<Option<rustls::ServerConfig>, rustls::Error> {
        if self.state.config.tls_files().is_none() {
            return Ok(None);
        }
        let mut tls = rustls::ServerConfig::builder_with_provider(Arc::new(default_provider()))
            .with_protocol_versions(&[&rustls::version::TLS13])?
            .with_no_client_auth()
            .with_cert_resolver(self.certificates.clone());
        tls.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(Some(tls))
    }

    /// The world that is served; `None` before the first.
    pub(crate) fn world(&self) -> Option<ServedWorld> {
        self.state.offers.offer().map(|offer| offer.world)
    }

    /// Whether visitors get only those pieces that they may see.
    pub(crate) fn is_private(&self) -> bool {
        self.state.config.private_geometry
    }

    /// Which of these pieces of a world a visitor may have now, that is known by a secret.
    pub(crate) async fn may_have(
        &self,
        pieces: &ServedPieces,
        numbers: &[u32],
        secret: Option<VisitorSecret>,
    ) -> Vec<bool> {
        let Some(privacy) = pieces.privacy() else { return vec![true; numbers.len()] };
        let visitor = secret.and_then(|secret| {
            let registry = self.state.registry();
            registry.visitors.get(secret.fingerprint()).map(|client| client.avatar())
        });
        let whereabouts = match visitor {
            Some(avatar) => self.state.whereabouts(avatar).await,
            None => None,
        };
        let may = whereabouts.map(|at| privacy.branches(&at)).unwrap_or_default();
        numbers.iter().map(|number| privacy.is_of(*number, &may)).collect()
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
        self.state
            .config
            .allows_origin(origin, |origin| host.is_some_and(|host| origin.is_of(host)))
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
