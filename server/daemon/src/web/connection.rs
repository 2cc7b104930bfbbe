//! One connection of a browser: it may ask for several things, one after the other.

use std::{net::SocketAddr, sync::Arc, time::Duration};

use axum::extract::Request;
use hyper::{
    body::Incoming,
    server::conn::http1,
    service::{Service, service_fn},
};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use tokio::{
    io::{AsyncRead, AsyncWrite},
    time::timeout,
};

use super::routes::{Peer, Site};

/// How long the header of a request may take to arrive, and how long a connection may idle.
const HEADER_TIME: Duration = Duration::from_secs(5);
/// How long a connection may last, beside the download of a world.
const CONNECTION_TIME: Duration = Duration::from_secs(60);
/// The most bytes of a header, and of what waits to be sent.
const BUFFER_BYTES: usize = 16 * 1_024;
/// The most fields of a header.
const HEADERS_MAX: usize = 64;

/// Answers requests until the connection ends, becomes a visit, or has had its time. Nobody learns
/// of errors: they are the peer's.
pub(super) async fn converse<S>(stream: S, peer: SocketAddr, site: Arc<Site>)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let router = site.clone().router();
    let service = service_fn(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(Peer(peer));
        TowerToHyperService::new(router.clone()).call(request)
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEADER_TIME)
        .max_headers(HEADERS_MAX)
        .max_buf_size(BUFFER_BYTES)
        .serve_connection(TokioIo::new(stream), service)
        .with_upgrades();
    let _ = timeout(CONNECTION_TIME + site.door.download_time(), connection).await;
}
