//! The download of the world that is served, by its content id.

use std::{
    convert::Infallible,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll},
};

use axum::{
    body::Body,
    extract::{Extension, Path, State},
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};
use bytes::Bytes;
use hyper::body::{Frame, SizeHint};

use super::{
    host,
    routes::{Site, Visitor},
};
use crate::http::ConnectionPlace;

/// The size of the pieces in which the world is sent, in bytes.
const PIECE_BYTES: usize = 64 * 1_024;
/// A content id never means another world.
const IMMUTABLE: &str = "public, max-age=31536000, immutable";

/// `GET /world/ID`: the file as native clients get it.
pub(super) async fn world(
    State(site): State<Arc<Site>>,
    Extension(visitor): Extension<Visitor>,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Response {
    let served = site.door.world().filter(|world| world.id().to_string() == id);
    let Some(world) = served else {
        return (StatusCode::NOT_FOUND, "this world is not served\n").into_response();
    };
    let tag = format!("\"{id}\"");
    let caching = [(header::CACHE_CONTROL, IMMUTABLE), (header::ETAG, &tag)];
    if host::text(headers.get(header::IF_NONE_MATCH)) == Some(&tag) {
        return (StatusCode::NOT_MODIFIED, caching).into_response();
    }
    let place = match site.downloads.begin(visitor.address.ip()) {
        Ok(place) => place,
        Err(reason) => {
            site.door.count_refusal(reason);
            let said = "too many others download the world: try again soon\n";
            return (StatusCode::SERVICE_UNAVAILABLE, [(header::RETRY_AFTER, "2")], said)
                .into_response();
        }
    };
    let body = Download { rest: world.bytes().clone(), site, _place: place };
    let kind = [(header::CONTENT_TYPE, "application/octet-stream")];
    (caching, kind, Body::new(body)).into_response()
}

/// A world's bytes, piece by piece. It counts as a download until the last one is taken.
struct Download {
    rest: Bytes,
    site: Arc<Site>,
    _place: ConnectionPlace,
}

impl hyper::body::Body for Download {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        _: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        if self.rest.is_empty() {
            return Poll::Ready(None);
        }
        let bytes = self.rest.len().min(PIECE_BYTES);
        let piece = self.rest.split_to(bytes);
        self.site.door.count_world_out(bytes);
        Poll::Ready(Some(Ok(Frame::data(piece))))
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty()
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.rest.len() as u64)
    }
}
