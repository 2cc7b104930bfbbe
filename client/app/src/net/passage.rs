//! The way into a world that the server offers: first of all, and whenever it offers another one.

use std::sync::Arc;

use sightline_client_core::{presence::WorldOffer, replica::ReplicaError};
use sightline_protocol::message::ServerMessage;
use sightline_world::{ContentId, World};

use super::{
    cache::WorldCache,
    control_stream::{ControlReceiver, ControlStream},
    download::fetch,
    error::ConnectError,
};

/// What a client waits for before it is in a world.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum JoinProgress {
    /// The server has not answered yet.
    Connecting,
    /// The server has no world yet, or no time, and says what it does.
    Waiting(String),
    /// The world is being downloaded.
    Download {
        /// The number of bytes received so far.
        done: u64,
        /// The number of all bytes.
        all: u64,
    },
    /// The world is being read.
    Reading,
}

/// Called as a client comes nearer to a world.
pub type ProgressListener = Arc<dyn Fn(JoinProgress) + Send + Sync>;

/// Tells a listener, if there is one.
pub(super) fn tell(progress: Option<&ProgressListener>, step: impl FnOnce() -> JoinProgress) {
    if let Some(progress) = progress {
        progress(step());
    }
}

/// Waits for an offer unless there is one, and gets the world. Whenever the server offers another
/// one meanwhile, that one is got instead.
pub(super) async fn offered_world(
    control: &mut ControlStream,
    cache: &WorldCache,
    offer: Option<WorldOffer>,
    progress: Option<&ProgressListener>,
) -> Result<(WorldOffer, Arc<World>), ConnectError> {
    let ControlStream { connection, sender, receiver } = control;
    let mut offer = match offer {
        Some(offer) => offer,
        None => next_offer(receiver, progress).await?,
    };
    loop {
        tell(progress, || JoinProgress::Reading);
        let fetching = fetch(sender, connection, offer, progress);
        tokio::select! {
            world = cache.get(offer.id, fetching) => return Ok((offer, world?)),
            newer = next_offer(receiver, progress) => offer = newer?,
        }
    }
}

/// Waits for the next offer, however long it takes.
async fn next_offer(
    receiver: &mut ControlReceiver,
    progress: Option<&ProgressListener>,
) -> Result<WorldOffer, ConnectError> {
    loop {
        match receiver.receive().await? {
            ServerMessage::World { number, id, bytes } => {
                return Ok(WorldOffer { number, id: ContentId(id), bytes });
            }
            ServerMessage::Loading { what } => {
                tell(progress, || JoinProgress::Waiting(what.into()));
            }
            // What was said to somebody in another world.
            ServerMessage::Notice { .. } => {}
            ServerMessage::Goodbye { reason, may_return } => {
                return Err(ConnectError::Goodbye { reason: reason.into(), may_return });
            }
            _ => return Err(ReplicaError::OutOfPlace.into()),
        }
    }
}
