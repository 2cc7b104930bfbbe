//! A connected client, as the engine's thread and the client's own session share it.

use std::{net::IpAddr, time::Duration};

use quinn::Connection;
use sightline_protocol::text::Name;
use sightline_world::motion::AvatarId;

use super::outbox::Outbox;
use crate::operate::{ClientStats, TrafficCounters};

/// A connected client.
pub struct ConnectedClient {
    /// The avatar that it has, or will have. Each connection has its own.
    pub avatar: AvatarId,
    /// The messages that wait to be sent to it.
    pub outbox: Outbox,
    /// What was sent to it and received from it.
    pub counters: TrafficCounters,
    /// The QUIC connection.
    pub connection: Connection,
}

impl ConnectedClient {
    /// A client of which nothing is known yet but its connection, at a server with this time from
    /// tick to tick.
    pub fn new(avatar: AvatarId, connection: Connection, tick_interval: Duration) -> Self {
        let (outbox, counters) = (Outbox::new(tick_interval), TrafficCounters::default());
        Self { avatar, outbox, counters, connection }
    }

    /// The address of its machine.
    pub fn address(&self) -> IpAddr {
        self.connection.remote_address().ip()
    }

    /// The statistics at present.
    pub fn stats(&self) -> ClientStats {
        ClientStats {
            traffic: self.counters.traffic(),
            reporting_state: self.outbox.reporting_state(),
            round_trip_ms: self.connection.rtt().as_secs_f64() * 1e3,
        }
    }
}

/// The first message of a client.
pub struct Hello {
    /// The name that others see.
    pub name: Name,
    /// The avatar's colour, sRGB.
    pub colour: [u8; 3],
    /// Whether the client speaks another version of the protocol.
    pub is_foreign: bool,
}
