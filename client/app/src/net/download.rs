//! The download of a world file.

use std::time::Duration;

use quinn::{Connection, RecvStream};
use sightline_client_core::presence::WorldOffer;
use sightline_protocol::message::ClientMessage;
use sightline_world::ReadError;
use tokio::time::timeout;

use super::{
    control_stream::ControlSender,
    error::{ConnectError, lost},
    passage::{JoinProgress, ProgressListener, tell},
};

/// The time within which the download must start.
const START_DEADLINE: Duration = Duration::from_secs(10);
/// The time within which each piece of the world must arrive.
const PIECE_DEADLINE: Duration = Duration::from_secs(20);
/// The largest world file that is fetched: 1 GiB.
const WORLD_BYTES_MAX: u64 = 1 << 30;

/// Asks the server for the world that it offers, and receives the file.
pub(super) async fn fetch(
    sender: &mut ControlSender,
    connection: &Connection,
    offer: WorldOffer,
    progress: Option<&ProgressListener>,
) -> Result<Vec<u8>, ConnectError> {
    if offer.bytes > WORLD_BYTES_MAX {
        return Err(ConnectError::WorldTooLarge(offer.bytes));
    }
    sender.send(&ClientMessage::FetchWorld { world: offer.number }).await?;
    let stream = timeout(START_DEADLINE, stream_of(connection, offer.number)).await;
    let stream = stream.map_err(|_| {
        ConnectError::Lost("the download of the world did not start in time".to_owned())
    })?;
    receive(stream?, offer.bytes, progress).await
}

/// The stream that begins with the number of a world. One of an earlier world may come first.
async fn stream_of(connection: &Connection, number: u32) -> Result<RecvStream, ConnectError> {
    loop {
        let mut stream = connection.accept_uni().await.map_err(lost)?;
        let mut begins = [0; 4];
        if stream.read_exact(&mut begins).await.is_ok() && u32::from_le_bytes(begins) == number {
            return Ok(stream);
        }
    }
}

async fn receive(
    mut stream: RecvStream,
    world_bytes: u64,
    progress: Option<&ProgressListener>,
) -> Result<Vec<u8>, ConnectError> {
    // Memory grows with what has arrived, not with the announced size.
    let mut bytes = Vec::new();
    loop {
        let piece = timeout(PIECE_DEADLINE, stream.read_chunk(usize::MAX, true))
            .await
            .map_err(|_| ConnectError::Lost("the download of the world stopped".to_owned()))?
            .map_err(|error| ConnectError::Lost(error.to_string()))?;
        let Some(piece) = piece else { break };
        bytes.extend_from_slice(&piece.bytes);
        if bytes.len() as u64 > world_bytes {
            return Err(ConnectError::World(ReadError::Damaged));
        }
        let done = bytes.len() as u64;
        tell(progress, || JoinProgress::Download { done, all: world_bytes });
    }
    debug_assert!(bytes.len() as u64 <= world_bytes, "checked piece by piece");
    tell(progress, || JoinProgress::Reading);
    Ok(bytes)
}
