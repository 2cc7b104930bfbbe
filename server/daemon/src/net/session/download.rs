//! The download of the world, beside the conversation with a client.

use std::sync::Arc;

use bytes::Bytes;
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
            let _ = send(number, &world, &client).await;
        });
    }
}

/// Sends a world with its number. `None` when the client does not take it.
async fn send(number: u32, world: &Bytes, client: &ConnectedClient) -> Option<()> {
    let mut stream = client.transport.open_world_stream().await?;
    stream.write(Bytes::copy_from_slice(&number.to_le_bytes())).await?;
    for piece in world.chunks(PIECE_BYTES) {
        let piece = world.slice_ref(piece);
        let bytes = piece.len();
        stream.write(piece).await?;
        client.count_world_out(bytes);
    }
    stream.finish().await;
    Some(())
}
