//! The visitors that are here, by their keys: those who are connected, and those whose link broke
//! and who may come back.

use std::{collections::HashMap, sync::Arc, time::Duration};

use sightline_protocol::fingerprint::KeyFingerprint;

use super::client::ConnectedClient;

/// How long the avatar of a client whose link broke is kept for it.
pub const KEPT_FOR: Duration = Duration::from_secs(30);

/// The visitors that are here. Each key has one avatar.
#[derive(Default)]
pub struct Visitors {
    by_key: HashMap<KeyFingerprint, Entry>,
}

struct Entry {
    /// The client that has the avatar, or had it last.
    client: Arc<ConnectedClient>,
    /// Until when it may come back, by the server's time; `None` while it is connected.
    until: Option<Duration>,
}

impl Visitors {
    /// The client that has the avatar of a key, or had it last.
    pub fn get(&self, key: KeyFingerprint) -> Option<&Arc<ConnectedClient>> {
        self.by_key.get(&key).map(|entry| &entry.client)
    }

    /// Takes in a client, which has the avatar of its key from now on.
    pub fn arrive(&mut self, client: Arc<ConnectedClient>) {
        self.by_key.insert(client.visit.key, Entry { client, until: None });
    }

    /// Whether a client has the avatar of its key: no other one has taken its place.
    pub fn has_avatar(&self, client: &Arc<ConnectedClient>) -> bool {
        self.get(client.visit.key).is_some_and(|current| Arc::ptr_eq(current, client))
    }

    /// Takes in that the link to a client broke.
    pub fn part(&mut self, client: &Arc<ConnectedClient>, now: Duration) {
        if let Some(entry) = self.by_key.get_mut(&client.visit.key) {
            entry.until = Some(now + KEPT_FOR);
        }
    }

    /// Takes in that the owner of a key, if its link is broken, need not come back.
    pub fn give_up(&mut self, key: KeyFingerprint) {
        if let Some(until) = self.by_key.get_mut(&key).and_then(|entry| entry.until.as_mut()) {
            *until = Duration::ZERO;
        }
    }

    /// Takes in that the owner of a key has gone for good.
    pub fn leave(&mut self, key: KeyFingerprint) {
        self.by_key.remove(&key);
    }

    /// Those who have not come back in time.
    pub fn overdue(&self, now: Duration) -> Vec<Arc<ConnectedClient>> {
        let is_overdue = |entry: &&Entry| entry.until.is_some_and(|until| until <= now);
        self.by_key.values().filter(is_overdue).map(|entry| entry.client.clone()).collect()
    }

    /// All clients, and whether they are connected.
    pub fn all(&self) -> impl Iterator<Item = (&Arc<ConnectedClient>, bool)> {
        self.by_key.values().map(|entry| (&entry.client, entry.until.is_none()))
    }

    /// The clients that are connected.
    pub fn connected(&self) -> impl Iterator<Item = &Arc<ConnectedClient>> {
        self.all().filter(|(_, is_connected)| *is_connected).map(|(client, _)| client)
    }
}
