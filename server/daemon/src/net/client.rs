//! A connected client, as the engine's thread and the client's own session share it.

use std::{
    net::IpAddr,
    sync::{Mutex, PoisonError},
    time::Duration,
};

use glam::Vec3;
use quinn::Connection;
use sightline_protocol::text::Name;
use sightline_world::{
    motion::{AvatarId, Tbv},
    tolerance::WIRE_POSE_M,
};

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
    /// Where it was in the world before this one.
    former: Mutex<Option<FormerPlace>>,
}

/// Where a client was when its world ended.
#[derive(Clone, Copy, Debug)]
pub struct FormerPlace {
    /// The last accepted place of its eye.
    pub eye: Vec3,
    /// Where its eye was, as far as it had said.
    pub region: Tbv,
}

impl FormerPlace {
    /// Where it goes on, if it says that it was at a place.
    pub fn going_on(&self, claimed: Vec3) -> Vec3 {
        if self.region.grown(WIRE_POSE_M).contains(claimed) { claimed } else { self.eye }
    }
}

impl ConnectedClient {
    /// A client of which nothing is known yet but its connection, at a server with this time from
    /// tick to tick.
    pub fn new(avatar: AvatarId, connection: Connection, tick_interval: Duration) -> Self {
        let (outbox, counters) = (Outbox::new(tick_interval), TrafficCounters::default());
        Self { avatar, outbox, counters, connection, former: Mutex::default() }
    }

    /// Notes where it was when its world ended.
    pub fn set_former(&self, place: FormerPlace) {
        *self.former.lock().unwrap_or_else(PoisonError::into_inner) = Some(place);
    }

    /// Where it was in the world before this one. The next call has nothing.
    pub fn take_former(&self) -> Option<FormerPlace> {
        self.former.lock().unwrap_or_else(PoisonError::into_inner).take()
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

#[cfg(test)]
mod tests {
    use sightline_world::geometry::{Aabb, Axes};

    use super::*;

    #[test]
    fn a_client_goes_on_where_it_was_and_nowhere_else() {
        let within = Aabb::new(Vec3::ZERO, Vec3::splat(4.0));
        let (expiry, notice) = (Duration::ZERO, Duration::ZERO);
        let region = Tbv { within, axes: Axes::turned(0.0), expiry, notice };
        let former = FormerPlace { eye: Vec3::ONE, region };
        assert_eq!(former.going_on(Vec3::splat(3.0)), Vec3::splat(3.0));
        assert_eq!(former.going_on(Vec3::splat(4.001)), Vec3::splat(4.001), "rounded on the wire");
        assert_eq!(former.going_on(Vec3::splat(5.0)), Vec3::ONE);
    }
}
