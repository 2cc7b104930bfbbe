//! `sightline-client bench --fuzzy`.

use std::path::PathBuf;

use serde::Serialize;
use sightline_client::bench::{self, FRAME_S, FuzzyRun, Options};
use sightline_shared::{motion::Pose, world::World};

use super::{Args, sizes, table};
use crate::cli::progress::Progress;

/// All figures.
#[derive(Serialize)]
struct Report<'a> {
    world: &'a PathBuf,
    width: usize,
    height: usize,
    threads: usize,
    #[serde(flatten)]
    run: FuzzyRun,
}

/// Measures along the path; gives the text and the figures for machines.
pub fn run(args: &Args, world: &World, progress: &Progress) -> anyhow::Result<(String, String)> {
    let (path, from, until) = args.way.read(world)?;
    let times = (0..args.frames).map(|i| (from + i as f64 * FRAME_S).min(until));
    let poses: Vec<Pose> = times.map(|time| path.at(time)).collect();
    let (size, threads) = (sizes(args)[0], args.threads.first().copied().unwrap_or(1).into());
    let options = Options { size, threads, repeats: args.repeats.into() };
    let hear = &mut |share| progress.tell("boxes of eyes", share, "");
    let run = bench::fuzzy(world, &poses, &options, hear)?;
    let text = text(&run, &table::stage(size, threads));
    let (width, height) = size;
    let report = Report { world: &args.world, width, height, threads, run };
    Ok((text, serde_json::to_string_pretty(&report)? + "\n"))
}

fn text(run: &FuzzyRun, stage: &str) -> String {
    let rows = [("nodes", run.nodes), ("mask tests", run.mask_tests)];
    let mut out = format!(
        "{stage}, {} pictures, CPU time\n\nwalls      {:>8}    found in {:.0} ms\nboxes      {:>8}    {:.2} ms \
         each, {:.0} a second; they hide {:.1} % of the nodes\nin time    {:>6.1} %\n\n{:24}{:>10}{:>10}{:>10}\n",
        run.pictures,
        run.walls,
        run.walls_ms,
        run.boxes,
        run.box_ms,
        run.boxes_per_s,
        run.hidden * 100.0,
        run.hit_rate * 100.0,
        "of a picture",
        "whole",
        "less",
        "gain"
    );
    for (name, [whole, less]) in rows {
        out += &format!("{name:24}{whole:>10.0}{less:>10.0}{:>10.3}\n", whole / less.max(1.0));
    }
    let [whole, less] = run.picture_ms;
    let all = whole / run.gain_all;
    out += &format!("{:24}{whole:>10.3}{less:>10.3}{:>10.3}\n", "ms", run.gain);
    out + &format!("{:24}{whole:>10.3}{all:>10.3}{:>10.3}\n", "ms, boxes counted", run.gain_all)
}
