//! Names that no other station gives: a server's end of what `shared_names` does.

use std::{sync::Arc, time::Duration};

use sightline_protocol::fingerprint::KeyFingerprint;
use tokio::{
    sync::{OwnedSemaphorePermit, Semaphore, mpsc, oneshot},
    time::{Instant, timeout_at},
};

/// How many claims may wait. Names are given without the bus when more do.
const CLAIMS_MAX: usize = 1_024;
/// How long a visitor waits for the bus to say whether a name is free.
pub(crate) const PATIENCE: Duration = Duration::from_millis(300);

/// Claims names at all stations. Copies belong to the same server.
#[derive(Clone, Debug)]
pub(crate) struct NameClaims {
    /// In order: what is released may be claimed again at once.
    requests: mpsc::UnboundedSender<NameRequest>,
    room: Arc<Semaphore>,
}

/// What the bus says of a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NameAnswer {
    /// No other station gives it from now on.
    Ours,
    /// Another station's visitor has it.
    Taken,
    /// The bus does not answer in time. The name is claimed when it does.
    Unknown,
}

/// What a server asks of the bus about a name. A name is what it looks like, in up to two forms.
#[derive(Debug)]
pub(super) enum NameRequest {
    /// The owner of a key is to have it.
    Claim {
        forms: Vec<String>,
        key: KeyFingerprint,
        reply: oneshot::Sender<NameAnswer>,
        /// Its room among those that wait.
        room: OwnedSemaphorePermit,
    },
    /// Its owner has left.
    Release { forms: Vec<String> },
}

impl NameClaims {
    pub(super) fn new() -> (Self, mpsc::UnboundedReceiver<NameRequest>) {
        let (requests, asked) = mpsc::unbounded_channel();
        (Self { requests, room: Arc::new(Semaphore::new(CLAIMS_MAX)) }, asked)
    }

    /// Claims a name for the owner of a key. It waits for an answer up to some moment.
    pub(crate) async fn claim(
        &self,
        forms: Vec<String>,
        key: KeyFingerprint,
        until: Instant,
    ) -> NameAnswer {
        let mut answer = self.ask(forms, key);
        let in_time = timeout_at(until, &mut answer).await;
        // What is answered from now on is not heard, and the other side knows that.
        answer.close();
        let answer = in_time.map_or_else(|_| answer.try_recv().ok(), Result::ok);
        answer.unwrap_or(NameAnswer::Unknown)
    }

    /// Claims a name that was given already.
    pub(crate) fn claim_given(&self, forms: Vec<String>, key: KeyFingerprint) {
        drop(self.ask(forms, key));
    }

    /// Gives a name back.
    pub(crate) fn release(&self, forms: Vec<String>) {
        // Nobody listens when the server ends.
        let _ = self.requests.send(NameRequest::Release { forms });
    }

    /// Claims a name. Returns what hears the answer; that there is none, if too many wait. The name
    /// is free at other stations then.
    fn ask(&self, forms: Vec<String>, key: KeyFingerprint) -> oneshot::Receiver<NameAnswer> {
        let (reply, answer) = oneshot::channel();
        if let Ok(room) = self.room.clone().try_acquire_owned() {
            // Nobody listens when the server ends.
            let _ = self.requests.send(NameRequest::Claim { forms, key, reply, room });
        }
        answer
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_given_back_however_many_wait() {
        let (claims, mut asked) = NameClaims::new();
        let key = KeyFingerprint([1; 10]);
        (0..2 * CLAIMS_MAX).for_each(|_| claims.claim_given(vec!["ada".to_owned()], key));
        claims.release(vec!["ada".to_owned()]);
        let requests: Vec<NameRequest> = std::iter::from_fn(|| asked.try_recv().ok()).collect();
        assert_eq!(requests.len(), CLAIMS_MAX + 1);
        assert!(matches!(requests.last(), Some(NameRequest::Release { .. })));
        drop(requests);
        claims.claim_given(vec!["bo".to_owned()], key);
        assert!(asked.try_recv().is_ok(), "there is room again");
    }
}
