//! The pieces of a served world, and cutting it into them beside the offer.

use std::{
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use bytes::Bytes;
use sightline_protocol::message::HeadOffer;
use sightline_visibility::streaming;
use sightline_world::{PieceId, World, WorldPieces};
use tokio::sync::{oneshot, watch};

use super::{offers::WorldOffer, served_world::ServedWorld};
use crate::background;

/// The pieces of a world, as they are handed out. They are one block of memory.
#[derive(Debug)]
pub struct ServedPieces {
    head: Bytes,
    id: PieceId,
    pieces: Vec<Bytes>,
}

impl ServedPieces {
    /// Cuts a world. It takes seconds for a large one.
    fn cut(world: &World) -> Self {
        let WorldPieces { head, pieces } = streaming::pieces_of(world);
        let id = PieceId::of(&head);
        let all = Bytes::from(pieces.concat());
        let mut from = 0;
        let place = |piece: &Vec<u8>| {
            let to = from + piece.len();
            let place = all.slice(from..to);
            from = to;
            place
        };
        Self { head: head.into(), id, pieces: pieces.iter().map(place).collect() }
    }

    /// The head.
    pub fn head(&self) -> &Bytes {
        &self.head
    }

    /// The content id of the head.
    #[cfg(feature = "web")]
    pub fn id(&self) -> PieceId {
        self.id
    }

    /// A piece, if there is one of this number.
    pub fn piece(&self, number: u32) -> Option<&Bytes> {
        self.pieces.get(number as usize)
    }

    /// The bytes of all pieces and the head.
    pub fn bytes(&self) -> usize {
        self.head.len() + self.pieces.iter().map(Bytes::len).sum::<usize>()
    }

    /// What tells clients of them; `None` when the head is too long to be sent.
    pub fn offer(&self) -> Option<HeadOffer> {
        Some(HeadOffer { id: self.id.0, bytes: self.head.len().try_into().ok()? })
    }
}

/// Cuts each world that is offered, one at a time, if its file has at least `from_bytes`. Until a
/// world is cut, clients that come get its file.
pub async fn cut_offered(mut offers: watch::Receiver<Option<WorldOffer>>, from_bytes: u64) {
    offers.mark_changed();
    while offers.changed().await.is_ok() {
        let world = offers.borrow_and_update().as_ref().map(|offer| offer.world.clone());
        let is_large = |world: &ServedWorld| world.bytes().len() as u64 >= from_bytes;
        if let Some(world) = world.filter(|world| is_large(world) && world.pieces().is_none()) {
            cut_beside(world).await;
        }
    }
}

/// Cuts a world on a thread of its own, which a server that ends does not wait for.
async fn cut_beside(world: ServedWorld) {
    let (send, cut) = oneshot::channel();
    let started = Instant::now();
    let spawned = thread::Builder::new().name("pieces".into()).spawn(move || {
        background::lower_priority();
        let pieces = Arc::new(ServedPieces::cut(world.world()));
        let bytes = pieces.bytes();
        world.set_pieces(pieces);
        // Nobody waits any more when the server has ended.
        let _ = send.send(bytes);
    });
    match (spawned, cut.await) {
        (Ok(_), Ok(bytes)) => tell(started.elapsed(), bytes),
        (Ok(_), Err(_)) => tracing::error!("the world cannot be cut: clients get its file"),
        (Err(error), _) => tracing::warn!(%error, "the world is not cut: clients get its file"),
    }
}

fn tell(took: Duration, bytes: usize) {
    tracing::info!(seconds = took.as_secs_f64(), bytes, "the world can be had in pieces");
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor;
    use sightline_world::WorldHead;
    use tokio::time::timeout;

    use super::*;

    fn offer(number: u32) -> Option<WorldOffer> {
        let world = ServedWorld::from_world(Arc::new(voxel_floor::world(&[])));
        Some(WorldOffer { number, world })
    }

    #[tokio::test]
    async fn worlds_are_cut_while_they_are_offered_but_not_small_ones() {
        let (sender, receiver) = watch::channel(None);
        let bytes = offer(1).unwrap().world.bytes().len() as u64;
        for (from_bytes, is_cut) in [(bytes, true), (bytes + 1, false)] {
            let task = tokio::spawn(cut_offered(receiver.clone(), from_bytes));
            sender.send_replace(offer(1));
            let world = sender.borrow().as_ref().unwrap().world.clone();
            let cut = async {
                while world.pieces().is_none() {
                    tokio::time::sleep(Duration::from_millis(5)).await;
                }
            };
            let patience = Duration::from_millis(if is_cut { 60_000 } else { 300 });
            assert_eq!(timeout(patience, cut).await.is_ok(), is_cut);
            task.abort();
        }
    }

    #[test]
    fn the_head_that_is_offered_tells_of_all_pieces() {
        let pieces = ServedPieces::cut(&voxel_floor::world(&[]));
        let head = WorldHead::read(pieces.head()).unwrap();
        let offer = pieces.offer().unwrap();
        assert_eq!(offer.id, PieceId::of(pieces.head()).0);
        assert_eq!(offer.bytes as usize, pieces.head().len());
        for number in 0..head.pieces() {
            let piece = pieces.piece(number as u32).unwrap();
            assert_eq!(head.piece(number), Some((PieceId::of(piece), piece.len() as u32)));
        }
        assert!(pieces.piece(head.pieces() as u32).is_none());
    }
}
