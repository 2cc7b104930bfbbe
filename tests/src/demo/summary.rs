//! The closing table: the same walk under three policies, what the live run measured, and what
//! rays say of both.

use std::{fmt::Write, io::BufReader, sync::Arc, time::Duration};

use rayon::prelude::*;
use sightline_cli::{progress::Progress, trace::Trace};
use sightline_client::swarm::{self, Snapshot};
use sightline_engine::Policy;
use sightline_oracle::Oracle;
use sightline_replay::{self as replay, OracleStride};
use sightline_server::net::ServerStats;
use sightline_world::{World, motion::AvatarId};

use super::FrameRate;

/// Everybody is compared with rays so often.
const ORACLE_INTERVAL: Duration = Duration::from_secs(1);
/// Sampled points a side on a body.
const BODY_SAMPLES: u32 = 3;

/// Prints the table.
pub(super) fn print(
    world: &Arc<World>,
    snapshots: &[Snapshot],
    report: &swarm::SwarmReport,
    server: &ServerStats,
    frames: &FrameRate,
) -> anyhow::Result<()> {
    let trace = trace(snapshots)?;
    let progress = Progress::new();
    let policies = [Policy::Broadcast, Policy::Pvs, Policy::Tbv];
    let mut columns = Vec::new();
    for (i, policy) in policies.into_iter().enumerate() {
        let mut options = replay::ReplayOptions::new(policy, round_trip(report));
        options.oracle = OracleStride::Every(ORACLE_INTERVAL);
        columns.push(replay::run(world, &trace, &options, None, &mut |share| {
            progress.show("the same walk under three policies", (i as f32 + share) / 3.0);
        })?);
    }
    progress.finish();
    print_policies(&columns);
    print_live(&check(world, snapshots), report, server);
    let (width, height) = frames.size;
    println!(
        "frames            {:.1} a second, {:.1} ms each to draw, {width} × {height}, {}",
        frames.per_s, frames.draw_ms, frames.note
    );
    Ok(())
}

fn round_trip(report: &swarm::SwarmReport) -> Duration {
    Duration::from_secs_f64((report.round_trip_ms / 1e3).clamp(0.0, 1.0))
}

/// Where everybody truly was, in the form of a recorded trace.
fn trace(snapshots: &[Snapshot]) -> anyhow::Result<Trace> {
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

fn print_policies(columns: &[replay::ReplayReport]) {
    println!("\nThe same walk, each client's mean, by what it is told of:\n");
    let row = |name: &str, figure: &dyn Fn(&replay::ReplayReport) -> String| {
        print!("{name:<28}");
        columns.iter().for_each(|column| print!("{:>12}", figure(column)));
        println!();
    };
    row("", &|c| c.policy.clone());
    row("visitors", &|c| c.avatars.to_string());
    row("others held, mean", &|c| format!("{:.1}", c.held_mean));
    row("messages to it, a second", &|c| format!("{:.1}", c.messages_to_client));
    row("bytes to it, a second", &|c| format!("{:.0}", c.bytes_to_client));
    row("messages from it, a second", &|c| format!("{:.1}", c.messages_from_client));
    row("bytes from it, a second", &|c| format!("{:.0}", c.bytes_from_client));
    row("share of time it is quiet", &|c| format!("{:.1} %", c.quiet_share * 100.0));
    let oracle = |c: &replay::ReplayReport| c.oracle.clone().unwrap_or_default();
    row("misses", &|c| oracle(c).misses.to_string());
    row("over-send against sight", &|c| format!("{:.2}", oracle(c).over_send));
    println!();
}

/// What rays say of what the clients held.
#[derive(Default)]
struct LiveCheck {
    visible: u64,
    held: u64,
    /// Visible, but not held, at a look and at the one before.
    missed: u64,
}

/// A visible avatar that is not held yet at one moment may be on its way; one that is still not
/// held when somebody looks again is missed.
fn check(world: &World, snapshots: &[Snapshot]) -> LiveCheck {
    let sight = Oracle::new(&world.mesh);
    let looks = every(snapshots, ORACLE_INTERVAL);
    looks
        .par_iter()
        .map(|&index| {
            let mut live = LiveCheck::default();
            let again = snapshots.get(index + 1);
            for (viewer, other) in pairs(&snapshots[index]) {
                let body = world.body.around(other.pose.eye);
                let is_held = viewer.held.iter().any(|held| held.id == other.avatar);
                live.held += u64::from(is_held);
                if sight.of_box(viewer.pose.eye, &body, BODY_SAMPLES) {
                    live.visible += 1;
                    let is_missed = !is_held
                        && again.is_some_and(|later| {
                            misses(world, &sight, later, viewer.avatar, other.avatar)
                        });
                    live.missed += u64::from(is_missed);
                }
            }
            live
        })
        .reduce(LiveCheck::default, |a, b| LiveCheck {
            visible: a.visible + b.visible,
            held: a.held + b.held,
            missed: a.missed + b.missed,
        })
}

fn misses(
    world: &World,
    sight: &Oracle,
    snapshot: &Snapshot,
    viewer: AvatarId,
    other: AvatarId,
) -> bool {
    pairs(snapshot).any(|(v, o)| {
        (v.avatar, o.avatar) == (viewer, other)
            && !v.held.iter().any(|held| held.id == other)
            && sight.of_box(v.pose.eye, &world.body.around(o.pose.eye), BODY_SAMPLES)
    })
}

fn pairs(snapshot: &Snapshot) -> impl Iterator<Item = (&swarm::VisitorView, &swarm::VisitorView)> {
    let visitors = &snapshot.visitors;
    visitors.iter().flat_map(move |viewer| {
        visitors.iter().filter(|o| o.avatar != viewer.avatar).map(move |other| (viewer, other))
    })
}

/// The indices of snapshots that are at least so far apart, without the first second.
fn every(snapshots: &[Snapshot], interval: Duration) -> Vec<usize> {
    let mut next = interval;
    let mut chosen = Vec::new();
    for (index, snapshot) in snapshots.iter().enumerate() {
        if snapshot.elapsed >= next {
            chosen.push(index);
            next = snapshot.elapsed + interval;
        }
    }
    chosen
}

fn print_live(live: &LiveCheck, report: &swarm::SwarmReport, server: &ServerStats) {
    let over_send = live.held as f64 / live.visible.max(1) as f64;
    println!(
        "live, over QUIC   {} visible pairs looked at, {} misses, over-send {over_send:.2}",
        live.visible, live.missed
    );
    if report.clients > 0 {
        println!(
            "                  {:.0} B/s to a client with QUIC's own ({:.0} without), {:.0} B/s from it",
            report.udp_bytes_in_per_s, report.bytes_in_per_s, report.udp_bytes_out_per_s
        );
        println!(
            "                  poses {:.0} ms old in the mean, 99 of 100 within {:.0} ms; {} corrections",
            report.age_mean_ms, report.age_p99_ms, report.corrections
        );
    }
    println!(
        "server            {:.2} ms a tick in the median, {:.2} ms at the 99th percentile",
        server.ticks.median_us as f64 / 1e3,
        server.ticks.p99_us as f64 / 1e3
    );
}
