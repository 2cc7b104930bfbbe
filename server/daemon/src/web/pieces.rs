//! Pieces of the world that is served, by the content id of their head.

use std::sync::Arc;

use axum::{
    body::Body,
    extract::{Extension, Path, State},
    http::{HeaderMap, HeaderName, StatusCode, header},
    response::{IntoResponse, Response},
};
use base64::{Engine as _, prelude::BASE64_STANDARD};
use bytes::Bytes;
use sightline_protocol::{fingerprint::VisitorSecret, piece_stream::REQUEST_MAX};

use super::{
    download::{Download, IMMUTABLE},
    host,
    routes::{Site, Visitor},
};
use crate::{net::ServedPieces, operate::Reason};

/// The name by which the head is asked for.
const HEAD: &str = "head";
/// The secret of the visitor that asks, in base64. Only where geometry is private it is needed.
const VISITOR: HeaderName = HeaderName::from_static("x-visitor");
/// The numbers of the pieces of a request that are not handed out now.
const REFUSED: HeaderName = HeaderName::from_static("x-refused");
const KIND: (HeaderName, &str) = (header::CONTENT_TYPE, "application/octet-stream");

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
    let is_head = wanted == HEAD;
    let Some(parts) = parts(&pieces, &wanted) else {
        return (StatusCode::BAD_REQUEST, "name up to 256 pieces of this world\n").into_response();
    };
    if !is_head && site.door.is_private() {
        return private(site, &pieces, parts, &headers).await;
    }
    // What the head's id and numbers mean never changes.
    let tag = format!("\"{id}\"");
    let caching = [(header::CACHE_CONTROL, IMMUTABLE), (header::ETAG, &tag)];
    if host::text(headers.get(header::IF_NONE_MATCH)) == Some(&tag) {
        return (StatusCode::NOT_MODIFIED, caching).into_response();
    }
    // A head is what newcomers download; pieces are for those who are in.
    let place = match is_head.then(|| site.downloads.begin(visitor.address.ip())) {
        Some(Err(reason)) => return site.refuse_download(reason),
        Some(Ok(place)) => Some(place),
        None => None,
    };
    let parts = parts.into_iter().map(|(_, piece)| piece).collect();
    (caching, [KIND], Body::new(Download::new(parts, site, place))).into_response()
}

/// The pieces that the visitor who asks may have now, and the numbers of the others. No cache keeps
/// them: later it may have others.
async fn private(
    site: Arc<Site>,
    pieces: &ServedPieces,
    parts: Vec<(u32, Bytes)>,
    headers: &HeaderMap,
) -> Response {
    let numbers: Vec<u32> = parts.iter().map(|(number, _)| *number).collect();
    let may = site.door.may_have(pieces, &numbers, secret(headers)).await;
    let (mut given, mut refused) = (Vec::new(), Vec::new());
    for ((number, piece), may_have) in parts.into_iter().zip(may) {
        match may_have {
            true => given.push(piece),
            false => {
                site.door.count_refusal(Reason::PrivateGeometry);
                refused.push(number.to_string());
            }
        }
    }
    let about = [(header::CACHE_CONTROL, "no-store"), (REFUSED, &refused.join(","))];
    (about, [KIND], Body::new(Download::new(given, site, None))).into_response()
}

/// The secret of the visitor that asks.
fn secret(headers: &HeaderMap) -> Option<VisitorSecret> {
    let bytes = BASE64_STANDARD.decode(host::text(headers.get(VISITOR))?).ok()?;
    Some(VisitorSecret(bytes.try_into().ok()?))
}

/// The bytes that are wanted, with their numbers; `None` when there are no such pieces, or too many.
fn parts(pieces: &ServedPieces, wanted: &str) -> Option<Vec<(u32, Bytes)>> {
    if wanted == HEAD {
        return Some(vec![(u32::MAX, pieces.head().clone())]);
    }
    let piece = |number: &str| {
        let number = number.parse().ok()?;
        Some((number, pieces.piece(number)?.clone()))
    };
    let numbers = wanted.split(',');
    // One more than may be tells that there are too many.
    let parts: Option<Vec<(u32, Bytes)>> = numbers.take(REQUEST_MAX + 1).map(piece).collect();
    parts.filter(|parts| parts.len() <= REQUEST_MAX)
}
