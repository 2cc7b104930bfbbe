//! Gives a running server its world, and other ones later.

use std::{sync::Arc, time::Instant};

use sightline_engine::Engine;
use tokio::sync::mpsc;

use super::{
    config::ServeConfig,
    engine_task::{EngineEvent, TimedEvent},
    offers::Offers,
    served_pieces::Cutting,
    served_world::ServedWorld,
};

/// The server has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the server has ended")]
pub struct ServerEnded;

/// Gives a running server its world, and other ones later. Copies belong to the same server.
#[derive(Clone)]
pub struct WorldChanger {
    config: ServeConfig,
    offers: Arc<Offers>,
    /// When the server's time was zero.
    started: Instant,
    events: mpsc::WeakSender<TimedEvent>,
}

impl WorldChanger {
    pub(super) fn new(
        config: ServeConfig,
        offers: Arc<Offers>,
        started: Instant,
        events: &mpsc::Sender<TimedEvent>,
    ) -> Self {
        Self { config, offers, started, events: events.downgrade() }
    }

    /// Serves a world from the next tick on. Visitors of the one before are moved over: they keep
    /// their connections, their names and, where there is room, their places.
    ///
    /// What the engine derives from the world is derived on this thread first, which may take
    /// seconds. Not to be called within a tokio runtime.
    ///
    /// # Errors
    /// When the server has ended.
    pub fn change(&self, world: ServedWorld) -> Result<(), ServerEnded> {
        let start = Instant::now();
        let world = Cutting::new(&self.config).prepare(world);
        let engine = Box::new(Engine::new(world.world().clone(), self.config.engine()));
        tracing::debug!(seconds = start.elapsed().as_secs_f64(), "the engine is ready");
        let event = EngineEvent::Change { engine, world };
        let event = TimedEvent { at: self.started.elapsed(), event };
        let events = self.events.upgrade().ok_or(ServerEnded)?;
        events.blocking_send(event).map_err(|_| ServerEnded)
    }

    /// Tells clients that wait for the first world what the server does, as a line for people.
    pub fn tell_loading(&self, what: &str) {
        self.offers.tell_loading(what);
    }
}
