//! Where visitors were last, for the station to which they come next.
//!
//! A bucket of NATS has a key for each visitor. Its station writes where it is when it leaves, when
//! its link breaks, and every few seconds while it moves: a station that dies says nothing more.
//! The last word counts, and nobody waits for an answer.

use std::{collections::HashMap, panic::AssertUnwindSafe, sync::Arc, time::Duration};

use async_nats::{
    Client,
    connection::State,
    jetstream::{
        kv::{Config, Operation, Store},
        stream::StorageType,
    },
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
/// The most bytes of all values together.
const BUCKET_MAX: i64 = 64 * 1_024 * 1_024;
/// How long places are kept. Each station has them in its own database for longer.
const LASTS: Duration = Duration::from_secs(86_400);
/// How often the places of those who move are written.
const INTERVAL: Duration = Duration::from_secs(5);
/// The most visitors of whom places wait to be written.
const MOVED_MAX: usize = 16_384;
/// How many visitors may be asked about at once.
const AT_ONCE: usize = 64;

/// Shares places with other stations.
pub(super) struct SharedPlaces {
    client: Client,
    /// Changes whenever NATS is reached.
    connections: watch::Receiver<u32>,
    requests: mpsc::Receiver<PlaceRequest>,
    /// Where those are who have moved since that was written.
    moved: HashMap<KeyFingerprint, (Arc<str>, Vec3)>,
    pauses: Pauses,
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
                        // Who asks hears that nothing is known.
                        Some(_) => {}
                        None => return,
                    },
                }
            }
        }
    }

    /// Shares until NATS is lost or the server ends.
    async fn share(&mut self) -> Result<(), BucketError> {
        let config = Config {
            bucket: BUCKET.to_owned(),
            description: "last places of visitors of Sightline".to_owned(),
            max_value_size: VALUE_MAX as i32,
            max_bytes: BUCKET_MAX,
            max_age: LASTS,
            history: 1,
            storage: StorageType::Memory,
            ..Config::default()
        };
        let store = buckets::open(&self.client, config).await?;
        self.pauses = Pauses::default();
        let mut turns = interval(INTERVAL);
        turns.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut asking = JoinSet::new();
        loop {
            tokio::select! {
                request = self.requests.recv() => match request {
                    None => return Ok(()),
                    Some(PlaceRequest::Moved { building, places }) => self.note(&building, places),
                    Some(PlaceRequest::Left(key)) => {
                        if let Some((building, eye)) = self.moved.remove(&key) {
                            self.write(&store, key, &building, eye).await?;
                        }
                    }
                    Some(PlaceRequest::Last { key, building, reply }) => {
                        if asking.len() < AT_ONCE {
                            let store = store.clone();
                            asking.spawn(async move {
                                // Who asked may have lost patience.
                                let _ = reply.send(last(&store, key, &building).await);
                            });
                        }
                    }
                },
                _ = turns.tick() => {
                    for (key, (building, eye)) in std::mem::take(&mut self.moved) {
                        self.write(&store, key, &building, eye).await?;
                    }
                }
                Some(_) = asking.join_next() => {}
                changed = self.connections.changed() => return match changed {
                    Ok(()) => Err(BucketError::Failed("the bus was lost".to_owned())),
                    Err(_) => Ok(()),
                },
            }
        }
    }

    fn note(&mut self, building: &Arc<str>, places: Vec<(KeyFingerprint, Vec3)>) {
        for (key, eye) in places {
            if self.moved.len() < MOVED_MAX || self.moved.contains_key(&key) {
                self.moved.insert(key, (building.clone(), eye));
            }
        }
    }

    async fn write(
        &self,
        store: &Store,
        key: KeyFingerprint,
        building: &str,
        eye: Vec3,
    ) -> Result<(), BucketError> {
        let at = i64::try_from(now_ms() / 1_000).unwrap_or(i64::MAX);
        let value = Value { building: building.to_owned(), eye: eye.to_array(), at };
        let value = serde_json::to_vec(&value).map_err(BucketError::failed)?;
        let is_there = self.client.connection_state() == State::Connected;
        if !is_there || value.len() > VALUE_MAX {
            return Ok(());
        }
        let subject = format!("{}{key}", store.prefix);
        self.client.publish(subject, value.into()).await.map_err(BucketError::failed)
    }
}

/// Where a visitor was last in a building of this title.
async fn last(store: &Store, key: KeyFingerprint, building: &str) -> Option<SharedPlace> {
    let entry = store.entry(key.to_string()).await.ok()??;
    (entry.operation == Operation::Put).then(|| read(&entry.value, building))?
}

/// Reads a value, if it is about a building of this title.
fn read(value: &[u8], building: &str) -> Option<SharedPlace> {
    let value = Some(value).filter(|value| value.len() <= VALUE_MAX)?;
    let Value { building: title, eye, at } = serde_json::from_slice(value).ok()?;
    let eye = Vec3::from_array(eye);
    (title == building && eye.is_finite()).then_some(SharedPlace { eye, at_s: at })
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
            r#"{"building":"house","eye":[1,2,1e39],"at":7}"#,
            r#"{"building":"house","eye":[1,2,null],"at":7}"#,
            &format!(r#"{{"building":"house","eye":[1,2,3],"at":7}}{}"#, " ".repeat(VALUE_MAX)),
        ] {
            assert_eq!(read(noise.as_bytes(), "house"), None, "{noise}");
        }
    }
}
