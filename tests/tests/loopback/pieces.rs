//! A world that arrives in pieces, on real sockets.

use std::time::Duration;

use base64::{Engine as _, prelude::BASE64_STANDARD};
use sightline_client::net::{ConnectOptions, Dialer, Session, SessionState};
use sightline_client_core::{arriving::ArrivingWorld, fetching::Outlook};
use sightline_protocol::{
    VERSION, frame,
    message::{ClientMessage, ServerMessage},
    piece_stream::{HEAD, REFUSED, before_piece, read_before_piece, requests},
};
use sightline_renderer::{Camera, Frame, Renderer, streaming::shown_branches};
use sightline_server::{
    net::{Limits, ServeConfig, Server},
    web::WebServer,
};
use sightline_visibility::streaming::pieces_of;
use sightline_world::{PieceId, WorldHead};

use super::{
    building::{self, EAST, WAY, WEST},
    config, holds, join, options,
    proxy::Proxy,
    serve,
    stranger::{Stranger, hello, hello_and_enter},
    until,
    visitor::{Doors, Kind, Visitor, get},
    walk,
};

const SIZE: (usize, usize) = (96, 54);
/// The most bytes that are asked for and not here.
const UNDER_WAY: usize = 16 * 1_024;

/// A server of the two rooms, which it has cut.
async fn serve_pieces(config: ServeConfig) -> (Server, std::net::SocketAddr) {
    let (server, address) = serve(ServeConfig { pieces_from_bytes: 0, ..config });
    let is_cut = || server.world().is_some_and(|world| world.pieces_bytes().is_some());
    until("the world is cut", is_cut).await;
    (server, address)
}

/// A visitor that draws what has come of the world.
struct Eyes {
    session: Session,
    building: ArrivingWorld,
    frame: Frame,
    renderer: Renderer,
}

impl Eyes {
    async fn join(server: &Server, address: std::net::SocketAddr, name: &str) -> Self {
        Self::join_by(&Dialer::new(None), server, address, name).await
    }

    async fn join_by(
        dialer: &Dialer,
        server: &Server,
        address: std::net::SocketAddr,
        name: &str,
    ) -> Self {
        let options = ConnectOptions { in_pieces: true, ..options(server, name, WEST) };
        let session = dialer.connect(address, &options).await.unwrap();
        let building = session.building();
        let (frame, renderer) = (Frame::new(SIZE.0, SIZE.1), Renderer::default());
        Self { session, building, frame, renderer }
    }

    /// Takes in what has come, draws, and asks for more. Returns whether the picture is sharp.
    fn look(&mut self, all: bool) -> bool {
        for (number, piece) in self.session.arrived_pieces(&self.building) {
            self.building.take(number, piece).unwrap();
        }
        let camera = Camera::at(&self.session.pose());
        let mut shown = Vec::new();
        if self.building.is_open_at(camera.eye) {
            self.renderer.draw(self.building.octree(), &camera, &mut self.frame);
            let fetcher = self.building.fetcher();
            shown = fetcher
                .map(|fetcher| shown_branches(&self.frame, &camera, fetcher.octree(), 1))
                .unwrap_or_default();
        }
        let focal = camera.focal(SIZE.1);
        let (eye, velocity) = (camera.eye, glam::Vec3::ZERO);
        let outlook = Outlook { eye, velocity, focal, shown: &shown, plan: true, all };
        self.building.refuse(&self.session.refused_pieces(&self.building));
        let next = self.building.next(&outlook, UNDER_WAY);
        self.session.ask_for_pieces(&self.building, &next);
        self.building.fetcher().is_none_or(|fetcher| fetcher.is_sharp(&outlook))
    }

    /// The picture that the whole world gives.
    fn expected(&mut self) -> Frame {
        let mut frame = Frame::new(SIZE.0, SIZE.1);
        let camera = Camera::at(&self.session.pose());
        self.renderer.draw(&building::world().world().octree, &camera, &mut frame);
        frame
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn who_comes_is_in_before_the_world_is_here_and_sees_the_same_in_the_end() {
    let (server, address) = serve_pieces(config()).await;
    let mut ada = Eyes::join(&server, address, "Ada").await;
    assert!(ada.session.is_present() && ada.building.complete().is_none());
    assert!(!ada.building.is_open_at(WEST), "no voxel is here");
    let mut bo = Eyes::join(&server, address, "Bo").await;
    let (one, other) = (ada.session.avatar(), bo.session.avatar());
    until("they see each other", || holds(&ada.session, other) && holds(&bo.session, one)).await;
    until("the picture is sharp", || ada.look(false)).await;
    assert!(ada.building.complete().is_none(), "not all is needed for it");
    let expected = ada.expected();
    assert!(ada.frame.colour == expected.colour && ada.frame.depth == expected.depth);

    until("all is here", || {
        bo.look(true);
        bo.building.complete().is_some()
    })
    .await;
    let (whole, complete) = (building::world(), bo.building.complete().unwrap());
    let whole = whole.world();
    assert_eq!(complete.octree.materials, whole.octree.materials);
    assert_eq!((&complete.spawns, complete.body), (&whole.spawns, whole.body));
    let expected = bo.expected();
    assert!(bo.look(true) && bo.frame.colour == expected.colour);

    // Others get the file as before.
    let carl = join(&server, "Carl", EAST).await;
    assert_eq!(&carl.world(), whole);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_asked_for_comes_however_the_link_breaks() {
    let (server, address) = serve_pieces(config()).await;
    let proxy = Proxy::new(address, 5);
    proxy.delay(Duration::from_millis(20), Duration::ZERO);
    let mut ada = Eyes::join(&server, proxy.address, "Ada").await;
    until("some pieces are here", || {
        ada.look(true);
        ada.building.taken() > 3
    })
    .await;
    proxy.cut(true);
    ada.look(true);
    let is_lost = || matches!(ada.session.state(), SessionState::Returning { .. });
    until("the link is lost", is_lost).await;
    assert!(ada.building.complete().is_none());
    proxy.cut(false);
    until("all is here", || {
        ada.look(true);
        ada.building.complete().is_some()
    })
    .await;
    until("Ada is back", || ada.session.is_present()).await;
    assert!(ada.building.is(&ada.session.world()), "it is the same building");
}

#[tokio::test(flavor = "multi_thread")]
async fn pieces_that_are_on_disk_are_not_fetched_again() {
    let folder = tempfile::tempdir().unwrap();
    let (server, address) = serve_pieces(config()).await;
    let mut fetched = Vec::new();
    for _ in 0..2 {
        let dialer = Dialer::new(Some(folder.path().to_owned()));
        let mut ada = Eyes::join_by(&dialer, &server, address, "Ada").await;
        assert!(ada.building.complete().is_none(), "the file is not kept");
        until("all is here", || {
            ada.look(true);
            ada.building.complete().is_some()
        })
        .await;
        let client = server.stats().clients[&ada.session.avatar().0];
        fetched.push(client.traffic.world_bytes_out as usize);
        ada.session.leave().await;
        // What is stored beside may take a moment.
        tokio::time::sleep(Duration::from_millis(300)).await;
    }
    let all = server.world().unwrap().pieces_bytes().unwrap();
    // Equal pieces are fetched once.
    assert!(fetched[0] > all / 2 && fetched[1] < all / 20, "{fetched:?} of {all}");
}

/// What a stranger gets on the stream for pieces that it opens with these bytes, until nothing comes
/// for a while.
async fn asks(stranger: &Stranger, bytes: &[u8]) -> Vec<u8> {
    let (mut send, mut receive) = stranger.connection.open_bi().await.unwrap();
    send.write_all(bytes).await.unwrap();
    let mut got = Vec::new();
    let mut chunk = [0; 4_096];
    let pause = Duration::from_millis(700);
    while let Ok(Ok(Some(bytes))) = tokio::time::timeout(pause, receive.read(&mut chunk)).await {
        got.extend_from_slice(&chunk[..bytes]);
    }
    got
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_that_no_client_makes_end_the_session() {
    let (_server, address) = serve_pieces(config()).await;
    let world = 1u32.to_le_bytes();
    let head = [&world[..], &requests(&[HEAD])].concat();
    let none = [&world[..], &0u16.to_le_bytes()].concat();
    let many = [&world[..], &300u16.to_le_bytes()].concat();
    let unknown = [&world[..], &requests(&[1 << 30])].concat();
    let later = [&7u32.to_le_bytes()[..], &requests(&[HEAD])].concat();
    let twice = [&world[..], &requests(&[HEAD; 100])].concat();
    for faulty in [none, many, unknown, later, twice] {
        let stranger = Stranger::connect(address).await;
        let _control = stranger.send(&hello(VERSION)).await;
        assert!(asks(&stranger, &head).await.len() > 100, "the head comes");
        asks(&stranger, &faulty).await;
        stranger.is_closed().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn who_asks_again_and_again_waits_and_is_counted() {
    let limits = Limits { piece_bytes_per_s: 1_024, ..Limits::default() };
    let (server, address) = serve_pieces(ServeConfig { limits, ..config() }).await;
    let http = super::operators::listen(&server, &Limits::default()).await;
    let stranger = Stranger::connect(address).await;
    let _control = stranger.send(&hello(VERSION)).await;
    let world = 1u32.to_le_bytes();
    let again = requests(&[HEAD]).repeat(200);
    let got = asks(&stranger, &[&world[..], &again].concat()).await;
    // Another stream brings no more.
    let more = asks(&stranger, &[&world[..], &again].concat()).await;
    let all = server.world().unwrap().pieces_bytes().unwrap();
    assert!(got.len() > all / 2 && got.len() + more.len() < all * 2, "{} {all}", got.len());
    let counts = super::operators::metrics(http.local_addr()).await;
    assert!(counts["sightline_refused_total{reason=\"piece_bytes_per_s\"}"] >= 1.0);
    let goodbye = frame::encode(&ClientMessage::Goodbye);
    let said = Stranger::connect(address).await.converse(&[hello(VERSION), goodbye].concat()).await;
    let is_offer = |message: &ServerMessage| matches!(message, ServerMessage::World { head: Some(head), .. } if head.bytes > 0);
    assert!(said.iter().any(is_offer), "{said:?}");
}

/// A server of the two rooms that hands out only what may be seen, and the numbers of the pieces
/// that may be seen from the western room, and of those in the eastern one that may not.
async fn serve_private() -> (Server, std::net::SocketAddr, [Vec<u32>; 2]) {
    let (server, address) = serve_pieces(ServeConfig { private_geometry: true, ..config() }).await;
    let world = building::world();
    let head = WorldHead::read(&pieces_of(world.world(), &[]).head).unwrap();
    let grades = u32::from(head.octree.grades());
    let seen = head.seen_from(WEST).unwrap();
    let (mut shown, mut hidden) = (Vec::new(), Vec::new());
    for branch in 0..head.octree.branches() as u32 {
        let is_east = head.octree.bounds_of(branch as usize).unwrap().min.x > WAY[3].x;
        match (seen.contains(branch), is_east) {
            (true, _) => shown.extend(branch * grades..(branch + 1) * grades),
            (false, true) => hidden.extend(branch * grades..(branch + 1) * grades),
            (false, false) => {}
        }
    }
    (server, address, [shown, hidden])
}

/// Whether an avatar is in the world, seen or not.
fn is_somebody_in(server: &Server) -> bool {
    let counts = server.stats().counts;
    counts.live + counts.quiet + counts.asked > 0
}

#[tokio::test(flavor = "multi_thread")]
async fn where_geometry_is_private_nobody_gets_what_cannot_be_seen() {
    let (server, address, [shown, hidden]) = serve_private().await;
    let http = super::operators::listen(&server, &Limits::default()).await;
    assert!(!shown.is_empty() && hidden.len() > 20, "{} {}", shown.len(), hidden.len());
    let stranger = Stranger::connect(address).await;
    let _control = stranger.send(&hello_and_enter()).await;
    let world = 1u32.to_le_bytes();
    until("the stranger is in", || is_somebody_in(&server)).await;
    let some = [shown[0], hidden[0], hidden[hidden.len() / 2]];
    let got = asks(&stranger, &[&world[..], &requests(&some)].concat()).await;
    let (before, rest) = got.split_first_chunk().unwrap();
    let (number, bytes) = read_before_piece(*before);
    assert_eq!(number, shown[0]);
    let refused: Vec<u8> = some[1..].iter().flat_map(|at| before_piece(*at, REFUSED)).collect();
    assert_eq!(rest[bytes as usize..], refused);
    let counts = super::operators::metrics(http.local_addr()).await;
    assert_eq!(counts["sightline_refused_total{reason=\"private_geometry\"}"], 2.0);

    // The file would show all.
    let whole = options(&server, "Carl", EAST);
    assert!(Dialer::new(None).connect(address, &whole).await.is_err());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_walk_through_private_geometry_shows_what_the_whole_world_shows() {
    let (server, address, _) = serve_private().await;
    let mut ada = Eyes::join(&server, address, "Ada").await;
    for place in WAY {
        walk(&ada.session, place).await;
        until("all is here that is to be seen", || ada.look(false)).await;
        let expected = ada.expected();
        assert!(ada.frame.colour == expected.colour && ada.frame.depth == expected.depth);
    }
    assert!(ada.building.complete().is_none());
}

#[tokio::test(flavor = "multi_thread")]
async fn browsers_get_private_pieces_by_the_secret_of_their_visitor() {
    let (server, _, [shown, hidden]) = serve_private().await;
    let web =
        WebServer::listen("127.0.0.1:0".parse().unwrap(), server.web_door().unwrap()).unwrap();
    let address = web.local_addr();
    let (_, _, body) = get(address, "/join.json", "").await;
    let join: serde_json::Value = serde_json::from_slice(&body).unwrap();
    assert_eq!(join["private"], true);
    let (id, file) = (join["head"].as_str().unwrap(), join["world"].as_str().unwrap());
    assert_eq!(get(address, &format!("/world/{file}"), "").await.0, 403);
    let path = format!("/pieces/{id}/{},{}", shown[0], hidden[0]);
    let (status, header, body) = get(address, &path, "").await;
    assert!(status == 200 && header.contains("no-store") && body.is_empty(), "{header}");
    let all = format!("x-refused: {},{}", shown[0], hidden[0]);
    assert!(header.contains(&all), "nobody is known to ask: {header}");

    let doors = Doors { quic: server.local_addr().unwrap(), web: address };
    let mut ada = Visitor::greet(Kind::WebSocket, doors, "Ada", 7).await;
    ada.until(|message| matches!(message, ServerMessage::World { .. }).then_some(())).await;
    ada.say(&ClientMessage::Enter { world: 1, place: None, reports_from: 0 }).await;
    ada.until(|message| matches!(message, ServerMessage::Entered { .. }).then_some(())).await;
    let field = format!("x-visitor: {}\r\n", BASE64_STANDARD.encode([7; 32]));
    let (_, header, body) = get(address, &path, &field).await;
    assert!(header.contains(&format!("x-refused: {}\r\n", hidden[0])), "{header}");
    assert!(!body.is_empty(), "she sees the first one");
}

#[tokio::test(flavor = "multi_thread")]
async fn browsers_get_pieces_by_http_and_keep_them() {
    let (server, _) = serve_pieces(config()).await;
    let web =
        WebServer::listen("127.0.0.1:0".parse().unwrap(), server.web_door().unwrap()).unwrap();
    let address = web.local_addr();
    let (_, _, body) = get(address, "/join.json", "").await;
    let join: serde_json::Value = serde_json::from_slice(&body).unwrap();
    let id = join["head"].as_str().unwrap().to_owned();
    let (status, header, body) = get(address, &format!("/pieces/{id}/head"), "").await;
    assert!(status == 200 && header.contains("immutable"), "{status} {header}");
    assert_eq!(PieceId::of(&body).to_string(), id);
    let head = WorldHead::read(&body).unwrap();
    let (status, header, body) = get(address, &format!("/pieces/{id}/2,0"), "").await;
    assert!(status == 200 && header.contains("immutable"), "{status} {header}");
    let lengths = [2, 0].map(|number| head.piece(number).unwrap());
    let (first, second) = body.split_at(lengths[0].1 as usize);
    assert_eq!([first, second].map(PieceId::of), lengths.map(|(id, _)| id));
    let many = vec!["1"; 257].join(",");
    let other = "0".repeat(32);
    for (path, expected) in [
        (format!("/pieces/{id}/{many}"), 400),
        (format!("/pieces/{id}/x"), 400),
        (format!("/pieces/{id}/1,,2"), 400),
        (format!("/pieces/{id}/{}", head.pieces()), 400),
        (format!("/pieces/{other}/head"), 404),
    ] {
        assert_eq!(get(address, &path, "").await.0, expected, "{path}");
    }
}
