//! The task that has the other end of the bus: a connection to NATS.

use std::{
    collections::{BTreeMap, BTreeSet},
    hash::{BuildHasher, RandomState},
    sync::Arc,
    time::{Duration, Instant},
};

use async_nats::{
    Client, ConnectOptions, Event, Message, ServerAddr, Subscriber, connection::State,
};
use bytes::Bytes;
use futures_util::StreamExt;
use sightline_engine::StationId;
use sightline_protocol::{bus, message::StationAddress};
use tokio::{
    sync::{mpsc, watch},
    time::{MissedTickBehavior, interval, timeout_at},
};

use super::{
    ADDRESS_LASTS, Arrived, BusError, BusOptions, Outgoing, STATIONS_MAX, Served,
    lateness::Lateness,
};
use crate::operate::{BusCounters, BusDrop};

/// How long the NATS server may take to answer.
const CONNECT_DEADLINE: Duration = Duration::from_secs(5);
/// How often the connection is tested. NATS counts as lost when two tests go unanswered.
const PING_INTERVAL: Duration = Duration::from_secs(2);
/// By how much each pause between two attempts to connect again is longer than the one before, and
/// how long they are at most.
const RECONNECT_STEP: Duration = Duration::from_millis(100);
const RECONNECT_MAX: Duration = Duration::from_secs(1);
/// How many commands may wait in the connection.
const COMMANDS_MAX: usize = 256;
/// How long a station that wants a number waits for those that have it.
const CLAIM_TIME: Duration = Duration::from_millis(400);
/// How many numbers are tried.
const CLAIMS_MAX: usize = 256;
/// A parcel that has waited for so long is not sent any more.
const PARCEL_LASTS: Duration = Duration::from_millis(500);
/// How often a station tells its address.
const ADDRESS_INTERVAL: Duration = Duration::from_secs(1);
/// How many changes of the connection may wait to be taken in. They are logged.
const EVENTS_MAX: usize = 64;
/// How many different refusals of NATS are told.
const REFUSALS_MAX: usize = 64;

/// A station's connection to NATS, and its number there.
pub(super) struct Nats {
    client: Client,
    events: mpsc::Receiver<Event>,
    connections: watch::Receiver<u32>,
    number: Number,
}

/// A number that no other station has.
struct Number {
    number: u32,
    /// Drawn at random, to tell this station from another one with the same number.
    nonce: u64,
    /// What is said of the number.
    claims: Subscriber,
}

/// What is said of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Claim {
    /// A station wants it.
    Wanted(u64),
    /// A station has it.
    Taken(u64),
}

/// The subjects that a station hears for a world.
struct Subscriptions {
    world: u32,
    to_all: Subscriber,
    to_this: Subscriber,
    addresses: Subscriber,
}

/// What came on a subject of the world.
enum Heard {
    Parcel(Message),
    Address(Message),
}

/// The task, with what it has to remember.
struct Task {
    nats: Nats,
    started: Instant,
    served: Served,
    own_address: Option<StationAddress>,
    others: BTreeMap<StationId, (StationAddress, Instant)>,
    lateness: BTreeMap<StationId, Lateness>,
    addresses: watch::Sender<Vec<StationAddress>>,
    incoming: mpsc::Sender<Arrived>,
    counters: Arc<BusCounters>,
    /// What NATS refuses, as far as it was told.
    refusals: BTreeSet<String>,
}

impl Nats {
    /// Connects, and draws a number.
    pub(super) async fn join(options: &BusOptions) -> Result<Self, BusError> {
        let BusOptions { url, credentials } = options;
        let parsed: Result<Vec<ServerAddr>, _> = url.split(',').map(str::parse).collect();
        let servers = parsed.map_err(|_| BusError::Url(without_users(url)))?;
        let at = without_users(url);
        let (said, events) = mpsc::channel(EVENTS_MAX);
        let (reached, connections) = watch::channel(0);
        let reached = Arc::new(reached);
        let mut connect = ConnectOptions::new()
            .name("sightline")
            .no_echo()
            .connection_timeout(CONNECT_DEADLINE)
            .ping_interval(PING_INTERVAL)
            .client_capacity(COMMANDS_MAX)
            .max_reconnects(None)
            .reconnect_delay_callback(|attempts| {
                RECONNECT_STEP.saturating_mul(attempts as u32).min(RECONNECT_MAX)
            })
            // Whoever may use sightline.> hears the answers, too.
            .custom_inbox_prefix("sightline.inbox")
            .event_callback(move |event| {
                let (said, reached) = (said.clone(), reached.clone());
                async move {
                    if matches!(event, Event::Connected) {
                        reached.send_modify(|connections| *connections += 1);
                    }
                    // More than wait already say nothing new.
                    drop(said.try_send(event));
                }
            });
        if let Some(path) = credentials {
            connect =
                connect.credentials_file(path).await.map_err(|error| BusError::Credentials {
                    path: path.display().to_string(),
                    reason: error.to_string(),
                })?;
        } else if let Some((user, password)) = servers.iter().find_map(user_of) {
            connect = connect.user_and_password(user, password);
        }
        let failed = |reason: String| BusError::Connect { at: at.clone(), reason };
        let client = connect.connect(servers).await.map_err(|error| failed(error.to_string()))?;
        let number = Number::draw(&client).await?.map_err(failed)?;
        Ok(Self { client, events, connections, number })
    }

    pub(super) fn station(&self) -> StationId {
        StationId(self.number.number)
    }

    /// The connection.
    pub(super) fn client(&self) -> Client {
        self.client.clone()
    }

    /// A word that no other station has drawn.
    pub(super) fn random_word(&self) -> u64 {
        self.number.nonce
    }

    /// Changes whenever NATS is reached.
    pub(super) fn connections(&self) -> watch::Receiver<u32> {
        self.connections.clone()
    }

    /// Carries parcels to and from the bus until the server ends.
    pub(super) async fn run(
        self,
        mut outgoing: mpsc::Receiver<Outgoing>,
        incoming: mpsc::Sender<Arrived>,
        addresses: watch::Sender<Vec<StationAddress>>,
        counters: Arc<BusCounters>,
    ) {
        let mut task = Task {
            nats: self,
            started: Instant::now(),
            served: Served::default(),
            own_address: None,
            others: BTreeMap::new(),
            lateness: BTreeMap::new(),
            addresses,
            incoming,
            counters,
            refusals: BTreeSet::new(),
        };
        let mut subscriptions = None;
        let mut ticks = interval(ADDRESS_INTERVAL);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                out = outgoing.recv() => match out {
                    None => return,
                    Some(Outgoing::World(served)) => {
                        task.served = served;
                        subscriptions = task.subscribe().await;
                    }
                    Some(Outgoing::Parcel { to, parcel, at }) => task.send(to, parcel, at).await,
                    Some(Outgoing::Address(address)) => task.own_address = Some(address),
                },
                heard = hear(&mut subscriptions) => match heard {
                    Some((world, Heard::Parcel(message))) => task.take(world, &message),
                    Some((_, Heard::Address(message))) => task.take_address(&message),
                    None => subscriptions = task.subscribe().await,
                },
                claim = task.nats.number.claims.next() => {
                    let Some(claim) = claim else { return };
                    if !task.keeps_number(&claim).await {
                        return;
                    }
                }
                event = task.nats.events.recv() => task.note(event).await,
                _ = ticks.tick() => task.tell_address().await,
            }
        }
    }
}

/// The next that is heard of the world that is served; `None` when its subscriptions have ended.
/// Waits for ever while there is none.
async fn hear(subscriptions: &mut Option<Subscriptions>) -> Option<(u32, Heard)> {
    let Some(Subscriptions { world, to_all, to_this, addresses }) = subscriptions else {
        return std::future::pending().await;
    };
    let heard = tokio::select! {
        message = to_this.next() => message.map(Heard::Parcel),
        message = to_all.next() => message.map(Heard::Parcel),
        message = addresses.next() => message.map(Heard::Address),
    };
    heard.map(|heard| (*world, heard))
}

impl Task {
    fn station(&self) -> StationId {
        self.nats.station()
    }

    /// Hears of the world that is served now. The subscriptions of the one before end when they are
    /// dropped.
    async fn subscribe(&mut self) -> Option<Subscriptions> {
        self.others.clear();
        self.addresses.send_if_modified(|addresses| !std::mem::take(addresses).is_empty());
        if self.served == Served::default() {
            return None;
        }
        let Served { number, name } = &self.served;
        let own = self.station().0;
        let client = &self.nats.client;
        let subjects = ["all".to_owned(), own.to_string(), "address".to_owned()];
        let mut all = Vec::new();
        for end in subjects {
            match client.subscribe(format!("sightline.{name}.*.{end}")).await {
                Ok(subscriber) => all.push(subscriber),
                Err(error) => tracing::error!(%error, "cannot hear the bus"),
            }
        }
        let [to_all, to_this, addresses] = all.try_into().ok()?;
        Some(Subscriptions { world: *number, to_all, to_this, addresses })
    }

    async fn send(&self, to: Option<StationId>, parcel: Vec<u8>, at: Instant) {
        if self.nats.client.connection_state() != State::Connected {
            return self.counters.drop_parcel(BusDrop::Lost);
        }
        if at.elapsed() > PARCEL_LASTS {
            return self.counters.drop_parcel(BusDrop::Late);
        }
        let to = to.map_or("all".to_owned(), |to| to.0.to_string());
        self.publish(&to, parcel).await;
    }

    async fn publish(&self, end: &str, bytes: Vec<u8>) {
        let subject = format!("sightline.{}.{}.{end}", self.served.name, self.station().0);
        if let Err(error) = self.nats.client.publish(subject, bytes.into()).await {
            tracing::debug!(%error, "not said on the bus");
            self.counters.drop_parcel(BusDrop::Lost);
        }
    }

    fn take(&mut self, world: u32, message: &Message) {
        let at = Instant::now();
        let Some(from) = sender(message).filter(|from| *from != self.station()) else { return };
        let messages = bus::decode(&message.payload).ok();
        if let Some((first, _)) = messages.iter().flatten().next() {
            let lateness = self.lateness.entry(from).or_default();
            if lateness.is_late(at.saturating_duration_since(self.started), first.sent) {
                return self.counters.drop_parcel(BusDrop::Late);
            }
        }
        if self.incoming.try_send(Arrived { at, world, from, messages }).is_err() {
            self.counters.drop_parcel(BusDrop::Full);
        }
    }

    fn take_address(&mut self, message: &Message) {
        let Some(from) = sender(message).filter(|from| *from != self.station()) else { return };
        if let Ok(address) = bus::decode_address(&message.payload) {
            self.others.insert(from, (address, Instant::now()));
            self.note_addresses();
        }
    }

    /// Takes in where visitors reach other stations at present.
    fn note_addresses(&mut self) {
        self.others.retain(|_, (_, at)| at.elapsed() < ADDRESS_LASTS);
        let now: Vec<StationAddress> = self.others.values().map(|(address, _)| *address).collect();
        self.addresses.send_if_modified(|before| {
            let has_changed = *before != now;
            *before = now;
            has_changed
        });
    }

    async fn tell_address(&mut self) {
        self.note_addresses();
        let is_connected = self.nats.client.connection_state() == State::Connected;
        if let Some(address) = self.own_address.filter(|_| is_connected && self.served.number > 0) {
            self.publish("address", bus::encode_address(&address)).await;
        }
    }

    /// Takes in what another station says of this one's number. Returns whether this one keeps it.
    async fn keeps_number(&self, message: &Message) -> bool {
        let Number { number, nonce, .. } = self.nats.number;
        match Claim::read(&message.payload) {
            Some(Claim::Taken(other)) if other > nonce => {
                tracing::error!(
                    number,
                    "another station has this one's number: this server leaves the bus; start it \
                     again"
                );
                return false;
            }
            Some(Claim::Wanted(other) | Claim::Taken(other)) if other != nonce => {
                self.say_taken().await;
            }
            _ => {}
        }
        true
    }

    async fn say_taken(&self) {
        let Number { number, nonce, .. } = self.nats.number;
        // Who does not hear it is told at the next connection.
        let _ = self.nats.client.publish(subject_of(number), Claim::Taken(nonce).bytes()).await;
    }

    /// Takes in that the bus is lost.
    fn lose(&self) {
        if !self.counters.set_lost(true) {
            tracing::warn!("the bus is lost: this station goes on alone");
        }
    }

    /// NATS refuses something. Each refusal is told once.
    fn note_refusal(&mut self, error: &str) {
        let is_new = self.refusals.len() < REFUSALS_MAX && self.refusals.insert(error.to_owned());
        if is_new {
            tracing::warn!(error, "the bus refuses something");
        } else {
            tracing::debug!(error, "the bus refuses something");
        }
    }

    async fn note(&mut self, event: Option<Event>) {
        match event {
            Some(Event::Connected) => {
                if self.counters.set_lost(false) {
                    tracing::info!("the bus is back");
                }
                self.say_taken().await;
            }
            Some(Event::Disconnected) => self.lose(),
            Some(Event::ServerError(error)) => self.note_refusal(&error.to_string()),
            Some(event) => tracing::debug!(%event, "the bus"),
            None => {}
        }
    }
}

impl Number {
    /// Draws numbers until one is free. An inner error says why NATS does not answer.
    async fn draw(client: &Client) -> Result<Result<Self, String>, BusError> {
        let keys = RandomState::new();
        for attempt in 0..CLAIMS_MAX {
            let nonce = keys.hash_one(attempt);
            let number = (nonce % u64::from(STATIONS_MAX)) as u32 + 1;
            match claim(client, number, nonce).await {
                Ok(Some(claims)) => return Ok(Ok(Self { number, nonce, claims })),
                Ok(None) => {}
                Err(error) => return Ok(Err(error)),
            }
        }
        Err(BusError::Full)
    }
}

/// Asks for a number. Returns what is said of it from then on, or `None` when it is taken.
async fn claim(client: &Client, number: u32, nonce: u64) -> Result<Option<Subscriber>, String> {
    let mut claims = client.subscribe(subject_of(number)).await.map_err(|e| e.to_string())?;
    let say = async |claim: Claim| {
        let said = client.publish(subject_of(number), claim.bytes()).await;
        said.map_err(|error| error.to_string())
    };
    say(Claim::Wanted(nonce)).await?;
    client.flush().await.map_err(|error| error.to_string())?;
    let until = tokio::time::Instant::now() + CLAIM_TIME;
    while let Ok(message) = timeout_at(until, claims.next()).await {
        let message = message.ok_or("the bus has ended")?;
        match Claim::read(&message.payload) {
            Some(Claim::Taken(_)) => return Ok(None),
            Some(Claim::Wanted(other)) if other > nonce => return Ok(None),
            Some(Claim::Wanted(_)) => say(Claim::Taken(nonce)).await?,
            None => {}
        }
    }
    Ok(Some(claims))
}

impl Claim {
    fn bytes(self) -> Bytes {
        let (kind, nonce) = match self {
            Self::Wanted(nonce) => (0, nonce),
            Self::Taken(nonce) => (1, nonce),
        };
        [&[kind][..], &nonce.to_le_bytes()].concat().into()
    }

    fn read(bytes: &[u8]) -> Option<Self> {
        let (kind, nonce) = bytes.split_first()?;
        let nonce = u64::from_le_bytes(nonce.try_into().ok()?);
        match kind {
            0 => Some(Self::Wanted(nonce)),
            1 => Some(Self::Taken(nonce)),
            _ => None,
        }
    }
}

fn subject_of(number: u32) -> String {
    format!("sightline.number.{number}")
}

/// The station that sent a message, by its subject.
fn sender(message: &Message) -> Option<StationId> {
    let number: u32 = message.subject.split('.').nth(2)?.parse().ok()?;
    (1..=STATIONS_MAX).contains(&number).then_some(StationId(number))
}

/// The user and the password in the address of a server.
fn user_of(server: &ServerAddr) -> Option<(String, String)> {
    let decoded = |text: &str| urlencoding::decode(text).map(|text| text.into_owned()).ok();
    Some((decoded(server.username()?)?, decoded(server.password().unwrap_or_default())?))
}

/// Addresses without users and passwords, to show to people.
fn without_users(url: &str) -> String {
    let bare = |url: &str| match (url.split_once("://"), url.rsplit_once('@')) {
        (Some((scheme, _)), Some((_, host))) => format!("{scheme}://{host}"),
        _ => url.to_owned(),
    };
    url.split(',').map(bare).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claims_read_back_and_noise_is_none() {
        for claim in [Claim::Wanted(7), Claim::Taken(u64::MAX)] {
            assert_eq!(Claim::read(&claim.bytes()), Some(claim));
        }
        for noise in [&[][..], &[0], &[0; 8], &[2; 9], &[0; 10]] {
            assert_eq!(Claim::read(noise), None);
        }
    }

    #[test]
    fn a_password_is_taken_from_the_address_and_never_shown() {
        let url = "nats://ada:l%40ve@house.example:4222,tls://other";
        assert_eq!(without_users(url), "nats://house.example:4222,tls://other");
        let server: ServerAddr = "nats://ada:l%40ve@house.example:4222".parse().unwrap();
        assert_eq!(user_of(&server), Some(("ada".to_owned(), "l@ve".to_owned())));
    }
}
