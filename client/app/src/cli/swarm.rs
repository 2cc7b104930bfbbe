//! `sightline-client swarm`.

use std::{
    collections::VecDeque,
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use anyhow::{Context, ensure};
use sightline_cli::{
    files::check_output,
    flags,
    log::{self, LogFormat},
    output,
    progress::Progress,
    trace::Trace,
};
use sightline_client::{
    net::{self, Dialer, Trust},
    swarm::{self, SwarmOptions, SwarmReport},
};
use sightline_protocol::fingerprint::Fingerprint;

/// Sends simulated visitors to a server, and reports what they received.
///
/// The visitors wander from room to room, or follow a recorded trace. Each has a connection of its
/// own.
#[derive(clap::Args)]
pub struct Args {
    /// The server, as host:port; or several servers of one building, to which the visitors go in
    /// turns.
    #[arg(value_name = "ADDR", default_value = "localhost:4777")]
    addresses: Vec<String>,
    /// The number of visitors.
    #[arg(long, value_name = "N", default_value_t = 16,
          value_parser = clap::value_parser!(u32).range(1..=16_384))]
    clients: u32,
    /// How long they walk, in seconds.
    #[arg(long, value_name = "S", default_value_t = 30.0)]
    seconds: f64,
    /// Follow the walks of a trace, gzipped or not, instead of wandering.
    #[arg(long, value_name = "TRACE.csv")]
    trace: Option<PathBuf>,
    /// The fingerprint of the server's certificate. When absent, the server first met at this
    /// address is trusted.
    #[arg(long, value_name = "HEX")]
    fingerprint: Option<Fingerprint>,
    /// The seed of the visitors' goals: the same seed gives the same goals.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write the figures to a JSON file.
    #[arg(long, value_name = "F")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    log::show_log("warn,winit=error", LogFormat::Text);
    ensure!(
        args.seconds.is_finite() && (0.1..=86_400.0).contains(&args.seconds),
        "--seconds must be between 0.1 and 86400"
    );
    args.json.as_deref().map_or(Ok(()), check_output)?;
    let addresses = args.addresses.iter().map(|address| flags::resolve(address));
    let mut addresses = addresses.collect::<Result<VecDeque<_>, _>>()?;
    let address = addresses.pop_front().context("there is no server")?;
    let trust = match args.fingerprint {
        Some(fingerprint) => Trust::Pinned(fingerprint),
        None => Trust::of_user().context("there is no home folder: give --fingerprint")?,
    };
    let open = |path: &Path| Trace::open(path).with_context(|| path.display().to_string());
    let trace = args.trace.as_deref().map(open).transpose()?;
    let duration = Duration::from_secs_f64(args.seconds);
    let progress = Arc::new(Progress::new());
    let on_join = {
        let (progress, clients) = (progress.clone(), args.clients);
        move |joined: usize| {
            let note = format!("({joined} of {clients})");
            progress.show_with_note("coming in", joined as f32 / clients as f32, &note);
        }
    };
    let options = SwarmOptions {
        seed: args.seed,
        trace,
        others: addresses.into(),
        on_join: Some(Arc::new(on_join)),
        dialer: Arc::new(Dialer::new(net::world_folder_of_user())),
        ..SwarmOptions::new(args.clients as usize, duration, trust)
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let walk = swarm::run(address, &options, |snapshot| {
        let share = snapshot.elapsed.as_secs_f32() / duration.as_secs_f32();
        progress.show_with_note(
            "walking",
            share,
            &format!("({} visitors)", snapshot.visitors.len()),
        );
    });
    let report = runtime.block_on(async {
        tokio::select! {
            report = walk => report.map_err(anyhow::Error::from),
            _ = tokio::signal::ctrl_c() => Err(anyhow::anyhow!("interrupted")),
        }
    })?;
    progress.finish();
    output::print(&table(&report))?;
    if report.is_bottleneck {
        output::note(&format!(
            "the swarm itself is the bottleneck: its visitors step every {:.0} ms at the 99th \
             percentile, not every 25; send fewer visitors, or use a faster or idler machine",
            report.step_p99_ms
        ));
    }
    if report.looks == 0 {
        output::note("no pair was looked at for misses, because all visitors leapt all the time");
    }
    output::write_json(args.json.as_deref(), &report)?;
    let (clients, disconnected) = (report.clients, report.disconnected);
    ensure!(disconnected == 0, "{disconnected} of {clients} visitors were disconnected");
    Ok(())
}

fn table(report: &SwarmReport) -> String {
    let by_distance = report.promised_errors_by_distance.iter();
    let by_distance = by_distance.map(|band| (band.name(), band.to_string()));
    // Without anything to compare, a nought would be no praise.
    let has_compared = !report.promised_errors_by_distance.is_empty();
    let compared = |figure: f64, unit: &str| match has_compared {
        true => format!("{figure:.1} {unit}"),
        false => "-".to_owned(),
    };
    let rows = [
        ("visitors", format!("{}", report.clients)),
        ("refused", format!("{}", report.refused)),
        ("disconnected", format!("{}", report.disconnected)),
        ("came back", format!("{}", report.returned)),
        ("seconds", format!("{:.1}", report.seconds)),
        ("all were in after", format!("{:.1} s", report.joined_s)),
        ("time to come in, median", format!("{:.0} ms", report.join_p50_ms)),
        ("time to come in, 99th percentile", format!("{:.0} ms", report.join_p99_ms)),
        ("share of time moving", format!("{:.1} %", report.moving_share * 100.0)),
        ("avatars held by a client", format!("{:.2}", report.visible_mean)),
        ("share of time quiet", format!("{:.1} %", report.quiet_share * 100.0)),
        ("share of time on course", format!("{:.1} %", report.course_share * 100.0)),
        ("messages to a client", format!("{:.1} /s", report.messages_in_per_s)),
        ("messages from a client", format!("{:.1} /s", report.messages_out_per_s)),
        ("bytes to a client", format!("{:.0} /s", report.bytes_in_per_s)),
        ("bytes from a client", format!("{:.0} /s", report.bytes_out_per_s)),
        ("bytes with QUIC, to a client", format!("{:.0} /s", report.udp_bytes_in_per_s)),
        ("bytes with QUIC, from a client", format!("{:.0} /s", report.udp_bytes_out_per_s)),
        ("poses delivered", format!("{:.2} %", report.delivered_share * 100.0)),
        ("age of poses, mean", format!("{:.0} ms", report.age_mean_ms)),
        ("age of poses, 99th percentile", format!("{:.0} ms", report.age_p99_ms)),
        ("age of poses, oldest", format!("{:.0} ms", report.age_max_ms)),
        ("shown off by, 99th percentile", format!("{:.1} cm", report.shown_error_p99_m * 100.0)),
        ("off the promise, median", compared(report.promised_error_p50_m * 100.0, "cm")),
        ("off the promise, 99th percentile", compared(report.promised_error_p99_m * 100.0, "cm")),
        ("turned off it, median", compared(report.promised_error_p50_deg, "degrees")),
        ("turned off it, 99th percentile", compared(report.promised_error_p99_deg, "degrees")),
        ("certainty, 99th percentile", format!("{:.0} ms", report.certainty_p99_ms)),
        ("round trip", format!("{:.1} ms", report.round_trip_ms)),
        ("corrections", format!("{}", report.corrections)),
        ("misses", format!("{}", report.misses)),
        ("pairs looked at for misses", format!("{}", report.looks)),
        ("time between steps, 99th perc.", format!("{:.0} ms", report.step_p99_ms)),
        ("processor time of the swarm", format!("{:.0} %", report.swarm_cpu * 100.0)),
    ];
    let server_cpu = report
        .server_cpu
        .map(|cpu| ("processor time of the server", format!("{:.0} %", cpu * 100.0)));
    let server_memory = report
        .server_memory_bytes
        .map(|bytes| ("memory of the server", format!("{:.0} MB", bytes as f64 / 1e6)));
    let beside = server_cpu.into_iter().chain(server_memory);
    let rows = rows.into_iter().chain(beside).map(|(what, figure)| (what.to_owned(), figure));
    let lines = rows.chain(by_distance);
    lines.map(|(what, figure)| format!("{what:<33}{figure:>12}\n")).collect()
}
