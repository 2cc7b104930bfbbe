//! Clients that go back to a spawn point, and those that join in the background.

use std::{
    thread,
    time::{Duration, Instant},
};

use glam::Vec3;
use sightline_client::net::{ConnectError, Connector, JoinProgress, Session};
use sightline_client_core::replica::{Event, ShownAvatar};

use super::{
    building::{EAST, WAY, WEST},
    config, holds, join, options, serve, until, walk,
};

#[tokio::test(flavor = "multi_thread")]
async fn who_asks_is_put_back_to_a_spawn_point_and_walks_on_from_there() {
    let (server, _) = serve(config());
    let (ada, bo) = (join(&server, "Ada", EAST).await, join(&server, "Bo", WEST).await);
    walk(&ada, WAY[3]).await;
    let spawns = ada.world().spawns.clone();
    let is_near_spawn =
        |session: &Session| spawns.iter().any(|s| s.eye.distance(session.pose().eye) < 4.0);
    for _ in 0..2 {
        ada.respawn();
        let mut events = Vec::new();
        until("Ada is put back", || {
            events.extend(ada.events());
            events.iter().any(|event| matches!(event, Event::Corrected(_))) && is_near_spawn(&ada)
        })
        .await;
    }
    let start = ada.pose().eye;
    walk(&ada, start + Vec3::Z).await;
    until("they see each other", || holds(&ada, bo.avatar()) && holds(&bo, ada.avatar())).await;
    let is_there = |shown: &ShownAvatar| shown.pose.eye.distance(start + Vec3::Z) < 0.1;
    until("Bo knows where Ada is", || bo.shown_avatars().iter().any(is_there)).await;
    assert_eq!((ada.end(), bo.end()), (None, None));
}

/// Waits for the outcome of an attempt to join. Returns it with what the attempt told.
fn outcome(connector: &Connector) -> (Result<Session, ConnectError>, Vec<JoinProgress>) {
    let (mut joining, mut told) = (connector.join(), Vec::new());
    let begun = Instant::now();
    loop {
        let progress = joining.progress();
        if told.last() != Some(&progress) {
            told.push(progress);
        }
        if let Some(outcome) = joining.outcome() {
            return (outcome, told);
        }
        assert!(begun.elapsed() < Duration::from_secs(30), "{told:?}");
        thread::sleep(Duration::from_millis(1));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_connector_joins_a_server_as_often_as_it_is_asked_to() {
    let (server, address) = serve(config());
    let connector = Connector::new(address, options(&server, "Ada", WEST), None).unwrap();
    let (session, connector) = blocking(connector, |connector| {
        let (session, told) = outcome(connector);
        assert_eq!(told[0], JoinProgress::Connecting);
        session.unwrap()
    })
    .await;
    let world = session.world();
    let ((), connector) = blocking(connector, move |connector| connector.leave(session)).await;
    until("the server knows that Ada left", || server.stats().clients.is_empty()).await;
    let (session, connector) = blocking(connector, |connector| outcome(connector).0.unwrap()).await;
    assert!(std::sync::Arc::ptr_eq(&session.world(), &world), "it is not read again");
    blocking(connector, move |connector| connector.leave(session)).await.1.shut_down();
}

/// Runs something with a connector on a thread of its own, as a window does.
async fn blocking<T: Send + 'static>(
    connector: Connector,
    work: impl FnOnce(&Connector) -> T + Send + 'static,
) -> (T, Connector) {
    let thread = thread::spawn(move || (work(&connector), connector));
    until("the thread is done", || thread.is_finished()).await;
    thread.join().unwrap()
}
