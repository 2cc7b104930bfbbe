//! The closing table: the same walk under four policies, what the live run measured, and how both
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

/// What the walk is replayed under: a column each.
const COLUMNS: [Column; 4] = [
    Column { name: "broadcast", policy: Policy::Broadcast, by_exception: false },
    Column { name: "PVS", policy: Policy::Pvs, by_exception: false },
    // Sudarsky and Gotsman 1996, section 5.
    Column { name: "TBV of 1996", policy: Policy::Tbv, by_exception: false },
    Column { name: "Sightline", policy: Policy::Tbv, by_exception: true },
];

/// A policy, and how live clients report under it.
struct Column {
    name: &'static str,
    policy: Policy,
    /// Whether live clients report only when they depart from their courses.
    by_exception: bool,
}

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
    /// A report for each of [`COLUMNS`].
    replays: Vec<ReplayReport>,
    live: LiveCheck,
}

impl Summary {
    /// Replays the recorded walk under each policy, and checks the live run with rays. All five run
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
            let runs: Vec<_> = (0..COLUMNS.len())
                .map(|i| {
                    scope.spawn(move || {
                        let mut options = ReplayOptions::new(COLUMNS[i].policy, round_trip);
                        options.config.by_exception = COLUMNS[i].by_exception;
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
        println!("\nThe same walk under four policies, means over all clients:\n");
        let row = |name: &str, figure: &dyn Fn(&ReplayReport) -> String| {
            print!("{name:<32}");
            self.replays.iter().for_each(|replay| print!("{:>13}", figure(replay)));
            println!();
        };
        print!("{:<32}", "");
        COLUMNS.iter().for_each(|column| print!("{:>13}", column.name));
        println!();
        row("visitors", &|r| r.avatars.to_string());
        row("avatars held by a client", &|r| format!("{:.1}", r.held_mean));
        row("messages to a client, a second", &|r| format!("{:.1}", r.messages_to_client));
        row("bytes to a client, a second", &|r| format!("{:.0}", r.bytes_to_client));
        row("messages from a client, a second", &|r| format!("{:.1}", r.messages_from_client));
        row("bytes from a client, a second", &|r| format!("{:.0}", r.bytes_from_client));
        let percent = |share: f64| format!("{:.1} %", share * 100.0);
        row("time live, with a report", &|r| percent(reporting_share(r)));
        row("time live, silent on course", &|r| percent(r.course_share));
        row("time quiet, silent in a TBV", &|r| percent(r.quiet_share));
        let oracle = |r: &ReplayReport| r.oracle.clone().unwrap_or_default();
        row("misses", &|r| oracle(r).misses.to_string());
        row("over-send against rays", &|r| format!("{:.2}", oracle(r).over_send));
        row("shown off by, 99th percentile", &|r| {
            format!("{:.0} cm", oracle(r).shown_error_p99_m * 100.0)
        });
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
                "                  to a client:   {:5.1} messages/s, {:.0} B/s, {:.0} B/s with QUIC",
                report.messages_in_per_s, report.bytes_in_per_s, report.udp_bytes_in_per_s
            );
            println!(
                "                  from a client: {:5.1} messages/s, {:.0} B/s, {:.0} B/s with QUIC",
                report.messages_out_per_s, report.bytes_out_per_s, report.udp_bytes_out_per_s
            );
            println!(
                "                  silent on course for {:.1} % of the time, in a TBV for {:.1} %",
                report.course_share * 100.0,
                report.quiet_share * 100.0
            );
            println!(
                "                  shown off by {:.0} cm at the 99th percentile; {} corrections",
                report.shown_error_p99_m * 100.0,
                report.corrections
            );
        }
    }
}

/// One progress bar for replays that run at the same time.
#[derive(Default)]
struct ReplayProgress {
    bar: Progress,
    /// The share done of each replay, from 0 to 1.
    shares: Mutex<[f32; COLUMNS.len()]>,
}

impl ReplayProgress {
    fn show(&self, replay: usize, share: f32) {
        let mut shares = self.shares.lock().unwrap_or_else(PoisonError::into_inner);
        shares[replay] = share;
        let mean = shares.iter().sum::<f32>() / COLUMNS.len() as f32;
        self.bar.show("the same walk under four policies", mean);
    }
}

/// The share of a client's ticks at which it is live and reports, from 0 to 1.
fn reporting_share(report: &ReplayReport) -> f64 {
    1.0 - report.course_share - report.quiet_share
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
