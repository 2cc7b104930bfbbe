//! What the listener answers, and to whom.

use std::{
    net::{IpAddr, SocketAddr},
    sync::Arc,
};

use axum::{
    Router,
    extract::{Request, State},
    http::{HeaderMap, HeaderValue, StatusCode, header},
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::get,
};

use super::{host, join, page, pieces, rates::Rates, visit, world};
use crate::{
    http::{Connections, is_own_name},
    net::{VISIT_PATH, WebDoor},
    operate::Reason,
};

/// What all requests share.
pub(super) struct Site {
    pub(super) door: WebDoor,
    /// The downloads of the world that are under way.
    pub(super) downloads: Connections,
    rates: Rates,
    /// Whether the listener is on this machine's own address.
    is_local: bool,
    /// Whether it speaks HTTPS.
    is_secure: bool,
}

/// The other end of a connection: a visitor, or a reverse proxy.
#[derive(Clone, Copy)]
pub(super) struct Peer(pub(super) SocketAddr);

/// Who asks.
#[derive(Clone, Copy)]
pub(super) struct Visitor {
    /// Where it is, as far as known: behind a proxy its port is not.
    pub(super) address: SocketAddr,
    /// Whether its browser knows that nobody reads along.
    pub(super) is_secure: bool,
}

impl Site {
    pub(super) fn new(door: WebDoor, address: SocketAddr, is_secure: bool) -> Self {
        let limits = door.limits();
        let downloads = Connections::new(
            (limits.joining_max, Reason::Joining),
            (limits.joining_per_address_max, Reason::JoiningOfNetwork),
        );
        let rates = Rates::new(limits.web_requests_per_s, limits.log_networks_max);
        Self { downloads, rates, is_local: address.ip().is_loopback(), is_secure, door }
    }

    /// Whether an address is that of a reverse proxy, which says for whom it asks.
    pub(super) fn is_proxy(&self, address: IpAddr) -> bool {
        self.door.proxies().contains(&address.to_canonical())
    }

    /// Everything that is answered.
    pub(super) fn router(self: Arc<Self>) -> Router {
        Router::new()
            .route("/join.json", get(join::join))
            .route("/world/{id}", get(world::world))
            .route("/pieces/{id}/{wanted}", get(pieces::pieces))
            .route(VISIT_PATH, get(visit::visit))
            .route("/", get(page::index))
            .route("/{file}", get(page::file))
            .with_state(self.clone())
            .layer(middleware::from_fn_with_state(self, guard))
    }

    /// Answers a download that is beyond a limit.
    pub(super) fn refuse_download(&self, reason: Reason) -> Response {
        self.door.count_refusal(reason);
        let said = "too many others download the world: try again soon\n";
        (StatusCode::SERVICE_UNAVAILABLE, [(header::RETRY_AFTER, "2")], said).into_response()
    }

    /// Who asks by a request.
    fn visitor(&self, peer: SocketAddr, headers: &HeaderMap) -> Visitor {
        let is_trusted = self.is_secure
            || host::host(headers).is_some_and(|host| is_own_machine(host::name(host)));
        if !self.is_proxy(peer.ip()) {
            return Visitor { address: peer, is_secure: is_trusted };
        }
        let forwarded = host::text(headers.get("x-forwarded-for"));
        // What comes before the last entry is what the visitor claims.
        let last = forwarded.and_then(|all| all.rsplit(',').next()?.trim().parse().ok());
        let address = last.map_or(peer, |address: IpAddr| (address, 0).into());
        let scheme = host::text(headers.get("x-forwarded-proto"));
        Visitor { address, is_secure: is_trusted || scheme == Some("https") }
    }

    /// Whether the listener answers to a host. A page of another site can make a browser ask this
    /// machine by that site's own name.
    fn is_called(&self, headers: &HeaderMap) -> bool {
        let Some(host) = host::host(headers) else { return false };
        !self.is_local || is_own_name(host) || self.door.is_listed(host)
    }
}

/// Whether a name is this machine's for a browser on it, which then trusts plain HTTP.
fn is_own_machine(name: &str) -> bool {
    let bare = name.trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost")
        || bare.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Lets a request pass that is within the limits, and is meant for this listener.
async fn guard(State(site): State<Arc<Site>>, mut request: Request, next: Next) -> Response {
    let Some(&Peer(peer)) = request.extensions().get() else {
        return StatusCode::INTERNAL_SERVER_ERROR.into_response();
    };
    let visitor = site.visitor(peer, request.headers());
    if !site.rates.allows(visitor.address.ip(), site.door.now()) {
        site.door.count_refusal(Reason::WebRequests);
        let wait = [(header::RETRY_AFTER, "1")];
        return (StatusCode::TOO_MANY_REQUESTS, wait, "too many requests\n").into_response();
    }
    if !site.is_called(request.headers()) {
        let said = "this server is called localhost, by its address, or as web_origins says\n";
        return (StatusCode::FORBIDDEN, said).into_response();
    }
    request.extensions_mut().insert(visitor);
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}
