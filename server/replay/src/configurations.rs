//! One server, several, or none: what each costs in messages.
//!
//! Sudarsky and Gotsman 1996, section 5, name the three. Without a server each visitor has a station
//! of its own, on its own machine, and stations ask each other directly. That is compared with
//! everybody telling everybody.

use std::{fmt, time::Duration};

use serde::Serialize;
use sightline_engine::{Margin, Policy};

use super::{
    options::{Assignment, ReplayOptions, StationOptions},
    report::ReplayReport,
};

/// How long a message between two servers of a network takes.
const BETWEEN_SERVERS: Duration = Duration::from_millis(1);

/// Who decides who is told of whom.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Configuration {
    /// A server tells everybody of everybody, at every tick.
    Broadcast,
    /// One server.
    Server,
    /// A number of servers, with visitors at any of them.
    Network(usize),
    /// No server: each visitor has a station of its own.
    Peers,
}

/// The report of one trace in a configuration.
#[derive(Clone, Debug, Serialize)]
pub struct ConfigurationReport {
    /// Who decides.
    pub configuration: Configuration,
    /// What it costs.
    pub report: ReplayReport,
}

/// The reports of one trace, one for each configuration. They print as a table with a row for each.
/// All figures are a second, and for each visitor.
#[derive(Clone, Debug, Default, Serialize)]
#[serde(transparent)]
pub struct ConfigurationTable {
    /// The rows, in the order in which they are printed.
    pub rows: Vec<ConfigurationReport>,
}

impl Configuration {
    /// All of them, with a number of servers in the network.
    pub fn all(servers: usize) -> [Self; 4] {
        [Self::Broadcast, Self::Server, Self::Network(servers), Self::Peers]
    }

    /// The options of a run for a number of visitors. `options` has what all have in common, and
    /// the round trip between visitors and a server: among peers, a message takes half of that.
    pub fn options(self, options: &ReplayOptions, visitors: usize) -> ReplayOptions {
        let mut options = options.clone();
        options.config.bus_margin = Margin::Fixed(Duration::ZERO);
        let between = |count, assignment, delay| StationOptions {
            count,
            assignment,
            delay,
            ..StationOptions::default()
        };
        match self {
            Self::Broadcast => {
                (options.config.policy, options.config.by_exception) = (Policy::Broadcast, false);
            }
            Self::Server => {}
            Self::Network(servers) => {
                options.stations = between(servers, Assignment::Random, BETWEEN_SERVERS);
            }
            Self::Peers => {
                let delay = options.round_trip / 2;
                options.stations = between(visitors, Assignment::Each, delay);
                options.round_trip = Duration::ZERO;
            }
        }
        options
    }
}

impl fmt::Display for Configuration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Broadcast => f.write_str("broadcast"),
            Self::Server => f.write_str("server"),
            Self::Network(servers) => write!(f, "network of {servers}"),
            Self::Peers => f.write_str("peers"),
        }
    }
}

/// What crosses the network in a second, for each visitor.
struct Crossing {
    /// Messages between clients and servers.
    client: f64,
    /// Messages between stations, without heartbeats.
    words: f64,
    /// Heartbeats of stations.
    heartbeats: f64,
    /// Bytes of all of them, without what QUIC, UDP and NATS add.
    bytes: f64,
}

impl ConfigurationReport {
    fn crossing(&self) -> Crossing {
        let ReplayReport { present_mean, seconds, stations, .. } = &self.report;
        let each = |all: u64| all as f64 / (present_mean * seconds).max(1e-9);
        let bus = stations.as_ref();
        let of_kinds = |is_beat: bool| {
            let kinds = bus.into_iter().flat_map(|bus| &bus.messages);
            kinds.filter(|(kind, _)| (**kind == "heartbeat") == is_beat).map(|(_, n)| n).sum()
        };
        // A visitor who has a station of its own tells it everything on the same machine.
        let is_near = self.configuration == Configuration::Peers;
        let far = |figure: f64| if is_near { 0.0 } else { figure };
        let ReplayReport { messages_to_client, messages_from_client, .. } = self.report;
        let ReplayReport { bytes_to_client, bytes_from_client, .. } = self.report;
        Crossing {
            client: far(messages_to_client + messages_from_client),
            words: each(of_kinds(false)),
            heartbeats: each(of_kinds(true)),
            bytes: far(bytes_to_client + bytes_from_client) + each(bus.map_or(0, |bus| bus.bytes)),
        }
    }
}

impl fmt::Display for ConfigurationTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<14}  {:>12}  {:>12}  {:>12}  {:>12}  {:>10}  {:>6}",
            "a visitor",
            "client msg/s",
            "bus msg/s",
            "heartbeats/s",
            "all msg/s",
            "bytes/s",
            "misses"
        )?;
        for row in &self.rows {
            let Crossing { client, words, heartbeats, bytes } = row.crossing();
            let misses = row.report.oracle.as_ref().map(|oracle| oracle.misses.to_string());
            writeln!(
                f,
                "{:<14}  {client:>12.2}  {words:>12.2}  {heartbeats:>12.2}  {:>12.2}  {bytes:>10.0}  {:>6}",
                row.configuration.to_string(),
                client + words + heartbeats,
                misses.as_deref().unwrap_or("-")
            )?;
        }
        Ok(())
    }
}
