//! The download of the world, beside the conversation with a client.

use std::sync::Arc;

use bytes::Bytes;
use quinn::SendStream;
use tokio::task::JoinSet;

use super::super::client::ConnectedClient;

/// The size of the pieces in which the world is written, in bytes.
const PIECE_BYTES: usize = 64 * 1_024;

/// The downloads of one client: one at a time, each of a later world. They end with this.
#[derive(Default)]
pub(super) struct Downloads {
    tasks: JoinSet<()>,
    /// The number of the last world that was asked for.
    last: u32,
}

impl Downloads {
    /// The number of the world that was asked for last; zero before the first.
    pub(super) fn last(&self) -> u32 {
        self.last
    }

    /// Starts to send a world on a stream of its own, in place of an earlier world.
    pub(super) fn start(&mut self, number: u32, world: Bytes, client: Arc<ConnectedClient>) {
        debug_assert!(number > self.last, "worlds follow one another");
        self.last = number;
        self.tasks.abort_all();
        self.tasks.spawn(async move {
            if let Some(stream) = send(number, &world, &client).await {
                // The stream must live until all of it has arrived.
                let _ = stream.stopped().await;
            }
        });
    }
}

/// Sends a world with its number. `None` when the client does not take it.
async fn send(number: u32, world: &Bytes, client: &ConnectedClient) -> Option<SendStream> {
    let mut stream = client.connection.open_uni().await.ok()?;
    // Control messages go first.
    let _ = stream.set_priority(-1);
    stream.write_all(&number.to_le_bytes()).await.ok()?;
    for piece in world.chunks(PIECE_BYTES) {
        let piece = world.slice_ref(piece);
        let bytes = piece.len();
        stream.write_chunk(piece).await.ok()?;
        client.count_world_out(bytes);
    }
    stream.finish().ok()?;
    Some(stream)
}
