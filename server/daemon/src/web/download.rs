//! What is sent of a world, in chunks that are counted.

use std::{
    convert::Infallible,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll},
};

use bytes::Bytes;
use hyper::body::{Body, Frame, SizeHint};

use super::routes::Site;
use crate::http::ConnectionPlace;

/// The most bytes of a chunk.
const CHUNK_BYTES: usize = 64 * 1_024;
/// A content id never means something else.
pub(super) const IMMUTABLE: &str = "public, max-age=31536000, immutable";

/// Bytes of a world, chunk by chunk. It keeps its place until the last one is taken.
pub(super) struct Download {
    /// What is left, the last part first.
    parts: Vec<Bytes>,
    left: usize,
    site: Arc<Site>,
    _place: Option<ConnectionPlace>,
}

impl Download {
    /// Sends parts one after the other.
    pub(super) fn new(
        mut parts: Vec<Bytes>,
        site: Arc<Site>,
        place: Option<ConnectionPlace>,
    ) -> Self {
        parts.retain(|part| !part.is_empty());
        parts.reverse();
        let left = parts.iter().map(Bytes::len).sum();
        Self { parts, left, site, _place: place }
    }
}

impl Body for Download {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        _: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        let Some(part) = self.parts.last_mut() else { return Poll::Ready(None) };
        let bytes = part.len().min(CHUNK_BYTES);
        let chunk = part.split_to(bytes);
        if part.is_empty() {
            self.parts.pop();
        }
        self.left = self.left.saturating_sub(bytes);
        self.site.door.count_world_out(bytes);
        Poll::Ready(Some(Ok(Frame::data(chunk))))
    }

    fn is_end_stream(&self) -> bool {
        self.parts.is_empty()
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.left as u64)
    }
}
