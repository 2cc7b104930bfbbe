//! A connected client, as the engine's thread and the client's own session share it.

use std::{
    net::IpAddr,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use glam::Vec3;
use sightline_protocol::{
    fingerprint::KeyFingerprint,
    text::{ChatLine, Name},
};
use sightline_world::{
    geometry::{Aabb, Axes},
    motion::{AvatarId, Tbv},
    tolerance::WIRE_POSE_M,
};

use super::{admission::ConnectionId, config::ServeConfig, outbox::Outbox, transport::Transport};
use crate::operate::{ClientStats, Metrics, Reason, SentFrames, TrafficCounters};

/// A visitor, from when it comes in to when it leaves. It outlasts connections.
pub struct Visit {
    /// The fingerprint of the visitor's key.
    pub key: KeyFingerprint,
    /// The avatar that it has, or will have.
    pub avatar: AvatarId,
    /// The name that others see.
    pub name: Name,
    /// The name that the visitor asked for.
    pub wanted: Name,
    /// The avatar's colour, sRGB.
    pub colour: [u8; 3],
    /// Whether the avatar is in the world, or was when the world ended.
    has_entered: AtomicBool,
    /// Where it was before it was in this world, or before its link broke.
    former: Mutex<Option<FormerPlace>>,
}

/// A connected client.
pub struct ConnectedClient {
    /// The number of its connection.
    pub connection_id: ConnectionId,
    /// Its connection.
    pub transport: Arc<Transport>,
    /// The visitor.
    pub visit: Arc<Visit>,
    /// The messages that wait to be sent to it.
    pub outbox: Outbox,
    /// What was sent to it and received from it.
    counters: TrafficCounters,
    /// What the server counts.
    metrics: Arc<Metrics>,
    /// When it connected.
    pub since: Instant,
    /// Whether another client has its avatar.
    is_replaced: AtomicBool,
}

/// Where a client was when its world ended.
#[derive(Clone, Copy, Debug)]
pub struct FormerPlace {
    /// The last accepted place of its eye.
    pub eye: Vec3,
    /// Where its eye was, as far as it had said.
    pub region: Tbv,
    /// The number of the world that it was in.
    pub world: u32,
}

impl FormerPlace {
    /// Where it was when another server had it, in no world of this one.
    pub fn last(eye: Vec3) -> Self {
        let within = Aabb::new(eye, eye);
        let (expiry, notice) = (Duration::ZERO, Duration::ZERO);
        let region = Tbv { within, axes: Axes::WORLD, expiry, notice };
        Self { eye, region, world: 0 }
    }

    /// Where it goes on: where it says that it was, if it could be there.
    pub fn going_on(&self, claimed: Option<Vec3>) -> Vec3 {
        let region = self.region.grown(WIRE_POSE_M);
        claimed.filter(|claimed| region.contains(*claimed)).unwrap_or(self.eye)
    }
}

impl Visit {
    /// A visitor that has just come in.
    pub fn new(key: KeyFingerprint, avatar: AvatarId, name: Name, hello: &Hello) -> Self {
        let (has_entered, former) = Default::default();
        let (wanted, colour) = (hello.name.clone(), hello.colour);
        Self { key, avatar, name, wanted, colour, has_entered, former }
    }

    /// Whether a visitor who says this goes on with the visit.
    pub fn goes_on_with(&self, hello: &Hello) -> bool {
        self.wanted == hello.name && self.colour == hello.colour
    }

    /// Notes where it was when its world ended, or when its link broke.
    pub fn set_former(&self, place: FormerPlace) {
        *self.former.lock().unwrap_or_else(PoisonError::into_inner) = Some(place);
    }

    /// Where it was before; `None` when it has been there since.
    pub fn former(&self) -> Option<FormerPlace> {
        *self.former.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes in that its avatar is in the world.
    pub fn enter(&self) {
        self.has_entered.store(true, Relaxed);
        *self.former.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// Whether it has an avatar that can be kept for it.
    pub fn has_entered(&self) -> bool {
        self.has_entered.load(Relaxed)
    }
}

impl ConnectedClient {
    /// The client of a visitor, at a server of this configuration.
    pub fn new(
        connection_id: ConnectionId,
        transport: Arc<Transport>,
        visit: Arc<Visit>,
        config: &ServeConfig,
        metrics: Arc<Metrics>,
    ) -> Self {
        let outbox =
            Outbox::new(visit.avatar, config.tick_interval(), config.limits.control_bytes_max);
        let counters = TrafficCounters::default();
        let (since, is_replaced) = (Instant::now(), AtomicBool::new(false));
        Self { connection_id, transport, visit, outbox, counters, metrics, since, is_replaced }
    }

    /// Its own counters, and those of all clients together.
    fn counters(&self) -> [&TrafficCounters; 2] {
        [&self.counters, &self.metrics.traffic]
    }

    /// Counts a control message from it, without its length prefix.
    pub fn count_frame_in(&self, frame: &[u8]) {
        self.counters().into_iter().for_each(|counters| counters.frame_in(frame));
    }

    /// Counts a datagram from it.
    pub fn count_datagram_in(&self, bytes: usize) {
        self.counters().into_iter().for_each(|counters| counters.datagram_in(bytes));
    }

    /// Counts control messages to it.
    pub fn count_frames_out(&self, frames: &SentFrames) {
        self.counters().into_iter().for_each(|counters| counters.frames_out(frames));
    }

    /// Counts a datagram to it.
    pub fn count_datagram_out(&self, bytes: usize) {
        self.counters().into_iter().for_each(|counters| counters.datagram_out(bytes));
    }

    /// Counts a piece of the world file that was sent to it.
    pub fn count_world_out(&self, bytes: usize) {
        self.counters().into_iter().for_each(|counters| counters.world_out(bytes));
    }

    /// Counts that the server refused it something.
    pub fn count_refusal(&self, reason: Reason) {
        self.metrics.refusals.count(reason);
    }

    /// Takes in that another client has its avatar. It is told so, and is not listened to any more.
    pub fn replace(&self, reason: &str) {
        self.is_replaced.store(true, Relaxed);
        self.outbox.end(reason, false);
    }

    /// Whether another client has its avatar.
    pub fn is_replaced(&self) -> bool {
        self.is_replaced.load(Relaxed)
    }

    /// The avatar that it has, or will have.
    pub fn avatar(&self) -> AvatarId {
        self.visit.avatar
    }

    /// The address of its machine.
    pub fn address(&self) -> IpAddr {
        self.transport.remote_address().ip()
    }

    /// The statistics at present.
    pub fn stats(&self) -> ClientStats {
        ClientStats {
            traffic: self.counters.traffic(),
            reporting_state: self.outbox.reporting_state(),
            round_trip_ms: self.transport.round_trip().as_secs_f64() * 1e3,
        }
    }
}

/// The first message of a client.
pub struct Hello {
    /// The name that others see.
    pub name: Name,
    /// The avatar's colour, sRGB.
    pub colour: [u8; 3],
    /// An invitation, where not everybody is let in.
    pub invitation: Option<ChatLine>,
    /// What the visitor is known by: its key, or its secret.
    pub key: Option<KeyFingerprint>,
    /// Whether the client speaks another version of the protocol.
    pub is_foreign: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_goes_on_where_it_was_and_nowhere_else() {
        let within = Aabb::new(Vec3::ZERO, Vec3::splat(4.0));
        let (expiry, notice) = (Duration::ZERO, Duration::ZERO);
        let region = Tbv { within, axes: Axes::turned(0.0), expiry, notice };
        let former = FormerPlace { eye: Vec3::ONE, region, world: 1 };
        let going_on = |x| former.going_on(Some(Vec3::splat(x)));
        assert_eq!(going_on(3.0), Vec3::splat(3.0));
        assert_eq!(going_on(4.001), Vec3::splat(4.001), "rounded on the wire");
        assert_eq!((going_on(5.0), former.going_on(None)), (Vec3::ONE, Vec3::ONE));
        assert_eq!(FormerPlace::last(Vec3::X).going_on(Some(Vec3::Y)), Vec3::X);
    }
}
