//! Names that no other station gives: a server's end of what `shared_names` does.

use std::time::Duration;

use sightline_protocol::fingerprint::KeyFingerprint;
use tokio::{
    sync::{mpsc, oneshot},
    time::{Instant, timeout_at},
};

/// How many requests may wait. Names are given without the bus when more do.
const REQUESTS_MAX: usize = 1_024;
/// How long a visitor waits for the bus to say whether a name is free.
pub(crate) const PATIENCE: Duration = Duration::from_millis(300);

/// Claims names at all stations. Copies belong to the same server.
#[derive(Clone, Debug)]
pub(crate) struct NameClaims(mpsc::Sender<NameRequest>);

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
    Claim { forms: Vec<String>, key: KeyFingerprint, reply: oneshot::Sender<NameAnswer> },
    /// Its owner has left.
    Release { forms: Vec<String> },
}

impl NameClaims {
    pub(super) fn new() -> (Self, mpsc::Receiver<NameRequest>) {
        let (requests, asked) = mpsc::channel(REQUESTS_MAX);
        (Self(requests), asked)
    }

    /// Claims a name for the owner of a key. It waits for an answer up to some moment.
    pub(crate) async fn claim(
        &self,
        forms: Vec<String>,
        key: KeyFingerprint,
        until: Instant,
    ) -> NameAnswer {
        let (reply, answer) = oneshot::channel();
        if self.0.try_send(NameRequest::Claim { forms, key, reply }).is_err() {
            return NameAnswer::Unknown;
        }
        timeout_at(until, answer).await.ok().and_then(Result::ok).unwrap_or(NameAnswer::Unknown)
    }

    /// Claims a name that was given already.
    pub(crate) fn claim_given(&self, forms: Vec<String>, key: KeyFingerprint) {
        let (reply, _) = oneshot::channel();
        // A name that finds no room is free at other stations.
        let _ = self.0.try_send(NameRequest::Claim { forms, key, reply });
    }

    /// Gives a name back.
    pub(crate) fn release(&self, forms: Vec<String>) {
        // What finds no room lapses at the end of this server.
        let _ = self.0.try_send(NameRequest::Release { forms });
    }
}
