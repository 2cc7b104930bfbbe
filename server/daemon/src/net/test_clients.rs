//! Clients for the tests of this module.

use std::sync::Arc;

use quinn::{Connection, Endpoint, crypto::rustls::QuicClientConfig};
use sightline_cli::identity::Identity;
use sightline_protocol::{ALPN, text::Name};

use super::{
    admission::ConnectionId,
    certificates::Certificates,
    client::{ConnectedClient, Hello},
    config::ServeConfig,
    endpoint,
    entrance::{self, Arrival},
    state::ServerState,
    transport::{QuicTransport, Transport},
};

/// An endpoint whose connections the test itself serves.
pub fn endpoint_of(config: &ServeConfig, identity: &Identity) -> Endpoint {
    let certificates = Certificates::new(config, identity).unwrap();
    endpoint::listen(config, identity, Arc::new(certificates)).unwrap()
}

/// Connects a visitor to an endpoint. Returns both ends.
pub async fn connect(
    server: &Endpoint,
    identity: &Identity,
    visitor: &Identity,
) -> [Connection; 2] {
    let mut roots = rustls::RootCertStore::empty();
    roots.add(identity.certificate.clone()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let mut tls = rustls::ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])
        .unwrap()
        .with_root_certificates(roots)
        .with_client_auth_cert(vec![visitor.certificate.clone()], visitor.key.clone_key())
        .unwrap();
    tls.alpn_protocols = vec![ALPN.to_vec()];
    let config = quinn::ClientConfig::new(Arc::new(QuicClientConfig::try_from(tls).unwrap()));
    let client = Endpoint::client("127.0.0.1:0".parse().unwrap()).unwrap();
    let connecting = client.connect_with(config, server.local_addr().unwrap(), "sightline");
    let accepting = async { server.accept().await.unwrap().await };
    let (there, here) = tokio::join!(connecting.unwrap(), accepting);
    [there.unwrap(), here.unwrap()]
}

/// Lets a visitor in, as its session does.
pub async fn admit(
    state: &ServerState,
    id: ConnectionId,
    connection: Connection,
) -> Arc<ConnectedClient> {
    let name = Name::new("Ada").unwrap();
    state.registry().places.begin(id, connection.remote_address().ip(), true);
    let transport = Arc::new(Transport::Quic(QuicTransport::new(connection)));
    let (colour, invitation, key) = ([0; 3], None, transport.key());
    let hello = Hello { name, colour, invitation, key, is_foreign: false };
    entrance::admit(state, Arrival { id, transport, hello }).await.unwrap()
}
