//! Notes where visitors are, so that they find themselves there when the server was started again.

use std::{
    collections::{BTreeMap, HashMap},
    sync::Arc,
    time::Duration,
};

use glam::Vec3;
use sightline_engine::Engine;
use sightline_protocol::fingerprint::KeyFingerprint;
use sightline_world::motion::AvatarId;

use super::client::ConnectedClient;
use crate::{bus::place_shares::PlaceShares, people::People};

/// How often places are noted. Together with the time until they are written it is below a second.
const INTERVAL: Duration = Duration::from_millis(500);
/// A visitor that has moved by less than this is where it was, in metres.
const MOVED_M: f32 = 0.1;

/// Notes where visitors are.
pub struct PlaceNotes {
    people: Arc<People>,
    /// Shares places with other stations, if there are any.
    shares: Option<PlaceShares>,
    /// The title of the world.
    building: Arc<str>,
    /// The place of each visitor that was noted last.
    noted: HashMap<AvatarId, Vec3>,
    /// When places are noted next.
    due: Duration,
}

impl PlaceNotes {
    /// Notes places for these people, and for other stations.
    pub fn new(people: Arc<People>, shares: Option<PlaceShares>) -> Self {
        let (building, noted, due) = ("".into(), HashMap::new(), Duration::ZERO);
        Self { people, shares, building, noted, due }
    }

    /// Visitors are in another building from now on.
    pub fn change_building(&mut self, title: &str) {
        self.building = title.into();
        self.noted.clear();
    }

    /// Notes where those are who have moved, if it is time.
    pub fn note_all(
        &mut self,
        now: Duration,
        engine: &Engine,
        clients: &BTreeMap<AvatarId, Arc<ConnectedClient>>,
    ) {
        if now < self.due {
            return;
        }
        self.due = now + INTERVAL;
        let places = clients.values().filter_map(|client| self.moved(engine, client));
        let places: Vec<_> = places.collect();
        if !places.is_empty() {
            self.note(&places);
        }
    }

    /// Notes where a leaving visitor is, if it has moved.
    pub fn note_last(&mut self, engine: &Engine, client: &ConnectedClient) {
        if let Some(place) = self.moved(engine, client) {
            self.note(&[place]);
        }
        if let Some(shares) = &self.shares {
            shares.note_left(client.visit.key);
        }
        self.noted.remove(&client.avatar());
    }

    fn note(&self, places: &[(KeyFingerprint, Vec3)]) {
        self.people.note_places(&self.building, places);
        if let Some(shares) = &self.shares {
            shares.note(&self.building, places);
        }
    }

    /// Where a visitor is by its course, if it has moved.
    fn moved(
        &mut self,
        engine: &Engine,
        client: &ConnectedClient,
    ) -> Option<(KeyFingerprint, Vec3)> {
        let avatar = client.avatar();
        let course = engine.known_course(avatar).map(|course| course.pose.eye);
        let eye = course.or_else(|| Some(engine.pose(avatar)?.eye))?;
        let before = self.noted.get(&avatar);
        if before.is_some_and(|before| before.distance(eye) < MOVED_M) {
            return None;
        }
        self.noted.insert(avatar, eye);
        Some((client.visit.key, eye))
    }
}
