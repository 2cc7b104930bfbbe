//! What the stations of a bus share of people: bans, mutes, roles and the list of those let in.
//!
//! A bucket of NATS has a key for each visitor and each network about which something was ruled.
//! The value is the ruling, as JSON. A station reads all of them when it reaches the bus, and hears
//! of changes from then on. It merges what it reads with what it knows, and writes what NATS does
//! not have yet: only if the revision is still the one that it has read, so that two stations that
//! write at once both count. Rulings can be merged in any order, so stations that were apart agree
//! when they have heard of each other.
//!
//! A part of a ruling that is dated far ahead counts when its day has come. Until then it stays in
//! the bucket as it is: the clock that is wrong may be this station's own.

use std::{
    collections::{BTreeSet, HashMap, HashSet},
    convert::Infallible,
    net::{IpAddr, Ipv4Addr, Ipv6Addr},
    panic::AssertUnwindSafe,
    sync::Arc,
    time::Duration,
};

use async_nats::{
    Client,
    connection::State,
    jetstream::{
        consumer::push::Ordered,
        kv::{Config, Operation, Store, UpdateErrorKind},
        message::Message,
    },
};
use futures_util::{FutureExt, StreamExt};
use tokio::{
    sync::{mpsc, watch},
    time::{Instant, MissedTickBehavior, interval, sleep, sleep_until, timeout},
};

use super::buckets::{self, BucketError, Pauses};
use crate::{
    operate::{BusCounters, BusRuling},
    people::{People, Ruling, Subject, now_ms},
};

/// The name of the bucket.
const BUCKET: &str = "sightline-people";
/// The most bytes of a value. A ruling has up to 1,300: a reason has 256 characters.
const VALUE_MAX: usize = 4_096;
/// The most bytes of all values together.
const BUCKET_MAX: i64 = 64 * 1_024 * 1_024;
/// The most visitors and networks about which something may be ruled for others to add some.
const SUBJECTS_MAX: usize = 100_000;
/// How far ahead the clocks of other stations may be.
const AHEAD_MAX: Duration = Duration::from_secs(86_400);
/// How long the next of the rulings that are there may take.
const READ_PATIENCE: Duration = Duration::from_secs(5);
/// How often a ruling is merged and written again when others were quicker.
const ATTEMPTS_MAX: u32 = 16;
/// How long to wait after NATS has refused a ruling. The same one is tried after twice as long, so
/// that it holds up no others.
const RETRY: Duration = Duration::from_secs(2);
/// How long to wait before a ruling that somebody overwrites again and again is written anew.
const AGAIN_PAUSE: Duration = Duration::from_secs(2);
/// How often those rulings are looked at that are dated ahead.
const AHEAD_INTERVAL: Duration = Duration::from_secs(60);
/// How long to wait when too much is to be written to the disk.
const BEHIND_PAUSE: Duration = Duration::from_millis(100);
/// How often a broken value is told.
const COMPLAINT_INTERVAL: Duration = Duration::from_secs(1);
/// The author, in the audit log, of what was ruled at other stations.
const AUTHOR: &str = "another station";

/// Removes visitors who are banned at another station, for a reason.
pub(crate) type OnBan = Box<dyn Fn(Subject, &str) + Send + Sync>;

/// Shares rulings with other stations.
pub(super) struct SharedPeople {
    client: Client,
    /// Changes whenever NATS is reached.
    connections: watch::Receiver<u32>,
    people: Arc<People>,
    /// Of whom something is ruled here.
    ruled: mpsc::UnboundedReceiver<Subject>,
    on_ban: OnBan,
    counters: Arc<BusCounters>,
    /// What NATS has.
    held: HashMap<Subject, Held>,
    /// Those of whom NATS has something that is dated ahead.
    ahead: HashSet<Subject>,
    /// Those of whom NATS may not have all that this station knows.
    unshared: Queue,
    /// Why nothing was shared, as it was told last.
    told: Option<BucketError>,
    complain_at: Instant,
    pauses: Pauses,
}

/// What NATS has of a subject.
#[derive(Clone, Debug, Default)]
struct Held {
    ruling: Ruling,
    revision: u64,
    /// When this station wrote it last.
    written: Option<Instant>,
    /// How often in a row somebody has soon overwritten what this station wrote.
    overwritten: u32,
}

/// Subjects that wait, each with the moment when its turn comes.
#[derive(Debug, Default)]
struct Queue {
    turns: BTreeSet<(Instant, Subject)>,
    waiting: HashMap<Subject, Instant>,
}

impl SharedPeople {
    /// Shares the rulings of a server; `None` if something else does already.
    pub(super) fn new(
        client: Client,
        connections: watch::Receiver<u32>,
        people: Arc<People>,
        on_ban: OnBan,
        counters: Arc<BusCounters>,
    ) -> Option<Self> {
        let ruled = people.follow_rulings()?;
        let (held, ahead, unshared, told) = Default::default();
        let complain_at = Instant::now();
        Some(Self {
            client,
            connections,
            people,
            ruled,
            on_ban,
            counters,
            held,
            ahead,
            unshared,
            told,
            complain_at,
            pauses: Pauses::default(),
        })
    }

    /// Shares until the server ends.
    pub(super) async fn run(mut self) {
        loop {
            let mut connections = self.connections.clone();
            connections.mark_unchanged();
            let sharing = AssertUnwindSafe(self.share()).catch_unwind();
            let end = tokio::select! {
                end = sharing => end,
                changed = connections.changed() => match changed {
                    Ok(()) => continue,
                    Err(_) => return,
                },
            };
            self.counters.set_sharing(false, self.held.len());
            self.tell(match end {
                Ok(Err(error)) => error,
                Err(_) => BucketError::failed("a fault of this program"),
            });
            let pause = self.pauses.next(*connections.borrow());
            tokio::select! {
                () = sleep(pause) => {}
                changed = connections.changed() => if changed.is_err() {
                    return;
                },
            }
        }
    }

    /// Tells why nothing is shared, once.
    fn tell(&mut self, error: BucketError) {
        // That the bus is lost is told already.
        let is_connected = self.client.connection_state() == State::Connected;
        if is_connected && self.told.as_ref() != Some(&error) {
            tracing::warn!(
                %error,
                "bans, mutes, roles and names are not shared with other stations: this one goes on \
                 with its own"
            );
            self.told = Some(error);
        }
    }

    /// Reads all rulings, and shares them from then on.
    async fn share(&mut self) -> Result<Infallible, BucketError> {
        let config = Config {
            bucket: BUCKET.to_owned(),
            description: "bans, mutes and roles of Sightline".to_owned(),
            max_value_size: VALUE_MAX as i32,
            max_bytes: BUCKET_MAX,
            history: 1,
            ..Config::default()
        };
        let store = buckets::open(&self.client, config).await?;
        let mut messages = self.read_all(&store).await?;
        self.told = None;
        self.pauses = Pauses::default();
        tracing::info!(
            rulings = self.held.len(),
            "bans, mutes and roles are shared with other stations"
        );
        let mut put_at = Instant::now();
        let mut looks = interval(AHEAD_INTERVAL);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            self.counters.set_sharing(true, self.held.len());
            let next = self.unshared.next();
            let turn = next.map_or(put_at, |(turn, _)| turn.max(put_at));
            tokio::select! {
                biased;
                message = messages.next() => self.hear(&store, message).await?,
                ruled = self.ruled.recv() => match ruled {
                    Some(subject) => self.unshared.add(subject, Instant::now()),
                    None => return Err(BucketError::failed("the server ends")),
                },
                _ = looks.tick() => self.look_ahead(),
                () = sleep_until(turn), if next.is_some() => {
                    if let Err(error) = self.put_next(&store).await {
                        self.tell(error);
                        put_at = Instant::now() + RETRY;
                    }
                }
            }
        }
    }

    /// Reads what NATS has. Returns what tells of changes.
    async fn read_all(&mut self, store: &Store) -> Result<Ordered, BucketError> {
        self.held.clear();
        self.ahead.clear();
        let follow = buckets::follow(&self.client, store);
        let consumer = store.stream.create_consumer(follow).await.map_err(BucketError::failed)?;
        let mut left = consumer.cached_info().num_pending;
        let mut messages = consumer.messages().await.map_err(BucketError::failed)?;
        while left > 0 {
            // What is removed meanwhile does not come.
            let Ok(message) = timeout(READ_PATIENCE, messages.next()).await else { break };
            left = match &message {
                Some(Ok(message)) => message.info().map_or(0, |info| info.pending),
                _ => 0,
            };
            self.hear(store, message).await?;
        }
        let now = Instant::now();
        for subject in self.people.ruled() {
            self.look_at(subject, now);
        }
        Ok(messages)
    }

    /// Takes in what is heard of changes.
    async fn hear<E: std::fmt::Display>(
        &mut self,
        store: &Store,
        message: Option<Result<Message, E>>,
    ) -> Result<(), BucketError> {
        let message = message.ok_or(BucketError::Failed("the bus has ended".to_owned()))?;
        let message = message.map_err(BucketError::failed)?;
        let Ok(info) = message.info() else { return Ok(()) };
        let Some(key) = message.subject.strip_prefix(&store.prefix) else { return Ok(()) };
        let is_removed = buckets::is_removal(message.headers.as_ref());
        self.take(key, &message.payload, info.stream_sequence, is_removed);
        while self.people.is_behind() {
            sleep(BEHIND_PAUSE).await;
        }
        Ok(())
    }

    /// Takes in what is heard of a key.
    fn take(&mut self, key: &str, value: &[u8], revision: u64, is_removed: bool) {
        let Some(subject) = subject_of(key) else { return self.complain(key, "no such key") };
        match self.held.get(&subject) {
            Some(before) if before.revision >= revision => return,
            None if self.is_full() && self.people.ruling(&subject).is_open() => {
                return self.complain(key, "too many keys");
            }
            _ => {}
        }
        self.take_in(subject, value, revision, is_removed);
    }

    /// Whether others can tell of nobody else.
    fn is_full(&self) -> bool {
        self.people.ruled_count().max(self.held.len()) >= SUBJECTS_MAX
    }

    /// Takes in what NATS has of somebody.
    fn take_in(&mut self, subject: Subject, value: &[u8], revision: u64, is_removed: bool) {
        let read = if is_removed { Ok(Ruling::default()) } else { read(value) };
        // A broken value counts for nothing. This station's own word takes its place.
        let ruling = read.unwrap_or_else(|why| {
            self.complain(&key_of(&subject), why);
            Ruling::default()
        });
        let now = Instant::now();
        let Held { written, overwritten, .. } =
            self.held.get(&subject).cloned().unwrap_or_default();
        let is_soon = written.is_some_and(|written| now < written + 2 * AGAIN_PAUSE);
        let overwritten = if is_soon { overwritten.saturating_add(1) } else { 0 };
        self.held.insert(subject, Held { ruling, revision, written, overwritten });
        if self.count_in(subject) {
            self.complain(&key_of(&subject), "it is dated far ahead: are the clocks right?");
        }
        // Two stations that overwrite each other's word without end do so seldom.
        let is_contested = overwritten > ATTEMPTS_MAX;
        self.look_at(subject, if is_contested { now + AGAIN_PAUSE } else { now });
    }

    /// Lets that part of what NATS has of somebody count that is not dated ahead. Returns whether
    /// another part is.
    fn count_in(&mut self, subject: Subject) -> bool {
        let Some(Held { ruling, .. }) = self.held.get(&subject) else { return false };
        let by = now_ms().saturating_add(AHEAD_MAX.as_millis() as u64);
        let counts = ruling.until(by);
        let is_ahead = counts != *ruling;
        if is_ahead {
            self.ahead.insert(subject);
        } else {
            self.ahead.remove(&subject);
        }
        if let Some(before) = self.people.merge(AUTHOR, subject, &counts) {
            self.counters.count_ruling(BusRuling::In);
            let after = self.people.ruling(&subject).banned.is;
            if let Some(reason) = after.filter(|_| before.banned.is.is_none()) {
                (self.on_ban)(subject, &reason);
            }
        }
        is_ahead
    }

    /// Lets what was dated ahead count if its day has come.
    fn look_ahead(&mut self) {
        for subject in self.ahead.clone() {
            self.count_in(subject);
        }
    }

    /// Notes whether NATS has all that this station knows of somebody, to be written from some
    /// moment on.
    fn look_at(&mut self, subject: Subject, turn: Instant) {
        let theirs = self.held.get(&subject).map(|held| held.ruling.clone()).unwrap_or_default();
        if self.merged(subject, &theirs) != theirs {
            self.unshared.add(subject, turn);
        }
    }

    /// What NATS has of somebody, with what this station knows.
    fn merged(&self, subject: Subject, theirs: &Ruling) -> Ruling {
        let mut merged = theirs.clone();
        merged.merge(&self.people.ruling(&subject));
        merged
    }

    /// Writes what this station knows of the one whose turn it is.
    async fn put_next(&mut self, store: &Store) -> Result<(), BucketError> {
        let Some((_, subject)) = self.unshared.next() else { return Ok(()) };
        self.unshared.remove(subject);
        let put = self.put(store, subject).await;
        if put.is_err() {
            // Those that wait come first.
            self.unshared.remove(subject);
            self.unshared.add(subject, Instant::now() + 2 * RETRY);
        }
        put
    }

    /// Writes what this station knows of somebody.
    async fn put(&mut self, store: &Store, subject: Subject) -> Result<(), BucketError> {
        let key = key_of(&subject);
        for _ in 0..ATTEMPTS_MAX {
            let Held { ruling: theirs, revision, overwritten, .. } =
                self.held.get(&subject).cloned().unwrap_or_default();
            let ruling = self.merged(subject, &theirs);
            if ruling == theirs {
                self.unshared.remove(subject);
                return Ok(());
            }
            let value = serde_json::to_vec(&ruling).map_err(BucketError::failed)?;
            match store.update(&key, value.into(), revision).await {
                Ok(revision) => {
                    self.counters.count_ruling(BusRuling::Out);
                    let written = Some(Instant::now());
                    self.held.insert(subject, Held { ruling, revision, written, overwritten });
                }
                Err(error) if error.kind() == UpdateErrorKind::WrongLastRevision => {
                    self.counters.count_ruling(BusRuling::Again);
                    match store.entry(&key).await.map_err(BucketError::failed)? {
                        Some(now) => {
                            let is_removed = now.operation != Operation::Put;
                            self.take_in(subject, &now.value, now.revision, is_removed);
                        }
                        None => drop(self.held.remove(&subject)),
                    }
                }
                Err(error) => return Err(BucketError::failed(error)),
            }
        }
        Err(BucketError::Failed("other stations rule without end".to_owned()))
    }

    /// Tells of a broken value.
    fn complain(&mut self, key: &str, why: &str) {
        self.counters.count_ruling(BusRuling::Broken);
        if Instant::now() >= self.complain_at {
            let key: String = key.chars().take(64).collect();
            tracing::warn!(?key, why, "a ruling on the bus is ignored");
            self.complain_at = Instant::now() + COMPLAINT_INTERVAL;
        }
    }
}

impl Queue {
    /// Adds a subject. Its turn comes no later than it would have come before.
    fn add(&mut self, subject: Subject, turn: Instant) {
        let turn = self.waiting.get(&subject).map_or(turn, |before| turn.min(*before));
        self.remove(subject);
        self.turns.insert((turn, subject));
        self.waiting.insert(subject, turn);
    }

    fn remove(&mut self, subject: Subject) {
        if let Some(turn) = self.waiting.remove(&subject) {
            self.turns.remove(&(turn, subject));
        }
    }

    /// The one whose turn comes first, and when.
    fn next(&self) -> Option<(Instant, Subject)> {
        self.turns.first().copied()
    }
}

/// Reads a value.
fn read(value: &[u8]) -> Result<Ruling, &'static str> {
    if value.len() > VALUE_MAX {
        return Err("too long");
    }
    let ruling: Ruling = serde_json::from_slice(value).map_err(|_| "not a ruling")?;
    if ruling.is_sound() { Ok(ruling) } else { Err("no server rules so") }
}

/// The key of a subject: letters, digits, dashes and underscores.
fn key_of(subject: &Subject) -> String {
    match subject {
        Subject::Key(key) => format!("key.{key}"),
        Subject::Network(IpAddr::V4(v4)) => {
            format!("ipv4.{v4}").replace('.', "_").replacen('_', ".", 1)
        }
        Subject::Network(IpAddr::V6(v6)) => format!("ipv6.{v6}").replace(':', "_"),
    }
}

/// The subject of a key. Each has one key only.
fn subject_of(key: &str) -> Option<Subject> {
    let subject = match key.split_once('.')? {
        ("key", key) => Subject::Key(key.parse().ok()?),
        ("ipv4", v4) => Subject::of(v4.replace('_', ".").parse::<Ipv4Addr>().ok()?.into()),
        ("ipv6", v6) => Subject::of(v6.replace('_', ":").parse::<Ipv6Addr>().ok()?.into()),
        _ => return None,
    };
    (key_of(&subject) == key).then_some(subject)
}

#[cfg(test)]
mod tests {
    use sightline_protocol::fingerprint::KeyFingerprint;

    use super::*;
    use crate::people::{Act, Role};

    #[test]
    fn each_subject_has_one_key() {
        let key = Subject::Key(KeyFingerprint([7; 10]));
        let networks = ["192.0.2.1", "2001:db8:1:2::/64", "::/64"];
        let networks = networks.map(|text| text.parse::<Subject>().unwrap());
        for subject in networks.into_iter().chain([key]) {
            let text = key_of(&subject);
            let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
            assert!(text.chars().all(is_plain) && !text.ends_with('.'), "{text}");
            assert_eq!(subject_of(&text), Some(subject), "{text}");
        }
        for wrong in [
            "",
            "key",
            "key.",
            "key.07",
            "key.07070707070707070707",
            "ipv4.192.0.2.1",
            "ipv6.2001_db8_1_2_3_4_5_6",
            "ipv6.__ffff_192_0_2_1",
            "name.Ada",
        ] {
            assert_eq!(subject_of(wrong), None, "{wrong}");
        }
    }

    /// One that shares, out of reach of NATS.
    async fn alone() -> SharedPeople {
        let options = async_nats::ConnectOptions::new().retry_on_initial_connect();
        let client = options.connect("127.0.0.1:1").await.unwrap();
        let people = Arc::new(People::open(None, 0).unwrap());
        let (_, connections) = watch::channel(0);
        SharedPeople::new(client, connections, people, Box::new(|_, _| ()), Arc::default()).unwrap()
    }

    #[tokio::test]
    async fn what_is_dated_far_ahead_is_left_as_it_is_and_the_rest_counts() {
        let mut shared = alone().await;
        let key = KeyFingerprint([7; 10]);
        let subject = Subject::Key(key);
        let mut ruling = Ruling::default();
        ruling.take(&Act::Ban(subject, "rude".to_owned()), now_ms());
        ruling.take(&Act::SetRole(key, Role::Owner), now_ms() + 2 * AHEAD_MAX.as_millis() as u64);
        let value = serde_json::to_vec(&ruling).unwrap();
        shared.take(&key_of(&subject), &value, 1, false);
        assert!(shared.people.is_banned(key, None), "its date is sound");
        assert_eq!(shared.people.standing(key).role, Role::Visitor, "not yet");
        assert!(shared.unshared.next().is_none() && shared.ahead.contains(&subject));
        shared.people.act("Mo", Act::SetMuted(key, true), "");
        let written = shared.merged(subject, &ruling);
        assert_eq!((&written.role, &written.banned), (&ruling.role, &ruling.banned));
        assert!(written.muted.is, "what is ruled here is added");

        ruling.role.at = now_ms();
        shared.held.get_mut(&subject).unwrap().ruling = ruling;
        shared.look_ahead();
        assert_eq!(shared.people.standing(key).role, Role::Owner, "its day has come");
        assert!(shared.ahead.is_empty());
    }

    #[tokio::test]
    async fn what_somebody_overwrites_again_and_again_is_written_after_a_pause() {
        let mut shared = alone().await;
        let subject = Subject::Key(KeyFingerprint([7; 10]));
        shared.people.act("Mo", Act::Ban(subject, "rude".to_owned()), "");
        shared.take(&key_of(&subject), b"{", 1, false);
        for revision in 1..=u64::from(ATTEMPTS_MAX) + 1 {
            let (turn, _) = shared.unshared.next().expect("it is written");
            assert!(turn <= Instant::now(), "at once");
            shared.unshared.remove(subject);
            shared.held.get_mut(&subject).unwrap().written = Some(Instant::now());
            shared.take(&key_of(&subject), b"{", 1 + revision, false);
        }
        let (turn, _) = shared.unshared.next().expect("it is written");
        assert!(turn > Instant::now() + AGAIN_PAUSE / 2, "after a pause");
    }

    #[test]
    fn each_subject_waits_for_its_turn_once() {
        let [one, other] = [1, 2].map(|n| Subject::Key(KeyFingerprint([n; 10])));
        let now = Instant::now();
        let mut queue = Queue::default();
        queue.add(one, now + RETRY);
        queue.add(other, now + AGAIN_PAUSE / 2);
        assert_eq!(queue.next().map(|(_, first)| first), Some(other));
        queue.add(one, now);
        queue.add(one, now + RETRY);
        assert_eq!(queue.next(), Some((now, one)), "the earlier turn is kept");
        queue.remove(one);
        queue.remove(other);
        assert!(queue.turns.is_empty() && queue.waiting.is_empty());
    }

    #[test]
    fn rulings_read_back_and_noise_is_none() {
        let key = KeyFingerprint([7; 10]);
        let mut ruling = Ruling::default();
        ruling.take(&Act::SetRole(key, Role::Moderator), now_ms());
        ruling.take(&Act::Ban(Subject::Key(key), "\"é\" ".repeat(999)), now_ms());
        let value = serde_json::to_vec(&ruling).unwrap();
        assert_eq!(read(&value).as_ref(), Ok(&ruling), "{}", value.len());
        let text = r#"{"muted":{"is":true,"at":5}}"#;
        assert_eq!(serde_json::to_string(&read(text.as_bytes()).unwrap()).unwrap(), text);
        let deep = "[".repeat(VALUE_MAX);
        for noise in [
            "",
            "null",
            "[1,2]",
            r#"{"role":{"is":"king","at":5}}"#,
            r#"{"muted":{"is":true,"at":-5}}"#,
            r#"{"muted":{"is":true,"at":18446744073709551615}}"#,
            r#"{"muted":{"is":true,"at":18446744073709551616}}"#,
            r#"{"banned":{"is":"two\nlines","at":5}}"#,
            r#"{"banned":{"is":"without a date","at":0}}"#,
            r#"{"role":{"is":"owner","at":0}}"#,
            &deep,
            &format!("{text}{}", " ".repeat(VALUE_MAX)),
        ] {
            assert!(read(noise.as_bytes()).is_err(), "{noise}");
        }
        assert!(read(&[0xff; 9]).is_err());
    }
}
