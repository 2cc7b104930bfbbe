//! The whole system over loopback QUIC: server, engine, protocol and client.

mod browser;
mod building;
mod crowd;
mod in_browser;
mod ladder;
mod limits;
mod moderation;
mod nats;
mod operators;
mod page;
mod pieces;
mod proxy;
mod respawn;
mod returning;
mod shared_people;
mod stations;
mod stop;
mod stranger;
mod supplied;
mod traced;
mod transports;
mod visitor;
mod worlds;

use std::{net::SocketAddr, sync::Arc, time::Duration};

use glam::Vec3;
use sightline_client::net::{
    ConnectError, ConnectOptions, Dialer, Session, SessionState, Trust, TrustError,
};
use sightline_client_core::replica::{Event, ShownAvatar};
use sightline_protocol::{
    VERSION,
    fingerprint::Fingerprint,
    message::{Refusal, ServerMessage},
    text::Name,
};
use sightline_server::net::{Identity, ServeConfig, Server};
use sightline_world::motion::{AvatarId, Pose, ReportingState};

use building::{EAST, SPEED_MAX, WAY, WEST};
use stranger::{Stranger, hello, hello_and_enter};

/// How long a test waits for what must happen, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

fn config() -> ServeConfig {
    ServeConfig {
        free_entry: true,
        listen: "127.0.0.1:0".parse().unwrap(),
        tick_hz: 50,
        validity_max_s: 0.3,
        ..ServeConfig::default()
    }
}

/// Starts a server of the two rooms. Returns it with its address.
fn serve(config: ServeConfig) -> (Server, SocketAddr) {
    let server = Server::bind(building::world(), config, &Identity::generate().unwrap()).unwrap();
    let address = server.local_addr().unwrap();
    (server, address)
}

fn options(server: &Server, name: &str, place: Vec3) -> ConnectOptions {
    ConnectOptions {
        name: Name::new(name).unwrap(),
        colour: [10, 20, 30],
        place: Some(place),
        trust: Trust::Pinned(server.fingerprint()),
        identity: Arc::new(Identity::generate().unwrap()),
        invitation: None,
        in_pieces: false,
        progress: None,
    }
}

async fn join(server: &Server, name: &str, place: Vec3) -> Session {
    let address = server.local_addr().unwrap();
    Dialer::new(None).connect(address, &options(server, name, place)).await.unwrap()
}

/// Waits until a condition holds, however slow the machine is.
async fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let began = tokio::time::Instant::now();
    while !holds() {
        assert!(began.elapsed() < PATIENCE, "timed out waiting until {what}");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

fn holds(viewer: &Session, avatar: AvatarId) -> bool {
    viewer.held().iter().any(|held| held.id == avatar)
}

/// Walks in a straight line, slightly below the top speed.
async fn walk(session: &Session, to: Vec3) {
    let mut clock = tokio::time::Instant::now();
    loop {
        tokio::time::sleep(Duration::from_millis(5)).await;
        let passed = clock.elapsed().as_secs_f32();
        clock = tokio::time::Instant::now();
        let from = session.pose().eye;
        let (way, step) = (to - from, SPEED_MAX * 0.9 * passed.min(0.1));
        if way.length() <= step {
            session.set_pose(Pose { eye: to, ..Pose::default() });
            return;
        }
        let velocity = way.normalize() * SPEED_MAX * 0.9;
        session.set_pose(Pose { eye: from + way.normalize() * step, velocity, ..Pose::default() });
    }
}

fn is_quiet(session: &Session) -> bool {
    session.stats().reporting_state == Some(ReportingState::Quiet)
}

/// Waits until the listener hears the speaker's line.
async fn hears(listener: &Session, speaker: &str, line: &str) {
    until(&format!("{line:?} is heard"), || {
        let is_it = |event: &Event| match event {
            Event::Chat { name, text, .. } => name == speaker && text == line,
            _ => false,
        };
        listener.events().iter().any(is_it)
    })
    .await;
}

/// Both walk from their rooms to the lobby, where they see each other.
async fn meet(west: &Session, east: &Session) {
    walk(west, WAY[1]).await;
    walk(west, WAY[2]).await;
    walk(east, WAY[3]).await;
    let each_other = || holds(west, east.avatar()) && holds(east, west.avatar());
    until("they see each other", each_other).await;
}

/// Both walk back to their rooms, where neither is told of the other, and both are quiet.
async fn part(west: &Session, east: &Session) {
    walk(west, WAY[1]).await;
    walk(west, WEST).await;
    walk(east, EAST).await;
    let alone = || west.held().is_empty() && east.held().is_empty();
    until("neither holds the other", alone).await;
    until("both are quiet", || is_quiet(west) && is_quiet(east)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn two_avatars_fall_silent_are_asked_meet_part_meet_again_and_leave() {
    let (server, _) = serve(config());
    let ada = join(&server, "Ada", WEST).await;
    let bo = join(&server, "Bo", EAST).await;
    assert!(ada.pose().eye.distance(WEST) < 0.01, "the chosen place");
    assert!(ada.held().is_empty() && bo.held().is_empty());

    // Apart, they only answer asks.
    until("both are quiet", || is_quiet(&ada) && is_quiet(&bo)).await;
    let before = bo.stats();
    until("several asks came", || bo.stats().messages_in >= before.messages_in + 8).await;
    let after = bo.stats();
    let heard = after.messages_in - before.messages_in;
    let said = after.messages_out - before.messages_out;
    assert!(said <= heard, "{said} messages while quiet, though only {heard} came");

    meet(&ada, &bo).await;
    let is_live = |session: &Session| session.stats().reporting_state == Some(ReportingState::Live);
    until("both are live", || is_live(&ada) && is_live(&bo)).await;
    let is_ada = |shown: &ShownAvatar| shown.pose.eye.distance(WAY[2]) < 0.01;
    until("Bo knows just where Ada is", || bo.shown_avatars().iter().any(is_ada)).await;
    assert!(bo.shown_avatars().iter().any(|ada| ada.name == "Ada" && ada.colour == [10, 20, 30]));
    ada.chat("hello").unwrap();
    hears(&bo, "Ada", "hello").await;

    part(&ada, &bo).await;
    meet(&ada, &bo).await;
    let gone = ada.avatar();
    ada.leave().await;
    until("Ada vanishes", || !holds(&bo, gone)).await;
    let ada = join(&server, "Ada", WAY[2]).await;
    assert_ne!(ada.avatar(), gone);
    until("Ada is back", || holds(&bo, ada.avatar())).await;
    assert!(!holds(&bo, gone));
    assert_eq!((ada.end(), bo.end()), (None, None));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_closes_says_goodbye() {
    let (server, _) = serve(config());
    let ada = join(&server, "Ada", WEST).await;
    let begin = std::time::Instant::now();
    server.shutdown().await;
    assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
    let is_told = || match ada.state() {
        SessionState::Returning { reason, .. } => reason == "the server is closing",
        _ => false,
    };
    until("Ada is told", is_told).await;
    let goodbye = Event::Goodbye("the server is closing".to_owned());
    assert!(ada.events().contains(&goodbye));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_jump_is_refused_and_the_client_corrected() {
    let (server, _) = serve(config());
    let ada = join(&server, "Ada", WEST).await;
    ada.set_pose(Pose { eye: EAST, ..Pose::default() });
    let mut events = Vec::new();
    until("Ada is corrected", || {
        events.extend(ada.events());
        events.iter().any(|e| matches!(e, Event::Corrected(pose) if pose.eye.distance(WEST) < 0.01))
    })
    .await;
    until("Ada stays", || ada.pose().eye.distance(WEST) < 0.01).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_is_not_the_pinned_one_receives_nothing() {
    let (server, address) = serve(config());
    let mut options = options(&server, "Ada", WEST);
    options.trust = Trust::Pinned(Fingerprint([7; 32]));
    let error = Dialer::new(None).connect(address, &options).await.err().unwrap();
    assert!(matches!(error, ConnectError::Trust(TrustError::Pinned { found, .. })
        if found == server.fingerprint()));
    assert!(server.stats().clients.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_known_server_that_changed_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let known = folder.path().join("known-servers");
    let (server, address) = serve(config());
    let mut options = options(&server, "Ada", WEST);
    options.trust = Trust::FirstUse(known);
    for _ in 0..2 {
        Dialer::new(None).connect(address, &options).await.unwrap().leave().await;
    }
    server.shutdown().await;
    // The system frees the socket shortly after the server has gone.
    let mut other = None;
    until("the address is free", || {
        let config = ServeConfig { listen: address, ..config() };
        other = Server::bind(building::world(), config, &Identity::generate().unwrap()).ok();
        other.is_some()
    })
    .await;
    let error = Dialer::new(None).connect(address, &options).await.err().unwrap();
    assert!(matches!(error, ConnectError::Trust(TrustError::Changed { .. })), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_server_says_so() {
    let (server, address) = serve(ServeConfig { clients_max: 1, ..config() });
    let ada = join(&server, "Ada", WEST).await;
    let refused = Dialer::new(None).connect(address, &options(&server, "Bo", EAST)).await;
    assert!(matches!(refused.err().unwrap(), ConnectError::Refused(Refusal::Full)));
    ada.leave().await;
    until("there is room", || server.stats().clients.is_empty()).await;
    join(&server, "Bo", EAST).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_of_another_version_is_told_the_servers_version() {
    let (_server, address) = serve(config());
    let stranger = Stranger::connect(address).await;
    let said = stranger.converse(&hello(VERSION + 1)).await;
    let reason = Refusal::Version { server: VERSION };
    assert_eq!(said, [ServerMessage::Refused { reason }]);
    stranger.is_closed().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_sends_junk_is_dropped_and_no_other_is() {
    let (server, address) = serve(config());
    let ada = join(&server, "Ada", WEST).await;
    let enter_twice = [hello_and_enter(), hello_and_enter()].concat();
    let flood = [hello_and_enter(), [1, 0, 5].repeat(5_000)].concat();
    let junk: [&[u8]; 6] = [
        b"GET / HTTP/1.1\r\n\r\n",
        &[0xff; 64],
        &[0, 0],
        &[4, 0, 9, 9, 9, 9],
        &enter_twice,
        &flood,
    ];
    for bytes in junk {
        let stranger = Stranger::connect(address).await;
        let _stream = stranger.send(bytes).await;
        stranger.is_closed().await;
    }
    let stranger = Stranger::connect(address).await;
    let _stream = stranger.send(&hello_and_enter()).await;
    until("the stranger is in", || server.stats().clients.len() == 2).await;
    stranger.connection.send_datagram(vec![0xff; 1_000].into()).unwrap();
    stranger.is_closed().await;
    until("only Ada is left", || server.stats().clients.len() == 1).await;
    ada.chat("still here").unwrap();
    hears(&ada, "Ada", "still here").await;
    assert_eq!(ada.end(), None);
}

#[tokio::test(flavor = "multi_thread")]
async fn clients_that_stall_are_dropped() {
    let (server, address) = serve(ServeConfig { hello_s: 0.2, silence_s: 0.5, ..config() });
    let silent = Stranger::connect(address).await;
    let half = Stranger::connect(address).await;
    let _half = half.send(&hello(VERSION)[..5]).await;
    let mute = Stranger::connect(address).await;
    let _mute = mute.send(&hello_and_enter()).await;
    for stranger in [silent, half, mute] {
        stranger.is_closed().await;
    }
    until("nobody is left", || server.stats().clients.is_empty()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_world_is_fetched_once() {
    let folder = tempfile::tempdir().unwrap();
    let (server, address) = serve(config());
    let fetched = async || {
        let dialer = Dialer::new(Some(folder.path().to_owned()));
        let session = dialer.connect(address, &options(&server, "Ada", WEST)).await.unwrap();
        assert_eq!(&session.world(), building::world().world());
        let client = server.stats().clients[&session.avatar().0];
        session.leave().await;
        client.traffic.world_bytes_out
    };
    assert!(fetched().await > 0);
    assert_eq!(fetched().await, 0);
}

/// A client that may enter anywhere could look into every room.
#[tokio::test(flavor = "multi_thread")]
async fn a_client_comes_in_at_a_spawn_point() {
    let spawn = building::world().world().spawns[0].eye;
    let elsewhere = WAY[1];
    for (free_entry, asked, expected) in
        [(false, elsewhere, spawn), (false, spawn, spawn), (true, elsewhere, elsewhere)]
    {
        let (server, _) = serve(ServeConfig { free_entry, ..config() });
        let session = join(&server, "Ada", asked).await;
        assert!(session.pose().eye.distance(expected) < 0.01, "{asked} with {free_entry}");
        server.shutdown().await;
    }
}
