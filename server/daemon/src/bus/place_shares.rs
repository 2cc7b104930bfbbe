//! Last places that all stations know: a server's end of what `shared_places` does.

use std::{sync::Arc, time::Duration};

use glam::Vec3;
use sightline_protocol::fingerprint::KeyFingerprint;
use tokio::{
    sync::{mpsc, oneshot},
    time::timeout,
};

/// How many requests may wait. What finds no room is not shared.
const REQUESTS_MAX: usize = 1_024;
/// How long a visitor waits for the bus to say where it was.
const PATIENCE: Duration = Duration::from_millis(300);

/// Shares last places with other stations. Copies belong to the same server.
#[derive(Clone, Debug)]
pub(crate) struct PlaceShares(mpsc::Sender<PlaceRequest>);

/// Where a visitor was at some station.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SharedPlace {
    /// The place of its eye.
    pub(crate) eye: Vec3,
    /// When, in seconds since 1970, by that station's clock.
    pub(crate) at_s: i64,
}

/// What a server tells or asks about places.
#[derive(Debug)]
pub(super) enum PlaceRequest {
    /// Visitors have moved in a building of this title.
    Moved { building: Arc<str>, places: Vec<(KeyFingerprint, Vec3)> },
    /// A visitor has left, or its link broke.
    Left(KeyFingerprint),
    /// Where was a visitor last in a building of this title?
    Last { key: KeyFingerprint, building: String, reply: oneshot::Sender<Option<SharedPlace>> },
}

impl PlaceShares {
    pub(super) fn new() -> (Self, mpsc::Receiver<PlaceRequest>) {
        let (requests, asked) = mpsc::channel(REQUESTS_MAX);
        (Self(requests), asked)
    }

    /// Takes in where visitors are. Never waits.
    pub(crate) fn note(&self, building: &Arc<str>, places: &[(KeyFingerprint, Vec3)]) {
        let (building, places) = (building.clone(), places.to_vec());
        let _ = self.0.try_send(PlaceRequest::Moved { building, places });
    }

    /// Takes in that a visitor has left, or that its link broke. Never waits.
    pub(crate) fn note_left(&self, key: KeyFingerprint) {
        let _ = self.0.try_send(PlaceRequest::Left(key));
    }

    /// Where a visitor was last in a building of this title, if the bus says so in time.
    pub(crate) async fn last(&self, key: KeyFingerprint, building: &str) -> Option<SharedPlace> {
        let (reply, answer) = oneshot::channel();
        let building = building.to_owned();
        self.0.try_send(PlaceRequest::Last { key, building, reply }).ok()?;
        timeout(PATIENCE, answer).await.ok()?.ok()?
    }
}
