//! What stations share of people, over NATS.

use std::{net::SocketAddr, time::Duration};

use glam::Vec3;
use sightline_client::net::{ConnectError, ConnectOptions, Dialer, Session};
use sightline_protocol::{fingerprint::KeyFingerprint, message::Refusal};
use sightline_server::{
    bus::{Bus, BusOptions},
    net::{Author, Identity, ServeConfig, Server},
    people::{Act, Role, Standing, Subject},
};
use tokio::time::Instant;

use crate::{
    building::{self, WAY, WEST},
    config,
    nats::Nats,
    options, until, walk,
};

/// Within which time a visitor who is banned at one station is out of another one. It takes some
/// milliseconds; the machine may be busy.
const OUT_WITHIN: Duration = Duration::from_secs(1);
/// How many visitors two stations rule about at once.
const AT_ONCE: u8 = 20;

/// A station.
struct Station {
    server: Server,
    address: SocketAddr,
}

impl Station {
    async fn start(nats: &Nats, identity: &Identity) -> Self {
        Self::start_with(nats, identity, config()).await
    }

    async fn start_with(nats: &Nats, identity: &Identity, config: ServeConfig) -> Self {
        let bus = BusOptions { url: nats.url(), credentials: None };
        let bus = Bus::connect(&bus).await.unwrap();
        let server = Server::listen_on_bus(config, identity, bus).unwrap();
        let changer = server.world_changer();
        let changed = tokio::task::spawn_blocking(move || changer.change(building::world()));
        changed.await.unwrap().unwrap();
        let address = server.local_addr().unwrap();
        let station = Self { server, address };
        station.shares(true).await;
        station
    }

    async fn shares(&self, is_sharing: bool) {
        let began = Instant::now();
        loop {
            let bus = self.server.observer().overview().await.and_then(|overview| overview.bus);
            if bus.is_some_and(|bus| bus.is_sharing == is_sharing) {
                return;
            }
            assert!(began.elapsed() < crate::PATIENCE, "sharing is {is_sharing}: {bus:?}");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }

    async fn join(&self, options: &ConnectOptions) -> Result<Session, ConnectError> {
        Dialer::new(None).connect(self.address, options).await
    }

    async fn refuses(&self, options: &ConnectOptions) -> bool {
        matches!(self.join(options).await, Err(ConnectError::Refused(Refusal::Banned)))
    }

    /// Somebody comes in. Returns the name that others see.
    async fn name_of(&self, options: &ConnectOptions) -> (Session, String) {
        let session = self.join(options).await.unwrap();
        let visitors = self.server.moderation().visitors();
        let own = visitors.into_iter().find(|visitor| visitor.key == key(options).to_string());
        (session, own.unwrap().name)
    }

    fn names(&self) -> Vec<String> {
        let visitors = self.server.moderation().visitors();
        visitors.into_iter().map(|visitor| visitor.name).collect()
    }

    fn rule(&self, act: &Act) {
        let moderation = self.server.moderation();
        match act {
            Act::Ban(subject, reason) => moderation.ban(Author::Operator, *subject, reason),
            Act::Unban(subject) => moderation.unban(Author::Operator, *subject),
            Act::SetMuted(key, is_muted) => {
                moderation.set_muted(Author::Operator, *key, *is_muted, "")
            }
            Act::SetRole(key, role) => moderation.set_role(Author::Operator, *key, *role),
            Act::Allow(key) => moderation.allow(Author::Operator, *key),
            Act::Invite(..) => unreachable!("nobody invites here"),
        }
        .unwrap();
    }
}

fn key(options: &ConnectOptions) -> KeyFingerprint {
    options.identity.key_fingerprint()
}

async fn is_told(session: &Session, reason: &str) {
    until(&format!("somebody is told: {reason}"), || session.end().as_deref() == Some(reason))
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_ruled_at_one_station_counts_at_all_and_outlives_nats() {
    let folder = tempfile::tempdir().unwrap();
    let Some(nats) = Nats::start_keeping(folder.path()) else { return };
    let identity = Identity::generate().unwrap();
    let (a, b) = tokio::join!(Station::start(&nats, &identity), Station::start(&nats, &identity));
    let [mo, ada, bo] = ["Mo", "Ada", "Bo"].map(|name| options(&a.server, name, WEST));

    let _mo = b.join(&mo).await.unwrap();
    a.rule(&Act::SetRole(key(&mo), Role::Moderator));
    let is_moderator = || b.server.moderation().standing(key(&mo)).role == Role::Moderator;
    until("a role counts at the other station", is_moderator).await;
    let ada_at_b = b.join(&ada).await.unwrap();
    let began = Instant::now();
    a.rule(&Act::Ban(Subject::Key(key(&ada)), "rude".to_owned()));
    is_told(&ada_at_b, "you are banned: rude").await;
    println!("out of the other station after {} ms", began.elapsed().as_millis());
    assert!(began.elapsed() < OUT_WITHIN, "{:?}", began.elapsed());
    assert!(a.refuses(&ada).await && b.refuses(&ada).await);

    rule_at_once(&a, &b).await;
    let (nats, bo_at_b) = lose_nats(nats, folder.path(), [&a, &b], [&ada, &bo]).await;
    is_told(&bo_at_b, "you are banned: loud").await;
    let c = forget_and_lie(&nats, &identity, &a, &bo).await;
    assert!(c.refuses(&bo).await && !c.refuses(&ada).await);
}

/// Two stations rule about the same visitors at once, and nothing is lost.
async fn rule_at_once(a: &Station, b: &Station) {
    let keys: Vec<_> = (0..AT_ONCE).map(|n| KeyFingerprint([n + 1; 10])).collect();
    for key in &keys {
        a.rule(&Act::SetMuted(*key, true));
        b.rule(&Act::Ban(Subject::Key(*key), "at once".to_owned()));
        a.rule(&Act::Allow(*key));
        b.rule(&Act::SetRole(*key, Role::Owner));
    }
    let began = Instant::now();
    let whole = |station: &Station| {
        let moderation = station.server.moderation();
        let all = Standing { role: Role::Owner, is_muted: true, is_allowed: true };
        keys.iter().all(|key| moderation.standing(*key) == all && moderation.keeps_out(*key))
    };
    until("both stations have both", || whole(a) && whole(b)).await;
    println!("agreed after {} ms", began.elapsed().as_millis());
}

/// NATS stops, both stations go on ruling, and agree when it is back.
async fn lose_nats(
    nats: Nats,
    folder: &std::path::Path,
    [a, b]: [&Station; 2],
    [ada, bo]: [&ConnectOptions; 2],
) -> (Nats, Session) {
    let bo_at_b = b.join(bo).await.unwrap();
    let port = nats.stop();
    a.rule(&Act::Ban(Subject::Key(key(bo)), "loud".to_owned()));
    b.rule(&Act::Unban(Subject::Key(key(ada))));
    let keep_out = |who| [a, b].map(|station| station.server.moderation().keeps_out(key(who)));
    assert_eq!([keep_out(bo), keep_out(ada)], [[true, false]; 2], "each has its own");
    assert!(a.refuses(bo).await && bo_at_b.end().is_none());
    let nats = Nats::again(port, Some(folder));
    let began = Instant::now();
    until("they agree", || [keep_out(bo), keep_out(ada)] == [[true; 2], [false; 2]]).await;
    println!("agreed {} ms after NATS was back", began.elapsed().as_millis());
    (nats, bo_at_b)
}

/// Somebody on the bus overwrites a ban with noise. A station that knows of it writes it again, and
/// a new one hears of it.
async fn forget_and_lie(
    nats: &Nats,
    identity: &Identity,
    a: &Station,
    bo: &ConnectOptions,
) -> Station {
    let long = "x".repeat(4_096);
    for noise in ["", "{", "null", r#"{"banned":{"is":null,"at":99999999999999}}"#, &long] {
        nats.publish(&format!("$KV.sightline-people.key.{}", key(bo)), noise.as_bytes());
        nats.publish("$KV.sightline-people.key.nobody", noise.as_bytes());
        nats.publish("$KV.sightline-people.a.b.c", noise.as_bytes());
    }
    assert!(a.refuses(bo).await);
    Station::start(nats, identity).await
}

/// How long the names of a dead station last in the bucket that the test makes.
const NAMES_LAST: Duration = Duration::from_secs(3);

#[tokio::test(flavor = "multi_thread")]
async fn a_name_is_given_at_one_station_only_and_outlives_neither_it_nor_nats() {
    let folder = tempfile::tempdir().unwrap();
    let Some(nats) = Nats::start_keeping(folder.path()) else { return };
    let bucket = format!(
        r#"{{"name":"KV_sightline-names","subjects":["$KV.sightline-names.>"],"retention":"limits",
        "storage":"memory","num_replicas":1,"max_msgs_per_subject":1,"max_age":{},"discard":"new",
        "allow_rollup_hdrs":true,"deny_delete":true,"allow_direct":true}}"#,
        NAMES_LAST.as_nanos()
    );
    nats.publish("$JS.API.STREAM.CREATE.KV_sightline-names", bucket.as_bytes());
    let identity = Identity::generate().unwrap();
    let (a, b) = tokio::join!(Station::start(&nats, &identity), Station::start(&nats, &identity));
    let visitor = |name: &str| options(&a.server, name, WEST);
    let [ada, namesake, alike, later] = ["Ada", "Ada", "\u{410}da", "Ada"].map(visitor);

    let (ada_at_a, name) = a.name_of(&ada).await;
    assert_eq!(name, "Ada");
    let (_namesake, name) = b.name_of(&namesake).await;
    assert_eq!(name, "Ada 2", "as at one station");
    let (_alike, name) = b.name_of(&alike).await;
    assert!(name != "Ada" && name.ends_with(char::is_numeric), "{name} looks alike");
    let bo = [visitor("Bo"), visitor("Bo")];
    let ((_one, one), (_other, other)) = tokio::join!(a.name_of(&bo[0]), b.name_of(&bo[1]));
    let both: std::collections::BTreeSet<_> = [one.as_str(), other.as_str()].into();
    assert_eq!(both, ["Bo", "Bo 2"].into(), "both come in at once");
    ada_at_a.leave().await;
    let name = name_at_last(&b, &later, "Ada").await;
    println!("a name is free {} ms after its owner has left", name.as_millis());

    let [cy, di, namesake] = ["Cy", "Di", "Di"].map(visitor);
    let (cy_at_a, di_at_a) = (a.name_of(&cy).await.0, a.name_of(&di).await.0);
    drop(a);
    drop(di_at_a);
    until("Cy is back by himself", || cy_at_a.is_present() && cy_at_a.stats().returns == 1).await;
    assert!(b.names().contains(&"Cy".to_owned()), "he takes his name along: {:?}", b.names());
    let (namesake_at_b, name) = b.name_of(&namesake).await;
    assert_eq!(name, "Di 2", "Di may come yet");
    namesake_at_b.leave().await;
    let free = name_at_last(&b, &namesake, "Di").await;
    println!("a name is free {} ms after its station died", free.as_millis());
    assert!(free < 3 * NAMES_LAST, "{free:?}");
    let began = Instant::now();
    let _flo = b.name_of(&options(&b.server, "Flo", WEST)).await;
    let usual = began.elapsed();
    drop(nats);
    let began = Instant::now();
    let (_eve, name) = b.name_of(&options(&b.server, "Eve", WEST)).await;
    assert_eq!(name, "Eve");
    println!("in after {} ms, and {usual:?} with NATS", began.elapsed().as_millis());
    assert!(began.elapsed() < usual + Duration::from_secs(3), "{:?}", began.elapsed());
}

/// Comes in again and again until the name is the one that is wanted. Returns after how long.
async fn name_at_last(station: &Station, options: &ConnectOptions, wanted: &str) -> Duration {
    let began = Instant::now();
    loop {
        let (session, name) = station.name_of(options).await;
        if name == wanted {
            return began.elapsed();
        }
        session.leave().await;
        assert!(began.elapsed() < crate::PATIENCE, "{name} is not {wanted}");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

/// How long a station that dies may not have said where somebody is.
const PLACES_WITHIN: Duration = Duration::from_secs(6);

#[tokio::test(flavor = "multi_thread")]
async fn a_visitor_goes_on_at_another_station_where_it_was_at_one() {
    let folder = tempfile::tempdir().unwrap();
    let Some(nats) = Nats::start_keeping(folder.path()) else { return };
    let identity = Identity::generate().unwrap();
    let start = || {
        let config = ServeConfig { free_entry: false, ..config() };
        Station::start_with(&nats, &identity, config)
    };
    let (a, b) = tokio::join!(start(), start());
    let ada = options(&a.server, "Ada", WEST);
    let aside = WEST + 2.0 * Vec3::X;
    for (station, from, to) in [(&b, WEST, aside), (&a, aside, WAY[1]), (&b, WAY[1], aside)] {
        let session = station.join(&ada).await.unwrap();
        let eye = session.pose().eye;
        assert!(eye.distance(from) < 0.4, "{eye} in place of {from}");
        walk(&session, to).await;
        // What was noted a second ago is older than what is noted now.
        tokio::time::sleep(Duration::from_millis(1_100)).await;
        session.leave().await;
        tokio::time::sleep(Duration::from_millis(200)).await;
    }

    let bo_at_a = a.join(&options(&a.server, "Bo", WEST)).await.unwrap();
    walk(&bo_at_a, WAY[1]).await;
    tokio::time::sleep(PLACES_WITHIN).await;
    drop(a);
    until("Bo is back by himself", || bo_at_a.is_present() && bo_at_a.stats().returns == 1).await;
    let eye = bo_at_a.pose().eye;
    assert!(eye.distance(WAY[1]) < 0.4, "{eye}");
}
