//! Clients whose links break, and who come back by themselves.

use std::{net::SocketAddr, sync::Arc, time::Duration};

use glam::Vec3;
use sightline_client::net::{ConnectOptions, Dialer, Session, SessionState};
use sightline_client_core::replica::{Event, ShownAvatar};
use sightline_protocol::{VERSION, frame, message::ClientMessage};
use sightline_server::net::{Identity, ServeConfig, Server};
use sightline_world::motion::{AvatarId, Pose};
use tokio::time::{Instant, sleep};

use super::{
    building::{self, EAST, WAY, WEST},
    config, hears, holds, join, options, serve, until, walk,
};
use crate::{
    proxy::Proxy,
    stranger::{Stranger, hello_as},
};

/// Joins through a proxy, or another address.
async fn join_at(address: SocketAddr, server: &Server, name: &str, place: Vec3) -> Session {
    Dialer::new(None).connect(address, &options(server, name, place)).await.unwrap()
}

fn is_returning(session: &Session) -> bool {
    matches!(session.state(), SessionState::Returning { .. })
}

/// Whom a session was told of since the last call.
fn appeared(session: &Session) -> Vec<AvatarId> {
    let appeared = |event| match event {
        Event::Appeared(avatar) => Some(avatar),
        _ => None,
    };
    session.events().into_iter().filter_map(appeared).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn after_a_partition_of_twelve_seconds_all_are_back_in_their_avatars() {
    let (server, address) = serve(ServeConfig { validity_max_s: 8.0, ..config() });
    let proxy = Proxy::new(address, 1);
    let witness = join(&server, "Wes", WEST + Vec3::Z).await;
    let mut lost = Vec::new();
    for i in 0..4 {
        let place = WEST + Vec3::X * i as f32;
        lost.push(join_at(proxy.address, &server, &format!("Ada {i}"), place).await);
    }
    let ids: Vec<AvatarId> = lost.iter().map(Session::avatar).collect();
    until("all are seen", || ids.iter().all(|id| holds(&witness, *id))).await;
    appeared(&witness);
    proxy.cut(true);
    let cut = Instant::now();
    until("all know that their links broke", || lost.iter().all(is_returning)).await;
    assert!(cut.elapsed() < Duration::from_secs(8), "{:?}", cut.elapsed());
    sleep(Duration::from_secs(12).saturating_sub(cut.elapsed())).await;
    assert!(ids.iter().all(|id| holds(&witness, *id)), "their avatars stand there");
    let overview = server.observer().overview().await.unwrap();
    assert_eq!((overview.clients.absent, overview.people.len()), (4, 5), "operators see them");
    proxy.cut(false);
    let mended = Instant::now();
    until("all are back", || lost.iter().all(Session::is_present)).await;
    assert!(mended.elapsed() < Duration::from_secs(5), "{:?}", mended.elapsed());
    for (i, session) in lost.iter().enumerate() {
        assert_eq!((session.avatar(), session.stats().returns), (ids[i], 1));
        assert!(session.pose().eye.distance(WEST + Vec3::X * i as f32) < 0.01);
    }
    let are_told = || lost.iter().all(|session| session.held().len() == 4);
    until("they are told anew who is in sight", are_told).await;
    assert_eq!(appeared(&witness), [], "nobody noticed");
    lost[0].chat("back again").unwrap();
    hears(&witness, "Ada 0", "back again").await;
    walk(&lost[1], WEST).await;
    let is_there =
        |avatar: &ShownAvatar| avatar.id == ids[1] && avatar.pose.eye.distance(WEST) < 0.05;
    until("he walks on", || witness.shown_avatars().iter().any(is_there)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn six_seconds_with_losses_lose_nobody() {
    let (server, address) = serve(ServeConfig { validity_max_s: 8.0, ..config() });
    let proxy = Proxy::new(address, 2);
    let mut visitors = Vec::new();
    for i in 0..4 {
        let place = WEST + Vec3::X * i as f32;
        visitors.push(join_at(proxy.address, &server, &format!("Ada {i}"), place).await);
    }
    proxy.lose(0.05);
    let end = Instant::now() + Duration::from_secs(6);
    while Instant::now() < end {
        for session in &visitors {
            session.set_pose(Pose { yaw: session.pose().yaw + 0.1, ..session.pose() });
        }
        sleep(Duration::from_millis(20)).await;
    }
    proxy.lose(0.0);
    until("all are there", || visitors.iter().all(Session::is_present)).await;
    assert!(visitors.iter().all(|session| session.end().is_none()));
    until("all see each other", || visitors.iter().all(|one| one.held().len() == 3)).await;
    assert_eq!(server.stats().clients.len(), 4);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_changed_address_goes_unnoticed() {
    let (server, address) = serve(config());
    let proxy = Proxy::new(address, 3);
    let ada = join_at(proxy.address, &server, "Ada", WEST).await;
    let bo = join(&server, "Bo", WEST + Vec3::X).await;
    until("they see each other", || holds(&ada, bo.avatar()) && holds(&bo, ada.avatar())).await;
    for line in ["one", "two", "three"] {
        proxy.change_addresses();
        let before = proxy.passed();
        until("packets pass", || proxy.passed() > before + 5).await;
        ada.chat(line).unwrap();
        hears(&bo, "Ada", line).await;
    }
    bo.chat("hello").unwrap();
    hears(&ada, "Bo", "hello").await;
    assert_eq!(ada.stats().returns, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_login_takes_the_avatar_over_and_the_first_is_told() {
    let (server, address) = serve(ServeConfig { clients_max: 2, ..config() });
    let bo = join(&server, "Bo", WEST + Vec3::X).await;
    let key = options(&server, "Ada", WEST);
    let first = Dialer::new(None).connect(address, &key).await.unwrap();
    walk(&first, WEST - Vec3::X).await;
    let is_there = |ada: &ShownAvatar| ada.pose.eye.distance(WEST - Vec3::X) < 0.05;
    until("Bo sees her there", || bo.shown_avatars().iter().any(is_there)).await;
    appeared(&bo);
    let elsewhere = ConnectOptions { place: Some(EAST), ..key };
    let second = Dialer::new(None).connect(address, &elsewhere).await.unwrap();
    assert_eq!(second.avatar(), first.avatar());
    assert!(second.pose().eye.distance(WEST - Vec3::X) < 0.3, "{}", second.pose().eye);
    let told = Some("somebody else came in with your key".to_owned());
    until("the first is told", || first.end() == told).await;
    walk(&second, WEST).await;
    second.chat("it is still me").unwrap();
    hears(&bo, "Ada", "it is still me").await;
    assert_eq!(appeared(&bo), [], "for Bo she was there all the time");
    assert_eq!(server.stats().clients.len(), 2);
}

/// Where the first one was is known only at the next tick.
#[tokio::test(flavor = "multi_thread")]
async fn a_second_login_that_enters_at_once_goes_on_where_the_first_one_was() {
    let (server, address) = serve(ServeConfig { tick_hz: 5, ..config() });
    let ada_at = options(&server, "Ada", WEST);
    let first = Dialer::new(None).connect(address, &ada_at).await.unwrap();
    let second = Stranger::with_identity(address, &ada_at.identity).await;
    let enter = ClientMessage::Enter { world: 1, place: Some(EAST.into()), reports_from: 0 };
    let _stream = second
        .send(&[hello_as("Ada", [10, 20, 30], VERSION), frame::encode(&enter)].concat())
        .await;
    until("the first is told", || first.end().is_some()).await;
    let is_in = || server.stats().clients.values().any(|client| client.reporting_state.is_some());
    until("the second is in the world", is_in).await;
    let overview = server.observer().overview().await.unwrap();
    let eyes = overview.people.iter().filter_map(|person| person.place.as_ref());
    let eyes: Vec<Vec3> = eyes.map(|place| place.eye.into()).collect();
    assert!(eyes.len() == 1 && eyes[0].distance(WEST) < 0.3, "{eyes:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn operators_see_who_is_back_and_has_not_entered_as_joining() {
    let (server, address) = serve(config());
    let options = options(&server, "Ada", WEST);
    let first = Dialer::new(None).connect(address, &options).await.unwrap();
    let second = Stranger::with_identity(address, &options.identity).await;
    let _stream = second.send(&hello_as("Ada", [10, 20, 30], VERSION)).await;
    until("the first is told", || first.end().is_some()).await;
    let overview = server.observer().overview().await.unwrap();
    assert_eq!((overview.clients.joining, overview.people.len()), (1, 1));
    assert!(overview.people[0].place.is_some(), "her avatar stands in the world");
}

#[tokio::test(flavor = "multi_thread")]
async fn who_says_goodbye_is_gone_at_once() {
    let (server, address) = serve(config());
    let bo = join(&server, "Bo", WEST + Vec3::X).await;
    let options = options(&server, "Ada", WEST);
    let ada = Dialer::new(None).connect(address, &options).await.unwrap();
    let before = ada.avatar();
    until("Bo sees her", || holds(&bo, before)).await;
    ada.leave().await;
    until("she is gone", || bo.held().is_empty()).await;
    let ada = Dialer::new(None).connect(address, &options).await.unwrap();
    assert_ne!(ada.avatar(), before);
}

/// A server that was killed leaves its clients without a word. The one in its place knows none of
/// them.
#[tokio::test(flavor = "multi_thread")]
async fn clients_are_back_soon_after_the_server_is() {
    let identity = Arc::new(Identity::generate().unwrap());
    let start = |listen: SocketAddr| {
        let config = ServeConfig { listen, ..config() };
        Server::bind(building::world(), config, &identity)
    };
    let server = start("127.0.0.1:0".parse().unwrap()).unwrap();
    let address = server.local_addr().unwrap();
    let (ada, bo) = (join(&server, "Ada", WEST).await, join(&server, "Bo", WAY[1]).await);
    drop(server);
    let mut server = None;
    until("the address is free", || {
        server = start(address).ok();
        server.is_some()
    })
    .await;
    let started = Instant::now();
    until("both are back", || {
        let is_back = |session: &Session| session.is_present() && session.stats().returns == 1;
        is_back(&ada) && is_back(&bo)
    })
    .await;
    assert!(started.elapsed() < Duration::from_secs(5), "{:?}", started.elapsed());
    assert!(ada.pose().eye.distance(WEST) < 0.01 && bo.pose().eye.distance(WAY[1]) < 0.01);
    assert_eq!((ada.end(), bo.end()), (None, None));
}

#[tokio::test(flavor = "multi_thread")]
async fn who_comes_again_with_another_name_begins_anew() {
    let (server, address) = serve(config());
    let witness = join(&server, "Wes", WEST + Vec3::Z).await;
    let names = || Vec::from_iter(witness.shown_avatars().into_iter().map(|shown| shown.name));
    let first = options(&server, "Ada", WEST);
    let ada = Dialer::new(None).connect(address, &first).await.unwrap();
    until("Ada is there", || names() == ["Ada"]).await;
    // The goodbye of the first link has not arrived.
    let second =
        ConnectOptions { identity: first.identity.clone(), ..options(&server, "Eve", WEST) };
    let eve = Dialer::new(None).connect(address, &second).await.unwrap();
    until("Eve is there, and Ada is not", || names() == ["Eve"]).await;
    until("Ada's link has ended", || ada.end().is_some()).await;
    eve.leave().await;
    until("nobody is there", || names().is_empty()).await;
}
