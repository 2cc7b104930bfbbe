//! How a trace is run.

use std::time::Duration;

use sightline_engine::{Config, Margin, Policy};

use super::network::NetworkConditions;

/// How a trace is run.
#[derive(Clone, Debug)]
pub struct ReplayOptions {
    /// The engine's configuration.
    pub config: Config,
    /// The round trip of every client, or the least one when the network spreads them.
    pub round_trip: Duration,
    /// What the network does to messages.
    pub network: NetworkConditions,
    /// How much of the trace is run, from its first sample on; all of it when `None`.
    pub length: Option<Duration>,
    /// How often the audit compares what clients hold with what rays find visible.
    pub oracle: OracleStride,
    /// Whether the audit also looks ahead, for over-send against the horizon. That is most of its
    /// work.
    pub look_ahead: bool,
    /// The stations that share the building.
    pub stations: StationOptions,
    /// Faults for tests of the tests.
    #[doc(hidden)]
    pub faults: ClientFaults,
}

/// The stations of a run. The default is one server that is no station.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StationOptions {
    /// How many there are. Zero means one server that is no station.
    pub count: usize,
    /// Which visitors go to which.
    pub assignment: Assignment,
    /// How long a message from one to another takes.
    pub delay: Duration,
    /// Each message adds a random part of this.
    pub jitter: Duration,
    /// What goes wrong.
    pub troubles: Vec<Trouble>,
    /// Faults for tests of the tests.
    #[doc(hidden)]
    pub faults: BusFaults,
}

impl StationOptions {
    /// How much longer word of an avatar takes to viewers of another station, at most: the way, and
    /// the time by which that station waits for what may still be on its way.
    pub(crate) fn longest_way(&self) -> Duration {
        if self.count > 1 { self.delay + 3 * self.jitter } else { Duration::ZERO }
    }
}

/// Which visitors go to which station.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Assignment {
    /// Any to any.
    #[default]
    Random,
    /// By where they begin, so that neighbours are together.
    ByPlace,
    /// One to each, in the order in which they come.
    Each,
}

/// What goes wrong between stations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// A station stops. Its clients come back to others after a second.
    Loss {
        /// Which one, counted from zero.
        station: usize,
        /// When.
        at: Duration,
    },
    /// The first stations and the others hear nothing of each other for a while.
    Partition {
        /// How many are the first.
        stations: usize,
        /// When it begins.
        from: Duration,
        /// When it ends.
        until: Duration,
    },
}

/// Faults of the bus that a test injects, to see that another test finds them.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BusFaults {
    /// By how much reports are later than the receiver knows.
    pub reports_late: Duration,
}

/// Faults of clients that a test injects, to see that another test finds them. The default injects
/// none.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClientFaults {
    /// Whether clients tell a departure one tick late.
    pub departures_late: bool,
    /// The factor by which clients' tolerances are larger than those that the server orders.
    pub tolerance_scale: f32,
    /// Whether a departure that the network loses is never sent again.
    pub departures_lost: bool,
}

impl Default for ClientFaults {
    fn default() -> Self {
        Self { departures_late: false, tolerance_scale: 1.0, departures_lost: false }
    }
}

impl ReplayOptions {
    /// A policy at a round trip, with every other setting as it is served. Only the engine's margin
    /// for late messages is zero, since on an even network no message is late.
    pub fn new(policy: Policy, round_trip: Duration) -> Self {
        let config = Config { policy, margin: Margin::Fixed(Duration::ZERO), ..Config::default() };
        let network = NetworkConditions::default();
        let oracle = OracleStride::Auto;
        let (length, faults) = (None, ClientFaults::default());
        let stations = StationOptions::default();
        Self { config, round_trip, network, length, oracle, look_ahead: true, stations, faults }
    }
}

/// How often the audit compares what clients hold with what rays find visible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OracleStride {
    /// Never.
    Off,
    /// Every second, or less often where many pairs would make that slow.
    Auto,
    /// At the first tick after each such interval.
    Every(Duration),
}
