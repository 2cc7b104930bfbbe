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
    /// Faults for tests of the tests.
    #[doc(hidden)]
    pub faults: ClientFaults,
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
        Self { config, round_trip, network, length, oracle, look_ahead: true, faults }
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
