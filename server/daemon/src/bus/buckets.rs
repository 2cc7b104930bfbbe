//! Buckets of NATS' key-value store, which need JetStream.

use std::time::Duration;

use async_nats::{
    Client, HeaderMap,
    jetstream::{
        self,
        consumer::{DeliverPolicy, push::OrderedConfig},
        context::AccountErrorKind,
        kv::{Config, Store},
        stream::StorageType,
    },
};
use serde::de::DeserializeOwned;

/// How long JetStream may take to answer.
const ANSWER_PATIENCE: Duration = Duration::from_secs(3);
/// The most bytes of all values of a bucket in memory together.
const LAPSING_BYTES_MAX: i64 = 64 * 1_024 * 1_024;
/// How long to wait after NATS has refused something, or had no JetStream: this long at first, and
/// twice as long each time, up to the longest.
const RETRY_FIRST: Duration = Duration::from_secs(2);
const RETRY_MAX: Duration = Duration::from_secs(120);

/// Why nothing is kept on the bus.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum BucketError {
    /// The NATS server has no JetStream.
    #[error("the NATS server has no JetStream; start it as nats-server -js -sd FOLDER")]
    NoJetStream,
    /// NATS does not answer, or refuses.
    #[error("{0}")]
    Failed(String),
}

/// The pauses between attempts to use a bucket. They begin anew when one succeeds, and with each
/// connection to NATS.
#[derive(Debug, Default)]
pub(super) struct Pauses {
    /// How many attempts have failed.
    failures: u32,
    /// The number of the connection that they were made on.
    connection: u32,
}

impl Pauses {
    /// The pause after an attempt that has failed on a connection.
    pub(super) fn next(&mut self, connection: u32) -> Duration {
        if connection != self.connection {
            *self = Self { failures: 0, connection };
        }
        let pause = RETRY_FIRST.saturating_mul(1 << self.failures.min(16));
        self.failures += 1;
        pause.min(RETRY_MAX)
    }
}

impl BucketError {
    /// NATS does not answer, or refuses.
    pub(super) fn failed(error: impl std::fmt::Display) -> Self {
        Self::Failed(error.to_string())
    }
}

/// What a bucket in memory is made like whose values lapse after a time. A value has at most this
/// number of bytes.
pub(super) fn lapsing(
    bucket: &str,
    description: &str,
    value_max: usize,
    lasts: Duration,
) -> Config {
    Config {
        bucket: bucket.to_owned(),
        description: description.to_owned(),
        max_value_size: i32::try_from(value_max).unwrap_or(i32::MAX),
        max_bytes: LAPSING_BYTES_MAX,
        max_age: lasts,
        history: 1,
        storage: StorageType::Memory,
        ..Config::default()
    }
}

/// Reads a value of at most this number of bytes; `None` when it has another form.
pub(super) fn read<T: DeserializeOwned>(value: &[u8], value_max: usize) -> Option<T> {
    let value = Some(value).filter(|value| value.len() <= value_max)?;
    serde_json::from_slice(value).ok()
}

/// Opens a bucket as it is, or makes it.
///
/// # Errors
/// When NATS has no JetStream, does not answer, or refuses.
pub(super) async fn open(client: &Client, config: Config) -> Result<Store, BucketError> {
    let mut context = jetstream::new(client.clone());
    context.set_timeout(ANSWER_PATIENCE);
    if let Ok(store) = context.get_key_value(&config.bucket).await {
        return Ok(store);
    }
    if let Err(error) = context.query_account().await {
        return Err(match error.kind() {
            AccountErrorKind::JetStreamUnavailable | AccountErrorKind::JetStream(_) => {
                BucketError::NoJetStream
            }
            AccountErrorKind::TimedOut => {
                let why = "JetStream does not answer; may this user publish to $JS.API.> ?";
                BucketError::Failed(why.to_owned())
            }
            _ => BucketError::failed(error),
        });
    }
    context.create_key_value(config).await.map_err(BucketError::failed)
}

/// How to hear of the last value of each key, and then of all changes.
pub(super) fn follow(client: &Client, store: &Store) -> OrderedConfig {
    OrderedConfig {
        deliver_subject: client.new_inbox(),
        description: Some("a station".to_owned()),
        filter_subject: format!("{}>", store.prefix),
        deliver_policy: DeliverPolicy::LastPerSubject,
        ..OrderedConfig::default()
    }
}

/// Whether a message about a key says that it has no value any more.
pub(super) fn is_removal(headers: Option<&HeaderMap>) -> bool {
    let is_put = |headers: &HeaderMap| match headers.get("KV-Operation") {
        Some(operation) => operation.as_str() == "PUT",
        None => headers.get("Nats-Marker-Reason").is_none(),
    };
    headers.is_some_and(|headers| !is_put(headers))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_until_nats_is_reached_again() {
        let mut pauses = Pauses::default();
        let seconds: Vec<u64> = (0..9).map(|_| pauses.next(1).as_secs()).collect();
        assert_eq!(seconds, [2, 4, 8, 16, 32, 64, 120, 120, 120]);
        assert_eq!([2, 2, 3].map(|connection| pauses.next(connection).as_secs()), [2, 4, 2]);
    }
}
