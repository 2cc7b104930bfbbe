//! What operators see of a running server.

use std::{
    collections::BTreeMap,
    sync::Arc,
    time::{Duration, Instant},
};

use sightline_world::{World, motion::AvatarId};
use tokio::{sync::oneshot, time::timeout};

use super::{
    client::ConnectedClient, engine_task::EngineEvent, state::ServerState, survey::Survey,
};
use crate::{
    operate::{
        ClientCounts, Metrics, Overview, Person, PersonState, Prism, ProcessUse, ServerStats,
        Sight, StageSums, WorldName,
    },
    people::Standing,
};

/// How long the engine may take to answer.
const PATIENCE: Duration = Duration::from_secs(2);
/// The most cells of a PVS that are told.
const CELLS_MAX: usize = 2_000;

/// What operators see of a running server. Copies belong to the same server.
#[derive(Clone)]
pub struct Observer(Arc<ServerState>);

impl Observer {
    pub(super) fn new(state: Arc<ServerState>) -> Self {
        Self(state)
    }

    /// The statistics at present.
    pub fn stats(&self) -> ServerStats {
        let clients = self.clients();
        let clients = clients.iter().map(|client| (client.avatar().0, client.stats())).collect();
        let (counts, engine) = self.metrics().ticks.engine();
        let (ticks, overload) = (self.metrics().ticks.summary(), self.0.load.stats());
        ServerStats { clients, ticks, overload, counts, engine }
    }

    /// The world that is served, with its number; `None` before the first.
    pub fn world(&self) -> Option<(u32, Arc<World>)> {
        let offer = self.0.offers.offer()?;
        Some((offer.number, offer.world.world().clone()))
    }

    /// How many clients are connected, by the kind of their connections.
    pub fn transports(&self) -> BTreeMap<&'static str, usize> {
        let mut counts = BTreeMap::new();
        for client in self.clients() {
            *counts.entry(client.transport.kind()).or_default() += 1;
        }
        counts
    }

    /// The server at present. `None` when the engine does not answer within two seconds.
    pub async fn overview(&self) -> Option<Overview> {
        let survey = self.ask(EngineEvent::Survey).await?;
        let visitors: Vec<_> = {
            // One look at all of them: nobody who comes back meanwhile is missed, or there twice.
            let registry = self.0.registry();
            registry.visitors.all().map(|(client, is_here)| (client.clone(), is_here)).collect()
        };
        let people = visitors.iter().map(|(client, is_here)| {
            person(client, *is_here, self.0.people.standing(client.visit.key), &survey)
        });
        let mut people: Vec<Person> = people.collect();
        people.sort_unstable_by_key(|person| person.avatar);
        let mut clients = ClientCounts::default();
        people.iter().for_each(|person| clients.add(person.state));
        let world =
            self.world().map(|(number, world)| WorldName { number, title: world.title.clone() });
        let metrics = self.metrics();
        let (stages, _) = metrics.ticks.histograms();
        let [take_s, engine_s, tell_s] =
            [stages.take, stages.engine, stages.tell].map(|times| times.sum().as_secs_f64());
        Some(Overview {
            uptime_s: self.0.now().as_secs_f64(),
            world,
            tick_hz: survey.interval.as_secs_f64().recip(),
            ticks: metrics.ticks.summary(),
            stages: StageSums { take_s, engine_s, tell_s },
            overload: self.0.load.stats(),
            clients,
            totals: metrics.traffic.traffic().totals(),
            refused: metrics.refusals.total(),
            bus: metrics.bus.as_ref().map(|bus| bus.stats()),
            process: ProcessUse::now(),
            people,
        })
    }

    /// What a viewer may see. `None` when it is not in the world, or the engine does not answer.
    pub async fn sight(&self, viewer: u32) -> Option<Sight> {
        let viewer = AvatarId(viewer);
        let (eye, held) = self.ask(|reply| EngineEvent::Look { viewer, reply }).await??;
        let (_, world) = self.world()?;
        let cells = &world.cells;
        let pvs = cells.at(eye).and_then(|cell| cells.pvs.get(cell.0 as usize));
        let seen = pvs.into_iter().flatten();
        let prisms = seen.filter_map(|cell| cells.cells.get(cell as usize));
        let prisms = prisms.map(|cell| Prism::new(&cell.bounds, &cells.axes));
        let cells_all = pvs.map_or(0, |pvs| pvs.len() as usize);
        let held = held.into_iter().map(|avatar| avatar.0).collect();
        Some(Sight { held, cells: prisms.take(CELLS_MAX).collect(), cells_all })
    }

    pub(crate) fn metrics(&self) -> &Metrics {
        &self.0.metrics
    }

    /// The server's time.
    #[cfg(feature = "http")]
    pub(crate) fn now(&self) -> Duration {
        self.0.now()
    }

    /// How many handshakes are under way.
    #[cfg(feature = "http")]
    pub(crate) fn handshakes(&self) -> usize {
        self.0.handshakes.load(std::sync::atomic::Ordering::Relaxed)
    }

    /// Asks the engine's thread, which answers at its next tick.
    async fn ask<T>(&self, event: impl FnOnce(oneshot::Sender<T>) -> EngineEvent) -> Option<T> {
        let (reply, answer) = oneshot::channel();
        let answered = async {
            self.0.tell_engine(event(reply)).await.then_some(())?;
            answer.await.ok()
        };
        timeout(PATIENCE, answered).await.ok()?
    }

    fn clients(&self) -> Vec<Arc<ConnectedClient>> {
        self.0.registry().visitors.connected().cloned().collect()
    }
}

fn person(
    client: &ConnectedClient,
    is_connected: bool,
    standing: Standing,
    survey: &Survey,
) -> Person {
    let surveyed = survey.avatars.get(&client.avatar());
    let stats = client.stats();
    let state = match surveyed {
        _ if !is_connected => PersonState::Absent,
        // Who was welcomed back has an avatar in the world before it enters.
        Some((state, _)) if stats.reporting_state.is_some() => *state,
        _ => PersonState::Joining,
    };
    Person {
        avatar: client.avatar().0,
        name: client.visit.name.as_str().to_owned(),
        address: client.transport.remote_address().to_string(),
        role: standing.role,
        is_muted: standing.is_muted,
        state,
        connected_s: Instant::now().saturating_duration_since(client.since).as_secs_f64(),
        round_trip_ms: stats.round_trip_ms,
        totals: stats.traffic.totals(),
        place: surveyed.map(|(_, place)| place.clone()),
    }
}
