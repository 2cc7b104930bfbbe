//! The newest overview of a server, which all HTTP clients share.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use tokio::sync::Mutex;

use crate::{net::Observer, operate::Overview};

/// An overview that is younger is told again.
const FRESH: Duration = Duration::from_millis(500);

/// The newest overview of a server.
pub(super) struct Snapshots {
    observer: Observer,
    newest: Mutex<Option<(Instant, Arc<Overview>)>>,
}

impl Snapshots {
    pub(super) fn new(observer: Observer) -> Self {
        Self { observer, newest: Mutex::default() }
    }

    /// An overview that is half a second old at most. `None` when the engine does not answer. All
    /// who ask meanwhile wait for the same answer.
    pub(super) async fn overview(&self) -> Option<Arc<Overview>> {
        let mut newest = self.newest.lock().await;
        if let Some((at, overview)) = &*newest
            && at.elapsed() < FRESH
        {
            return Some(overview.clone());
        }
        let overview = Arc::new(self.observer.overview().await?);
        *newest = Some((Instant::now(), overview.clone()));
        Some(overview)
    }
}
