//! The live page for operators, with its plans.

use std::{
    hash::{BuildHasher, RandomState},
    sync::Arc,
};

use axum::{
    Json, Router,
    extract::{Path, State},
    http::{StatusCode, header},
    response::{IntoResponse, Response},
    routing::get,
};
use serde::Serialize;

use super::{
    plans::{PlanDrawer, Storey},
    snapshots::Snapshots,
    stream,
};
use crate::net::Observer;

/// The page, with its style and its script.
const PAGE: &str = include_str!("page.html");
/// What stands in the page for the word that allows its own style and script to run, and no others.
const NONCE: &str = "NONCE";

/// What requests for the page share.
pub(super) struct PageState {
    observer: Observer,
    snapshots: Arc<Snapshots>,
    drawer: PlanDrawer,
}

/// The page and what it asks for.
pub(super) fn router(observer: Observer, snapshots: Arc<Snapshots>) -> Router {
    let drawer = PlanDrawer::new(observer.clone());
    let state = Arc::new(PageState { observer, snapshots, drawer });
    Router::new()
        .route("/", get(page))
        .route("/events", get(events))
        .route("/storeys.json", get(storeys))
        .route("/plan/{world}/{storey}", get(plan))
        .route("/sight/{viewer}", get(sight))
        .with_state(state)
}

async fn page() -> Response {
    let nonce = format!("{:016x}", RandomState::new().hash_one(0));
    let policy = format!(
        "default-src 'none'; img-src 'self' data:; connect-src 'self'; base-uri 'none'; \
         form-action 'none'; frame-ancestors 'none'; style-src 'nonce-{nonce}'; script-src \
         'nonce-{nonce}'"
    );
    let headers = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8".to_owned()),
        (header::CONTENT_SECURITY_POLICY, policy),
    ];
    (headers, PAGE.replace(NONCE, &nonce)).into_response()
}

async fn events(State(state): State<Arc<PageState>>) -> Response {
    stream::overviews(state.snapshots.clone()).into_response()
}

/// The storeys of a world.
#[derive(Serialize)]
struct Storeys<'a> {
    world: u32,
    storeys: &'a [Storey],
}

async fn storeys(State(state): State<Arc<PageState>>) -> Response {
    match state.drawer.plans().await {
        Some(plans) => {
            Json(Storeys { world: plans.world, storeys: &plans.storeys }).into_response()
        }
        None => (StatusCode::SERVICE_UNAVAILABLE, "the world is being loaded\n").into_response(),
    }
}

async fn plan(
    State(state): State<Arc<PageState>>,
    Path((world, storey)): Path<(u32, usize)>,
) -> Response {
    let plans = state.drawer.plans().await.filter(|plans| plans.world == world);
    match plans.as_ref().and_then(|plans| plans.pictures.get(storey)) {
        Some(png) => ([(header::CONTENT_TYPE, "image/png")], png.clone()).into_response(),
        None => (StatusCode::NOT_FOUND, "there is no such plan\n").into_response(),
    }
}

async fn sight(State(state): State<Arc<PageState>>, Path(viewer): Path<u32>) -> Response {
    match state.observer.sight(viewer).await {
        Some(sight) => Json(sight).into_response(),
        None => (StatusCode::NOT_FOUND, "nobody of this number is in the world\n").into_response(),
    }
}
