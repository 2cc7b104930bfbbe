//! In which range each number of the configuration must be, and what it may cost in memory.

use super::ServeConfig;

/// The memory of a connection apart from its buffers, in bytes: what QUIC and the session keep.
const CONNECTION_BYTES: u64 = 32 * 1_024;
/// What the engine keeps of an avatar, in bytes: itself, and what it sees.
const AVATAR_BYTES: u64 = 16 * 1_024;
/// Poses of a client without acknowledgement, in bytes.
const POSES_BYTES: u64 = 112 * 1_024;
/// An event for the engine, or a client that waits to enter, in bytes.
const EVENT_BYTES: u64 = 256;
/// What the log keeps of a network, in bytes.
const NETWORK_BYTES: u64 = 160;
/// The buffers of an HTTP connection, in bytes.
const HTTP_BYTES: u64 = 64 * 1_024;

/// The bounds of a number.
pub(super) struct Bound {
    /// The name of the field.
    pub(super) name: &'static str,
    /// The least value.
    pub(super) min: f64,
    /// The greatest value.
    pub(super) max: f64,
    /// The most memory that it lets peers occupy, in bytes.
    pub(super) bytes: Option<fn(&ServeConfig) -> u64>,
}

const fn bound(name: &'static str, min: f64, max: f64) -> Bound {
    Bound { name, min, max, bytes: None }
}

const fn costly(name: &'static str, [min, max]: [f64; 2], bytes: fn(&ServeConfig) -> u64) -> Bound {
    Bound { name, min, max, bytes: Some(bytes) }
}

/// The bounds of the numbers of [`ServeConfig`].
pub(super) const SETTINGS: &[Bound] = &[
    bound("tick_hz", 1.0, 128.0),
    costly("clients_max", [1.0, 16_384.0], |config| {
        let buffers = client_buffers(config);
        config.clients_max as u64 * (CONNECTION_BYTES + AVATAR_BYTES + POSES_BYTES + buffers)
    }),
    bound("clients_per_address_max", 1.0, 16_384.0),
    bound("horizon_max_ms", 50.0, 2_000.0),
    bound("sight_test_budget", 0.0, 100_000_000.0),
    bound("validity_max_s", 0.1, 60.0),
    bound("threads", 1.0, 64.0),
    bound("hello_s", 0.1, 600.0),
    bound("silence_s", 0.1, 3_600.0),
    bound("chat_days", 0.0, 3_650.0),
    bound("pieces_from_bytes", 0.0, 1e15),
];

/// The bounds of the numbers of [`super::Limits`].
pub(super) const LIMITS: &[Bound] = &[
    costly("connections_spare", [1.0, 16_384.0], |config| {
        config.limits.connections_spare as u64 * connection_bytes(config)
    }),
    costly("incoming_max", [1.0, 65_536.0], |config| config.limits.incoming_bytes()),
    bound("handshakes_before_retry", 0.0, 16_384.0),
    costly("joining_max", [1.0, 16_384.0], |config| {
        config.limits.joining_max as u64 * connection_bytes(config)
    }),
    bound("joining_per_address_max", 1.0, 16_384.0),
    costly("entering_max", [1.0, 16_384.0], |config| {
        config.limits.entering_max as u64 * EVENT_BYTES
    }),
    bound("joins_per_tick", 1.0, 1_000.0),
    costly("events_max", [1_024.0, 1_048_576.0], |config| {
        config.limits.events_max as u64 * EVENT_BYTES
    }),
    bound("enter_s", 0.1, 600.0),
    bound("download_s", 1.0, 3_600.0),
    bound("download_bytes_per_s", 1_024.0, 1e9),
    bound("piece_bytes_per_s", 1_024.0, 1e9),
    bound("idle_s", 1.0, 600.0),
    bound("write_s", 0.1, 600.0),
    bound("messages_per_tick", 1.1, 100.0),
    bound("messages_burst", 16.0, 10_000.0),
    bound("messages_tolerated", 1.0, 100_000.0),
    bound("message_bytes", 64.0, 1_024.0),
    bound("bytes_burst", 4_096.0, 1_048_576.0),
    bound("chat_per_s", 0.01, 100.0),
    bound("chat_burst", 1.0, 100.0),
    // The buffers of a client are part of what `clients_max` costs.
    bound("control_bytes_max", 16_384.0, 16_777_216.0),
    bound("stream_window_bytes", 4_096.0, 1_048_576.0),
    bound("receive_window_bytes", 4_096.0, 16_777_216.0),
    bound("send_window_bytes", 16_384.0, 16_777_216.0),
    bound("datagram_buffer_bytes", 4_096.0, 1_048_576.0),
    bound("datagram_send_bytes", 2_048.0, 65_536.0),
    bound("client_bytes_per_s", 8_000.0, 1e9),
    bound("bytes_per_s", 8_000.0, 4e9),
    costly("socket_bytes", [65_536.0, 268_435_456.0], |config| {
        2 * config.limits.socket_bytes as u64
    }),
    bound("log_lines_per_s", 0.1, 1_000.0),
    costly("log_networks_max", [1.0, 1_048_576.0], |config| {
        config.limits.log_networks_max as u64 * NETWORK_BYTES
    }),
    costly("http_connections_max", [1.0, 1_024.0], |config| {
        config.limits.http_connections_max as u64 * HTTP_BYTES
    }),
    bound("http_connections_per_address_max", 1.0, 1_024.0),
    bound("http_requests_per_s", 1.0, 10_000.0),
    costly("web_connections_max", [1.0, 16_384.0], |config| {
        config.limits.web_connections_max as u64 * HTTP_BYTES
    }),
    bound("web_connections_per_address_max", 1.0, 16_384.0),
    bound("web_requests_per_s", 1.0, 10_000.0),
];

/// What waits for one client, and what it may send unread.
fn client_buffers(config: &ServeConfig) -> u64 {
    let limits = &config.limits;
    let windows = u64::from(limits.receive_window_bytes) + u64::from(limits.send_window_bytes);
    let datagrams = limits.datagram_buffer_bytes + limits.datagram_send_bytes;
    // As much waits in the outbox as has been taken from it to be written.
    windows + (datagrams + 2 * limits.control_bytes_max) as u64
}

/// What a connection without an avatar may occupy.
fn connection_bytes(config: &ServeConfig) -> u64 {
    CONNECTION_BYTES + client_buffers(config)
}

/// The most memory that peers can occupy beside the world, in bytes.
pub(super) fn bytes_all(config: &ServeConfig) -> u64 {
    let costs = SETTINGS.iter().chain(LIMITS).filter_map(|bound| bound.bytes);
    costs.map(|bytes| bytes(config)).sum()
}
