//! The closing table: the same walk under three policies, what the live run measured, and how both
//! compare with rays.

use std::{
    fmt::Write,
    io::BufReader,
    sync::{Arc, Mutex, PoisonError},
    thread,
    time::Duration,
};

use anyhow::anyhow;
use sightline_cli::{progress::Progress, trace::Trace};
use sightline_client::swarm::{SwarmReport, SwarmSnapshot};
use sightline_engine::Policy;
use sightline_replay::{OracleStride, ReplayOptions, ReplayReport};
use sightline_server::operate::ServerStats;
use sightline_world::World;

use super::live_check::{CHECK_INTERVAL, LiveCheck};

/// The policies that the walk is replayed under: a column each.
const POLICIES: [Policy; 3] = [Policy::Broadcast, Policy::Pvs, Policy::Tbv];

/// How fast the building was drawn.
pub(super) struct FrameRate {
    pub(super) per_s: f64,
    pub(super) draw_ms: f64,
    pub(super) size: (usize, usize),
    /// Where and how, in words.
    pub(super) note: &'static str,
}

/// The figures that are worked out after the walk.
pub(super) struct Summary {
    /// A report for each of [`POLICIES`].
    replays: Vec<ReplayReport>,
    live: LiveCheck,
}

impl Summary {
    /// Replays the recorded walk under each policy, and checks the live run with rays. All four run
    /// at the same time.
    ///
    /// # Errors
    /// When a replay fails.
    pub(super) fn new(
        world: &Arc<World>,
        snapshots: &[SwarmSnapshot],
        report: &SwarmReport,
    ) -> anyhow::Result<Self> {
        let trace = trace(snapshots)?;
        let round_trip = round_trip(report);
        let progress = ReplayProgress::default();
        let summary = thread::scope(|scope| {
            let progress = &progress;
            let trace = &trace;
            let runs: Vec<_> = (0..POLICIES.len())
                .map(|i| {
                    scope.spawn(move || {
                        let mut options = ReplayOptions::new(POLICIES[i], round_trip);
                        options.oracle = OracleStride::Every(CHECK_INTERVAL);
                        let hear = &mut |share| progress.show(i, share);
                        sightline_replay::run(world, trace, &options, None, hear)
                    })
                })
                .collect();
            let live = LiveCheck::of(world, snapshots);
            let replays = runs.into_iter().map(|run| {
                let report = run.join().map_err(|_| anyhow!("a replay's thread failed"))?;
                Ok(report?)
            });
            Ok(Self { replays: replays.collect::<anyhow::Result<_>>()?, live })
        });
        progress.bar.finish();
        summary
    }

    /// Prints the table for people.
    pub(super) fn print(&self, report: &SwarmReport, server: &ServerStats, frames: &FrameRate) {
        self.print_policies();
        self.print_live(report);
        println!(
            "server            {:.2} ms a tick in the median, {:.2} ms at the 99th percentile",
            server.ticks.median_us as f64 / 1e3,
            server.ticks.p99_us as f64 / 1e3
        );
        let (width, height) = frames.size;
        println!(
            "frames            {:.1} a second, {:.1} ms each to draw, {width} × {height}, {}",
            frames.per_s, frames.draw_ms, frames.note
        );
    }

    fn print_policies(&self) {
        println!("\nThe same walk under three policies, means over all clients:\n");
        let row = |name: &str, figure: &dyn Fn(&ReplayReport) -> String| {
            print!("{name:<30}");
            self.replays.iter().for_each(|replay| print!("{:>12}", figure(replay)));
            println!();
        };
        row("", &|r| r.policy.clone());
        row("visitors", &|r| r.avatars.to_string());
        row("avatars held by a client", &|r| format!("{:.1}", r.held_mean));
        row("messages to a client, per s", &|r| format!("{:.1}", r.messages_to_client));
        row("bytes to a client, per s", &|r| format!("{:.0}", r.bytes_to_client));
        row("messages from a client, per s", &|r| format!("{:.1}", r.messages_from_client));
        row("bytes from a client, per s", &|r| format!("{:.0}", r.bytes_from_client));
        row("share of time quiet", &|r| format!("{:.1} %", r.quiet_share * 100.0));
        let oracle = |r: &ReplayReport| r.oracle.clone().unwrap_or_default();
        row("misses", &|r| oracle(r).misses.to_string());
        row("over-send against rays", &|r| format!("{:.2}", oracle(r).over_send));
        println!();
    }

    fn print_live(&self, report: &SwarmReport) {
        println!(
            "live, over QUIC   {} visible pairs checked, {} misses, over-send {:.2}",
            self.live.visible,
            self.live.missed,
            self.live.over_send()
        );
        if report.clients > 0 {
            println!(
                "                  {:.0} B/s to a client with QUIC ({:.0} without), {:.0} B/s from it",
                report.udp_bytes_in_per_s, report.bytes_in_per_s, report.udp_bytes_out_per_s
            );
            println!(
                "                  poses {:.0} ms old on average, 99 of 100 within {:.0} ms; \
                 {} corrections",
                report.age_mean_ms, report.age_p99_ms, report.corrections
            );
        }
    }
}

/// One progress bar for replays that run at the same time.
#[derive(Default)]
struct ReplayProgress {
    bar: Progress,
    /// The share done of each replay, from 0 to 1.
    shares: Mutex<[f32; POLICIES.len()]>,
}

impl ReplayProgress {
    fn show(&self, replay: usize, share: f32) {
        let mut shares = self.shares.lock().unwrap_or_else(PoisonError::into_inner);
        shares[replay] = share;
        let mean = shares.iter().sum::<f32>() / POLICIES.len() as f32;
        self.bar.show("the same walk under three policies", mean);
    }
}

fn round_trip(report: &SwarmReport) -> Duration {
    Duration::from_secs_f64((report.round_trip_ms / 1e3).clamp(0.0, 1.0))
}

/// The visitors' true poses, in the form of a recorded trace.
fn trace(snapshots: &[SwarmSnapshot]) -> anyhow::Result<Trace> {
    let mut csv = String::from("t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n");
    for snapshot in snapshots {
        for visitor in &snapshot.visitors {
            let (pose, id) = (visitor.pose, visitor.avatar.0);
            let (eye, v) = (pose.eye, pose.velocity);
            writeln!(
                csv,
                "{},{id},{:.4},{:.4},{:.4},{:.4},{:.4},{:.3},{:.3},{:.3}",
                snapshot.elapsed.as_millis(),
                eye.x,
                eye.y,
                eye.z,
                pose.yaw,
                pose.pitch,
                v.x,
                v.y,
                v.z
            )?;
        }
    }
    Ok(Trace::read(BufReader::new(csv.as_bytes()))?)
}
