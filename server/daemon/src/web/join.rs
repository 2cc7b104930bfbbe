//! What a page needs to know to join.

use std::sync::Arc;

use axum::{
    Json,
    extract::{Extension, State},
    http::HeaderMap,
};
use base64::{Engine, prelude::BASE64_STANDARD};
use serde::Serialize;
use sightline_protocol::VERSION;

use super::{
    host,
    routes::{Site, Visitor},
};
use crate::net::VISIT_PATH;

/// What is said to a page that came over plain HTTP from another machine.
const PLAIN: &str = "This page came over plain HTTP. Others on the network can read along, and \
    could take your place. Browsers offer WebTransport and threads only to pages that came over \
    HTTPS, or from http://localhost on the server's own machine; a WebSocket is used instead. The \
    operator can give the server a certificate with --tls.";

/// `GET /join.json`.
#[derive(Serialize)]
pub(super) struct Join {
    /// The version of the protocol.
    version: u32,
    /// The content id of the world; `None` until there is one.
    world: Option<String>,
    /// The length of the world's file, in bytes.
    world_bytes: usize,
    /// The content id of the world's head; `None` where the world is not to be had in pieces.
    head: Option<String>,
    /// Whether pieces are handed out only to visitors that say who they are and may see them.
    private: bool,
    /// The building's title.
    name: String,
    /// Where WebTransport is; `None` when the request names no host.
    webtransport: Option<WebTransport>,
    /// The path of the WebSocket.
    websocket: &'static str,
    /// What does not work as it might, to show to people.
    warnings: Vec<&'static str>,
}

/// Where WebTransport is.
#[derive(Serialize)]
struct WebTransport {
    url: String,
    /// The SHA-256 hashes, in base64, of the certificates that the page may accept; none where the
    /// browser accepts them by their issuer.
    hashes: Vec<String>,
}

/// Tells how to join.
pub(super) async fn join(
    State(site): State<Arc<Site>>,
    Extension(visitor): Extension<Visitor>,
    headers: HeaderMap,
) -> Json<Join> {
    let world = site.door.world();
    let world = world.as_ref();
    Json(Join {
        version: VERSION,
        world: world.map(|world| world.id().to_string()),
        world_bytes: world.map_or(0, |world| world.bytes().len()),
        head: world.and_then(|world| world.pieces()).map(|pieces| pieces.id().to_string()),
        private: site.door.is_private(),
        name: world.map(|world| world.world().title.clone()).unwrap_or_default(),
        webtransport: host::host(&headers).map(|host| WebTransport {
            url: site.door.web_transport_url(host::name(host)),
            hashes: site.door.hashes().iter().map(|hash| BASE64_STANDARD.encode(hash)).collect(),
        }),
        websocket: VISIT_PATH,
        warnings: if visitor.is_secure { vec![] } else { vec![PLAIN] },
    })
}
