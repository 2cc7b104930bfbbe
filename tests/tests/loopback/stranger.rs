//! A raw connection that sends whatever it likes.

use std::{net::SocketAddr, sync::Arc, time::Duration};

use quinn::{Connection, Endpoint, SendStream, TransportConfig, crypto::rustls::QuicClientConfig};
use rustls::{
    DigitallySignedStruct, SignatureScheme,
    client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier},
    pki_types::{CertificateDer, ServerName, UnixTime},
};
use sightline_cli::identity::Identity;
use sightline_protocol::{
    ALPN, VERSION,
    frame::{self, FrameBuffer},
    message::{ClientMessage, ServerMessage},
    text::Name,
};

/// A connection without a client behind it.
pub struct Stranger {
    pub connection: Connection,
    _endpoint: Endpoint,
}

impl Stranger {
    pub async fn connect(address: SocketAddr) -> Self {
        Self::with_stream_window(address, 1 << 20).await
    }

    /// Connects as a client that has no more room than this for what it has not read, in bytes.
    pub async fn with_stream_window(address: SocketAddr, bytes: u32) -> Self {
        Self::open(address, bytes, Some(Identity::generate().unwrap())).await
    }

    /// Connects without a key.
    pub async fn without_key(address: SocketAddr) -> Self {
        Self::open(address, 1 << 20, None).await
    }

    /// Connects with the key of somebody else.
    pub async fn with_identity(address: SocketAddr, identity: &Identity) -> Self {
        let (certificate, key) = (identity.certificate.clone(), identity.key.clone_key());
        Self::open(address, 1 << 20, Some(Identity { certificate, key })).await
    }

    async fn open(address: SocketAddr, bytes: u32, identity: Option<Identity>) -> Self {
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let tls = rustls::ClientConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&rustls::version::TLS13])
            .unwrap()
            .dangerous()
            .with_custom_certificate_verifier(Arc::new(Anyone));
        let mut tls = match identity {
            Some(Identity { certificate, key }) => {
                tls.with_client_auth_cert(vec![certificate], key).unwrap()
            }
            None => tls.with_no_client_auth(),
        };
        tls.alpn_protocols = vec![ALPN.to_vec()];
        let crypto = QuicClientConfig::try_from(tls).unwrap();
        let mut endpoint = Endpoint::client("127.0.0.1:0".parse().unwrap()).unwrap();
        let mut transport = TransportConfig::default();
        transport.stream_receive_window(bytes.into());
        let mut config = quinn::ClientConfig::new(Arc::new(crypto));
        config.transport_config(Arc::new(transport));
        endpoint.set_default_client_config(config);
        let connection = endpoint.connect(address, "sightline").unwrap().await.unwrap();
        Self { connection, _endpoint: endpoint }
    }

    /// Sends bytes on a new stream, and leaves it open.
    pub async fn send(&self, bytes: &[u8]) -> SendStream {
        let (mut send, receive) = self.connection.open_bi().await.unwrap();
        send.write_all(bytes).await.unwrap();
        // Dropping it would tell the server to stop.
        std::mem::forget(receive);
        send
    }

    /// Sends bytes, and receives all messages until the server ends the stream.
    pub async fn converse(&self, bytes: &[u8]) -> Vec<ServerMessage> {
        let (mut send, mut receive) = self.connection.open_bi().await.unwrap();
        send.write_all(bytes).await.unwrap();
        let mut buffer = FrameBuffer::default();
        let all = receive.read_to_end(1 << 20);
        buffer.push(&tokio::time::timeout(Duration::from_secs(20), all).await.unwrap().unwrap());
        let mut messages = Vec::new();
        while let Some(frame) = buffer.next_frame().unwrap() {
            messages.push(ServerMessage::decode(frame).unwrap());
        }
        messages
    }

    /// Waits until the server has closed the connection.
    pub async fn is_closed(&self) {
        let closed = tokio::time::timeout(Duration::from_secs(20), self.connection.closed()).await;
        closed.expect("the server must close the connection");
    }
}

/// A hello message.
pub fn hello(version: u32) -> Vec<u8> {
    hello_as("Stranger", [9; 3], version)
}

/// A hello message of somebody with a name and a colour.
pub fn hello_as(name: &str, colour: [u8; 3], version: u32) -> Vec<u8> {
    let name = Name::new(name).unwrap();
    let (invitation, secret) = (None, None);
    frame::encode(&ClientMessage::Hello { version, name, colour, invitation, secret })
}

/// A hello message, and a request to enter.
pub fn hello_and_enter() -> Vec<u8> {
    let enter = ClientMessage::Enter { world: 1, place: None, reports_from: 0 };
    let enter = frame::encode(&enter);
    [hello(VERSION), enter].concat()
}

#[derive(Debug)]
struct Anyone;

impl ServerCertVerifier for Anyone {
    fn verify_server_cert(
        &self,
        _: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, rustls::Error> {
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn verify_tls13_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        vec![SignatureScheme::ECDSA_NISTP256_SHA256, SignatureScheme::ED25519]
    }
}
