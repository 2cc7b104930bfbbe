//! The bus between stations: several servers that share a building.
//!
//! [`Bus::connect`] joins a NATS server and draws a number that no other station there has. The
//! engine's thread has one end of the bus (`engine_end`), and a task has the other (`nats`). What
//! stations say is coded by [`sightline_protocol::bus`].
//!
//! Subjects begin with `sightline`, so that the rights of a NATS user can be limited to
//! `sightline.>`:
//!
//! | subject | what |
//! | --- | --- |
//! | `sightline.number.N` | who has the number N |
//! | `sightline.WORLD.FROM.all` | what station FROM tells all |
//! | `sightline.WORLD.FROM.TO` | what station FROM tells station TO |
//! | `sightline.WORLD.FROM.address` | where visitors reach station FROM |
//!
//! WORLD is the first half of the world's content id, in hexadecimal digits: stations hear only of
//! those that serve the same world file.
//!
//! What is known of people is shared by all stations of the bus, whatever they serve
//! (`shared_people`): a ban is of a person, not of a building. So are names (`shared_names`) and last
//! places (`shared_places`).

#[cfg(feature = "bus")]
mod buckets;
pub(crate) mod engine_end;
mod lateness;
pub(crate) mod name_claims;
#[cfg(feature = "bus")]
mod nats;
pub(crate) mod place_shares;
#[cfg(feature = "bus")]
mod shared_names;
#[cfg(feature = "bus")]
pub(crate) mod shared_people;
#[cfg(feature = "bus")]
mod shared_places;

use std::{
    path::PathBuf,
    sync::Arc,
    time::{Duration, Instant},
};

use sightline_engine::{StationId, StationMessage};
use sightline_protocol::message::StationAddress;
use sightline_world::ContentId;
use tokio::{
    sync::{mpsc, watch},
    task::JoinHandle,
};

use crate::operate::BusCounters;
#[cfg(feature = "bus")]
use crate::people::People;
use engine_end::EngineEnd;
use name_claims::NameClaims;
use place_shares::PlaceShares;
#[cfg(feature = "bus")]
use shared_names::SharedNames;
#[cfg(feature = "bus")]
use shared_people::SharedPeople;
#[cfg(feature = "bus")]
use shared_places::SharedPlaces;

/// The greatest number of a station on a bus; the least is 1.
pub const STATIONS_MAX: u32 = 127;
/// How many parcels may wait for the bus, and how many for the engine. Beyond it they are dropped,
/// and the stations begin anew.
const PARCELS_MAX: usize = 4_096;
/// A station that has not told its address for so long has none.
const ADDRESS_LASTS: Duration = Duration::from_secs(5);

/// Which bus to join.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BusOptions {
    /// The NATS servers: `nats://[USER:PASSWORD@]HOST[:PORT]`, or `tls://…`, with commas between
    /// several of one cluster.
    pub url: String,
    /// A file of NATS credentials.
    pub credentials: Option<PathBuf>,
}

/// Why a server is not on the bus.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// The program was built without the feature `bus`.
    #[error("this program was built without the feature bus")]
    NotBuilt,
    /// The address is none of a NATS server.
    #[error("{0:?} is no address of a bus: use nats://HOST:PORT")]
    Url(String),
    /// The credentials cannot be used.
    #[error("cannot use the credentials in {path}: {reason}")]
    Credentials {
        /// The file.
        path: String,
        /// Why not.
        reason: String,
    },
    /// The NATS server does not answer, or refuses.
    #[error("cannot join the bus at {at}: {reason}")]
    Connect {
        /// The servers, without users and passwords.
        at: String,
        /// Why not.
        reason: String,
    },
    /// There is no number left.
    #[error("all {STATIONS_MAX} numbers of stations on the bus are taken")]
    Full,
}

/// A server's place on a bus. It is given up when it is dropped.
pub struct Bus {
    /// The engine's end.
    pub(crate) end: EngineEnd,
    pub(crate) link: BusLink,
}

/// What a running server keeps of its bus. The bus is left when it is dropped.
pub(crate) struct BusLink {
    station: StationId,
    outgoing: mpsc::Sender<Outgoing>,
    addresses: watch::Receiver<Vec<StationAddress>>,
    names: NameClaims,
    places: PlaceShares,
    counters: Arc<BusCounters>,
    #[cfg(feature = "bus")]
    client: async_nats::Client,
    /// Changes whenever NATS is reached.
    #[cfg(feature = "bus")]
    connections: watch::Receiver<u32>,
    tasks: Vec<JoinHandle<()>>,
}

/// What goes out on the bus.
enum Outgoing {
    /// Another world is served.
    World(Served),
    /// A parcel for a station, or for all.
    Parcel { to: Option<StationId>, parcel: Vec<u8>, at: Instant },
    /// Where visitors reach this station.
    Address(StationAddress),
}

/// The world that a station serves, for its task.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Served {
    /// How many there were before.
    number: u32,
    /// The part of the subject that names it.
    name: String,
}

/// What came in on the bus.
struct Arrived {
    at: Instant,
    /// The number of the world that it is about.
    world: u32,
    from: StationId,
    /// The messages with their lengths in bytes; `None` when the bytes are none.
    messages: Option<Vec<(StationMessage, usize)>>,
}

impl Bus {
    /// Joins a bus. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// When the address or the credentials cannot be used, no NATS server answers, or it refuses.
    #[cfg(feature = "bus")]
    pub async fn connect(options: &BusOptions) -> Result<Self, BusError> {
        let joined = nats::Nats::join(options).await?;
        let counters = Arc::new(BusCounters::default());
        let (outgoing, to_send) = mpsc::channel(PARCELS_MAX);
        let (heard, incoming) = mpsc::channel(PARCELS_MAX);
        let (told, addresses) = watch::channel(Vec::new());
        let (station, client, connections) =
            (joined.station(), joined.client(), joined.connections());
        let (names, asked) = NameClaims::new();
        let word = joined.random_word();
        let shared_names =
            SharedNames::new(joined.client(), joined.connections(), asked, word, counters.clone());
        let (places, asked) = PlaceShares::new();
        let shared_places = SharedPlaces::new(joined.client(), joined.connections(), asked);
        let tasks = vec![
            tokio::spawn(joined.run(to_send, heard, told, counters.clone())),
            tokio::spawn(shared_names.run()),
            tokio::spawn(shared_places.run()),
        ];
        let end = EngineEnd::new(station, outgoing.clone(), incoming, counters.clone());
        let link = BusLink {
            station,
            outgoing,
            addresses,
            names,
            places,
            counters,
            client,
            connections,
            tasks,
        };
        Ok(Self { end, link })
    }

    /// There is no bus in this program.
    ///
    /// # Errors
    /// Always.
    #[cfg(not(feature = "bus"))]
    pub async fn connect(_: &BusOptions) -> Result<Self, BusError> {
        Err(BusError::NotBuilt)
    }

    /// The number of this station on the bus.
    pub fn station(&self) -> StationId {
        self.link.station
    }
}

impl BusLink {
    /// The number of this station on the bus.
    pub fn station(&self) -> StationId {
        self.station
    }

    /// Tells other stations where visitors reach this one.
    pub fn tell_address(&self, address: StationAddress) {
        // The queue is empty at the start, and a bus that has ended needs none.
        let _ = self.outgoing.try_send(Outgoing::Address(address));
    }

    /// Where visitors reach other stations.
    pub fn addresses(&self) -> watch::Receiver<Vec<StationAddress>> {
        self.addresses.clone()
    }

    /// What claims names at all stations.
    pub fn names(&self) -> NameClaims {
        self.names.clone()
    }

    /// What shares last places with other stations.
    pub fn places(&self) -> PlaceShares {
        self.places.clone()
    }

    /// Shares bans, mutes and roles with other stations from now on. Visitors whom they ban are
    /// removed by `on_ban`.
    #[cfg(feature = "bus")]
    pub fn share_people(&mut self, people: Arc<People>, on_ban: shared_people::OnBan) {
        let (client, connections) = (self.client.clone(), self.connections.clone());
        let counters = self.counters.clone();
        let shared = SharedPeople::new(client, connections, people, on_ban, counters);
        self.tasks.extend(shared.map(|shared| tokio::spawn(shared.run())));
    }

    /// What is counted.
    pub fn counters(&self) -> Arc<BusCounters> {
        self.counters.clone()
    }
}

impl Drop for BusLink {
    fn drop(&mut self) {
        self.tasks.iter().for_each(JoinHandle::abort);
    }
}

/// The part of a subject that names a world.
fn world_name(id: &ContentId) -> String {
    let (first, _) = id.0.split_at(id.0.len() / 2);
    first.iter().map(|byte| format!("{byte:02x}")).collect()
}
