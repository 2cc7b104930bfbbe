//! An engine that panics.

use glam::Vec3;
use sightline_cli::identity::Identity;
use sightline_fixtures::two_rooms;

use super::*;
use crate::net::{
    Server,
    test_clients::{admit, connect, endpoint_of},
};

/// Waits until something holds.
async fn until(what: &str, mut holds: impl AsyncFnMut() -> bool) {
    for _ in 0..600 {
        if holds().await {
            return;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    panic!("not in time: {what}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_world_begins_anew_when_the_engine_fails_and_visitors_go_on_where_they_were() {
    let [identity, ada] = [(); 2].map(|()| Identity::generate().unwrap());
    let listen = "127.0.0.1:0".parse().unwrap();
    let config = ServeConfig { listen, free_entry: true, ..ServeConfig::default() };
    let world = ServedWorld::from_world(Arc::new(two_rooms::world()));
    let mut server = Server::bind(world, config.clone(), &identity).unwrap();
    let state = server.state.clone();
    // The test itself serves this endpoint's connections.
    let endpoint = endpoint_of(&config, &identity);
    let [_there, here] = connect(&endpoint, &identity, &ada).await;
    let id = state.registry().number();
    let client = admit(&state, id, here).await;
    let there = Vec3::new(8.0, 1.6, 3.0);
    let join = async |world, place| {
        let newcomer = Newcomer { client: client.clone(), world, place: Some(place) };
        assert!(state.tell_engine(EngineEvent::Join(newcomer)).await);
    };
    let eye = async || {
        let overview = server.observer().overview().await?;
        Some(Vec3::from(overview.people[0].place.as_ref()?.eye))
    };
    join(1, there).await;
    until("Ada is in the world", async || eye().await.is_some()).await;

    assert!(state.tell_engine(EngineEvent::Fault).await);
    let number = || state.offers.offer().unwrap().number;
    until("the world is offered again", async || number() == 2).await;
    let former = client.visit.former().expect("it is known where Ada was");
    assert!(former.eye.distance(there) < 0.01, "{}", former.eye);
    assert_eq!(eye().await, None, "nobody is in the new world yet");
    join(2, former.going_on(Some(there))).await;
    until("Ada is back", async || eye().await.is_some_and(|eye| eye.distance(there) < 0.01)).await;

    assert!(state.tell_engine(EngineEvent::Fault).await);
    until("the world is offered again", async || number() == 3).await;
    assert!(state.tell_engine(EngineEvent::Fault).await);
    tokio::time::timeout(Duration::from_secs(60), server.failed()).await.expect("it ends");
    assert_eq!(state.metrics.engine_faults(), 3);
}
