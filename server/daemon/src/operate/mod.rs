//! What an operator sees of a running server: traffic, tick times, states of clients.
//!
//! Sessions count with atomic numbers of their own and of the server. No lock is shared by all of
//! them.

#[cfg_attr(not(feature = "bus"), allow(dead_code, reason = "only NATS carries what is counted"))]
mod bus;
mod histogram;
mod overview;
mod process;
mod refusals;
mod ticks;
mod traffic;

use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
};

use serde::{Deserialize, Serialize};
use sightline_world::motion::ReportingState;

#[cfg(feature = "bus")]
pub(crate) use bus::BusRuling;
pub use bus::BusStats;
pub(crate) use bus::{BusCounters, BusDrop, BusGauges};
pub use histogram::Histogram;
pub use overview::{
    ClientCounts, Overview, Person, PersonState, Place, Prism, Sight, StageSums, Totals, WorldName,
};
pub use process::ProcessUse;
pub(crate) use refusals::{Reason, Refusals};
pub use ticks::{StageTimes, TickSummary};
pub(crate) use ticks::{Stages, TickMetrics};
pub(crate) use traffic::{SentFrames, TrafficCounters};
pub use traffic::{Tally, Traffic};

/// What a server counts from its start on.
#[derive(Debug, Default)]
pub(crate) struct Metrics {
    /// Messages from and to all clients.
    pub(crate) traffic: TrafficCounters,
    /// What was refused.
    pub(crate) refusals: Refusals,
    /// How long ticks take.
    pub(crate) ticks: TickMetrics,
    /// Messages from and to other stations, where there is a bus.
    pub(crate) bus: Option<Arc<BusCounters>>,
    engine_faults: AtomicU64,
}

impl Metrics {
    /// Counters of a server, on a bus or not.
    pub(crate) fn new(bus: Option<Arc<BusCounters>>) -> Self {
        Self { bus, ..Self::default() }
    }

    /// Takes in that the engine panicked.
    pub(crate) fn count_engine_fault(&self) {
        self.engine_faults.fetch_add(1, Relaxed);
    }

    /// How often the engine panicked.
    pub(crate) fn engine_faults(&self) -> u64 {
        self.engine_faults.load(Relaxed)
    }
}

/// The statistics of a server.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ServerStats {
    /// The connected clients, by avatar.
    pub clients: BTreeMap<u32, ClientStats>,
    /// How long ticks took.
    pub ticks: TickSummary,
    /// How the server copes with its load.
    pub overload: OverloadStats,
    /// How many clients are in each state.
    #[serde(skip)]
    pub counts: sightline_engine::Counts,
    /// The engine's own statistics.
    #[serde(skip)]
    pub engine: sightline_engine::Stats,
}

/// How a server copes with its load.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct OverloadStats {
    /// How many steps the tick rate is below the full rate: each halves it.
    pub step: usize,
    /// How often the rate has fallen by a step.
    pub steps_down: u64,
    /// How often the rate has risen by a step.
    pub steps_up: u64,
    /// How many clients were told to come again later.
    pub joins_refused: u64,
    /// How many clients wait to enter.
    pub joins_waiting: usize,
}

/// The statistics of one client.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ClientStats {
    /// What was sent and received.
    pub traffic: Traffic,
    /// How the client is expected to report; `None` before it has entered.
    #[serde(skip)]
    pub reporting_state: Option<ReportingState>,
    /// The round trip, in milliseconds.
    pub round_trip_ms: f64,
}
