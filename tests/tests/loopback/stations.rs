//! Four stations on a NATS server share a building.

use std::{
    collections::BTreeSet,
    net::SocketAddr,
    sync::{Arc, OnceLock},
    time::{Duration, Instant},
};

use glam::Vec3;
use sightline_client::{
    net::{Dialer, Session, Trust},
    swarm::{self, SwarmOptions, SwarmSnapshot},
};
use sightline_compiler::{CompileOptions, LightMethod, compile, import::glb};
use sightline_server::{
    bus::{Bus, BusOptions, STATIONS_MAX},
    net::{Identity, ServeConfig, ServedWorld, Server},
    operate::BusStats,
};
use sightline_world::motion::AvatarId;
use tokio::runtime::{self, Runtime};

use crate::{PATIENCE, hears, nats::Nats, operators::check_metrics_of_station, options};

/// How many stations there are.
const STATIONS: usize = 4;
/// How many visitors walk.
const WALKERS: usize = 24;
/// How long they walk.
const WALK: Duration = Duration::from_secs(6);
/// How many visitors stand at each station, all in sight of each other.
const STANDING_EACH: usize = 2;
/// The time within which visitors of a lost station are back, and a bus that is back has healed.
const BACK_WITHIN: Duration = Duration::from_secs(5);

/// A station with a runtime of its own, so that it can stop from one moment to the next.
///
/// The server comes first, since a runtime waits for its engine's thread when it is dropped.
struct Station {
    server: Server,
    runtime: Runtime,
    number: u32,
    address: SocketAddr,
}

/// Somebody who stands at a station.
struct Standing {
    session: Session,
    station: usize,
}

impl Station {
    fn start(url: &str, identity: &Identity) -> Self {
        let runtime = threads(1);
        let listen = "127.0.0.1:0".parse().unwrap();
        let config = ServeConfig { listen, free_entry: true, ..ServeConfig::default() };
        let options = BusOptions { url: url.to_owned(), credentials: None };
        let (server, number) = runtime.block_on(async {
            let bus = Bus::connect(&options).await.unwrap();
            let number = bus.station().0;
            (Server::listen_on_bus(config, identity, bus).unwrap(), number)
        });
        server.world_changer().change(world()).unwrap();
        let address = server.local_addr().unwrap();
        Self { runtime, server, number, address }
    }

    /// Stops at once, as a machine without power: its clients are told nothing.
    fn kill(self) {
        self.runtime.shutdown_background();
        drop(self.server);
    }

    fn bus(&self) -> BusStats {
        let overview = self.runtime.block_on(self.server.observer().overview());
        overview.and_then(|overview| overview.bus).unwrap_or_default()
    }
}

impl Standing {
    fn join(
        clients: &Runtime,
        dialer: &Dialer,
        k: usize,
        at: (usize, &Station),
        eye: Vec3,
    ) -> Self {
        let (station, Station { server, address, .. }) = at;
        let hello = options(server, &format!("Visitor {k}"), eye);
        let session = clients.block_on(dialer.connect(*address, &hello)).unwrap();
        Self { session, station }
    }

    fn held(&self) -> BTreeSet<AvatarId> {
        self.session.held().iter().map(|held| held.id).collect()
    }
}

fn threads(count: usize) -> Runtime {
    runtime::Builder::new_multi_thread().worker_threads(count).enable_all().build().unwrap()
}

/// Waits until a condition holds, and returns after how long it did.
fn until(what: &str, mut holds: impl FnMut() -> bool) -> Duration {
    let began = Instant::now();
    while !holds() {
        assert!(began.elapsed() < PATIENCE, "timed out waiting until {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
    began.elapsed()
}

/// A generated building.
fn world() -> ServedWorld {
    static WORLD: OnceLock<ServedWorld> = OnceLock::new();
    let compiled = || {
        let bytes = sightline_demo_building::glb(12, 4);
        let model = glb::read_slice(&bytes, None, "twelve rooms").unwrap();
        let light = LightMethod::None;
        let options = CompileOptions { voxel: Some(0.1), light, ..CompileOptions::default() };
        let go_on = &|_, _| std::ops::ControlFlow::Continue(());
        let (world, _) = compile(&model, &options, go_on).unwrap();
        ServedWorld::from_world(Arc::new(world))
    };
    WORLD.get_or_init(compiled).clone()
}

/// The avatars of all who stand.
fn everybody(standing: &[Standing]) -> BTreeSet<AvatarId> {
    standing.iter().map(|one| one.session.avatar()).collect()
}

/// Whether each of those who stand is in the world and holds these of the others, and nobody else.
fn hold(standing: &[Standing], is_held: impl Fn(&Standing, &Standing) -> bool) -> bool {
    standing.iter().all(|one| {
        let own = one.session.avatar();
        let others = standing.iter().filter(|other| is_held(one, other));
        let mut ids: BTreeSet<AvatarId> = others.map(|other| other.session.avatar()).collect();
        ids.remove(&own);
        one.session.is_present() && one.held() == ids
    })
}

#[test]
fn four_stations_are_one_building_and_outlive_one_of_them_and_their_bus() {
    let Some(nats) = Nats::start() else { return };
    let identity = Identity::generate().unwrap();
    let url = nats.url();
    world();
    let mut stations: Vec<Station> = std::thread::scope(|scope| {
        let starting: Vec<_> =
            (0..STATIONS).map(|_| scope.spawn(|| Station::start(&url, &identity))).collect();
        starting.into_iter().map(|station| station.join().unwrap()).collect()
    });
    let numbers: BTreeSet<u32> = stations.iter().map(|station| station.number).collect();
    assert_eq!(numbers.len(), STATIONS, "each has a number of its own");
    until("they know each other", || stations.iter().all(|s| s.bus().stations == STATIONS - 1));

    let clients = threads(1);
    clients.block_on(check_metrics_of_station(&stations[0].server));
    walk(&clients, &stations);
    let shares = |station: &Station| station.bus().is_sharing;
    assert!(!stations.iter().any(shares), "this NATS has no JetStream");
    let mut standing = stand(&clients, &stations);
    until("all see all", || hold(&standing, |_, _| true));
    standing[0].session.chat("Good morning").unwrap();
    for other in &standing[1..] {
        clients.block_on(hears(&other.session, "Visitor 0", "Good morning"));
    }

    lose_a_station(&mut stations, &standing);
    let at = standing.iter().map(|one| one.session.avatar().0 & STATIONS_MAX);
    let homes: Vec<u32> = at.collect();
    let port = nats.stop();
    until("guests leave", || {
        let is_near = |one: &Standing, other: &Standing| {
            let [one, other] = [one, other].map(|s| s.session.avatar().0 & STATIONS_MAX);
            one == other
        };
        hold(&standing, is_near)
    });
    let _nats = Nats::again(port, None);
    let healed = until("all see all again", || hold(&standing, |_, _| true));
    println!("healed {} ms after NATS came back", healed.as_millis());
    assert!(healed < BACK_WITHIN, "{healed:?}");
    let still = standing.iter().map(|one| one.session.avatar().0 & STATIONS_MAX);
    assert_eq!(still.collect::<Vec<_>>(), homes, "nobody changed stations for that");
    standing.clear();
    clients.shutdown_background();
}

/// Visitors of all stations wander, and each holds whom it sees, wherever that one belongs.
fn walk(clients: &Runtime, stations: &[Station]) {
    let addresses: Vec<SocketAddr> = stations.iter().map(|station| station.address).collect();
    let trust = Trust::Pinned(stations[0].server.fingerprint());
    let options =
        SwarmOptions { others: addresses[1..].to_vec(), ..SwarmOptions::new(WALKERS, WALK, trust) };
    let (mut across, mut homes) = (0, BTreeSet::new());
    let check = |snapshot: &SwarmSnapshot| {
        for viewer in &snapshot.visitors {
            homes.insert(viewer.avatar.0 & STATIONS_MAX);
            let is_abroad = |held: &AvatarId| (held.0 ^ viewer.avatar.0) & STATIONS_MAX != 0;
            across += viewer.held.iter().filter(|held| is_abroad(&held.id)).count();
        }
    };
    let report = clients.block_on(swarm::run(addresses[0], &options, check)).unwrap();
    println!("{across} times somebody of another station was held; {report:?}");
    assert_eq!((report.clients, report.refused, report.disconnected), (WALKERS, 0, 0));
    assert_eq!(homes.len(), STATIONS, "visitors go to all stations");
    assert!(across > 50, "{across}");
    assert_eq!((report.misses, report.corrections), (0, 0), "{report:?}");
}

/// Some stand together, at all stations.
fn stand(clients: &Runtime, stations: &[Station]) -> Vec<Standing> {
    let spawn = world().world().spawns[0].eye;
    let dialer = Dialer::new(None);
    let count = STATIONS * STANDING_EACH;
    let joining = (0..count).map(|k| {
        let aside = Vec3::new(0.2 * (k % 3) as f32, 0.0, 0.2 * (k / 3) as f32);
        let station = k % STATIONS;
        Standing::join(clients, &dialer, k, (station, &stations[station]), spawn + aside)
    });
    joining.collect()
}

/// A station stops. Its visitors are back at others in time, and nobody else is affected.
fn lose_a_station(stations: &mut Vec<Station>, standing: &[Standing]) {
    standing.iter().for_each(|one| drop(one.session.events()));
    let before = everybody(standing);
    let lost = stations.remove(0);
    let is_lost = |one: &&Standing| one.station == 0;
    let gone: BTreeSet<AvatarId> =
        standing.iter().filter(is_lost).map(|one| one.session.avatar()).collect();
    let kept: BTreeSet<AvatarId> = before.difference(&gone).copied().collect();
    lost.kill();
    let others: Vec<&Standing> = standing.iter().filter(|one| !is_lost(one)).collect();
    let back = until("all are back", || {
        for one in &others {
            let (own, held) = (one.session.avatar(), one.held());
            let is_whole = kept.iter().all(|avatar| *avatar == own || held.contains(avatar));
            assert!(one.session.is_present() && is_whole, "somebody else is affected");
        }
        let is_back = |one: &Standing| one.session.is_present() && one.session.stats().returns == 1;
        standing.iter().filter(is_lost).all(is_back)
    });
    println!("back at other stations after {} ms", back.as_millis());
    assert!(back < BACK_WITHIN, "{back:?}");
    assert!(others.iter().all(|one| one.session.stats().returns == 0));
    until("all see all, and no ghosts", || hold(standing, |_, _| true));
    assert!(everybody(standing).is_disjoint(&gone), "they have other avatars now");
}
