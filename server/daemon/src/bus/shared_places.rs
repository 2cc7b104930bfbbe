//! Where visitors were last, for the station to which they come next.
//!
//! A bucket of NATS has a key for each visitor. Its station writes where it is when it leaves, when
//! its link breaks, and every few seconds while it moves: a station that dies says nothing more.
//! The last word counts, and nobody waits for an answer.

use std::{collections::HashMap, panic::AssertUnwindSafe, sync::Arc, time::Duration};

use async_nats::{
    Client,
    connection::State,
    jetstream::kv::{Operation, Store, UpdateErrorKind},
};
use futures_util::FutureExt;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use sightline_protocol::fingerprint::KeyFingerprint;
use tokio::{
    sync::{mpsc, watch},
    task::JoinSet,
    time::{MissedTickBehavior, interval, sleep},
};

use super::{
    buckets::{self, BucketError, Pauses},
    place_shares::{PlaceRequest, SharedPlace},
};
use crate::people::now_ms;

/// The name of the bucket.
const BUCKET: &str = "sightline-places";
/// The most bytes of a value.
const VALUE_MAX: usize = 1_024;
/// How long places are kept. Each station has them in its own database for longer.
const LASTS: Duration = Duration::from_secs(86_400);
/// How often the places of those who move are written.
const INTERVAL: Duration = Duration::from_secs(5);
/// The most visitors of whom places wait to be written.
const MOVED_MAX: usize = 16_384;
/// What waited longer than this is written only where NATS has nothing later, in seconds.
const FRESH_S: i64 = 15;
/// How far ahead the clock of another station may be, in seconds.
const AHEAD_MAX_S: i64 = 60;
/// How often NATS is asked whether the bucket is there.
const CHECK_INTERVAL: Duration = Duration::from_secs(30);
/// How many visitors may be asked about at once.
const AT_ONCE: usize = 64;

/// Shares places with other stations.
pub(super) struct SharedPlaces {
    client: Client,
    /// Changes whenever NATS is reached.
    connections: watch::Receiver<u32>,
    requests: mpsc::Receiver<PlaceRequest>,
    /// Where those are who have moved since that was written.
    moved: HashMap<KeyFingerprint, Moved>,
    pauses: Pauses,
}

/// Where a visitor is, which waits to be written.
#[derive(Clone, Debug)]
struct Moved {
    building: Arc<str>,
    eye: Vec3,
    /// When it was there, in seconds since 1970.
    at: i64,
}

/// Where a visitor was.
#[derive(Debug, Serialize, Deserialize)]
struct Value {
    /// The title of the building.
    building: String,
    /// The place of its eye, in metres.
    eye: [f32; 3],
    /// When, in seconds since 1970.
    at: i64,
}

impl SharedPlaces {
    pub(super) fn new(
        client: Client,
        connections: watch::Receiver<u32>,
        requests: mpsc::Receiver<PlaceRequest>,
    ) -> Self {
        Self { client, connections, requests, moved: HashMap::new(), pauses: Pauses::default() }
    }

    /// Shares until the server ends.
    pub(super) async fn run(mut self) {
        loop {
            let connection = *self.connections.borrow_and_update();
            match AssertUnwindSafe(self.share()).catch_unwind().await {
                Ok(Ok(())) => return,
                // Others tell what is wrong with the bus.
                Ok(Err(error)) => tracing::debug!(%error, "places are not shared"),
                Err(_) => tracing::error!("a fault of this program: places are not shared"),
            }
            if *self.connections.borrow() != connection {
                continue;
            }
            let mut pause = std::pin::pin!(sleep(self.pauses.next(connection)));
            loop {
                tokio::select! {
                    () = &mut pause => break,
                    changed = self.connections.changed() => match changed {
                        Ok(()) => break,
                        Err(_) => return,
                    },
                    request = self.requests.recv() => match request {
                        Some(PlaceRequest::Moved { building, places }) => {
                            self.note(&building, places);
                        }
                        // Who asks hears that nothing is known. Where those are who leave is
                        // written when the bus is back.
                        Some(_) => {}
                        None => return,
                    },
                }
            }
        }
    }

    /// Shares until NATS is lost or the server ends.
    async fn share(&mut self) -> Result<(), BucketError> {
        let config =
            buckets::lapsing(BUCKET, "last places of visitors of Sightline", VALUE_MAX, LASTS);
        let store = buckets::open(&self.client, config).await?;
        self.pauses = Pauses::default();
        let mut turns = interval(INTERVAL);
        turns.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut checks = interval(CHECK_INTERVAL);
        checks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut asking = JoinSet::new();
        loop {
            tokio::select! {
                request = self.requests.recv() => match request {
                    None => return Ok(()),
                    Some(PlaceRequest::Moved { building, places }) => self.note(&building, places),
                    Some(PlaceRequest::Left(key)) => {
                        if self.is_there() && let Some(moved) = self.moved.remove(&key) {
                            self.write(&store, key, &moved).await?;
                        }
                    }
                    Some(PlaceRequest::Last { key, building, reply }) => {
                        if asking.len() < AT_ONCE {
                            let store = store.clone();
                            asking.spawn(async move {
                                // Who asked may have lost patience.
                                let _ = reply.send(last(&store, key, &building).await);
                                Ok(())
                            });
                        }
                    }
                },
                _ = turns.tick() => if self.is_there() {
                    let fresh = now_s() - FRESH_S;
                    let moved = std::mem::take(&mut self.moved).into_iter();
                    let (fresh, late): (Vec<_>, Vec<_>) =
                        moved.partition(|(_, moved)| moved.at >= fresh);
                    for (key, moved) in fresh {
                        self.write(&store, key, &moved).await?;
                    }
                    if !late.is_empty() {
                        let store = store.clone();
                        asking.spawn(async move { write_late(&store, late).await });
                    }
                },
                _ = checks.tick() => {
                    let store = store.clone();
                    asking.spawn(async move {
                        store.stream.get_info().await.map(drop).map_err(BucketError::failed)
                    });
                }
                Some(done) = asking.join_next() => if let Ok(Err(error)) = done {
                    return Err(error);
                },
                changed = self.connections.changed() => return match changed {
                    Ok(()) => Err(BucketError::Failed("the bus was lost".to_owned())),
                    Err(_) => Ok(()),
                },
            }
        }
    }

    fn note(&mut self, building: &Arc<str>, places: Vec<(KeyFingerprint, Vec3)>) {
        let at = now_s();
        for (key, eye) in places {
            if self.moved.len() < MOVED_MAX || self.moved.contains_key(&key) {
                self.moved.insert(key, Moved { building: building.clone(), eye, at });
            }
        }
    }

    fn is_there(&self) -> bool {
        self.client.connection_state() == State::Connected
    }

    async fn write(
        &self,
        store: &Store,
        key: KeyFingerprint,
        moved: &Moved,
    ) -> Result<(), BucketError> {
        let Some(value) = moved.value()? else { return Ok(()) };
        let subject = format!("{}{key}", store.prefix);
        self.client.publish(subject, value.into()).await.map_err(BucketError::failed)
    }
}

impl Moved {
    /// The value that says so, unless it is too long.
    fn value(&self) -> Result<Option<Vec<u8>>, BucketError> {
        let Self { building, eye, at } = self;
        let value = Value { building: (**building).to_owned(), eye: eye.to_array(), at: *at };
        let value = serde_json::to_vec(&value).map_err(BucketError::failed)?;
        Ok(Some(value).filter(|value| value.len() <= VALUE_MAX))
    }
}

/// Writes where visitors were a while ago, unless NATS has something later.
async fn write_late(store: &Store, moved: Vec<(KeyFingerprint, Moved)>) -> Result<(), BucketError> {
    for (key, moved) in moved {
        let Some(value) = moved.value()? else { continue };
        let there = store.entry(key.to_string()).await.map_err(BucketError::failed)?;
        let revision = there.as_ref().map_or(0, |there| there.revision);
        if there.is_some_and(|there| is_later(&there.value, moved.at)) {
            continue;
        }
        match store.update(key.to_string(), value.into(), revision).await {
            Err(error) if error.kind() != UpdateErrorKind::WrongLastRevision => {
                return Err(BucketError::failed(error));
            }
            // What was written meanwhile is later.
            _ => {}
        }
    }
    Ok(())
}

/// Whether a value is of a later time than another one.
fn is_later(value: &[u8], at: i64) -> bool {
    let there: Option<Value> = buckets::read(value, VALUE_MAX);
    there.is_some_and(|there| (at..=now_s() + AHEAD_MAX_S).contains(&there.at))
}

/// The time, in seconds since 1970.
fn now_s() -> i64 {
    i64::try_from(now_ms() / 1_000).unwrap_or(i64::MAX)
}

/// Where a visitor was last in a building of this title.
async fn last(store: &Store, key: KeyFingerprint, building: &str) -> Option<SharedPlace> {
    let entry = store.entry(key.to_string()).await.ok()??;
    (entry.operation == Operation::Put).then(|| read(&entry.value, building))?
}

/// Reads a value, if it is about a building of this title. One that is dated ahead would be the last
/// for as long.
fn read(value: &[u8], building: &str) -> Option<SharedPlace> {
    let Value { building: title, eye, at } = buckets::read(value, VALUE_MAX)?;
    let eye = Vec3::from_array(eye);
    let is_sound = eye.is_finite() && at <= now_s() + AHEAD_MAX_S;
    (title == building && is_sound).then_some(SharedPlace { eye, at_s: at })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_read_back_and_noise_is_none() {
        let (building, eye) = ("house".to_owned(), [1.5, -0.1, 1.0e-3]);
        let value = serde_json::to_vec(&Value { building, eye, at: 7 }).unwrap();
        let expected = SharedPlace { eye: Vec3::from_array(eye), at_s: 7 };
        assert_eq!(read(&value, "house"), Some(expected));
        assert_eq!(read(&value, "other"), None);
        for noise in [
            "",
            "null",
            r#"{"building":"house","eye":[1,2],"at":7}"#,
            &format!(r#"{{"building":"house","eye":[1,2,3],"at":{}}}"#, now_s() + 99),
            r#"{"building":"house","eye":[1,2,1e39],"at":7}"#,
            r#"{"building":"house","eye":[1,2,null],"at":7}"#,
            &format!(r#"{{"building":"house","eye":[1,2,3],"at":7}}{}"#, " ".repeat(VALUE_MAX)),
        ] {
            assert_eq!(read(noise.as_bytes(), "house"), None, "{noise}");
        }
    }

    #[tokio::test]
    async fn what_waits_keeps_its_date_and_gives_way_to_what_is_later() {
        let options = async_nats::ConnectOptions::new().retry_on_initial_connect();
        let client = options.connect("127.0.0.1:1").await.unwrap();
        let ((_, connections), (_, requests)) = (watch::channel(0), mpsc::channel(1));
        let mut shared = SharedPlaces::new(client, connections, requests);
        let key = KeyFingerprint([7; 10]);
        let before = now_s();
        shared.note(&"house".into(), vec![(key, Vec3::ONE)]);
        let moved = shared.moved.get_mut(&key).unwrap();
        assert!((before..=now_s()).contains(&moved.at));
        moved.at = 7;
        let value = moved.value().unwrap().unwrap();
        assert_eq!(read(&value, "house").map(|place| place.at_s), Some(7), "however late");
        assert!(is_later(&value, 6) && !is_later(&value, 8) && !is_later(b"{", 6));
        moved.at = now_s() + 99;
        assert!(!is_later(&moved.value().unwrap().unwrap(), 6), "it is dated ahead");
    }
}
