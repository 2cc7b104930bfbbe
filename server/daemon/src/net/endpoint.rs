//! The QUIC endpoint: its certificate, its address and the limits of each connection.

mod reader;

use std::{
    io,
    net::{Ipv4Addr, SocketAddr, UdpSocket},
    sync::Arc,
    time::Duration,
};

use quinn::{
    AckFrequencyConfig, Endpoint, EndpointConfig, TransportConfig, VarInt, congestion::BbrConfig,
    crypto::rustls::QuicServerConfig,
};
use ring::hmac;
use sightline_cli::identity::Identity;
use socket2::{Domain, Protocol, Socket, Type};

use super::{
    BindError,
    certificates::Certificates,
    client_keys::AnyKey,
    config::{Limits, ServeConfig},
};
use reader::ReaderRuntime;

/// The client acknowledges packets after this time, or after a round trip if that is less.
const ACK_DELAY_MAX: Duration = Duration::from_millis(100);
/// What may wait of one new connection until it is looked at, in bytes.
const INCOMING_BYTES: u64 = 16 * 1_024;

/// How many streams a client may open: the control stream, one for pieces, and one that takes its
/// place; or for a browser the control stream, and before it the request for it. What nobody reads
/// stays within the window of the connection.
const BIDIRECTIONAL_STREAMS: u32 = 3;
/// HTTP/3 needs one of its own and two for the compression of headers.
const UNIDIRECTIONAL_STREAMS: u32 = if cfg!(feature = "web") { 3 } else { 0 };

/// Opens the endpoint on the configured address.
pub fn listen(
    config: &ServeConfig,
    identity: &Identity,
    certificates: Arc<Certificates>,
) -> Result<Endpoint, BindError> {
    let quic = quic_config(certificates, &config.limits)?;
    let (address, bytes) = (config.listen, config.limits.socket_bytes);
    let bound = match socket(address, bytes) {
        // On a machine without IPv6, every IPv4 address is meant.
        Err(_) if address.is_ipv6() && address.ip().is_unspecified() => {
            socket((Ipv4Addr::UNSPECIFIED, address.port()).into(), bytes)
        }
        bound => bound,
    };
    let endpoint = bound.and_then(|socket| {
        let runtime = Arc::new(ReaderRuntime::start()?);
        Endpoint::new(endpoint_config(identity), Some(quic), socket, runtime)
    });
    endpoint.map_err(|source: io::Error| BindError::Listen { address, source })
}

/// A socket with large buffers, of this number of bytes in each direction: they keep what arrives
/// while no processor is free. A packet of 60 bytes counts as about 800. On an IPv6 address it is
/// for IPv4, too.
fn socket(address: SocketAddr, bytes: usize) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::for_address(address), Type::DGRAM, Some(Protocol::UDP))?;
    if address.is_ipv6() {
        socket.set_only_v6(false)?;
    }
    // With smaller ones the server works, too.
    let _ = socket.set_recv_buffer_size(bytes);
    let _ = socket.set_send_buffer_size(bytes);
    socket.bind(&address.into())?;
    Ok(socket.into())
}

/// A server that was started again knows none of its former connections. By a key that it has kept,
/// it proves to each that it may tell it so, and the client need not wait in vain.
fn endpoint_config(identity: &Identity) -> EndpointConfig {
    let key = blake3::derive_key("sightline stateless reset", identity.key.secret_der());
    EndpointConfig::new(Arc::new(hmac::Key::new(hmac::HMAC_SHA256, &key)))
}

fn quic_config(
    certificates: Arc<Certificates>,
    limits: &Limits,
) -> Result<quinn::ServerConfig, rustls::Error> {
    let protocols = certificates.protocols();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let verifier = Arc::new(AnyKey(provider.clone()));
    let mut tls = rustls::ServerConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .with_client_cert_verifier(verifier)
        .with_cert_resolver(certificates);
    tls.alpn_protocols = protocols;
    let crypto = QuicServerConfig::try_from(tls)
        .map_err(|error| rustls::Error::General(error.to_string()))?;
    let mut quic = quinn::ServerConfig::with_crypto(Arc::new(crypto));
    quic.transport_config(Arc::new(transport(limits)))
        .max_incoming(limits.incoming_max)
        .incoming_buffer_size(INCOMING_BYTES)
        .incoming_buffer_size_total(limits.incoming_bytes());
    Ok(quic)
}

/// How often the client need say what has arrived: less often than each second packet, where the
/// round trip allows it.
fn acks() -> AckFrequencyConfig {
    let mut acks = AckFrequencyConfig::default();
    acks.ack_eliciting_threshold(VarInt::from_u32(8)).max_ack_delay(Some(ACK_DELAY_MAX));
    acks
}

/// The limits of a connection. Quinn's own defaults are a thousand times as generous.
fn transport(limits: &Limits) -> TransportConfig {
    let idle_ms = (limits.idle_s * 1_000.0) as u32;
    let mut transport = TransportConfig::default();
    // It does not take each loss for congestion, so that worlds arrive over bad paths, too.
    transport.congestion_controller_factory(Arc::new(BbrConfig::default()));
    transport
        .max_concurrent_bidi_streams(VarInt::from_u32(BIDIRECTIONAL_STREAMS))
        .max_concurrent_uni_streams(VarInt::from_u32(UNIDIRECTIONAL_STREAMS))
        .stream_receive_window(VarInt::from_u32(limits.stream_window_bytes))
        .receive_window(VarInt::from_u32(limits.receive_window_bytes))
        .send_window(limits.send_window_bytes.into())
        .datagram_receive_buffer_size(Some(limits.datagram_buffer_bytes))
        .datagram_send_buffer_size(limits.datagram_send_bytes)
        .ack_frequency_config(Some(acks()))
        .max_idle_timeout(Some(VarInt::from_u32(idle_ms).into()));
    transport
}
