//! The newest overview of a server, which all HTTP clients share.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use tokio::sync::Mutex;

use crate::{net::Observer, operate::Overview};

/// An answer that is younger is told again.
const FRESH: Duration = Duration::from_millis(500);

/// The newest overview of a server.
pub(super) struct Snapshots {
    observer: Observer,
    newest: Newest<Overview>,
}

/// The newest answer to a question, and when it came; `None` inside when there was no answer.
struct Newest<T>(Mutex<Option<(Instant, Option<Arc<T>>)>>);

impl Snapshots {
    pub(super) fn new(observer: Observer) -> Self {
        Self { observer, newest: Newest(Mutex::default()) }
    }

    /// An overview that is half a second old at most. `None` when the engine does not answer, or
    /// did not within that time. All who ask meanwhile wait for the same answer.
    pub(super) async fn overview(&self) -> Option<Arc<Overview>> {
        self.newest.get(self.observer.overview()).await
    }
}

impl<T> Newest<T> {
    /// The newest answer, or a new one when that is too old. A question that had no answer is not
    /// asked again at once, so that those who wait do not wait one after the other.
    async fn get(&self, ask: impl Future<Output = Option<T>>) -> Option<Arc<T>> {
        let mut newest = self.0.lock().await;
        if let Some((at, answer)) = &*newest
            && at.elapsed() < FRESH
        {
            return answer.clone();
        }
        let answer = ask.await.map(Arc::new);
        *newest = Some((Instant::now(), answer.clone()));
        answer
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

    use super::*;

    #[tokio::test]
    async fn all_who_wait_share_one_question_with_or_without_an_answer() {
        for answer in [None, Some(7)] {
            let (newest, asked) = (Newest(Mutex::default()), AtomicU32::new(0));
            let ask = || async {
                asked.fetch_add(1, Relaxed);
                tokio::task::yield_now().await;
                answer
            };
            let (one, other) = tokio::join!(newest.get(ask()), newest.get(ask()));
            assert_eq!((one.as_deref(), other.as_deref()), (answer.as_ref(), answer.as_ref()));
            assert_eq!(asked.load(Relaxed), 1);
        }
    }
}
