//! The way into a world that the server offers: first of all, and whenever it offers another one.

use std::sync::Arc;

use quinn::Connection;
use sightline_client_core::{presence::WorldOffer, replica::ReplicaError};
use sightline_protocol::message::ServerMessage;
use sightline_world::{ContentId, World};

use super::{
    cache::WorldCache,
    control_stream::{ControlReceiver, ControlSender, ControlStream},
    download::fetch,
    error::ConnectError,
    piece_traffic::{PieceStream, PieceTraffic, fetch_head},
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

/// A world that was offered and is here, as a whole or in pieces.
pub(super) struct ArrivedOffer {
    pub(super) number: u32,
    /// The world; without voxels where it comes in pieces.
    pub(super) world: Arc<World>,
    /// Its pieces, and the stream for them if one is open.
    pub(super) pieces: Option<(Arc<PieceTraffic>, Option<PieceStream>)>,
}

/// How a world may come.
#[derive(Clone, Copy)]
pub(super) struct Ways<'a> {
    /// Where worlds are kept.
    pub(super) cache: &'a WorldCache,
    /// Whether it may come in pieces.
    pub(super) in_pieces: bool,
    /// The pieces of the world that the client is in, or was in before its link broke.
    pub(super) present: Option<&'a Arc<PieceTraffic>>,
    pub(super) progress: Option<&'a ProgressListener>,
}

/// Waits for an offer unless there is one, and gets the world. Whenever the server offers another
/// one meanwhile, that one is got instead.
pub(super) async fn offered_world(
    control: &mut ControlStream,
    ways: Ways<'_>,
    offer: Option<WorldOffer>,
) -> Result<ArrivedOffer, ConnectError> {
    let progress = ways.progress;
    let ControlStream { connection, sender, receiver } = control;
    let mut offer = match offer {
        Some(offer) => offer,
        None => next_offer(receiver, progress).await?,
    };
    loop {
        tell(progress, || JoinProgress::Reading);
        tokio::select! {
            arrived = arrive(sender, connection, ways, offer) => return arrived,
            newer = next_offer(receiver, progress) => offer = newer?,
        }
    }
}

/// Gets an offered world.
async fn arrive(
    sender: &mut ControlSender,
    connection: &Connection,
    ways: Ways<'_>,
    offer: WorldOffer,
) -> Result<ArrivedOffer, ConnectError> {
    let number = offer.number;
    if let Some(head) = offer.head.filter(|_| ways.in_pieces) {
        if let Some(traffic) = ways.present.filter(|traffic| traffic.is_of(&head)) {
            let (world, traffic) = (traffic.world.clone(), traffic.clone());
            return Ok(ArrivedOffer { number, world, pieces: Some((traffic, None)) });
        }
        if let Some(world) = ways.cache.find(offer.id).await? {
            return Ok(ArrivedOffer { number, world, pieces: None });
        }
        match fetch_head(connection, number, head, ways.cache.pieces()).await {
            Ok((traffic, stream)) => {
                let world = traffic.world.clone();
                return Ok(ArrivedOffer { number, world, pieces: Some((traffic, stream)) });
            }
            Err(ConnectError::World(error)) => {
                tracing::warn!(%error, "the world cannot be had in pieces: its file is fetched");
            }
            Err(error) => return Err(error),
        }
    }
    let fetching = fetch(sender, connection, offer, ways.progress);
    let world = ways.cache.get(offer.id, fetching).await?;
    Ok(ArrivedOffer { number, world, pieces: None })
}

/// Waits for the next offer, however long it takes.
async fn next_offer(
    receiver: &mut ControlReceiver,
    progress: Option<&ProgressListener>,
) -> Result<WorldOffer, ConnectError> {
    loop {
        match receiver.receive().await? {
            ServerMessage::World { number, id, bytes, head } => {
                return Ok(WorldOffer { number, id: ContentId(id), bytes, head });
            }
            ServerMessage::Loading { what } => {
                tell(progress, || JoinProgress::Waiting(what.into()));
            }
            // What was said to somebody in another world.
            ServerMessage::Notice { .. } | ServerMessage::Stations { .. } => {}
            ServerMessage::Goodbye { reason, may_return } => {
                return Err(ConnectError::Goodbye { reason: reason.into(), may_return });
            }
            _ => return Err(ReplicaError::OutOfPlace.into()),
        }
    }
}
