//! The WebSocket by which a page visits.

use std::sync::Arc;

use axum::{
    extract::{Extension, State, WebSocketUpgrade},
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};

use super::{
    host,
    routes::{Site, Visitor},
};
use crate::operate::Reason;

/// The most bytes of a message from a page: two frames and more.
const MESSAGE_BYTES_MAX: usize = 8 * 1_024;
/// The size of the buffer for what arrives, in bytes.
const READ_BYTES: usize = 4 * 1_024;

/// `GET /visit`: begins a visit, if the page came from here.
pub(super) async fn visit(
    State(site): State<Arc<Site>>,
    Extension(visitor): Extension<Visitor>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    let origin = host::text(headers.get(header::ORIGIN));
    if !origin.is_some_and(|origin| site.door.allows_origin(origin, host::host(&headers))) {
        site.door.count_refusal(Reason::Origin);
        let said = "pages of other sites may not visit: list their origin in web_origins\n";
        return (StatusCode::FORBIDDEN, said).into_response();
    }
    let door = site.door.clone();
    upgrade
        .read_buffer_size(READ_BYTES)
        .write_buffer_size(0)
        .max_message_size(MESSAGE_BYTES_MAX)
        .max_frame_size(MESSAGE_BYTES_MAX)
        .on_upgrade(async move |socket| door.visit(socket, visitor.address).await)
}
