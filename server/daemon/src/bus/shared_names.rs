//! Names of visitors, each at one station only.
//!
//! A bucket of NATS has a key for each form of each name that a visitor has, and the value says
//! whose it is. A station creates it when the visitor comes in, which fails if it is there; renews
//! it, since values lapse; and removes it when the visitor leaves. What a dead station had lapses. A
//! visitor that comes from another station takes its name along: its key is in the value.

use std::{
    collections::HashMap,
    panic::AssertUnwindSafe,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use async_nats::{
    Client, HeaderMap,
    connection::State,
    jetstream::kv::{Operation, Store, UpdateErrorKind},
};
use bytes::Bytes;
use futures_util::{FutureExt, StreamExt, stream};
use serde::{Deserialize, Serialize};
use sightline_protocol::fingerprint::KeyFingerprint;
use tokio::{
    sync::{mpsc, watch},
    time::{MissedTickBehavior, interval, sleep},
};

use super::{
    buckets::{self, BucketError, Pauses},
    name_claims::{NameAnswer, NameRequest},
};
use crate::operate::BusCounters;

/// The name of the bucket.
const BUCKET: &str = "sightline-names";
/// The most bytes of a value.
const VALUE_MAX: usize = 256;
/// After this time the names of a dead station are free. Each is renewed three times within it.
const LASTS: Duration = Duration::from_secs(30);
/// The least time that names of a bucket which somebody else has made may last.
const LASTS_MIN: Duration = Duration::from_secs(1);
/// How many names are claimed or renewed at once.
const AT_ONCE: usize = 64;
/// How often a name is tried again when others change it.
const ATTEMPTS_MAX: u32 = 4;

/// Shares names with other stations.
pub(super) struct SharedNames {
    client: Client,
    /// Changes whenever NATS is reached.
    connections: watch::Receiver<u32>,
    requests: mpsc::UnboundedReceiver<NameRequest>,
    names: Arc<Names>,
    pauses: Pauses,
    /// Why nothing was shared, as it was told last.
    told: Option<BucketError>,
}

/// The names that this station's visitors have.
struct Names {
    /// Drawn at random, to tell this station from all others.
    station: u64,
    counters: Arc<BusCounters>,
    held: Mutex<HashMap<String, Held>>,
}

/// A form of a name that one of this station's visitors has.
#[derive(Clone, Copy, Debug)]
struct Held {
    owner: KeyFingerprint,
    claim: Claim,
}

/// What NATS says of a form that one of this station's visitors has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Claim {
    /// Nothing was written yet. The visitor may have just come from another station.
    New,
    /// The value of this revision says that it is this station's.
    Ours(u64),
    /// Another station has it: the visitor has gone on to there, or somebody else was given the
    /// name, too. It is claimed again when nobody has it.
    Elsewhere,
}

/// Whose a name is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Value {
    /// The fingerprint of the visitor's key.
    key: String,
    /// The station, as the random word that it drew.
    station: u64,
}

impl SharedNames {
    /// Shares the names of a station that has drawn a random word.
    pub(super) fn new(
        client: Client,
        connections: watch::Receiver<u32>,
        requests: mpsc::UnboundedReceiver<NameRequest>,
        station: u64,
        counters: Arc<BusCounters>,
    ) -> Self {
        let names = Arc::new(Names { station, counters, held: Mutex::default() });
        Self { client, connections, requests, names, pauses: Pauses::default(), told: None }
    }

    /// Shares until the server ends.
    pub(super) async fn run(mut self) {
        loop {
            let connection = *self.connections.borrow_and_update();
            let sharing = AssertUnwindSafe(self.share()).catch_unwind().await;
            match sharing {
                Ok(Ok(())) => return,
                Ok(Err(error)) => self.tell(error),
                Err(_) => self.tell(BucketError::failed("a fault of this program")),
            }
            if *self.connections.borrow() == connection && !self.wait().await {
                return;
            }
        }
    }

    /// Tells why nothing is shared, once.
    fn tell(&mut self, error: BucketError) {
        // That there is no JetStream, or no bus, is told already.
        let is_there = self.client.connection_state() == State::Connected;
        let is_told = error == BucketError::NoJetStream || self.told.as_ref() == Some(&error);
        if is_there && !is_told {
            tracing::warn!(%error, "names are not shared with other stations");
            self.told = Some(error);
        }
    }

    /// Answers that nothing is known, until it is time to try again. Returns whether the server
    /// goes on.
    async fn wait(&mut self) -> bool {
        let connection = *self.connections.borrow();
        let mut pause = std::pin::pin!(sleep(self.pauses.next(connection)));
        loop {
            tokio::select! {
                () = &mut pause => return true,
                changed = self.connections.changed() => return changed.is_ok(),
                request = self.requests.recv() => match request {
                    Some(request) => self.names.note(request),
                    None => return false,
                },
            }
        }
    }

    /// Claims and renews names, until NATS is lost or the server ends.
    async fn share(&mut self) -> Result<(), BucketError> {
        let config = buckets::lapsing(BUCKET, "names of visitors of Sightline", VALUE_MAX, LASTS);
        let store = buckets::open(&self.client, config).await?;
        self.told = None;
        self.pauses = Pauses::default();
        let lasts = Some(store.stream.cached_info().config.max_age).filter(|age| !age.is_zero());
        let mut renewals = interval(lasts.unwrap_or(LASTS).max(LASTS_MIN) / 3);
        renewals.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut tasks = tokio::task::JoinSet::new();
        loop {
            tokio::select! {
                request = self.requests.recv() => {
                    let Some(request) = request else { return Ok(()) };
                    let is_there = self.client.connection_state() == State::Connected;
                    if !is_there || tasks.len() >= AT_ONCE {
                        self.names.note(request);
                        continue;
                    }
                    match request {
                        NameRequest::Claim { forms, key, reply, room } => {
                            drop(room);
                            self.names.hold(&forms, key);
                            let (store, names) = (store.clone(), self.names.clone());
                            tasks.spawn(async move {
                                let answer = names.claim_all(&store, &forms).await;
                                // Who asked may have lost patience, and has the name. Otherwise
                                // a name that is taken is released.
                                let _ = reply.send(answer);
                                Ok(())
                            });
                        }
                        NameRequest::Release { forms } => {
                            for (form, revision) in self.names.release(&forms) {
                                self.remove(&store, &form, revision).await?;
                            }
                        }
                    }
                }
                _ = renewals.tick() => {
                    let (store, names) = (store.clone(), self.names.clone());
                    tasks.spawn(async move { names.renew(&store).await });
                }
                Some(done) = tasks.join_next() => if let Ok(Err(error)) = done {
                    return Err(error);
                },
                changed = self.connections.changed() => return match changed {
                    Ok(()) => Err(BucketError::Failed("the bus was lost".to_owned())),
                    Err(_) => Ok(()),
                },
            }
        }
    }

    /// Removes a value, unless another station has written it since. It is on its way before
    /// anything that is asked later.
    async fn remove(&self, store: &Store, form: &str, revision: u64) -> Result<(), BucketError> {
        let mut headers = HeaderMap::new();
        headers.insert("KV-Operation", "DEL");
        headers.insert("Nats-Expected-Last-Subject-Sequence", revision.to_string());
        let subject = format!("{}{form}", store.prefix);
        let sent = self.client.publish_with_headers(subject, headers, Bytes::new()).await;
        sent.map_err(BucketError::failed)
    }
}

impl Names {
    fn held(&self) -> MutexGuard<'_, HashMap<String, Held>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes in a request while the bus is not there. What is given now is claimed later.
    fn note(&self, request: NameRequest) {
        match request {
            NameRequest::Claim { forms, key, reply, room } => {
                drop(room);
                self.hold(&forms, key);
                // Who asked may have lost patience.
                let _ = reply.send(NameAnswer::Unknown);
            }
            NameRequest::Release { forms } => drop(self.release(&forms)),
        }
    }

    fn hold(&self, forms: &[String], owner: KeyFingerprint) {
        let mut held = self.held();
        for form in forms {
            held.insert(key_of(form), Held { owner, claim: Claim::New });
        }
    }

    /// Lets names go. Returns the keys that are to be removed, with their revisions.
    fn release(&self, forms: &[String]) -> Vec<(String, u64)> {
        let mut held = self.held();
        let released = forms.iter().map(|form| key_of(form)).filter_map(|key| {
            match held.remove(&key)?.claim {
                Claim::Ours(revision) => Some((key, revision)),
                Claim::New | Claim::Elsewhere => None,
            }
        });
        released.collect()
    }

    /// Claims all forms of a name.
    async fn claim_all(&self, store: &Store, forms: &[String]) -> NameAnswer {
        let answer = self.claim_each(store, forms).await;
        match answer {
            NameAnswer::Ours => self.counters.count_name(false),
            NameAnswer::Taken => self.counters.count_name(true),
            NameAnswer::Unknown => {}
        }
        answer
    }

    async fn claim_each(&self, store: &Store, forms: &[String]) -> NameAnswer {
        for form in forms {
            match self.claim(store, &key_of(form)).await {
                Ok(true) => {}
                Ok(false) => return NameAnswer::Taken,
                Err(error) => {
                    tracing::debug!(%error, "a name is not claimed");
                    return NameAnswer::Unknown;
                }
            }
        }
        NameAnswer::Ours
    }

    /// Claims or renews a key that one of this station's visitors has. Returns whether it is ours.
    async fn claim(&self, store: &Store, key: &str) -> Result<bool, BucketError> {
        let Some(before) = self.held().get(key).copied() else { return Ok(true) };
        let claim = self.write(store, key, before).await?;
        let is_held = self.note_claim(key, before.owner, claim);
        if let Claim::Ours(revision) = claim
            && !is_held
        {
            // Its owner has left meanwhile. What is not removed lapses.
            let _ = store.delete_expect_revision(key, Some(revision)).await;
        }
        Ok(claim != Claim::Elsewhere)
    }

    /// Notes what NATS says of a key that a visitor has. Returns whether it still has it.
    fn note_claim(&self, key: &str, owner: KeyFingerprint, claim: Claim) -> bool {
        let mut held = self.held();
        let Some(now) = held.get_mut(key).filter(|now| now.owner == owner) else { return false };
        now.claim = claim;
        true
    }

    /// Writes that a visitor of this station has a name, unless another one's visitor does. Returns
    /// what NATS says then.
    async fn write(&self, store: &Store, key: &str, held: Held) -> Result<Claim, BucketError> {
        let own = Value { key: held.owner.to_string(), station: self.station };
        let value: Bytes = serde_json::to_vec(&own).map_err(BucketError::failed)?.into();
        let mut revision = match held.claim {
            Claim::Ours(revision) => revision,
            Claim::New | Claim::Elsewhere => 0,
        };
        for _ in 0..ATTEMPTS_MAX {
            match store.update(key, value.clone(), revision).await {
                Ok(revision) => return Ok(Claim::Ours(revision)),
                Err(error) if error.kind() == UpdateErrorKind::WrongLastRevision => {}
                Err(error) => return Err(BucketError::failed(error)),
            }
            match store.entry(key).await.map_err(BucketError::failed)? {
                None => revision = 0,
                Some(there) if may_replace(there.operation, &there.value, &own, held.claim) => {
                    revision = there.revision;
                }
                Some(_) => return Ok(Claim::Elsewhere),
            }
        }
        Ok(Claim::Elsewhere)
    }

    /// Renews all names, and claims those that were given without the bus.
    ///
    /// # Errors
    /// When that fails for each of them: the bucket may be gone.
    async fn renew(&self, store: &Store) -> Result<(), BucketError> {
        let keys: Vec<String> = self.held().keys().cloned().collect();
        let renew = |key: String| async move { self.claim(store, &key).await.map(drop) };
        let renewed = stream::iter(keys).map(renew).buffer_unordered(AT_ONCE);
        let renewed: Vec<Result<(), BucketError>> = renewed.collect().await;
        whole_failure(renewed).map_or(Ok(()), Err)
    }
}

/// An error, if there is nothing else.
fn whole_failure(results: Vec<Result<(), BucketError>>) -> Option<BucketError> {
    let is_whole = results.iter().all(Result::is_err);
    let error = results.into_iter().find_map(Result::err)?;
    tracing::debug!(%error, "names are not renewed");
    is_whole.then_some(error)
}

/// Whether a value may be replaced: it is gone, this station's own, which gives each name once, or
/// the same visitor's, who has just come from another station.
fn may_replace(operation: Operation, value: &[u8], own: &Value, claim: Claim) -> bool {
    if operation != Operation::Put {
        return true;
    }
    let there: Option<Value> = buckets::read(value, VALUE_MAX);
    // A visitor that has gone on to another station keeps its name there.
    there.is_some_and(|there| {
        there.station == own.station || (there.key == own.key && claim == Claim::New)
    })
}

/// The key of a form of a name.
fn key_of(form: &str) -> String {
    let hash = blake3::hash(form.as_bytes()).to_hex();
    hash.chars().take(32).collect()
}

#[cfg(test)]
mod tests {
    use super::{
        Operation::{Delete, Put},
        *,
    };

    #[test]
    fn a_name_is_left_to_the_visitor_of_another_station() {
        let value =
            |key: u8, station| Value { key: KeyFingerprint([key; 10]).to_string(), station };
        let own = value(1, 7);
        let may = |operation, value: Vec<u8>, claim| may_replace(operation, &value, &own, claim);
        let bytes = |value: &Value| serde_json::to_vec(value).unwrap();
        let (mine, anothers, moved) = (value(2, 7), value(2, 8), value(1, 8));
        assert!(may(Put, bytes(&own), Claim::Ours(2)) && may(Put, bytes(&mine), Claim::New));
        assert!(!may(Put, bytes(&anothers), Claim::New));
        assert!(may(Put, bytes(&moved), Claim::New), "it comes from another station");
        for gone in [Claim::Ours(2), Claim::Elsewhere] {
            assert!(!may(Put, bytes(&moved), gone), "it has gone on to another station");
            assert!(may(Delete, bytes(&moved), gone), "it has left that one");
        }
        for noise in [&b""[..], b"{", b"null", &[b'x'; 999]] {
            assert!(!may(Put, noise.to_vec(), Claim::New));
        }
    }

    #[test]
    fn only_what_this_station_has_written_is_removed() {
        let names = Names { station: 7, counters: Arc::default(), held: Mutex::default() };
        let owner = KeyFingerprint([1; 10]);
        let forms = ["ada", "bo", "cy"].map(str::to_owned);
        names.hold(&forms, owner);
        let key = key_of("ada");
        assert!(names.note_claim(&key, owner, Claim::Ours(2)));
        assert!(names.note_claim(&key_of("bo"), owner, Claim::Elsewhere));
        assert!(!names.note_claim(&key, KeyFingerprint([2; 10]), Claim::Ours(3)), "another's");
        assert_eq!(names.release(&forms), [(key.clone(), 2)]);
        assert!(!names.note_claim(&key, owner, Claim::Ours(4)), "its owner has left");
    }

    #[test]
    fn a_round_fails_when_nothing_is_renewed() {
        let error = || Err(BucketError::NoJetStream);
        assert_eq!(whole_failure(vec![error(), error()]), Some(BucketError::NoJetStream));
        assert_eq!(whole_failure(vec![error(), Ok(())]), None);
        assert_eq!(whole_failure(Vec::new()), None);
    }
}
