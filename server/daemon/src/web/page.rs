//! The page, with its scripts and the WebAssembly module.

use std::{
    io::Write,
    sync::{Arc, LazyLock, OnceLock},
};

use axum::{
    extract::{Extension, Path, State},
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use bytes::Bytes;
use flate2::{Compression, write::GzEncoder};

use super::{
    host,
    routes::{Site, Visitor},
};

/// The names and the bytes of all files, as `build.rs` finds them.
static EMBEDDED: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/page_files.rs"));
/// The file that `/` means.
const INDEX: &str = "index.html";
/// What is answered by a server that was built without the page.
const NO_PAGE: &str = "This server was built without the page for browsers.\n\
    Join it with the native client: sightline-client walk HOST:PORT\n";

/// The files of the page.
static FILES: LazyLock<Vec<PageFile>> =
    LazyLock::new(|| EMBEDDED.iter().map(|(name, bytes)| PageFile::new(name, bytes)).collect());

/// A file of the page.
struct PageFile {
    name: &'static str,
    bytes: &'static [u8],
    tag: String,
    /// Compressed once, when it is first asked for.
    zipped: OnceLock<Bytes>,
}

impl PageFile {
    fn new(name: &'static str, bytes: &'static [u8]) -> Self {
        let tag = format!("\"{}\"", &blake3::hash(bytes).to_hex()[..32]);
        Self { name, bytes, tag, zipped: OnceLock::new() }
    }

    fn kind(&self) -> &'static str {
        match self.name.rsplit('.').next() {
            Some("html") => "text/html; charset=utf-8",
            Some("js") => "text/javascript; charset=utf-8",
            Some("css") => "text/css; charset=utf-8",
            Some("wasm") => "application/wasm",
            Some("svg") => "image/svg+xml",
            Some("png") => "image/png",
            _ => "application/octet-stream",
        }
    }

    fn zipped(&self) -> Bytes {
        let zip = || {
            let mut zip = GzEncoder::new(Vec::new(), Compression::best());
            zip.write_all(self.bytes).expect("a vector takes all");
            zip.finish().expect("a vector takes all").into()
        };
        self.zipped.get_or_init(zip).clone()
    }
}

/// `GET /`.
pub(super) async fn index(
    site: State<Arc<Site>>,
    visitor: Extension<Visitor>,
    headers: HeaderMap,
) -> Response {
    match FILES.iter().any(|file| file.name == INDEX) {
        true => file(site, visitor, Path(INDEX.to_owned()), headers).await,
        false => (StatusCode::NOT_FOUND, NO_PAGE).into_response(),
    }
}

/// `GET /FILE`.
pub(super) async fn file(
    State(site): State<Arc<Site>>,
    Extension(visitor): Extension<Visitor>,
    Path(name): Path<String>,
    headers: HeaderMap,
) -> Response {
    let Some(file) = FILES.iter().find(|file| file.name == name) else {
        return (StatusCode::NOT_FOUND, "there is no such file\n").into_response();
    };
    // A browser asks each time whether the file is still the same one.
    let caching = [(header::CACHE_CONTROL, "no-cache"), (header::ETAG, &file.tag)];
    if host::text(headers.get(header::IF_NONE_MATCH)) == Some(&file.tag) {
        return (StatusCode::NOT_MODIFIED, caching).into_response();
    }
    let takes_gzip = host::text(headers.get(header::ACCEPT_ENCODING))
        .is_some_and(|kinds| kinds.split(',').any(|kind| kind.trim().starts_with("gzip")));
    let body = if takes_gzip {
        tokio::task::spawn_blocking(|| file.zipped()).await.unwrap_or_default()
    } else {
        Bytes::from_static(file.bytes)
    };
    let kind = [(header::CONTENT_TYPE, file.kind()), (header::VARY, "accept-encoding")];
    let mut response = (caching, kind, body).into_response();
    let with = response.headers_mut();
    if takes_gzip {
        with.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    if let Ok(policy) = HeaderValue::from_str(&policy(&site, &headers)) {
        with.insert(header::CONTENT_SECURITY_POLICY, policy);
    }
    // Elsewhere browsers ignore these, and complain.
    if visitor.is_secure {
        with.insert("cross-origin-opener-policy", HeaderValue::from_static("same-origin"));
        with.insert("cross-origin-embedder-policy", HeaderValue::from_static("require-corp"));
    }
    response
}

/// What the page may load and reach: files from here, and this server.
fn policy(site: &Site, headers: &HeaderMap) -> String {
    let host = host::host(headers).unwrap_or_default();
    let transport = site.door.web_transport_url(host::name(host));
    format!(
        "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' \
         'unsafe-inline'; img-src 'self' data: blob:; worker-src 'self' blob:; connect-src 'self' \
         ws://{host} wss://{host} {transport}; object-src 'none'; base-uri 'none'; form-action \
         'none'; frame-ancestors 'self'"
    )
}
