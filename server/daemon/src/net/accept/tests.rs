//! A session that panics.

use quinn::ConnectionError;
use sightline_cli::identity::Identity;

use super::*;
use crate::net::{
    ServeConfig, Server,
    test_clients::{admit, connect, endpoint_of},
};

#[tokio::test(flavor = "multi_thread")]
async fn a_panic_ends_one_session_whose_client_is_told_and_finds_its_avatar() {
    let [identity, ada, bo] = [(); 3].map(|()| Identity::generate().unwrap());
    let config = ServeConfig { listen: "127.0.0.1:0".parse().unwrap(), ..ServeConfig::default() };
    let server = Server::listen(config.clone(), &identity).unwrap();
    let state = server.state.clone();
    // The test itself serves this endpoint's connections.
    let endpoint = endpoint_of(&config, &identity);
    let [bo_there, bo_here] = connect(&endpoint, &identity, &bo).await;
    let bo_id = state.registry().number();
    admit(&state, bo_id, bo_here).await;

    let [there, here] = connect(&endpoint, &identity, &ada).await;
    let (id, panicking) = (state.registry().number(), state.clone());
    let session = async move {
        admit(&panicking, id, here).await.visit.enter();
        panic!("a fault, injected by a test")
    };
    supervise(state.clone(), id, session).await;
    let ConnectionError::ApplicationClosed(told) = there.closed().await else {
        panic!("the client is told nothing")
    };
    assert_eq!(&told.reason[..], b"a fault of the server ended your session");

    let [_there, here] = connect(&endpoint, &identity, &ada).await;
    let avatars = |state: &ServerState| {
        let registry = state.registry();
        let all = registry.visitors.all().map(|(client, here)| (client.avatar(), here));
        let mut all: Vec<_> = all.collect();
        all.sort();
        all
    };
    let before = avatars(&state);
    assert_eq!(before.iter().filter(|(_, is_connected)| *is_connected).count(), 1);
    let id = state.registry().number();
    let back = admit(&state, id, here).await;
    assert!(before.contains(&(back.avatar(), false)), "it has its avatar again");
    assert!(avatars(&state).iter().all(|(_, is_connected)| *is_connected));
    assert!(bo_there.close_reason().is_none(), "nobody else noticed");
}
