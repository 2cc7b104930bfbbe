//! The download of the world, beside the conversation with a client.

use std::{sync::Arc, time::Duration};

use bytes::Bytes;
use tokio::task::JoinSet;

use super::super::client::ConnectedClient;

/// How long the download of a small world may take, in seconds.
const SECONDS_MIN: u64 = 30;
/// A slower download of a larger world is given up, in bytes a second.
const RATE_MIN: u64 = 128 * 1_024;
/// The size of the pieces in which the world is written, in bytes.
const PIECE_BYTES: usize = 64 * 1_024;

/// How long a download of a given number of bytes may take.
pub(super) fn time_allowed(bytes: usize) -> Duration {
    Duration::from_secs((bytes as u64 / RATE_MIN).max(SECONDS_MIN))
}

/// Starts to send the world on a stream of its own. The download ends with the set of tasks.
pub(super) fn start(world: Bytes, client: Arc<ConnectedClient>, tasks: &mut JoinSet<()>) {
    debug_assert!(tasks.is_empty(), "a client downloads the world once");
    tasks.spawn(async move {
        let Ok(mut stream) = client.connection.open_uni().await else { return };
        // Control messages go first.
        let _ = stream.set_priority(-1);
        for piece in world.chunks(PIECE_BYTES) {
            let piece = world.slice_ref(piece);
            let bytes = piece.len();
            if stream.write_chunk(piece).await.is_err() {
                return;
            }
            client.counters.world_out(bytes);
        }
        let _ = stream.finish();
        // The stream must live until all of it has arrived.
        let _ = stream.stopped().await;
    });
}
