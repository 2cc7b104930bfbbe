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

    /// Who asks by a request. None when a proxy says it in a way that cannot be read.
    fn visitor(&self, peer: SocketAddr, headers: &HeaderMap) -> Option<Visitor> {
        let is_trusted = self.is_secure
            || host::host(headers).is_some_and(|host| is_own_machine(host::name(host)));
        if !self.is_proxy(peer.ip()) {
            return Some(Visitor { address: peer, is_secure: is_trusted });
        }
        let address = match last_entry(headers, "x-forwarded-for") {
            Some(entry) => (address_in(entry?)?, 0).into(),
            None => peer,
        };
        let is_https = last_entry(headers, "x-forwarded-proto") == Some(Some("https"));
        Some(Visitor { address, is_secure: is_trusted || is_https })
    }

    /// Whether the listener answers to a host. A page of another site can make a browser ask this
    /// machine by that site's own name.
    fn is_called(&self, headers: &HeaderMap) -> bool {
        let Some(host) = host::host(headers) else { return false };
        !self.is_local || is_own_name(host) || self.door.is_listed(host)
    }
}

/// What the last proxy added to a header, if there is one: `Some(None)` when it is not text. What
/// comes before, in the same line or in lines before it, is what the visitor claims.
fn last_entry<'a>(headers: &'a HeaderMap, name: &str) -> Option<Option<&'a str>> {
    let line = headers.get_all(name).iter().next_back()?;
    Some(host::text(Some(line)).and_then(|line| line.rsplit(',').next()).map(str::trim))
}

/// An address as proxies write it: some add a port.
fn address_in(entry: &str) -> Option<IpAddr> {
    let with_port = || entry.parse::<SocketAddr>().ok().map(|address| address.ip());
    let bare = entry.trim_start_matches('[').trim_end_matches(']');
    bare.parse().ok().or_else(with_port)
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
    let Some(visitor) = site.visitor(peer, request.headers()) else {
        let said = "the proxy's x-forwarded-for ends with no address\n";
        return (StatusCode::BAD_REQUEST, said).into_response();
    };
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

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(lines: &[&str]) -> HeaderMap {
        let name = || header::HeaderName::from_static("x-forwarded-for");
        let value = |line: &str| HeaderValue::from_bytes(line.as_bytes()).expect("no control");
        lines.iter().map(|line| (name(), value(line))).collect()
    }

    #[test]
    fn what_the_last_proxy_added_counts_in_whichever_line() {
        for (lines, last) in [
            (&[][..], None),
            (&["198.51.100.7"], Some(Some("198.51.100.7"))),
            (&["127.0.0.1, 198.51.100.7"], Some(Some("198.51.100.7"))),
            (&["127.0.0.1", "198.51.100.7"], Some(Some("198.51.100.7"))),
            (&["198.51.100.7", "\u{e9}"], Some(None)),
        ] {
            assert_eq!(last_entry(&headers(lines), "x-forwarded-for"), last, "{lines:?}");
        }
    }

    #[test]
    fn an_address_may_have_a_port() {
        let of = |entry| address_in(entry).map(|address| address.to_string());
        for entry in ["198.51.100.7", "198.51.100.7:5012"] {
            assert_eq!(of(entry).as_deref(), Some("198.51.100.7"), "{entry}");
        }
        for entry in ["2001:db8::7", "[2001:db8::7]", "[2001:db8::7]:5012"] {
            assert_eq!(of(entry).as_deref(), Some("2001:db8::7"), "{entry}");
        }
        for entry in ["", "unknown", "198.51.100", "198.51.100.7:x"] {
            assert_eq!(of(entry), None, "{entry}");
        }
    }
}
