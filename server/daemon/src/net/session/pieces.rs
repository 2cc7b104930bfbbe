//! The stream by which a native client gets pieces of the world, beside the conversation with it.

use std::{
    pin::Pin,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU32, Ordering::Relaxed},
    },
    time::Duration,
};

use bytes::Bytes;
use sightline_protocol::{
    DecodeError,
    piece_stream::{
        BEGIN_BYTES, COUNT_BYTES, HEAD, NUMBER_BYTES, REFUSED, before_piece, request_count,
        request_numbers,
    },
};
use tokio::time::{sleep, timeout};

use super::{
    super::{budget::TokenBucket, served_pieces::ServedPieces, transport::PieceStream},
    Session, SessionEnd,
};
use crate::operate::Reason;

/// How often it is looked whether a client may get more.
const LOOK: Duration = Duration::from_millis(50);

/// The work of answering the requests on a stream.
type HandingOut<'a> = Pin<Box<dyn Future<Output = Result<(), SessionEnd>> + Send + 'a>>;

/// Pieces that a client asks for, with their numbers.
type Asked = Vec<(u32, Bytes)>;
/// The number of a piece, and its bytes unless it is refused.
type Answer = (u32, Option<Bytes>);

/// What a client was given on all its streams.
#[derive(Default)]
struct Given {
    /// The number of the world whose head it was given last.
    head_of: AtomicU32,
    /// What it may be given of a world, and the number of that.
    budget: Mutex<Option<(u32, TokenBucket)>>,
}

impl Given {
    /// Whether this number of bytes of a world of `all` bytes may be given now. All of it may be
    /// given at once, and then as many bytes in a second as the limit says: a client that drops
    /// some needs them again.
    fn may_take(&self, world: u32, bytes: usize, all: usize, per_s: u32, now: Duration) -> bool {
        let mut budget = self.budget.lock().unwrap_or_else(PoisonError::into_inner);
        if budget.as_ref().is_none_or(|(of, _)| *of != world) {
            *budget = Some((world, TokenBucket::new(per_s.into(), all.max(1) as f64, now)));
        }
        budget.as_mut().is_some_and(|(_, budget)| budget.take(bytes as f64, now))
    }
}

impl Session<'_> {
    /// Hands out pieces, until the client breaks the protocol. A new stream takes the place of the
    /// one before.
    pub(super) async fn hand_out_pieces(&self) -> SessionEnd {
        let given = Given::default();
        let mut stream: Option<HandingOut<'_>> = None;
        loop {
            let ended = async {
                match &mut stream {
                    Some(stream) => stream.await,
                    None => std::future::pending().await,
                }
            };
            let next = tokio::select! {
                next = self.client.transport.piece_stream() => Some(next),
                ended = ended => match ended {
                    Ok(()) => None,
                    Err(end) => return end,
                },
            };
            stream = match next {
                Some(Ok(next)) => Some(Box::pin(self.hand_out(next, &given))),
                Some(Err(error)) => return error.into(),
                None => None,
            };
        }
    }

    /// Answers the requests on a stream. Ends when the client ends it, the world is offered no
    /// more, or the client takes too long.
    async fn hand_out(&self, mut stream: PieceStream, given: &Given) -> Result<(), SessionEnd> {
        let mut begin = [0; BEGIN_BYTES];
        if stream.read(&mut begin).await.is_none() {
            return Ok(());
        }
        let world = u32::from_le_bytes(begin);
        let Some(offer) = self.offer_of(world)? else { return Ok(()) };
        let Some(pieces) = offer.world.pieces() else {
            return Err(SessionEnd::Breach("the world is not offered in pieces"));
        };
        let limits = &self.state.config.limits;
        let all = pieces.bytes();
        loop {
            let mut count = [0; COUNT_BYTES];
            if stream.read(&mut count).await.is_none() {
                return Ok(());
            }
            let mut numbers = vec![0; request_count(count)? * NUMBER_BYTES];
            if stream.read(&mut numbers).await.is_none() {
                return Ok(());
            }
            if self.offer_of(world)?.is_none() {
                return Ok(());
            }
            let asked = asked(pieces, &numbers)?;
            let bytes = asked.iter().map(|(_, piece)| piece.len()).sum::<usize>();
            if bytes > all {
                return Err(SessionEnd::Breach("a request for more than the world has"));
            }
            if asked.iter().any(|(number, _)| *number == HEAD) {
                self.allow_for_head(world, bytes, given);
            }
            let asked = self.private_share(pieces, asked).await;
            let bytes = asked.iter().flat_map(|(_, piece)| piece).map(Bytes::len).sum();
            self.wait_for(given, world, [bytes, all]).await;
            let sent = timeout(limits.download_time(bytes), self.send_pieces(&mut stream, asked));
            match sent.await {
                Ok(Some(())) => {}
                Ok(None) => return Ok(()),
                Err(_) => {
                    self.client.count_refusal(Reason::Download);
                    return Ok(());
                }
            }
        }
    }

    /// Gives a client that has not entered the time to receive a head, once for each world.
    fn allow_for_head(&self, world: u32, bytes: usize, given: &Given) {
        if given.head_of.swap(world, Relaxed) != world
            && self.entered.load(Relaxed) != world
            && let Some(deadline) = &mut self.limits().deadline
        {
            *deadline += self.state.config.limits.download_time(bytes);
        }
    }

    /// Waits until the client may be given `bytes` of a world that has `all`.
    async fn wait_for(&self, given: &Given, world: u32, [bytes, all]: [usize; 2]) {
        let per_s = self.state.config.limits.piece_bytes_per_s;
        let mut is_counted = false;
        while !given.may_take(world, bytes, all, per_s, self.state.now()) {
            if !is_counted {
                self.client.count_refusal(Reason::Pieces);
                is_counted = true;
            }
            sleep(LOOK).await;
        }
    }

    /// The pieces of a request, without those that the avatar may not have now.
    async fn private_share(&self, pieces: &ServedPieces, asked: Asked) -> Vec<Answer> {
        let Some(privacy) = pieces.privacy() else {
            return asked.into_iter().map(|(number, piece)| (number, Some(piece))).collect();
        };
        let whereabouts = self.state.whereabouts(self.client.avatar()).await;
        let may = whereabouts.map(|at| privacy.branches(&at)).unwrap_or_default();
        let answer = |(number, piece)| {
            let is_had = number == HEAD || privacy.is_of(number, &may);
            if !is_had {
                self.client.count_refusal(Reason::PrivateGeometry);
            }
            (number, Some(piece).filter(|_| is_had))
        };
        asked.into_iter().map(answer).collect()
    }

    /// Sends pieces, or that they are refused. `None` when the client does not take them.
    async fn send_pieces(&self, stream: &mut PieceStream, answers: Vec<Answer>) -> Option<()> {
        for (number, piece) in answers {
            let Some(piece) = piece else {
                let refused = before_piece(number, REFUSED);
                stream.write(Bytes::copy_from_slice(&refused)).await?;
                continue;
            };
            let bytes = piece.len();
            let before = before_piece(number, bytes as u32);
            stream.write(Bytes::copy_from_slice(&before)).await?;
            stream.write(piece).await?;
            self.client.count_world_out(bytes);
        }
        Some(())
    }
}

/// The pieces of a request.
fn asked(pieces: &ServedPieces, numbers: &[u8]) -> Result<Asked, SessionEnd> {
    let of = |number| match number {
        HEAD => Some(pieces.head()),
        number => pieces.piece(number),
    };
    let piece = |number| of(number).map(|piece| (number, piece.clone()));
    request_numbers(numbers)
        .map(|number| piece(number).ok_or(SessionEnd::Malformed(DecodeError::Malformed)))
        .collect()
}
