//! The state of a run once the engine has decided at a tick, for those who watch it.

use std::{collections::BTreeMap, time::Duration};

use glam::Vec3;
use sightline_engine::{Engine, Output};
use sightline_world::motion::{AvatarId, Pose};

use super::{network::SimulatedNetwork, simulated_clients::SimulatedClients, stations::Stations};

/// A tick: what the engine decided, by what it decided, and what is true. Nothing that it says at
/// this tick has arrived yet.
#[derive(Clone, Copy)]
pub struct TickView<'a> {
    /// The server's time.
    pub now: Duration,
    /// The share of the run that is done, from 0 to 1.
    pub done: f32,
    /// The engine's outputs at this tick.
    pub outputs: &'a [Output],
    /// The engine after the tick: one of them, where there are several stations.
    pub engine: &'a Engine,
    pub(super) stations: &'a Stations,
    pub(super) clients: &'a SimulatedClients<'a>,
    pub(super) network: &'a SimulatedNetwork,
    pub(super) last_reports: &'a BTreeMap<AvatarId, LastReport>,
    pub(super) reports: &'a BTreeMap<(AvatarId, Duration), LastReport>,
    pub(super) least_lateness: &'a BTreeMap<AvatarId, Duration>,
}

/// The last report of an avatar that the engine has accepted.
#[derive(Clone, Copy)]
pub(super) struct LastReport {
    /// When it arrived.
    pub(super) heard: Duration,
    /// When its pose was looked up.
    pub(super) sampled: Duration,
}

impl<'a> TickView<'a> {
    /// The engine that an avatar's client is connected to.
    pub fn engine_of(&self, avatar: AvatarId) -> &'a Engine {
        self.stations.engine_of(avatar)
    }

    /// All engines that run.
    pub fn engines(&self) -> impl Iterator<Item = &'a Engine> {
        self.stations.engines()
    }

    /// All avatars, by the station that each belongs to.
    pub fn avatars(&self) -> impl Iterator<Item = AvatarId> + 'a {
        self.stations.engines().flat_map(|engine| engine.avatars())
    }

    /// Whether two avatars belong to the same station.
    pub fn are_together(&self, one: AvatarId, other: AvatarId) -> bool {
        self.stations.are_together(one, other)
    }

    /// Whether the stations of two avatars hear each other.
    pub fn are_linked(&self, one: AvatarId, other: AvatarId) -> bool {
        self.linked_since(one, other).is_some()
    }

    /// Since when the stations of two avatars have heard each other.
    pub fn linked_since(&self, one: AvatarId, other: AvatarId) -> Option<Duration> {
        self.stations.linked_since(one, other)
    }

    /// The trace's id of an avatar.
    ///
    /// # Panics
    /// When the avatar has never been in this run.
    pub fn trace_id(&self, avatar: AvatarId) -> u32 {
        self.clients.trace_id(avatar)
    }

    /// The avatars whose clients take part, and where their eyes truly are.
    pub fn eyes(&self) -> impl Iterator<Item = (AvatarId, Vec3)> + 'a {
        self.clients.present().map(|client| (client.avatar, client.pose.eye))
    }

    /// The true pose of an avatar at a time; `None` when it was not there.
    pub fn pose_at(&self, avatar: AvatarId, at: Duration) -> Option<Pose> {
        self.clients.pose_at(avatar, at)
    }

    /// A client's round trip as the engine knows it, without jitter and loss.
    pub fn round_trip(&self, avatar: AvatarId) -> Duration {
        let known = self.engine_of(avatar).round_trip(avatar);
        known.unwrap_or_else(|| self.network.known_round_trip(avatar))
    }

    /// When an avatar joined, or last moved as no body can by itself.
    pub fn settled_at(&self, avatar: AvatarId) -> Option<Duration> {
        self.clients.settled_at(avatar)
    }

    /// When the engine last accepted a report of an avatar, or let it join.
    pub fn last_report(&self, avatar: AvatarId) -> Option<Duration> {
        self.last_reports.get(&avatar).map(|last| last.heard)
    }

    /// When the pose of that report was true.
    pub fn last_sampled(&self, avatar: AvatarId) -> Option<Duration> {
        self.last_reports.get(&avatar).map(|last| last.sampled)
    }

    /// When the engine of a viewer's client takes the last report of an avatar to have arrived at
    /// the avatar's own.
    pub fn last_report_by(&self, viewer: AvatarId, avatar: AvatarId) -> Option<Duration> {
        Some(self.report_by(viewer, avatar)?.heard)
    }

    /// When the pose of that report was true.
    pub fn last_sampled_by(&self, viewer: AvatarId, avatar: AvatarId) -> Option<Duration> {
        Some(self.report_by(viewer, avatar)?.sampled)
    }

    fn report_by(&self, viewer: AvatarId, avatar: AvatarId) -> Option<&LastReport> {
        if self.stations.are_together(viewer, avatar) {
            return self.last_reports.get(&avatar);
        }
        let heard = self.engine_of(viewer).heard(avatar)?;
        self.reports.get(&(avatar, heard))
    }

    /// By how much all reports of a client took longer than half of the round trip that the engine
    /// knew at their time.
    pub fn least_lateness(&self, avatar: AvatarId) -> Duration {
        self.least_lateness.get(&avatar).copied().unwrap_or_default()
    }

    /// Whether a client's message is on its way that takes longer than its quickest one, by more
    /// than the engine allows for.
    pub fn is_overdue(&self, avatar: AvatarId) -> bool {
        self.network.is_overdue(self.now, avatar)
    }

    /// Whether, when the engine last accepted a report of a client, one of the client's messages
    /// had recently taken longer than the engine allows for.
    pub fn was_late_when_heard(&self, avatar: AvatarId) -> bool {
        let heard = self.last_report(avatar).unwrap_or(self.now);
        self.network.is_late(heard.min(self.now), avatar)
    }

    /// Whether a message from or to a client recently took longer than the engine allows for.
    pub fn is_late(&self, avatar: AvatarId) -> bool {
        self.network.is_late(self.now, avatar)
    }
}
