//! The download of a world file.

use std::{sync::Arc, time::Duration};

use quinn::RecvStream;
use sightline_client_core::replica::ReplicaError;
use sightline_protocol::message::{ClientMessage, ServerMessage};
use sightline_world::ReadError;
use tokio::time::timeout;

use super::{
    control_stream::ControlStream,
    error::{ConnectError, lost},
};

/// The time within which the download must start.
const START_DEADLINE: Duration = Duration::from_secs(10);
/// The time within which each piece of the world must arrive.
const PIECE_DEADLINE: Duration = Duration::from_secs(20);
/// The largest world file that is fetched: 1 GiB.
const WORLD_BYTES_MAX: u64 = 1 << 30;

/// Called with the number of bytes received so far, and the number of all bytes.
pub type DownloadProgress = Arc<dyn Fn(u64, u64) + Send + Sync>;

/// Asks the server for its world, and receives the file.
pub(super) async fn fetch(
    control: &mut ControlStream,
    world_bytes: u64,
    progress: Option<&DownloadProgress>,
) -> Result<Vec<u8>, ConnectError> {
    if world_bytes > WORLD_BYTES_MAX {
        return Err(ConnectError::WorldTooLarge(world_bytes));
    }
    control.send(&ClientMessage::FetchWorld).await?;
    let connection = control.connection().clone();
    // A server that closes instead says goodbye on the control stream.
    let stream = tokio::select! {
        stream = timeout(START_DEADLINE, connection.accept_uni()) => stream,
        message = control.receive() => return Err(match message? {
            ServerMessage::Goodbye { reason } => ConnectError::Goodbye(reason.into()),
            _ => ReplicaError::OutOfPlace.into(),
        }),
    };
    let stream = stream.map_err(|_| {
        ConnectError::Lost("the download of the world did not start in time".to_owned())
    })?;
    receive(stream.map_err(lost)?, world_bytes, progress).await
}

async fn receive(
    mut stream: RecvStream,
    world_bytes: u64,
    progress: Option<&DownloadProgress>,
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
        if let Some(progress) = progress {
            progress(bytes.len() as u64, world_bytes);
        }
    }
    debug_assert!(bytes.len() as u64 <= world_bytes, "checked piece by piece");
    Ok(bytes)
}
