//! What the listener answers.

use std::{
    net::IpAddr,
    sync::{Arc, Mutex, PoisonError},
};

use axum::{
    Router,
    extract::{Request, State},
    http::{HeaderValue, StatusCode, header},
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::get,
};

use super::{
    Limits, OVERVIEW_PATH, Reason,
    metrics_text::{self, metrics_text},
    page,
    snapshots::Snapshots,
};
use crate::net::{Observer, TokenBucket};

/// What all requests share.
struct Shared {
    observer: Observer,
    snapshots: Arc<Snapshots>,
    requests: Mutex<TokenBucket>,
    /// Whether the listener is on this machine's own address.
    is_local: bool,
}

/// Everything that a listener on an address answers.
pub(super) fn router(observer: Observer, desk: Router, limits: &Limits, address: IpAddr) -> Router {
    let rate = f64::from(limits.http_requests_per_s);
    let snapshots = Arc::new(Snapshots::new(observer.clone()));
    let shared = Arc::new(Shared {
        snapshots: snapshots.clone(),
        requests: Mutex::new(TokenBucket::new(rate, 2.0 * rate, observer.now())),
        is_local: address.is_loopback(),
        observer: observer.clone(),
    });
    Router::new()
        .route("/metrics", get(metrics))
        .route("/healthz", get(health))
        .route(OVERVIEW_PATH, get(overview))
        .with_state(shared.clone())
        .merge(page::router(observer, snapshots))
        .merge(desk)
        .layer(middleware::from_fn_with_state(shared, guard))
}

/// Lets a request pass that is within the limits, and is meant for this listener.
async fn guard(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let now = shared.observer.now();
    let is_within = {
        let mut requests = shared.requests.lock().unwrap_or_else(PoisonError::into_inner);
        requests.take(1.0, now)
    };
    if !is_within {
        shared.observer.metrics().refusals.count(Reason::HttpRequests);
        return (StatusCode::TOO_MANY_REQUESTS, "too many requests\n").into_response();
    }
    let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok());
    if shared.is_local && !host.is_some_and(is_own_name) {
        let said = "this listener is called localhost or by its address\n";
        return (StatusCode::FORBIDDEN, said).into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

/// Whether a host is `localhost` or an address. A page of another site can make a browser ask this
/// machine by that site's own name, and would then be shown the answer.
pub(crate) fn is_own_name(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.parse::<u16>().is_ok() => name,
        _ => host,
    };
    let bare = name.trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost") || bare.parse::<IpAddr>().is_ok()
}

async fn metrics(State(shared): State<Arc<Shared>>) -> Response {
    let overview = shared.snapshots.overview().await;
    let said = metrics_text(&shared.observer, overview.as_deref());
    ([(header::CONTENT_TYPE, metrics_text::CONTENT_TYPE)], said).into_response()
}

async fn overview(State(shared): State<Arc<Shared>>) -> Response {
    match shared.snapshots.overview().await.as_deref().map(serde_json::to_string) {
        Some(Ok(said)) => ([(header::CONTENT_TYPE, "application/json")], said).into_response(),
        _ => (StatusCode::SERVICE_UNAVAILABLE, "the engine does not answer\n").into_response(),
    }
}

async fn health(State(shared): State<Arc<Shared>>) -> (StatusCode, &'static str) {
    match shared.snapshots.overview().await.as_deref() {
        Some(overview) if overview.world.is_some() => (StatusCode::OK, "ok\n"),
        Some(_) => (StatusCode::SERVICE_UNAVAILABLE, "the world is being loaded\n"),
        None => (StatusCode::SERVICE_UNAVAILABLE, "the engine does not answer\n"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_own_names_of_a_machine_are_answered() {
        for own in ["localhost", "localhost:4778", "127.0.0.1:4778", "[::1]:9", "[::1]", "10.0.0.2"]
        {
            assert!(is_own_name(own), "{own}");
        }
        for other in ["", "evil.example", "evil.example:4778", "localhost.evil.example"] {
            assert!(!is_own_name(other), "{other}");
        }
    }
}
