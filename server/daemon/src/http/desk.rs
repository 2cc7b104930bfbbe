//! What the owner of a server does to visitors on its page.

use std::sync::Arc;

use axum::{
    Json, Router,
    extract::{DefaultBodyLimit, Request, State},
    http::{StatusCode, header},
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::post,
};
use serde::Deserialize;
use sightline_protocol::text::ChatLine;

use super::owner_token::OwnerToken;
use crate::{
    net::{Author, Moderation, ModerationError},
    people::Subject,
};

/// The most bytes of an order.
const BODY_BYTES: usize = 2_048;

/// Who may do what.
struct Desk {
    moderation: Moderation,
    token: OwnerToken,
}

/// What is done to a visitor.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Order {
    /// The visitor's avatar.
    avatar: u32,
    act: Act,
    /// What the visitor is told.
    #[serde(default)]
    reason: Option<ChatLine>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Act {
    Kick,
    Mute,
    Unmute,
    Ban,
    BanNetwork,
}

/// Takes orders from whoever has the token.
pub(super) fn router(moderation: Moderation, token: OwnerToken) -> Router {
    let desk = Arc::new(Desk { moderation, token });
    Router::new()
        .route("/moderate", post(moderate))
        .layer(DefaultBodyLimit::max(BODY_BYTES))
        .layer(middleware::from_fn_with_state(desk.clone(), check))
        .with_state(desk)
}

/// Lets requests with the token pass. Nothing is read from the body of others.
async fn check(State(desk): State<Arc<Desk>>, request: Request, next: Next) -> Response {
    let said = request.headers().get(header::AUTHORIZATION).and_then(|said| said.to_str().ok());
    let token = said.and_then(|said| said.strip_prefix("Bearer "));
    if token.is_some_and(|token| desk.token.is(token)) {
        next.run(request).await
    } else {
        (StatusCode::UNAUTHORIZED, "the owner's token is missing or wrong\n").into_response()
    }
}

async fn moderate(State(desk): State<Arc<Desk>>, Json(order): Json<Order>) -> Response {
    match desk.obey(&order) {
        Ok(()) => (StatusCode::OK, "done\n").into_response(),
        Err(ModerationError::NotHere) => {
            (StatusCode::NOT_FOUND, "this visitor is not here any more\n").into_response()
        }
        Err(error) => (StatusCode::FORBIDDEN, format!("{error}\n")).into_response(),
    }
}

impl Desk {
    fn obey(&self, order: &Order) -> Result<(), ModerationError> {
        let author = Author::Operator;
        let reason = order.reason.as_ref().map_or("", ChatLine::as_str);
        let key = self.moderation.key_of(order.avatar)?;
        match order.act {
            Act::Kick => self.moderation.kick(author, key, reason),
            Act::Mute => self.moderation.set_muted(author, key, true, reason),
            Act::Unmute => self.moderation.set_muted(author, key, false, reason),
            Act::Ban => self.moderation.ban(author, Subject::Key(key), reason),
            Act::BanNetwork => {
                self.moderation.ban(author, self.moderation.network_of(key)?, reason)
            }
        }
    }
}
