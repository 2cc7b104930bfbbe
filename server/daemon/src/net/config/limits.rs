//! Limits on what peers may take.

use std::time::Duration;

use super::documented::documented;

/// What may wait of a new connection on average, in bytes.
const INCOMING_MEAN_BYTES: u64 = 2 * 1_024;

documented! {
    /// Limits on what peers may take. What one of them refuses is counted under its name in the
    /// metric `refused`.
    Limits, LIMIT_COMMENTS {
        /// Connections beyond those of clients with an avatar and of those that join: in their
        /// handshake, or about to be refused with a reason.
        connections_spare: usize,
        /// New connections that may wait to be looked at.
        incoming_max: usize,
        /// With this number of handshakes under way, all newcomers must first prove their address.
        handshakes_before_retry: usize,
        /// Clients that are about to enter. They may download the world.
        joining_max: usize,
        /// Those of one network that are about to enter.
        joining_per_address_max: usize,
        /// When this number of clients wait for the engine to let them in, others must come again
        /// later.
        entering_max: usize,
        /// Clients that enter at one tick. A newcomer costs about a millisecond.
        joins_per_tick: usize,
        /// Events that may wait for the engine. A client whose event finds no room waits.
        events_max: usize,
        /// How long a client may take to enter, apart from its download of the world, in seconds.
        enter_s: f64,
        /// How long the download of a small world may take, in seconds.
        download_s: f64,
        /// A slower download of a larger world is given up, in bytes a second.
        download_bytes_per_s: u32,
        /// Bytes of pieces to one native client in a second, once it was sent as many as the world
        /// has. It waits for more.
        piece_bytes_per_s: u32,
        /// A connection that is silent for longer is lost, in seconds.
        idle_s: f64,
        /// How long a client may take to read what was to be sent to it at one time, in seconds.
        write_s: f64,
        /// Messages of one client for each tick, in the long run. Others are ignored.
        messages_per_tick: f64,
        /// Messages of one client that may arrive at once.
        messages_burst: f64,
        /// Messages beyond its budget after which a client is dropped.
        messages_tolerated: f64,
        /// Bytes of one client for each message, on average.
        message_bytes: f64,
        /// Bytes of one client that may arrive at once.
        bytes_burst: f64,
        /// Lines of chat of one client in a second.
        chat_per_s: f64,
        /// Lines of chat of one client at once.
        chat_burst: f64,
        /// Bytes of control messages that may wait for one client. If more wait, it does not read,
        /// and is dropped.
        control_bytes_max: usize,
        /// Bytes of one client's stream that it may send unread.
        stream_window_bytes: u32,
        /// Bytes of one client's connection that it may send unread.
        receive_window_bytes: u32,
        /// Bytes to one client that are not acknowledged.
        send_window_bytes: u32,
        /// Bytes of datagrams from one client that wait to be read. The oldest are dropped first.
        datagram_buffer_bytes: usize,
        /// Bytes of datagrams to one client that wait for the path. The oldest are dropped first.
        datagram_send_bytes: usize,
        /// Bytes to one client in a second, worlds apart. Beyond them its poses wait, those that
        /// matter least to it for longest; control messages do not.
        client_bytes_per_s: u32,
        /// Bytes to all clients in a second, worlds apart. Each client has an equal share of them.
        bytes_per_s: u32,
        /// Bytes that the system is asked to keep of what arrives, and of what leaves.
        socket_bytes: usize,
        /// Lines of the log in a second about those who come and go from one network.
        log_lines_per_s: f64,
        /// Networks that the log tells apart. All others count as one.
        log_networks_max: usize,
        /// HTTP connections of operators.
        http_connections_max: usize,
        /// Those from one address. This machine's own have no such limit.
        http_connections_per_address_max: usize,
        /// HTTP requests of operators in a second.
        http_requests_per_s: u32,
        /// Connections of browsers that have not become visits.
        web_connections_max: usize,
        /// Those from one network. This machine's own have no such limit.
        web_connections_per_address_max: usize,
        /// Requests of browsers from one network in a second; twice as many at once.
        web_requests_per_s: u32,
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections_spare: 64,
            incoming_max: 1_024,
            handshakes_before_retry: 32,
            joining_max: 256,
            joining_per_address_max: 4,
            entering_max: 200,
            joins_per_tick: 5,
            events_max: 16_384,
            enter_s: 10.0,
            download_s: 30.0,
            download_bytes_per_s: 128 * 1_024,
            piece_bytes_per_s: 1 << 20,
            idle_s: 30.0,
            write_s: 10.0,
            messages_per_tick: 2.0,
            messages_burst: 128.0,
            messages_tolerated: 512.0,
            message_bytes: 128.0,
            bytes_burst: 16_384.0,
            chat_per_s: 1.0,
            chat_burst: 5.0,
            control_bytes_max: 256 * 1_024,
            stream_window_bytes: 64 * 1_024,
            receive_window_bytes: 256 * 1_024,
            send_window_bytes: 256 * 1_024,
            datagram_buffer_bytes: 16 * 1_024,
            datagram_send_bytes: 4 * 1_024,
            client_bytes_per_s: 64_000,
            bytes_per_s: 125_000_000,
            socket_bytes: 8 << 20,
            log_lines_per_s: 5.0,
            log_networks_max: 1_024,
            http_connections_max: 32,
            http_connections_per_address_max: 8,
            http_requests_per_s: 50,
            web_connections_max: 256,
            web_connections_per_address_max: 16,
            web_requests_per_s: 20,
        }
    }
}

impl Limits {
    /// What may wait of all new connections together until they are looked at, in bytes.
    pub fn incoming_bytes(&self) -> u64 {
        self.incoming_max as u64 * INCOMING_MEAN_BYTES
    }

    /// What each of a number of clients may be sent, in bytes a second.
    pub fn bytes_per_s_of_each(&self, clients: usize) -> f64 {
        let share = f64::from(self.bytes_per_s) / clients.max(1) as f64;
        share.min(self.client_bytes_per_s.into())
    }

    /// How long the download of a number of bytes may take.
    pub fn download_time(&self, bytes: usize) -> Duration {
        let seconds = bytes as f64 / f64::from(self.download_bytes_per_s.max(1));
        Duration::from_secs_f64(seconds.max(self.download_s))
    }
}
