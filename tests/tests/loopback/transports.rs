//! One suite for every kind of connection, and what is special to browsers.

use std::time::Duration;

use glam::Vec3;
use sightline_protocol::{
    VERSION,
    frame::{self, FrameBuffer},
    message::{ClientMessage, ServerMessage},
    pose_stream::{ClientDatagram, PoseDecoder},
    text::ChatLine,
};
use sightline_server::{
    net::{ServeConfig, Server},
    web::WebServer,
};
use sightline_world::{
    World, content_id,
    motion::{AvatarId, Pose},
};
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::Message;

use super::{
    browser::Browser,
    building::{self, WAY},
    config, serve,
    stranger::Stranger,
    until,
    visitor::{Doors, Kind, Visitor, get, hello, web_socket},
};

const KINDS: [Kind; 3] = [Kind::Quic, Kind::WebTransport, Kind::WebSocket];
/// One who walks reports at least this often.
const KEEP_ALIVE: Duration = Duration::from_secs(1);
/// How far a pose may be off on the wire.
const WIRE_M: f32 = 0.01;

/// Starts a server with a listener for browsers.
fn open(config: ServeConfig) -> (Server, WebServer, Doors) {
    let (server, quic) = serve(config);
    let web =
        WebServer::listen("127.0.0.1:0".parse().unwrap(), server.web_door().unwrap()).unwrap();
    let doors = Doors { quic, web: web.local_addr() };
    (server, web, doors)
}

/// A visitor that is in the world, and what it was told of itself.
struct Guest {
    visitor: Visitor,
    avatar: AvatarId,
}

impl Guest {
    async fn join(kind: Kind, doors: Doors, name: &str, secret: u8, place: Vec3) -> Self {
        let mut visitor = Visitor::greet(kind, doors, name, secret).await;
        let welcome = |message| match message {
            ServerMessage::Welcome { avatar, .. } => Some(avatar),
            _ => None,
        };
        let avatar = visitor.until(welcome).await;
        let offered = |message| match message {
            ServerMessage::World { number, .. } => Some(number),
            _ => None,
        };
        let world = visitor.until(offered).await;
        let place = Some(place.into());
        visitor.say(&ClientMessage::Enter { world, place, reports_from: 0 }).await;
        let is_in = |message| matches!(message, ServerMessage::Entered { .. }).then_some(());
        visitor.until(is_in).await;
        Self { visitor, avatar }
    }

    async fn sees(&mut self, other: AvatarId) {
        let appears = |message| match message {
            ServerMessage::Appear { avatar, .. } => (avatar == other).then_some(()),
            _ => None,
        };
        self.visitor.until(appears).await;
    }

    async fn hears(&mut self, other: AvatarId, line: &str) {
        let said = |message| match message {
            ServerMessage::Chat { from, text } => {
                (from == other && text.as_str() == line).then_some(())
            }
            _ => None,
        };
        self.visitor.until(said).await;
    }

    async fn says(&mut self, line: &str) {
        self.visitor.say(&ClientMessage::Chat { text: ChatLine::new(line).unwrap() }).await;
    }

    /// Walks to a place a little away, and says so in a datagram, as one does who reports at every
    /// tick, until the other one knows.
    async fn walks_before(&mut self, other: &mut Self, to: Vec3) {
        let mut decoder = PoseDecoder::new(other.visitor.tick);
        let ack = decoder.ack();
        loop {
            // A step that comes too soon after the report before is corrected, and tried again.
            self.visitor.pose = (&Pose { eye: to, ..Pose::default() }).into();
            let report = Some(self.visitor.report());
            self.visitor.send(&ClientDatagram { ack, report }.encode()).await;
            // What is lost, either way, is said again.
            let heard = timeout(KEEP_ALIVE, other.visitor.datagram()).await;
            let Ok(datagram) = heard else { continue };
            let Ok(Some(update)) = decoder.decode(&datagram) else { continue };
            let shown = update.pose(self.avatar).map(Pose::from);
            if shown.is_some_and(|pose| pose.eye.distance(to) < WIRE_M) {
                return;
            }
        }
    }
}

/// What must hold for two visitors, whatever connects them.
async fn suite(kinds: [Kind; 2]) {
    let (server, _web, doors) = open(config());
    let (mut ada, mut bo) = tokio::join!(
        Guest::join(kinds[0], doors, "Ada", 1, WAY[2]),
        Guest::join(kinds[1], doors, "Bo", 2, WAY[2] + Vec3::X),
    );
    let ids = [ada.avatar, bo.avatar];
    tokio::join!(ada.sees(ids[1]), bo.sees(ids[0]));
    ada.walks_before(&mut bo, WAY[2] - Vec3::Z * 0.3).await;
    bo.walks_before(&mut ada, WAY[2] + Vec3::X - Vec3::Z * 0.3).await;
    ada.says("hello").await;
    bo.hears(ada.avatar, "hello").await;
    bo.says("hello yourself").await;
    ada.hears(bo.avatar, "hello yourself").await;

    // A client that comes again, after its link broke or before, has its avatar again.
    let former = bo.avatar;
    let mut bo_again = Guest::join(kinds[1], doors, "Bo", 2, WAY[2]).await;
    assert_eq!(bo_again.avatar, former);
    let told = bo.visitor.rest().await;
    let is_dismissal = |message: &ServerMessage| match message {
        ServerMessage::Goodbye { reason, may_return } => {
            !may_return && reason.as_str() == "somebody else came in with your key"
        }
        _ => false,
    };
    assert!(told.iter().any(is_dismissal), "{told:?}");

    bo_again.visitor.say(&ClientMessage::Goodbye).await;
    bo_again.visitor.rest().await;
    let vanishes = |message| match message {
        ServerMessage::Vanish { avatar } => (avatar == former).then_some(()),
        _ => None,
    };
    ada.visitor.until(vanishes).await;
    server.shutdown().await;
    let told = ada.visitor.rest().await;
    let is_goodbye = |message: &ServerMessage| {
        matches!(message, ServerMessage::Goodbye { may_return: true, .. })
    };
    assert!(told.iter().any(is_goodbye), "{told:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn visitors_of_every_kind_meet_talk_come_back_and_leave() {
    for kind in KINDS {
        suite([kind; 2]).await;
    }
    suite([Kind::WebTransport, Kind::Quic]).await;
    suite([Kind::Quic, Kind::WebSocket]).await;
}

/// The goodbye may still be under way back when somebody comes again under another name.
#[tokio::test(flavor = "multi_thread")]
async fn who_says_goodbye_and_comes_again_at_once_is_somebody_new() {
    let (_server, _web, doors) = open(config());
    for kind in KINDS {
        let mut former = Guest::join(kind, doors, "Guest", 1, WAY[2]).await;
        former.visitor.say(&ClientMessage::Goodbye).await;
        let ada = Guest::join(kind, doors, "Ada", 1, WAY[2]).await;
        assert_ne!(ada.avatar, former.avatar, "{kind:?}");
        drop(ada);
        former.visitor.rest().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_broken_socket_is_no_goodbye() {
    let (server, _web, doors) = open(config());
    let ada = Guest::join(Kind::WebSocket, doors, "Ada", 1, WAY[2]).await;
    let avatar = ada.avatar;
    drop(ada);
    until("the link is lost", || server.stats().clients.is_empty()).await;
    let ada = Guest::join(Kind::WebSocket, doors, "Ada", 1, WAY[0]).await;
    assert_eq!(ada.avatar, avatar);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_secret_is_no_second_key() {
    let (server, _web, doors) = open(config());
    let stranger = Stranger::connect(doors.quic).await;
    let _stream = stranger.send(&frame::encode(&hello("Ada", 1))).await;
    stranger.is_closed().await;
    assert!(server.stats().clients.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_page_that_sends_junk_is_dropped_and_nobody_else_is() {
    let (server, _web, doors) = open(config());
    let mut ada = Guest::join(Kind::WebSocket, doors, "Ada", 1, WAY[2]).await;
    let fetch = frame::encode(&ClientMessage::FetchWorld { world: 1 });
    let junk = [
        Message::text("hello"),
        Message::binary(vec![]),
        Message::binary(vec![2, 0]),
        Message::binary(vec![0, 0xff, 0xff, 0xff]),
        Message::binary([&[0], &fetch[..]].concat()),
        Message::binary([&[1], &[0xff; 1_000][..]].concat()),
        Message::binary(vec![0; 100_000]),
    ];
    for message in junk {
        let mut stranger = Visitor::greet(Kind::WebSocket, doors, "Stranger", 9).await;
        let is_in = |message| matches!(message, ServerMessage::Welcome { .. }).then_some(());
        stranger.until(is_in).await;
        stranger.send_raw(message).await;
        stranger.rest().await;
    }
    until("only Ada is left", || server.stats().clients.len() == 1).await;
    ada.says("still here").await;
    let own = ada.avatar;
    ada.hears(own, "still here").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_of_other_sites_may_not_visit_unless_they_are_listed() {
    let web_origins = vec!["https://house.example".parse().unwrap()];
    let (_server, _web, doors) = open(ServeConfig { web_origins, ..config() });
    let own = format!("http://{}", doors.web);
    for (origin, is_welcome) in [
        (own.as_str(), true),
        ("https://house.example", true),
        ("http://house.example", false),
        ("http://evil.example", false),
        ("null", false),
    ] {
        let socket = web_socket(doors.web, origin).await;
        assert_eq!(socket.is_ok(), is_welcome, "{origin}");
    }
    let (status, ..) = get(doors.web, "/join.json", "Host: evil.example\r\n").await;
    assert_eq!(status, 403, "a name of another site that leads here");
    let (status, ..) = get(doors.web, "/join.json", "Host: house.example\r\n").await;
    assert_eq!(status, 200);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_page_learns_how_to_join_and_gets_the_world_once_and_for_all() {
    let (server, _web, doors) = open(config());
    let (status, _, body) = get(doors.web, "/join.json", "").await;
    let join: serde_json::Value = serde_json::from_slice(&body).unwrap();
    let served = building::world();
    let id = join["world"].as_str().unwrap();
    assert_eq!(
        (status, &join["version"], &join["websocket"]),
        (200, &VERSION.into(), &"/visit".into())
    );
    assert_eq!(join["world_bytes"], served.bytes().len());
    assert_eq!(join["warnings"].as_array().unwrap().len(), 0, "it is this machine: {join}");

    let (status, header, body) = get(doors.web, &format!("/world/{id}"), "").await;
    assert_eq!((status, &body[..]), (200, &served.bytes()[..]));
    assert_eq!(content_id(&body).unwrap().to_string(), id);
    assert!(World::from_bytes(&body).is_ok());
    assert!(header.contains("cache-control: public, max-age=31536000, immutable"), "{header}");
    let known = format!("If-None-Match: \"{id}\"\r\n");
    let (status, _, body) = get(doors.web, &format!("/world/{id}"), &known).await;
    assert_eq!((status, body.len()), (304, 0));
    let (status, ..) = get(doors.web, &format!("/world/{}", "0".repeat(64)), "").await;
    assert_eq!(status, 404);
    server.shutdown().await;
}

/// A reverse proxy says for whom it asks, and only one that is listed is believed.
#[tokio::test(flavor = "multi_thread")]
async fn a_listed_proxy_is_believed_and_no_other() {
    let rate = |said: &'static str, doors: Doors| async move {
        let mut taken = 0;
        for _ in 0..8 {
            let fields =
                format!("X-Forwarded-For: 203.0.113.1, {said}\r\nX-Forwarded-Proto: https\r\n");
            taken += u32::from(get(doors.web, "/join.json", &fields).await.0 == 200);
        }
        taken
    };
    for (web_proxies, taken_of_one) in [(vec!["127.0.0.1".parse().unwrap()], 2), (vec![], 8)] {
        let mut config = ServeConfig { web_proxies, ..config() };
        config.limits.web_requests_per_s = 1;
        let (_server, _web, doors) = open(config);
        assert!(rate("198.51.100.7", doors).await.abs_diff(taken_of_one) <= 1);
        let (status, ..) = get(doors.web, "/join.json", "X-Forwarded-For: 198.51.100.9\r\n").await;
        assert_eq!(status, 200, "another network");
    }
}

/// Opens both kinds of connections and says hello on each. What each hears first.
const VISIT: &str = "(async () => {
    const join = await (await fetch('/join.json')).json();
    const socket = new WebSocket(join.websocket);
    socket.binaryType = 'arraybuffer';
    await new Promise(open => socket.onopen = open);
    const first = new Promise(heard => socket.onmessage = ({ data }) => heard(data));
    socket.send(new Uint8Array([0, ...HELLOS[0]]));
    const { url, hashes } = join.webtransport;
    const value = hash => Uint8Array.from(atob(hash), letter => letter.charCodeAt(0));
    const serverCertificateHashes =
        hashes.map(hash => ({ algorithm: 'sha-256', value: value(hash) }));
    const transport = new WebTransport(url, { serverCertificateHashes });
    await transport.ready;
    const { readable, writable } = await transport.createBidirectionalStream();
    await writable.getWriter().write(new Uint8Array(HELLOS[1]));
    const { value: piece } = await readable.getReader().read();
    return [[...new Uint8Array(await first)], [0, ...piece]];
})().catch(String)";

#[tokio::test(flavor = "multi_thread")]
async fn a_real_browser_opens_both_kinds_of_connections() {
    let (server, _web, doors) = open(config());
    let hellos = [1, 2].map(|secret| frame::encode(&hello("Ada", secret)));
    let script = VISIT.replace("HELLOS", &serde_json::to_string(&hellos).unwrap());
    let url = format!("http://{}/join.json", doors.web);
    let look = move || {
        let mut page = Browser::open(&url)?;
        page.until("document.readyState === 'complete' && location.protocol === 'http:'");
        Some((page.value(&script), page))
    };
    let Some((heard, page)) = tokio::task::spawn_blocking(look).await.unwrap() else {
        println!("skipped: Chromium is not installed");
        return;
    };
    let pieces: Vec<Vec<u8>> =
        serde_json::from_value(heard.clone()).unwrap_or_else(|_| panic!("{heard}"));
    for piece in pieces {
        let mut frames = FrameBuffer::default();
        frames.push(&piece[1..]);
        let first = ServerMessage::decode(frames.next_frame().unwrap().unwrap()).unwrap();
        assert!(matches!(first, ServerMessage::Welcome { .. }), "{first:?}");
    }
    // A browser that goes away leaves nobody behind.
    drop(page);
    until("both are gone", || server.stats().clients.is_empty()).await;
}
