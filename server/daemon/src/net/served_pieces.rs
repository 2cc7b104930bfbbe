//! The pieces of a served world, and cutting it into them beside the offer.

use std::{
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use bytes::Bytes;
use sightline_compiler::storeys;
use sightline_protocol::message::HeadOffer;
use sightline_visibility::streaming;
use sightline_world::{PieceId, World, WorldHead, WorldPieces};
use tokio::sync::{oneshot, watch};

use super::{
    config::ServeConfig, kept_pieces::KeptPieces, offers::WorldOffer,
    private_geometry::PrivateGeometry, served_world::ServedWorld,
};
use crate::background;

/// The bytes of a block before the head: its content id and its length.
const BEFORE_HEAD_BYTES: usize = 20;

/// The pieces of a world, as they are handed out.
#[derive(Debug)]
pub struct ServedPieces {
    /// One block of memory: the head's content id and length, the head, and the pieces.
    block: Bytes,
    head: Bytes,
    id: PieceId,
    pieces: Vec<Bytes>,
    /// What says who may have which; `None` when everybody may have all.
    private: Option<PrivateGeometry>,
}

impl ServedPieces {
    /// Cuts a world, with plans of these storeys. It takes seconds for a large one.
    fn cut(world: &World, storeys: &[f32]) -> Self {
        let WorldPieces { head, pieces } = streaming::pieces_of(world, storeys);
        let id = PieceId::of(&head);
        let length = (head.len() as u32).to_le_bytes();
        let block = [&id.0[..], &length, &head, &pieces.concat()].concat().into();
        Self::placed(block, id, head.len(), pieces.iter().map(Vec::len))
    }

    /// Reads a [block](Self::block). `None` when it is damaged, or of another version.
    pub(super) fn from_block(block: Bytes) -> Option<Self> {
        let (before, rest) = block.split_first_chunk::<BEFORE_HEAD_BYTES>()?;
        let (id, length) = before.split_first_chunk::<16>()?;
        let length = u32::from_le_bytes(length.try_into().ok()?) as usize;
        let (head, pieces) = rest.split_at_checked(length)?;
        let id = PieceId(*id);
        let read = WorldHead::read(head).ok().filter(|_| PieceId::of(head) == id)?;
        let table = || (0..read.pieces()).filter_map(|number| read.piece(number));
        let lengths = || table().map(|(_, bytes)| bytes as usize);
        if lengths().sum::<usize>() != pieces.len() {
            return None;
        }
        let placed = Self::placed(block, id, length, lengths());
        let is_sound = table().zip(&placed.pieces).all(|((id, _), piece)| PieceId::of(piece) == id);
        is_sound.then_some(placed)
    }

    /// The head and the pieces of these lengths in a block that has exactly them.
    fn placed(
        block: Bytes,
        id: PieceId,
        head: usize,
        lengths: impl Iterator<Item = usize>,
    ) -> Self {
        let mut from = BEFORE_HEAD_BYTES + head;
        let place = |length: usize| {
            from += length;
            block.slice(from - length..from)
        };
        let pieces = lengths.map(place).collect();
        let head = block.slice(BEFORE_HEAD_BYTES..BEFORE_HEAD_BYTES + head);
        Self { head, id, pieces, block, private: None }
    }

    /// The same pieces, which an avatar gets only where it may see them.
    fn private(self, world: &Arc<World>) -> Option<Self> {
        let head = WorldHead::read(&self.head).ok()?;
        Some(Self { private: Some(PrivateGeometry::new(world, head)), ..self })
    }

    /// What says who may have which pieces; `None` when everybody may have all.
    pub(super) fn privacy(&self) -> Option<&PrivateGeometry> {
        self.private.as_ref()
    }

    /// All of it in one block, which can be kept and [read](Self::from_block).
    pub(super) fn block(&self) -> &Bytes {
        &self.block
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

/// How worlds are cut.
#[derive(Clone, Debug)]
pub struct Cutting {
    /// A file with fewer bytes is not cut.
    from_bytes: u64,
    /// Whether avatars get only what they may see. Then all worlds are cut, before they are offered.
    is_private: bool,
    /// Where pieces are kept, if anywhere.
    kept: Option<KeptPieces>,
}

impl Cutting {
    /// How a server of this configuration cuts.
    pub fn new(config: &ServeConfig) -> Self {
        let is_private = config.private_geometry;
        let kept = config.data.as_deref().map(|data| KeptPieces::new(data, is_private));
        Self { from_bytes: config.pieces_from_bytes, is_private, kept }
    }

    /// Prepares a world that is to be offered: it gets the pieces of an earlier run, if they are
    /// kept. Where geometry is private, it is cut now if they are not.
    pub fn prepare(&self, world: ServedWorld) -> ServedWorld {
        // A server beside this one may hand out all pieces of its copy.
        let world = if self.is_private { world.uncut() } else { world };
        if !self.lacks_pieces(&world) {
            return world;
        }
        let kept = self.kept.as_ref().and_then(|kept| kept.load(world.id()));
        if let Some(pieces) = &kept {
            tracing::info!(bytes = pieces.bytes(), "the world was cut before");
        }
        let cut = || {
            let cut = ServedPieces::cut(world.world(), &[]);
            self.keep(&world, &cut);
            cut
        };
        let pieces = match self.is_private {
            true => kept.unwrap_or_else(cut).private(world.world()),
            false => kept,
        };
        if let Some(pieces) = pieces {
            world.set_pieces(Arc::new(pieces));
        }
        world
    }

    fn keep(&self, world: &ServedWorld, pieces: &ServedPieces) {
        let kept = self.kept.as_ref().map(|kept| kept.store(world.id(), pieces));
        if let Some(Err(error)) = kept {
            tracing::warn!(%error, "the pieces are not kept: the next start cuts again");
        }
    }

    /// Cuts each world that is offered, one at a time. Until a world is cut, clients that come get
    /// its file.
    pub async fn cut_offered(self, mut offers: watch::Receiver<Option<WorldOffer>>) {
        offers.mark_changed();
        while offers.changed().await.is_ok() {
            let world = offers.borrow_and_update().as_ref().map(|offer| offer.world.clone());
            let is_due = |world: &ServedWorld| !self.is_private && self.lacks_pieces(world);
            if let Some(world) = world.filter(is_due) {
                cut_beside(world, self.clone()).await;
            }
        }
    }

    fn lacks_pieces(&self, world: &ServedWorld) -> bool {
        let is_cut = self.is_private || world.bytes().len() as u64 >= self.from_bytes;
        world.pieces().is_none() && is_cut
    }
}

/// Cuts a world on a thread of its own, which a server that ends does not wait for.
async fn cut_beside(world: ServedWorld, cutting: Cutting) {
    let (send, cut) = oneshot::channel();
    let started = Instant::now();
    let spawned = thread::Builder::new().name("pieces".into()).spawn(move || {
        // Without a thread of a lower priority nothing is sent.
        let Ok(beside) = background::threads(1) else { return };
        let cut = || ServedPieces::cut(world.world(), &storeys(world.world()));
        let pieces = Arc::new(beside.install(cut));
        world.set_pieces(pieces.clone());
        // Nobody waits any more when the server has ended.
        let _ = send.send(pieces.bytes());
        cutting.keep(&world, &pieces);
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
            let cutting = Cutting { from_bytes, is_private: false, kept: None };
            let task = tokio::spawn(cutting.cut_offered(receiver.clone()));
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
        let pieces = ServedPieces::cut(&voxel_floor::world(&[]), &[0.125]);
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

    #[tokio::test]
    async fn a_second_start_has_the_pieces_before_it_offers_the_world() {
        let data = tempfile::tempdir().unwrap();
        let config = ServeConfig {
            data: Some(data.path().to_owned()),
            pieces_from_bytes: 0,
            ..ServeConfig::default()
        };
        let cutting = Cutting::new(&config);
        let offered = || offer(1).unwrap().world;
        let first = cutting.prepare(offered());
        assert!(first.pieces().is_none(), "nothing is kept");
        cut_beside(first.clone(), cutting.clone()).await;
        let kept = || cutting.kept.as_ref().unwrap().load(first.id()).is_some();
        while !kept() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        let second = cutting.prepare(offered());
        let [one, other] = [&first, &second].map(|world| world.pieces().unwrap());
        assert_eq!(one.block(), other.block());
        assert_eq!((&one.pieces, one.id), (&other.pieces, other.id));
        let large = Cutting { from_bytes: 1 << 30, ..cutting.clone() };
        let third = large.prepare(offered());
        assert!(third.pieces().is_none(), "it arrives as a whole");
    }

    #[test]
    fn a_damaged_block_is_no_pieces() {
        let block = ServedPieces::cut(&voxel_floor::world(&[]), &[]).block().to_vec();
        let head = u32::from_le_bytes(block[16..20].try_into().unwrap()) as usize;
        for at in [0, 17, 30, BEFORE_HEAD_BYTES + head + 5, block.len() - 1] {
            let mut damaged = block.clone();
            damaged[at] ^= 1;
            assert!(ServedPieces::from_block(damaged.into()).is_none(), "{at}");
        }
        for end in [0, 10, 40, block.len() - 1] {
            assert!(ServedPieces::from_block(block[..end].to_vec().into()).is_none(), "{end}");
        }
        assert!(ServedPieces::from_block([&block[..], &[0]].concat().into()).is_none());
        assert!(ServedPieces::from_block(block.into()).is_some());
    }
}
