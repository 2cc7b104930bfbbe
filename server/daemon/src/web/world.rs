//! The download of the world that is served, by its content id.

use std::sync::Arc;

use axum::{
    body::Body,
    extract::{Extension, Path, State},
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};

use super::{
    download::{Download, IMMUTABLE},
    host,
    routes::{Site, Visitor},
};
use crate::operate::Reason;

/// `GET /world/ID`: the file as native clients get it.
pub(super) async fn world(
    State(site): State<Arc<Site>>,
    Extension(visitor): Extension<Visitor>,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Response {
    if site.door.is_private() {
        site.door.count_refusal(Reason::PrivateGeometry);
        let said = "this building is handed out in pieces only\n";
        return (StatusCode::FORBIDDEN, said).into_response();
    }
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
        Err(reason) => return site.refuse_download(reason),
    };
    let body = Download::new(vec![world.bytes().clone()], site, Some(place));
    let kind = [(header::CONTENT_TYPE, "application/octet-stream")];
    (caching, kind, Body::new(body)).into_response()
}
