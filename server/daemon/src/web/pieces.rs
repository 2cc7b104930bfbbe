//! Pieces of the world that is served, by the content id of their head.

use std::sync::Arc;

use axum::{
    body::Body,
    extract::{Extension, Path, State},
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};
use bytes::Bytes;
use sightline_protocol::piece_stream::REQUEST_MAX;

use super::{
    download::{Download, IMMUTABLE},
    host,
    routes::{Site, Visitor},
};
use crate::net::ServedPieces;

/// The name by which the head is asked for.
const HEAD: &str = "head";

/// `GET /pieces/ID/head` and `GET /pieces/ID/3,4,9`: the head of that id, and pieces of its world
/// by their numbers, one after the other.
pub(super) async fn pieces(
    State(site): State<Arc<Site>>,
    Extension(visitor): Extension<Visitor>,
    Path((id, wanted)): Path<(String, String)>,
    headers: HeaderMap,
) -> Response {
    let served = site.door.world().and_then(|world| world.pieces().cloned());
    let Some(pieces) = served.filter(|pieces| pieces.id().to_string() == id) else {
        return (StatusCode::NOT_FOUND, "these pieces are not served\n").into_response();
    };
    let Some(parts) = parts(&pieces, &wanted) else {
        return (StatusCode::BAD_REQUEST, "name up to 256 pieces of this world\n").into_response();
    };
    // What the head's id and numbers mean never changes.
    let tag = format!("\"{id}\"");
    let caching = [(header::CACHE_CONTROL, IMMUTABLE), (header::ETAG, &tag)];
    if host::text(headers.get(header::IF_NONE_MATCH)) == Some(&tag) {
        return (StatusCode::NOT_MODIFIED, caching).into_response();
    }
    // A head is what newcomers download; pieces are for those who are in.
    let place = match (wanted == HEAD).then(|| site.downloads.begin(visitor.address.ip())) {
        Some(Err(reason)) => return site.refuse_download(reason),
        Some(Ok(place)) => Some(place),
        None => None,
    };
    let kind = [(header::CONTENT_TYPE, "application/octet-stream")];
    (caching, kind, Body::new(Download::new(parts, site, place))).into_response()
}

/// The bytes that are wanted; `None` when there are no such pieces, or too many.
fn parts(pieces: &ServedPieces, wanted: &str) -> Option<Vec<Bytes>> {
    if wanted == HEAD {
        return Some(vec![pieces.head().clone()]);
    }
    let piece = |number: &str| pieces.piece(number.parse().ok()?).cloned();
    let numbers = wanted.split(',');
    // One more than may be tells that there are too many.
    let parts: Option<Vec<Bytes>> = numbers.take(REQUEST_MAX + 1).map(piece).collect();
    parts.filter(|parts| parts.len() <= REQUEST_MAX)
}
