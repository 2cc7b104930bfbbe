//! What operators see by HTTP, and what HTTP clients cannot do.

use std::{
    collections::{BTreeMap, BTreeSet},
    net::SocketAddr,
    path::Path,
    time::Duration,
};

use glam::Vec3;
use sightline_server::{
    http::{AskError, HttpServer, OwnerToken, ask_overview},
    net::{Limits, Server},
};
use sightline_world::motion::ReportingState;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    time::timeout,
};

use super::{config, join, meet, serve, until};
use crate::building::{EAST, WEST};

/// More than any answer takes.
const PATIENCE: Duration = Duration::from_secs(10);

pub async fn listen(server: &Server, limits: &Limits) -> HttpServer {
    listen_with(server, limits, OwnerToken::new().unwrap()).await
}

pub async fn listen_with(server: &Server, limits: &Limits, token: OwnerToken) -> HttpServer {
    let address = "127.0.0.1:0".parse().unwrap();
    HttpServer::listen(address, server, token, limits).await.unwrap()
}

/// Sends bytes. What comes until the connection is closed.
async fn answer(address: SocketAddr, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    // A listener that refuses closes at once.
    let _ = stream.write_all(request).await;
    let mut said = Vec::new();
    let _ = timeout(PATIENCE, stream.read_to_end(&mut said)).await.expect("it closes");
    String::from_utf8(said).unwrap()
}

/// Asks for a page. Its status and its body.
async fn get(address: SocketAddr, path: &str) -> (u16, String) {
    let request = format!("GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n");
    let said = answer(address, request.as_bytes()).await;
    let status = said.split(' ').nth(1).and_then(|status| status.parse().ok());
    let body = said.split_once("\r\n\r\n").map_or(String::new(), |(_, body)| body.to_owned());
    (status.unwrap_or_else(|| panic!("no answer: {said:?}")), body)
}

/// The metrics by name and labels.
pub async fn metrics(address: SocketAddr) -> BTreeMap<String, f64> {
    let (status, text) = get(address, "/metrics").await;
    assert_eq!(status, 200);
    assert!(text.ends_with("# EOF\n"), "{text}");
    let rows = text.lines().filter(|line| !line.starts_with('#'));
    let rows = rows.map(|line| line.rsplit_once(' ').unwrap());
    rows.map(|(name, value)| (name.to_owned(), value.parse().unwrap())).collect()
}

/// The metrics that a file of `docs/operate` tells of.
fn told(page: &str) -> BTreeSet<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/operate").join(page);
    let text = std::fs::read_to_string(path).unwrap();
    let is_name = |c: char| c.is_ascii_lowercase() || c == '_';
    let named: BTreeSet<String> = if page.ends_with(".json") {
        let dashboard: serde_json::Value = serde_json::from_str(&text).unwrap();
        let panels = dashboard["panels"].as_array().unwrap().iter();
        let targets = panels.flat_map(|panel| panel["targets"].as_array().unwrap());
        let queries = targets.map(|target| target["expr"].as_str().unwrap());
        let words = queries.flat_map(|query| query.split(|c: char| !is_name(c)));
        words.filter(|word| word.starts_with("sightline_")).map(str::to_owned).collect()
    } else {
        let headings = ["## Metrics", "## What to watch"];
        let (_, table) = headings.iter().find_map(|heading| text.split_once(heading)).unwrap();
        let firsts = table.lines().filter_map(|line| line.strip_prefix("| `")?.split(" |").next());
        let names = firsts.flat_map(|cell| cell.split(|c: char| !is_name(c)));
        names.filter(|name| !name.is_empty()).map(|name| format!("sightline_{name}")).collect()
    };
    assert!(named.len() > 6, "{named:?}");
    // A histogram has its own name in the table only.
    let rows = |name: String| {
        if name.ends_with("tick_seconds") || name.ends_with("trip_seconds") {
            name + "_bucket"
        } else {
            name
        }
    };
    named.into_iter().map(rows).collect()
}

/// The metrics of a station are those that its page tells of.
pub async fn check_metrics_of_station(server: &Server) {
    let http = listen(server, &Limits::default()).await;
    let now = metrics(http.local_addr()).await;
    let known: BTreeSet<&str> = now.keys().filter_map(|name| name.split('{').next()).collect();
    let told = told("several-servers.md");
    let missing: Vec<_> = told.iter().filter(|name| !known.contains(name.as_str())).collect();
    assert!(missing.is_empty(), "{missing:?} are not there: {known:?}");
    assert_eq!(now["sightline_bus_connected"], 1.0);
    assert!(now["sightline_bus_bytes_total{direction=\"in\",kind=\"heartbeat\"}"] > 0.0);
}

#[tokio::test(flavor = "multi_thread")]
async fn metrics_follow_what_happens() {
    let (server, _) = serve(config());
    let http = listen(&server, &Limits::default()).await;
    let address = http.local_addr();
    let before = metrics(address).await;
    assert_eq!(before["sightline_reports_total"], 0.0);
    let (ada, bo) = (join(&server, "Ada", WEST).await, join(&server, "Bo", EAST).await);
    meet(&ada, &bo).await;
    let is_live = || ada.stats().reporting_state == Some(ReportingState::Live);
    until("Ada is live", is_live).await;
    ada.chat("hello").unwrap();
    until("the chat has come", || {
        let sent = server.stats().clients.values().map(|client| client.traffic.frames_out).sum();
        let sent: u64 = sent;
        sent > 8
    })
    .await;
    tokio::time::sleep(Duration::from_millis(1_200)).await;
    let now = metrics(address).await;
    let of = |name: &str| now.get(name).copied().unwrap_or_else(|| panic!("{name}: {now:?}"));
    for (name, least) in [
        ("sightline_messages_total{direction=\"in\",kind=\"hello\"}", 2.0),
        ("sightline_messages_total{direction=\"out\",kind=\"welcome\"}", 2.0),
        ("sightline_messages_total{direction=\"in\",kind=\"chat\"}", 1.0),
        ("sightline_bytes_total{direction=\"in\",kind=\"report\"}", 20.0),
        ("sightline_bytes_total{direction=\"out\",kind=\"poses\"}", 20.0),
        ("sightline_reports_total", 3.0),
        ("sightline_departures_total", 1.0),
        ("sightline_tick_seconds_count{stage=\"engine\"}", 10.0),
        ("sightline_round_trip_seconds_count", 2.0),
        ("sightline_tick_hz", 1.0),
        ("sightline_world", 1.0),
    ] {
        assert!(of(name) >= least, "{name} is {}", of(name));
    }
    let states = ["joining", "live", "on_course", "quiet", "asked", "absent"];
    let count = |state| of(&format!("sightline_clients{{state=\"{state}\"}}"));
    assert_eq!(states.map(count).iter().sum::<f64>(), 2.0);
    assert!(of("sightline_departures_total") <= of("sightline_reports_total"));
    assert_eq!(of("sightline_refused_total{reason=\"chat_per_s\"}"), 0.0);
    assert!(now.len() > 100, "every kind and reason has a row");
    let known: BTreeSet<&str> = now.keys().filter_map(|name| name.split('{').next()).collect();
    for page in ["README.md", "grafana.json"] {
        let missing: Vec<_> =
            told(page).into_iter().filter(|name| !known.contains(&**name)).collect();
        assert!(missing.is_empty(), "{page} tells of {missing:?}, which are not there: {known:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn health_says_whether_there_is_a_world() {
    let identity = sightline_server::net::Identity::generate().unwrap();
    let server = Server::listen(config(), &identity).unwrap();
    let http = listen(&server, &Limits::default()).await;
    let (status, said) = get(http.local_addr(), "/healthz").await;
    assert_eq!((status, said.as_str()), (503, "the world is being loaded\n"));
    let changer = server.world_changer();
    tokio::task::spawn_blocking(move || changer.change(crate::building::world()))
        .await
        .unwrap()
        .unwrap();
    let (mut status, mut tries) = (503, 0);
    while status == 503 && tries < 50 {
        tokio::time::sleep(Duration::from_millis(100)).await;
        (status, _) = get(http.local_addr(), "/healthz").await;
        tries += 1;
    }
    assert_eq!(status, 200);
}

/// Who keeps a connection open, floods, or asks for another host gets nothing, and others get on.
#[tokio::test(flavor = "multi_thread")]
async fn hostile_http_clients_cost_nothing() {
    let (server, _) = serve(config());
    let limits =
        Limits { http_connections_max: 4, http_requests_per_s: 1_000, ..Limits::default() };
    let http = listen(&server, &limits).await;
    let address = http.local_addr();
    let asked_by = |name: &str| format!("GET /healthz HTTP/1.1\r\nHost: {name}\r\n\r\n");
    let other = answer(address, asked_by("evil.example").as_bytes()).await;
    assert!(other.starts_with("HTTP/1.1 403"), "{other}");
    let long = [b"GET / HTTP/1.1\r\nX: ".as_slice(), &[b'x'; 40_000]].concat();
    let long = answer(address, &long).await;
    assert!(long.is_empty() || long.starts_with("HTTP/1.1 4"), "{long}");
    let posted = answer(address, b"POST /healthz HTTP/1.1\r\nHost: [::1]\r\n\r\n").await;
    assert!(posted.starts_with("HTTP/1.1 405"), "{posted}");

    // Four that never end their header take all connections, for five seconds.
    let mut slow = Vec::new();
    for _ in 0..4 {
        let mut stream = TcpStream::connect(address).await.unwrap();
        stream.write_all(b"GET / HT").await.unwrap();
        slow.push(stream);
    }
    until("a fifth is refused", || {
        let refused = std::net::TcpStream::connect(address).and_then(|mut stream| {
            stream.set_read_timeout(Some(Duration::from_millis(200)))?;
            std::io::Read::read(&mut stream, &mut [0])
        });
        matches!(refused, Ok(0))
    })
    .await;
    for mut stream in slow {
        let mut said = Vec::new();
        let read = timeout(PATIENCE, stream.read_to_end(&mut said)).await;
        let _ = read.expect("a slow client is cut off");
    }
    let now = metrics(address).await;
    assert!(now["sightline_refused_total{reason=\"http_connections_max\"}"] >= 1.0);

    let http = listen(&server, &Limits { http_requests_per_s: 1, ..limits }).await;
    let mut statuses = Vec::new();
    for _ in 0..4 {
        statuses.push(get(http.local_addr(), "/healthz").await.0);
    }
    assert_eq!(statuses[0], 200);
    assert!(statuses.contains(&429), "{statuses:?}");
}

/// What `status` shows is what the server says.
#[tokio::test(flavor = "multi_thread")]
async fn status_asks_a_server_what_it_does() {
    let (server, _) = serve(config());
    let http = listen(&server, &Limits::default()).await;
    let ada = join(&server, "Ada <b>", WEST).await;
    let in_world =
        || server.stats().clients.values().any(|client| client.reporting_state.is_some());
    until("Ada is in", in_world).await;
    tokio::time::sleep(Duration::from_millis(600)).await;
    let overview = ask_overview(http.local_addr()).await.unwrap();
    let [person] = &overview.people[..] else { panic!("{overview:?}") };
    assert_eq!((person.name.as_str(), person.avatar), ("Ada <b>", ada.avatar().0));
    let place = person.place.as_ref().unwrap();
    assert!(Vec3::from(place.eye).distance(WEST) < 0.1 && place.held == 0, "{place:?}");
    assert!(person.totals.messages_in >= 2 && person.totals.bytes_out > 40, "{person:?}");
    assert!(overview.ticks.ticks > 0 && overview.uptime_s > 0.0, "{overview:?}");

    // Another program answers there.
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        let _ = stream.read(&mut [0; 1_000]).await;
        let _ = stream.write_all(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}").await;
    });
    let error = ask_overview(address).await.unwrap_err();
    assert!(matches!(error, AskError::Foreign { .. }), "{error}");
}

/// Gives an order with a token. The status of the answer.
async fn order(address: SocketAddr, token: &str, body: &str) -> u16 {
    let request = format!(
        "POST /moderate HTTP/1.1\r\nHost: {address}\r\nAuthorization: Bearer {token}\r\n\
         Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    let said = answer(address, request.as_bytes()).await;
    said.split(' ').nth(1).and_then(|status| status.parse().ok()).expect(&said)
}

#[tokio::test(flavor = "multi_thread")]
async fn only_who_has_the_owners_token_acts() {
    let (server, _) = serve(config());
    let token = OwnerToken::new().unwrap();
    let http = listen_with(&server, &Limits::default(), token.clone()).await;
    let (address, token) = (http.local_addr(), token.to_string());
    let ada = join(&server, "Ada", WEST).await;
    let moderation = server.moderation();
    let avatar = moderation.visitors()[0].avatar;
    let told = |act: &str| format!(r#"{{"avatar":{avatar},"act":"{act}","reason":"be nice"}}"#);
    for wrong in ["", "0", &token.to_uppercase(), &format!("{token} ")] {
        // A space at the end of a header is no part of it.
        let expected = if wrong.trim() == token { 200 } else { 401 };
        assert_eq!(order(address, wrong, &told("mute")).await, expected, "{wrong:?}");
    }
    assert!(moderation.visitors()[0].is_muted);
    assert_eq!(order(address, &token, &told("unmute")).await, 200);
    assert!(!moderation.visitors()[0].is_muted);
    for body in ["", "{}", "[1]", &told("praise"), &" ".repeat(3_000)] {
        let status = order(address, &token, body).await;
        assert!([400, 413, 422].contains(&status), "{body:?}: {status}");
    }
    let nobody = r#"{"avatar":4294967295,"act":"kick"}"#;
    assert_eq!(order(address, &token, nobody).await, 404);
    assert_eq!(order(address, &token, &told("ban")).await, 200);
    until("Ada is told", || ada.end().as_deref() == Some("you are banned: be nice")).await;
}
