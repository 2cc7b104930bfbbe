//! A server whose process is stopped for a while, as a busy host stops it.

use std::{
    io::{BufRead, BufReader},
    process::{Child, Command, Stdio},
    time::Duration,
};

use sightline_client::{
    net::Trust,
    swarm::{self, SwarmOptions, SwarmSnapshot},
};
use sightline_server::net::ServeConfig;

/// How long the server stands still.
const STOP: Duration = Duration::from_secs(3);
/// How long after that visitors must be shown where they are.
const RECOVERY: Duration = Duration::from_secs(5);

/// A server in a process of its own, which ends with this.
struct ServerProcess(Child);

impl ServerProcess {
    /// Starts one. Returns its address and its fingerprint as well.
    fn start() -> (Self, String, String) {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "stop::serves_until_it_is_killed", "--ignored", "--nocapture"])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let said = BufReader::new(child.stdout.take().unwrap());
        let process = Self(child);
        for line in said.lines().map(Result::unwrap) {
            // The test harness writes in front of the first word.
            if let Some((_, rest)) = line.split_once("serving ")
                && let Some((address, fingerprint)) = rest.split_once(' ')
            {
                return (process, address.to_owned(), fingerprint.to_owned());
            }
        }
        panic!("the server did not start");
    }

    fn signal(&self, signal: &str) {
        let id = self.0.id().to_string();
        assert!(Command::new("kill").args([signal, &id]).status().unwrap().success());
    }
}

impl Drop for ServerProcess {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "the server's end of the test below"]
async fn serves_until_it_is_killed() {
    let config = ServeConfig { tick_hz: 20, validity_max_s: 8.0, ..super::config() };
    let (server, address) = super::serve(config);
    println!("serving {address} {}", server.fingerprint());
    std::future::pending::<()>().await;
}

#[cfg(unix)]
#[tokio::test(flavor = "multi_thread")]
async fn nobody_is_dropped_or_corrected_while_the_server_stands_still() {
    let (process, address, fingerprint) = ServerProcess::start();
    let trust = Trust::Pinned(fingerprint.parse().unwrap());
    let (begin, seconds) = (Duration::from_secs(3), 13);
    let options = SwarmOptions::new(8, Duration::from_secs(seconds), trust);
    let (mut is_stopped, mut has_gone_on) = (false, false);
    let mut farthest_m: f32 = 0.0;
    let check = |snapshot: &SwarmSnapshot| {
        let now = snapshot.elapsed;
        if !is_stopped && now >= begin {
            process.signal("-STOP");
            is_stopped = true;
        }
        if !has_gone_on && now >= begin + STOP {
            process.signal("-CONT");
            has_gone_on = true;
        }
        if now < begin + STOP + RECOVERY {
            return;
        }
        for viewer in &snapshot.visitors {
            for shown in &viewer.shown {
                let truth = snapshot.visitors.iter().find(|other| other.avatar == shown.id);
                let off = truth.map_or(0.0, |other| other.pose.eye.distance(shown.pose.eye));
                farthest_m = farthest_m.max(off);
            }
        }
    };
    let report = swarm::run(address.parse().unwrap(), &options, check).await.unwrap();
    assert!(has_gone_on, "the walk took long enough");
    assert_eq!((report.clients, report.refused, report.disconnected), (8, 0, 0));
    assert_eq!(report.corrections, 0, "{report:?}");
    assert!(farthest_m < 3.0, "a visitor is shown {farthest_m} m off after the stop");
}
