//! Pieces of the world on their way: a window asks for them, and they come on a stream of their
//! own.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use quinn::{Connection, RecvStream, SendStream};
use sightline_protocol::{
    message::HeadOffer,
    piece_stream::{BEFORE_PIECE_BYTES, HEAD, REFUSED, read_before_piece, requests},
};
use sightline_world::{PieceId, ReadError, World, WorldHead};
use tokio::{
    sync::Notify,
    time::{sleep, timeout},
};

use super::{
    cache::blocking,
    error::{ConnectError, lost},
    piece_store::PieceStore,
};

/// The time within which a head must begin to arrive, and within which each chunk must.
const CHUNK_DEADLINE: Duration = Duration::from_secs(20);
/// The longest head that is fetched: 64 MiB.
const HEAD_BYTES_MAX: u32 = 1 << 26;
/// A stream that the server has ended is opened again after so long.
const PAUSE: Duration = Duration::from_secs(1);

/// The pieces of one world on their way to a window. It outlasts connections: what has not come is
/// asked for again on the next one.
#[derive(Debug)]
pub(super) struct PieceTraffic {
    /// The world without voxels.
    pub(super) world: Arc<World>,
    id: PieceId,
    /// The ids and lengths of the pieces.
    table: Vec<(PieceId, u32)>,
    /// Where pieces are kept on disk.
    store: Option<PieceStore>,
    waiting: Mutex<Waiting>,
    asked: Notify,
}

#[derive(Debug, Default)]
struct Waiting {
    /// The head, until a window takes it.
    head: Option<WorldHead>,
    /// What was asked for and is not here, in order.
    missing: VecDeque<u32>,
    /// How many of the last of them were not asked for on this stream.
    unsent: usize,
    arrived: Vec<(usize, Vec<u8>)>,
    refused: Vec<usize>,
}

impl Waiting {
    /// A piece is missing no more.
    fn strike(&mut self, number: u32) {
        if let Some(at) = self.missing.iter().position(|missing| *missing == number) {
            self.missing.remove(at);
        }
    }
}

impl PieceTraffic {
    fn new(head: WorldHead, id: PieceId, store: Option<PieceStore>) -> Self {
        let table = (0..head.pieces()).filter_map(|number| head.piece(number)).collect();
        let world = head.world.clone();
        let waiting = Mutex::new(Waiting { head: Some(head), ..Waiting::default() });
        Self { world, id, table, store, waiting, asked: Notify::new() }
    }

    /// Whether these are the pieces that are offered by a head.
    pub(super) fn is_of(&self, head: &HeadOffer) -> bool {
        self.id.0 == head.id
    }

    /// The head, once.
    pub(super) fn take_head(&self) -> Option<WorldHead> {
        self.waiting().head.take()
    }

    /// Asks for pieces. Numbers that there are not are ignored.
    pub(super) fn ask(&self, numbers: &[usize]) {
        let mut waiting = self.waiting();
        let known = numbers.iter().filter(|number| **number < self.table.len());
        for number in known.filter_map(|number| u32::try_from(*number).ok()) {
            waiting.missing.push_back(number);
            waiting.unsent += 1;
        }
        drop(waiting);
        self.asked.notify_one();
    }

    /// The pieces that have come since the last call.
    pub(super) fn take_arrived(&self) -> Vec<(usize, Vec<u8>)> {
        std::mem::take(&mut self.waiting().arrived)
    }

    /// The pieces that the server did not hand out since the last call.
    pub(super) fn take_refused(&self) -> Vec<usize> {
        std::mem::take(&mut self.waiting().refused)
    }

    /// On a new stream, all that is missing is to be asked for.
    fn begin(&self) {
        let mut waiting = self.waiting();
        waiting.unsent = waiting.missing.len();
        drop(waiting);
        self.asked.notify_one();
    }

    /// Waits until something is to be asked for on the stream.
    async fn next_numbers(&self) -> Vec<u32> {
        loop {
            {
                let mut waiting = self.waiting();
                let sent = waiting.missing.len() - waiting.unsent;
                if waiting.unsent > 0 {
                    waiting.unsent = 0;
                    return waiting.missing.range(sent..).copied().collect();
                }
            }
            self.asked.notified().await;
        }
    }

    /// Takes in those pieces that are on disk. Returns the numbers of the others.
    async fn take_kept(&self, numbers: Vec<u32>) -> Vec<u32> {
        let Some(store) = self.store.clone() else { return numbers };
        let id = |number: u32| self.table.get(number as usize).map(|(id, _)| (number, *id));
        let wanted: Vec<(u32, PieceId)> = numbers.iter().filter_map(|number| id(*number)).collect();
        let load = move || {
            let piece = |(number, id)| (number, store.load(id));
            Ok(wanted.into_iter().map(piece).collect::<Vec<_>>())
        };
        let Ok(looked) = blocking(load).await else { return numbers };
        let mut missing = Vec::new();
        for (number, piece) in looked {
            let is_kept = piece.is_some_and(|piece| self.arrive(number, piece).is_ok());
            if !is_kept {
                missing.push(number);
            }
        }
        missing
    }

    /// Keeps a piece on disk, beside the connection.
    fn keep(&self, number: u32, piece: &[u8]) {
        if let (Some(store), Some((id, _))) = (&self.store, self.table.get(number as usize)) {
            let (store, id, piece) = (store.clone(), *id, piece.to_vec());
            tokio::task::spawn_blocking(move || store.keep(id, &piece));
        }
    }

    /// The length of a piece that was asked for on this stream.
    fn expected(&self, number: u32) -> Option<u32> {
        let waiting = self.waiting();
        let sent = waiting.missing.len() - waiting.unsent;
        let is_expected = waiting.missing.range(..sent).any(|missing| *missing == number);
        self.table.get(number as usize).filter(|_| is_expected).map(|(_, bytes)| *bytes)
    }

    /// Takes in a piece.
    fn arrive(&self, number: u32, piece: Vec<u8>) -> Result<(), ReadError> {
        let id = self.table.get(number as usize).map(|(id, _)| *id);
        if id != Some(PieceId::of(&piece)) {
            return Err(ReadError::Damaged);
        }
        let mut waiting = self.waiting();
        waiting.strike(number);
        waiting.arrived.push((number as usize, piece));
        Ok(())
    }

    /// Takes in that the server does not hand out a piece now.
    fn refuse(&self, number: u32) {
        let mut waiting = self.waiting();
        waiting.strike(number);
        waiting.refused.push(number as usize);
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        // No panic while the lock is held leaves this half changed.
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A stream by which pieces of a world come.
pub(super) struct PieceStream {
    to: SendStream,
    from: RecvStream,
}

/// Why nothing more comes on a stream.
enum StreamEnd {
    /// The server ended it, or the connection broke.
    Ended,
    /// What came is no answer.
    Faulty(ConnectError),
}

impl PieceStream {
    /// Opens a stream for the pieces of an offered world.
    async fn open(connection: &Connection, world: u32) -> Result<Self, ConnectError> {
        let (mut to, from) = connection.open_bi().await.map_err(lost)?;
        let begun = to.write_all(&world.to_le_bytes()).await;
        begun.map_err(|error| ConnectError::Lost(error.to_string()))?;
        Ok(Self { to, from })
    }

    /// Carries pieces until the stream ends.
    async fn carry(self, traffic: &PieceTraffic) -> StreamEnd {
        let Self { mut to, mut from } = self;
        let ask = async {
            loop {
                let numbers = traffic.next_numbers().await;
                let numbers = traffic.take_kept(numbers).await;
                if to.write_all(&requests(&numbers)).await.is_err() {
                    return StreamEnd::Ended;
                }
            }
        };
        let receive = async {
            loop {
                let (number, bytes) = match receive_before(&mut from).await {
                    Some(before) => before,
                    None => return StreamEnd::Ended,
                };
                if bytes == REFUSED && traffic.expected(number).is_some() {
                    traffic.refuse(number);
                    continue;
                }
                if traffic.expected(number) != Some(bytes) {
                    return StreamEnd::Faulty(ReadError::Damaged.into());
                }
                let Some(piece) = receive_bytes(&mut from, bytes).await else {
                    return StreamEnd::Ended;
                };
                traffic.keep(number, &piece);
                if let Err(error) = traffic.arrive(number, piece) {
                    return StreamEnd::Faulty(error.into());
                }
            }
        };
        tokio::select! {
            end = ask => end,
            end = receive => end,
        }
    }
}

/// Carries the pieces of a world that is offered on a connection, by this stream and by later ones.
/// Ends when what comes is no answer; otherwise it is to be dropped with the connection.
pub(super) async fn carry(
    connection: Connection,
    world: u32,
    traffic: Arc<PieceTraffic>,
    mut stream: Option<PieceStream>,
) -> ConnectError {
    loop {
        let opened = match stream.take() {
            Some(stream) => Ok(stream),
            None => PieceStream::open(&connection, world).await,
        };
        if let Ok(stream) = opened {
            traffic.begin();
            if let StreamEnd::Faulty(error) = stream.carry(&traffic).await {
                return error;
            }
        }
        // The world is offered no more, or the connection broke: whoever began this learns of it.
        sleep(PAUSE).await;
    }
}

/// Gets the head of an offered world, from disk or by a stream for its pieces.
///
/// # Errors
/// When it does not come in time, or is none.
pub(super) async fn fetch_head(
    connection: &Connection,
    world: u32,
    offer: HeadOffer,
    store: Option<&PieceStore>,
) -> Result<(Arc<PieceTraffic>, Option<PieceStream>), ConnectError> {
    let id = PieceId(offer.id);
    if let Some(kept) = store.cloned() {
        let read = {
            let kept = kept.clone();
            blocking(move || kept.load(id).map(|head| WorldHead::read(&head)).transpose())
        };
        // Nobody waits for old ones to be removed.
        tokio::task::spawn_blocking(move || kept.prune());
        if let Ok(Some(head)) = read.await {
            return Ok((Arc::new(PieceTraffic::new(head, id, store.cloned())), None));
        }
    }
    if offer.bytes > HEAD_BYTES_MAX {
        return Err(ConnectError::WorldTooLarge(offer.bytes.into()));
    }
    let mut stream = PieceStream::open(connection, world).await?;
    let asked = stream.to.write_all(&requests(&[HEAD])).await;
    asked.map_err(|error| ConnectError::Lost(error.to_string()))?;
    let Some(before) = receive_before(&mut stream.from).await else { return overtaken().await };
    if before != (HEAD, offer.bytes) {
        return Err(ReadError::Damaged.into());
    }
    let Some(head) = receive_bytes(&mut stream.from, offer.bytes).await else {
        return overtaken().await;
    };
    let keeps = store.cloned();
    let read = blocking(move || {
        if PieceId::of(&head) != id {
            return Err(ReadError::Damaged);
        }
        if let Some(store) = keeps {
            store.keep(id, &head);
        }
        WorldHead::read(&head)
    });
    Ok((Arc::new(PieceTraffic::new(read.await?, id, store.cloned())), Some(stream)))
}

/// The server ended the stream. If it is because it offers another world, that offer follows.
async fn overtaken<T>() -> Result<T, ConnectError> {
    sleep(CHUNK_DEADLINE).await;
    Err(ConnectError::Lost("the head of the world did not arrive".to_owned()))
}

/// The number and the length of the next piece; `None` when the stream ends. It may be a long time
/// until one is asked for.
async fn receive_before(from: &mut RecvStream) -> Option<(u32, u32)> {
    let mut before = [0; BEFORE_PIECE_BYTES];
    from.read_exact(&mut before).await.ok()?;
    Some(read_before_piece(before))
}

/// Receives a number of bytes; `None` when the stream ends before, or stops. Memory grows with what
/// arrives.
async fn receive_bytes(from: &mut RecvStream, bytes: u32) -> Option<Vec<u8>> {
    let all = bytes as usize;
    let mut received = Vec::new();
    while received.len() < all {
        let chunk = timeout(CHUNK_DEADLINE, from.read_chunk(all - received.len(), true));
        received.extend_from_slice(&chunk.await.ok()?.ok()??.bytes);
    }
    Some(received)
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor;
    use sightline_visibility::streaming::pieces_of;

    use super::*;

    #[tokio::test]
    async fn what_has_not_come_is_asked_for_again_on_the_next_stream() {
        let cut = pieces_of(&voxel_floor::world(&[]), &[]);
        let id = PieceId::of(&cut.head);
        let traffic = PieceTraffic::new(WorldHead::read(&cut.head).unwrap(), id, None);
        assert!(traffic.is_of(&HeadOffer { id: id.0, bytes: 0 }));
        assert!(traffic.take_head().is_some() && traffic.take_head().is_none());
        traffic.ask(&[3, 1, 900]);
        assert_eq!(traffic.next_numbers().await, [3, 1]);
        traffic.ask(&[2]);
        assert_eq!(traffic.expected(3), Some(cut.pieces[3].len() as u32));
        assert_eq!((traffic.expected(2), traffic.expected(0)), (None, None), "not asked for here");
        assert_eq!(traffic.next_numbers().await, [2]);
        assert!(traffic.arrive(3, cut.pieces[2].clone()).is_err(), "another piece");
        traffic.arrive(3, cut.pieces[3].clone()).unwrap();
        assert_eq!(traffic.take_arrived(), [(3, cut.pieces[3].clone())]);
        traffic.begin();
        assert_eq!(traffic.next_numbers().await, [1, 2]);
        assert!(traffic.take_arrived().is_empty());
        traffic.refuse(1);
        assert_eq!((traffic.take_refused(), traffic.expected(1)), (vec![1], None));
        traffic.begin();
        assert_eq!(traffic.next_numbers().await, [2], "it is not missing");
    }

    #[tokio::test]
    async fn what_is_on_disk_is_not_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let store = PieceStore::new(folder.path().to_owned());
        let cut = pieces_of(&voxel_floor::world(&[]), &[]);
        let id = PieceId::of(&cut.head);
        let head = WorldHead::read(&cut.head).unwrap();
        let traffic = PieceTraffic::new(head, id, Some(store.clone()));
        store.keep(PieceId::of(&cut.pieces[1]), &cut.pieces[1]);
        traffic.ask(&[0, 1]);
        let numbers = traffic.next_numbers().await;
        assert_eq!(traffic.take_kept(numbers).await, [0]);
        assert_eq!(traffic.take_arrived(), [(1, cut.pieces[1].clone())]);
        traffic.keep(0, &cut.pieces[0]);
        while store.load(PieceId::of(&cut.pieces[0])).is_none() {
            sleep(Duration::from_millis(5)).await;
        }
        traffic.begin();
        assert!(traffic.take_kept(traffic.next_numbers().await).await.is_empty());
    }
}
