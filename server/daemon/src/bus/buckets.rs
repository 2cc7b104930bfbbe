//! Buckets of NATS' key-value store, which need JetStream.

use std::time::Duration;

use async_nats::{
    Client, HeaderMap,
    jetstream::{
        self,
        consumer::{DeliverPolicy, push::OrderedConfig},
        context::AccountErrorKind,
        kv::{Config, Store},
    },
};

/// How long JetStream may take to answer.
const ANSWER_PATIENCE: Duration = Duration::from_secs(3);

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

impl BucketError {
    /// NATS does not answer, or refuses.
    pub(super) fn failed(error: impl std::fmt::Display) -> Self {
        Self::Failed(error.to_string())
    }
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
