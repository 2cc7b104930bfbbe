//! The state of a server once a second, as server-sent events.

use std::{convert::Infallible, sync::Arc, time::Duration};

use axum::response::sse::{Event, Sse};
use futures_util::{Stream, stream};
use tokio::time::{MissedTickBehavior, interval};

use super::snapshots::Snapshots;

/// How often the state is sent.
const INTERVAL: Duration = Duration::from_secs(1);

/// Sends overviews for as long as somebody listens. What a slow client does not take in time is
/// left out: the next event is made when the one before has been taken.
pub(super) fn overviews(
    snapshots: Arc<Snapshots>,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let mut seconds = interval(INTERVAL);
    seconds.set_missed_tick_behavior(MissedTickBehavior::Skip);
    Sse::new(stream::unfold((snapshots, seconds), |(snapshots, mut seconds)| async {
        seconds.tick().await;
        let event = match snapshots.overview().await.as_deref().map(serde_json::to_string) {
            Some(Ok(said)) => Event::default().data(said),
            _ => Event::default().comment("the engine does not answer"),
        };
        Some((Ok(event), (snapshots, seconds)))
    }))
}
