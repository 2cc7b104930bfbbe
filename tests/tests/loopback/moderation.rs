//! Who may come in, who may do what to whom, and what is remembered.

use std::{net::SocketAddr, time::Duration};

use sightline_client::net::{ConnectError, ConnectOptions, Dialer, Session};
use sightline_client_core::replica::Event;
use sightline_protocol::{fingerprint::KeyFingerprint, message::Refusal, text::ChatLine};
use sightline_server::{
    net::{Author, Identity, ModerationError, ServeConfig, Server},
    people::{Access, Act, Database, Role, Subject, hash},
};

use super::{
    building::{self, WAY, WEST},
    config, hears, options, serve, until, walk,
};

async fn connect(address: SocketAddr, options: &ConnectOptions) -> Result<Session, ConnectError> {
    Dialer::new(None).connect(address, options).await
}

async fn is_refused(address: SocketAddr, options: &ConnectOptions, expected: Refusal) {
    match connect(address, options).await.err() {
        Some(ConnectError::Refused(reason)) => assert_eq!(reason, expected),
        other => panic!("{other:?} in place of {expected:?}"),
    }
}

fn key(options: &ConnectOptions) -> KeyFingerprint {
    options.identity.key_fingerprint()
}

/// Says a line until the server answers it. Who says too much is not heard, so it is said slowly.
async fn answers(session: &Session, line: &str, answer: &str) {
    let mut said = 0;
    until(&format!("{line:?} is answered by {answer:?}"), || {
        if said % 220 == 0 {
            session.chat(line).unwrap();
        }
        said += 1;
        let is_it = |event: &Event| matches!(event, Event::Notice(text) if text.contains(answer));
        session.events().iter().any(is_it)
    })
    .await;
}

async fn is_told(session: &Session, reason: &str) {
    until(&format!("somebody is told: {reason}"), || session.end().as_deref() == Some(reason))
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn moderators_kick_mute_and_ban_by_the_chat_line() {
    let (server, address) = serve(config());
    let [mo_at, ada_at, own_at] = ["Mo", "Ada 2", "Owen"].map(|name| options(&server, name, WEST));
    let (mo, ada) =
        (connect(address, &mo_at).await.unwrap(), connect(address, &ada_at).await.unwrap());
    let _own = connect(address, &own_at).await.unwrap();
    answers(&mo, "/kick Ada 2", "only moderators").await;
    let moderation = server.moderation();
    moderation.set_role(Author::Operator, key(&mo_at), Role::Moderator).unwrap();
    moderation.set_role(Author::Operator, key(&own_at), Role::Owner).unwrap();
    answers(&mo, "/help", "/kick NAME").await;
    answers(&mo, "/dance", "no command /dance").await;
    answers(&mo, "/role Ada 2 moderator", "only owners").await;
    answers(&mo, "/kick Owen", "your own role").await;
    answers(&mo, "/who Ada", &key(&ada_at).to_string()).await;

    answers(&mo, "/mute Ada 2 loud", "Ada 2 is muted").await;
    answers(&ada, "hello?", "you are muted").await;
    answers(&mo, "/unmute Ada 2", "may speak").await;
    tokio::time::sleep(Duration::from_secs(1)).await;
    ada.chat("hello!").unwrap();
    hears(&mo, "Ada 2", "hello!").await;

    answers(&mo, "/kick Ada 2 be nice", "Ada 2 is removed").await;
    is_told(&ada, "a moderator removed you: be nice").await;
    let ada = connect(address, &ada_at).await.unwrap();
    answers(&mo, "/ban Ada 2", "is banned").await;
    is_told(&ada, "you are banned").await;
    is_refused(address, &ada_at, Refusal::Banned).await;
    answers(&mo, &format!("/unban {}", key(&ada_at)), "is let in again").await;
    let _ada = connect(address, &ada_at).await.unwrap();
    // His own network is among those that he may not ban.
    answers(&mo, "/ban-network Ada 2", "your own role").await;
    let visitors = moderation.visitors();
    let names: Vec<&str> = visitors.iter().map(|visitor| visitor.name.as_str()).collect();
    assert_eq!(names, ["Ada 2", "Mo", "Owen"]);
    let roles: Vec<Role> = visitors.iter().map(|visitor| visitor.role).collect();
    assert_eq!(roles, [Role::Visitor, Role::Moderator, Role::Owner]);
    let subject = Subject::Key(key(&mo_at));
    moderation.ban(Author::Operator, subject, "").unwrap();
    let unbanned = moderation.unban(Author::Visitor(key(&mo_at)), subject);
    assert_eq!(unbanned, Err(ModerationError::Banned), "by himself");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_network_is_banned_as_a_whole() {
    let (server, address) = serve(config());
    let ada_at = options(&server, "Ada", WEST);
    let ada = connect(address, &ada_at).await.unwrap();
    let network: Subject = "127.0.0.1".parse().unwrap();
    let mo_at = options(&server, "Mo", WEST);
    server.moderation().set_role(Author::Operator, key(&mo_at), Role::Moderator).unwrap();
    let mo = connect(address, &mo_at).await.unwrap();
    server.moderation().ban(Author::Operator, network, "enough").unwrap();
    is_told(&ada, "you are banned: enough").await;
    is_refused(address, &options(&server, "Bo", WEST), Refusal::Banned).await;
    assert_eq!(mo.end(), None, "the ban of a network is about visitors");
    mo.leave().await;
    let _mo = connect(address, &mo_at).await.unwrap();
    server.moderation().unban(Author::Operator, network).unwrap();
    connect(address, &ada_at).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn only_those_on_the_list_come_in_where_not_everybody_may() {
    let (server, address) = serve(ServeConfig { access: Access::AllowList, ..config() });
    let (ada, bo) = (options(&server, "Ada", WEST), options(&server, "Bo", WEST));
    is_refused(address, &ada, Refusal::NotInvited).await;
    server.moderation().allow(Author::Operator, key(&ada)).unwrap();
    connect(address, &ada).await.unwrap();
    server.moderation().set_role(Author::Operator, key(&bo), Role::Moderator).unwrap();
    connect(address, &bo).await.unwrap();
}

/// A server with a data folder, which can be started again at the same address.
struct Kept {
    data: tempfile::TempDir,
    identity: Identity,
}

impl Kept {
    fn new() -> Self {
        Self { data: tempfile::tempdir().unwrap(), identity: Identity::generate().unwrap() }
    }

    async fn start(&self, listen: SocketAddr, access: Access) -> Server {
        let config = ServeConfig {
            listen,
            access,
            free_entry: false,
            data: Some(self.data.path().to_owned()),
            ..config()
        };
        let mut server = None;
        until("the address is free", || {
            server = Server::bind(building::world(), config.clone(), &self.identity).ok();
            server.is_some()
        })
        .await;
        server.unwrap()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_invitation_is_needed_once() {
    let kept = Kept::new();
    let server = kept.start("127.0.0.1:0".parse().unwrap(), Access::Invitation).await;
    let address = server.local_addr().unwrap();
    let invite = Act::Invite(hash("come in"), 1);
    Database::open(kept.data.path()).unwrap().act("operator", invite, "").unwrap();
    let (ada, bo) = (options(&server, "Ada", WEST), options(&server, "Bo", WEST));
    let with = |options: &ConnectOptions| ConnectOptions {
        invitation: Some(ChatLine::new("come in").unwrap()),
        ..options.clone()
    };
    is_refused(address, &ada, Refusal::NotInvited).await;
    let mut came_in = None;
    for _ in 0..100 {
        came_in = connect(address, &with(&ada)).await.ok();
        if came_in.is_some() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    came_in.expect("the server hears of the invitation").leave().await;
    is_refused(address, &with(&bo), Refusal::NotInvited).await;
    connect(address, &ada).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn after_a_restart_visitors_are_where_they_stood() {
    let kept = Kept::new();
    let server = kept.start("127.0.0.1:0".parse().unwrap(), Access::Open).await;
    let address = server.local_addr().unwrap();
    let (ada_at, bo_at) = (options(&server, "Ada", WEST), options(&server, "Bo", WEST));
    let (ada, bo) =
        (connect(address, &ada_at).await.unwrap(), connect(address, &bo_at).await.unwrap());
    walk(&ada, WAY[1]).await;
    walk(&bo, WEST + glam::Vec3::X).await;
    // They are noted twice in a second.
    tokio::time::sleep(Duration::from_secs(1)).await;
    bo.leave().await;
    drop(server);
    let server = kept.start(address, Access::Open).await;
    let is_back = || ada.is_present() && ada.stats().returns == 1;
    until("Ada is back by herself", is_back).await;
    assert!(ada.pose().eye.distance(WAY[1]) < 0.4, "{}", ada.pose().eye);
    let bo = connect(address, &ConnectOptions { place: None, ..bo_at }).await.unwrap();
    assert!(bo.pose().eye.distance(WEST + glam::Vec3::X) < 0.4, "{}", bo.pose().eye);
    assert_eq!(server.stats().clients.len(), 2);
    let stranger = connect(address, &options(&server, "Cy", WEST)).await.unwrap();
    assert!(stranger.pose().eye.distance(WEST) < 0.01, "a spawn point");
}
