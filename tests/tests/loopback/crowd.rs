//! A swarm in the two rooms, checked with rays against the triangles.

use std::{collections::HashMap, time::Duration};

use sightline_client::{
    net::Trust,
    swarm::{self, SwarmOptions, SwarmSnapshot},
};
use sightline_oracle::Oracle;
use sightline_server::net::{Identity, ServeConfig, Server};
use sightline_world::motion::AvatarId;

use crate::building;

/// The number of snapshots in a row at which an avatar may be in view and not held. On a busy
/// machine a message is late by a few of them, never by this many.
const LATE_MAX: u32 = 8;

/// Visitors wander through all three doors. Avatars in view are held, held poses are fresh, and
/// nobody who obeys the rules is corrected.
#[tokio::test(flavor = "multi_thread")]
async fn visitors_of_a_swarm_hold_all_avatars_in_view() {
    let world = building::world();
    let oracle = Oracle::new(&world.world().mesh);
    let body = world.world().body;
    let listen = "127.0.0.1:0".parse().unwrap();
    let config = ServeConfig { listen, validity_max_s: 0.3, ..ServeConfig::default() };
    let server = Server::bind(world, config, &Identity::generate().unwrap()).unwrap();
    let trust = Trust::Pinned(server.fingerprint());
    let options = SwarmOptions {
        snapshot_interval: Duration::from_millis(125),
        ..SwarmOptions::new(8, Duration::from_secs(6), trust)
    };
    let mut late: HashMap<(AvatarId, AvatarId), u32> = HashMap::new();
    let (mut in_view, mut worst) = (0, 0);
    let check = |snapshot: &SwarmSnapshot| {
        for viewer in &snapshot.visitors {
            for other in &snapshot.visitors {
                let pair = (viewer.avatar, other.avatar);
                let is_seen = viewer.avatar != other.avatar
                    && oracle.of_box(viewer.pose.eye, &body.around(other.pose.eye), 3);
                let is_held = viewer.held.iter().any(|held| held.id == other.avatar);
                in_view += u32::from(is_seen);
                if is_seen && !is_held {
                    let snapshots = late.entry(pair).or_default();
                    *snapshots += 1;
                    worst = worst.max(*snapshots);
                } else {
                    late.remove(&pair);
                }
            }
        }
    };
    let report = swarm::run(server.local_addr().unwrap(), &options, check).await.unwrap();
    assert!(in_view > 50, "pairs were in view only {in_view} times");
    assert!(worst < LATE_MAX, "an avatar in view was not held for {worst} snapshots");
    assert!(report.looks > 100, "few pairs were looked at: {report:?}");
    assert!(report.misses == 0 || worst > 4, "the swarm's own count has no more: {report:?}");
    assert_eq!((report.clients, report.refused, report.disconnected), (8, 0, 0));
    assert_eq!(report.corrections, 0, "{report:?}");
    assert!(report.visible_mean > 0.2 && report.age_mean_ms < 1_000.0, "{report:?}");
    server.shutdown().await;
}
