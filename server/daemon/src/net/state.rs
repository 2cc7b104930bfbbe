//! What all sessions of a server share.

use std::{
    collections::BTreeMap,
    num::NonZeroU32,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU32, AtomicUsize},
    },
    time::{Duration, Instant},
};

use sightline_protocol::{
    VERSION,
    message::{Refusal, ServerMessage},
};
use sightline_world::motion::AvatarId;
use tokio::sync::{mpsc, watch};

use super::{
    admission::AddressCounts,
    client::{ConnectedClient, Hello},
    config::ServeConfig,
    engine_task::{EngineEvent, TimedEvent},
    load::Load,
    served_world::ServedWorld,
};
use crate::operate::TickMetrics;

/// What all sessions of a server share.
pub struct ServerState {
    pub config: ServeConfig,
    pub world: ServedWorld,
    /// Where events for the engine go.
    pub events: mpsc::Sender<TimedEvent>,
    /// When the server's time was zero.
    pub started: Instant,
    pub registry: Mutex<Registry>,
    /// The id of the newest avatar. Each connection has its own, used or not.
    pub newest_avatar: AtomicU32,
    /// How many connections are in their handshake.
    pub handshakes: AtomicUsize,
    /// Becomes true when the server closes.
    pub closing: watch::Receiver<bool>,
    pub load: Arc<Load>,
    pub metrics: Arc<TickMetrics>,
}

/// The admitted clients and the addresses of all connections.
#[derive(Default)]
pub struct Registry {
    pub clients: BTreeMap<AvatarId, Arc<ConnectedClient>>,
    pub addresses: AddressCounts,
}

impl ServerState {
    /// The server's time.
    pub fn now(&self) -> Duration {
        self.started.elapsed()
    }

    /// The registry, locked. Hold it only for a moment: every session needs it.
    pub fn registry(&self) -> MutexGuard<'_, Registry> {
        self.registry.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells the engine's thread of an event that was read just now. Waits while too many do.
    /// Returns whether there is still an engine.
    pub async fn tell_engine(&self, event: EngineEvent) -> bool {
        let at = self.now();
        self.events.send(TimedEvent { at, event }).await.is_ok()
    }

    /// Admits a client, if it speaks this version and there is room.
    pub fn admit(&self, client: &Arc<ConnectedClient>, hello: &Hello) -> Result<(), Refusal> {
        if hello.is_foreign {
            return Err(Refusal::Version { server: VERSION });
        }
        if *self.closing.borrow() {
            return Err(Refusal::Closing);
        }
        if let Some(retry) = self.load.refuses() {
            return Err(Refusal::Busy { retry_ms: retry.as_millis() as u32 });
        }
        let mut registry = self.registry();
        if registry.clients.len() >= self.config.clients_max {
            return Err(Refusal::Full);
        }
        registry.clients.insert(client.avatar, client.clone());
        assert!(registry.clients.len() <= self.config.clients_max, "clients have a limit");
        drop(registry);
        tracing::info!(avatar = client.avatar.0, name = ?hello.name.as_str(), "joined");
        Ok(())
    }

    /// The answer to an admitted client's hello.
    pub fn welcome(&self, avatar: AvatarId) -> ServerMessage {
        let interval_us = self.config.tick_interval().as_micros() as u32;
        ServerMessage::Welcome {
            avatar,
            world: self.world.id().0,
            world_bytes: self.world.bytes().len() as u64,
            tick_interval_us: NonZeroU32::new(interval_us).unwrap_or(NonZeroU32::MIN),
        }
    }
}
