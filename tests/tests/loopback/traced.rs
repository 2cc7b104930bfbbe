//! Visitors who follow a trace live are silent for as long as in virtual time.

use std::{fmt::Write, sync::Arc, time::Duration};

use glam::Vec3;
use sightline_cli::trace::{HEADER, Trace};
use sightline_client::{
    net::Trust,
    swarm::{self, SwarmOptions},
};
use sightline_engine::{Config, Policy};
use sightline_replay::{OracleStride, ReplayOptions};
use sightline_server::net::{Identity, ServeConfig, Server};

use crate::building::{self, EAST, WAY, WEST};

/// How long the visitors walk.
const WALK: Duration = Duration::from_secs(12);
/// The time between two samples.
const SAMPLE_MS: u64 = 50;
/// By how much a share may differ from replay's, as a part of it. On a busy machine, too.
const APART_MAX: f64 = 0.1;
/// How fast the visitors walk, in metres a second.
const PACE: f32 = 1.3;
/// How fast they turn, in radians a second.
const TURN: f32 = 3.0;

/// Somebody who walks between two places, and stands at each for a while.
struct Stroller {
    eye: Vec3,
    yaw: f32,
    places: [Vec3; 2],
    rest_s: f32,
    rests_s: f32,
}

impl Stroller {
    fn new(from: Vec3, to: Vec3, rests_s: f32) -> Self {
        Self { eye: from, yaw: 0.0, places: [to, from], rest_s: rests_s, rests_s }
    }

    /// Takes a step of a time in seconds. Returns the velocity.
    fn step(&mut self, dt_s: f32) -> Vec3 {
        self.rest_s -= dt_s;
        if self.rest_s > 0.0 {
            return Vec3::ZERO;
        }
        let way = self.places[0] - self.eye;
        if way.length() < PACE * dt_s {
            self.places.reverse();
            self.rest_s = self.rests_s;
            return Vec3::ZERO;
        }
        let aside = sightline_world::motion::turn_between(self.yaw, (-way.x).atan2(-way.z));
        self.yaw += aside.clamp(-TURN * dt_s, TURN * dt_s);
        if aside.abs() > 1.0 {
            return Vec3::ZERO;
        }
        let velocity = way.normalize() * PACE;
        self.eye += velocity * dt_s;
        velocity
    }
}

/// Some stroll alone where nobody sees them, and some together.
fn trace() -> (Trace, usize) {
    let x = Vec3::X;
    let mut all = [
        Stroller::new(WEST, WEST + x * 6.0, 1.0),
        Stroller::new(WEST - Vec3::Z * 3.0, WEST + x * 5.0, 2.0),
        Stroller::new(WEST + x * 8.0, WEST, 3.0),
        Stroller::new(WEST + x * 4.0, WAY[1], 1.5),
        Stroller::new(EAST, EAST - x * 6.0, 2.5),
    ];
    let mut rows = HEADER.join(",") + "\n";
    for t_ms in (0..=WALK.as_millis() as u64 + 1_000).step_by(SAMPLE_MS as usize) {
        for (id, stroller) in all.iter_mut().enumerate() {
            let (Vec3 { x, y, z }, yaw) = (stroller.eye, stroller.yaw);
            let v = stroller.step(SAMPLE_MS as f32 * 1e-3);
            writeln!(rows, "{t_ms},{id},{x},{y},{z},{yaw},0,{},0,{}", v.x, v.z).unwrap();
        }
    }
    (Trace::read(rows.as_bytes()).unwrap(), all.len())
}

#[tokio::test(flavor = "multi_thread")]
async fn visitors_who_follow_a_trace_are_as_silent_as_in_replay() {
    let (trace, visitors) = trace();
    let world = building::world();
    let listen = "127.0.0.1:0".parse().unwrap();
    let config = ServeConfig { listen, free_entry: true, ..ServeConfig::default() };
    let server = Server::bind(world.clone(), config, &Identity::generate().unwrap()).unwrap();
    let trust = Trust::Pinned(server.fingerprint());
    let options =
        SwarmOptions { trace: Some(trace.clone()), ..SwarmOptions::new(visitors, WALK, trust) };
    let live = swarm::run(server.local_addr().unwrap(), &options, |_| ()).await.unwrap();
    server.shutdown().await;
    assert_eq!((live.clients, live.disconnected, live.corrections), (visitors, 0, 0));

    let config = Config { policy: Policy::Tbv, ..Config::default() };
    let round_trip = Duration::from_secs_f64(live.round_trip_ms / 1e3);
    let options = ReplayOptions {
        config,
        length: Some(WALK),
        oracle: OracleStride::Off,
        ..ReplayOptions::new(Policy::Tbv, round_trip)
    };
    let replayed =
        sightline_replay::run(&Arc::clone(world.world()), &trace, &options, None, &mut |_| {})
            .unwrap();
    assert!(replayed.quiet_share > 0.1 && replayed.course_share > 0.3, "{replayed:?}");
    for (what, live, replayed) in [
        ("quiet", live.quiet_share, replayed.quiet_share),
        ("on course", live.course_share, replayed.course_share),
    ] {
        println!("{what}: live {live:.4}, replay {replayed:.4}");
        let apart = (live - replayed).abs() / replayed;
        assert!(apart <= APART_MAX, "{what}: live {live:.3}, replay {replayed:.3}");
    }
}
