//! Joining, walking and seeing each other over ever worse paths.

use std::time::Duration;

use sightline_client::net::{Dialer, Session};
use sightline_world::motion::Pose;
use tokio::time::{Instant, sleep};

use super::{building::WEST, config, options, serve, until};
use crate::proxy::Proxy;

/// A path: the round trip in milliseconds, and the share of packets that are lost each way. A fifth
/// of the round trip is jitter, and two in a hundred packets arrive twice.
type Rung = (u64, f64);

/// From a good path to one on which hardly anything works.
const LADDER: [Rung; 5] = [(16, 0.001), (100, 0.02), (200, 0.05), (400, 0.1), (800, 0.25)];
/// How long visitors walk about on each path.
const WALK: Duration = Duration::from_secs(6);

/// Lets visitors join over a path, walk about, and see each other once it is good again.
async fn climb((round_trip_ms, loss): Rung, visitors: usize) {
    let (server, address) = serve(config());
    let proxy = Proxy::new(address, round_trip_ms);
    let one_way_ms = round_trip_ms * 2 / 5;
    let ms = Duration::from_millis;
    proxy.delay(ms(one_way_ms), ms(round_trip_ms / 2 - one_way_ms));
    proxy.lose(loss);
    proxy.double(0.02);
    let begin = Instant::now();
    let mut joining = Vec::new();
    for i in 0..visitors {
        let place = WEST + glam::Vec3::X * (i as f32 * 0.5);
        let (name, at) = (format!("Ada {i}"), proxy.address);
        let options = options(&server, &name, place);
        joining.push(tokio::spawn(async move { Dialer::new(None).connect(at, &options).await }));
    }
    let mut sessions = Vec::new();
    for join in joining {
        let joined = join.await.unwrap();
        sessions.push(joined.unwrap_or_else(|error| panic!("{round_trip_ms} ms: {error}")));
    }
    let joined = begin.elapsed();
    let end = Instant::now() + WALK;
    while Instant::now() < end {
        for session in &sessions {
            session.set_pose(Pose { yaw: session.pose().yaw + 0.05, ..session.pose() });
        }
        sleep(ms(20)).await;
    }
    proxy.lose(0.0);
    let healed = Instant::now();
    let are_present = || sessions.iter().all(Session::is_present);
    until("all are there", are_present).await;
    until("all see each other", || sessions.iter().all(|one| one.held().len() == visitors - 1))
        .await;
    let converged = healed.elapsed();
    assert!(sessions.iter().all(|session| session.end().is_none()));
    let returns: u64 = sessions.iter().map(|session| u64::from(session.stats().returns)).sum();
    println!(
        "{round_trip_ms} ms, {loss}: joined in {joined:?}, {returns} returns, all \
         well {converged:?} after losses ended"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn all_join_and_see_each_other_over_a_bad_path() {
    climb(LADDER[2], 3).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn all_join_and_see_each_other_over_the_worst_path() {
    climb(LADDER[4], 3).await;
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes a few minutes"]
async fn eight_climb_the_whole_ladder() {
    for rung in LADDER {
        climb(rung, 8).await;
    }
}
