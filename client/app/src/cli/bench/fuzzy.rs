//! `sightline-client bench --fuzzy`.

use std::path::PathBuf;

use serde::Serialize;
use sightline_cli::progress::Progress;
use sightline_client::bench::{self, BenchOptions, FRAME_S, FuzzyRun};
use sightline_world::{World, motion::Pose};

use super::{Args, sizes, table};

/// The figures for machines.
#[derive(Serialize)]
pub struct FuzzyReport<'a> {
    world: &'a PathBuf,
    width: usize,
    height: usize,
    threads: usize,
    #[serde(flatten)]
    run: FuzzyRun,
}

/// Measures along the path. Returns the text for people and the JSON for machines.
pub fn run<'a>(
    args: &'a Args,
    world: &World,
    progress: &Progress,
) -> anyhow::Result<(String, FuzzyReport<'a>)> {
    let (path, from, until) = args.path.read(world)?;
    let times = (0..args.frames).map(|i| (from + i as f64 * FRAME_S).min(until));
    let poses: Vec<Pose> = times.map(|time| path.at(time)).collect();
    let (size, threads) = (sizes(args)[0], args.threads.first().copied().unwrap_or(1).into());
    let options = BenchOptions { size, threads, repeats: args.repeats.into(), mode: None };
    let show = &mut |share| progress.show("viewpoint boxes", share);
    let run = bench::fuzzy(world, &poses, &options, show)?;
    let text = text(&run, &table::stage(size, threads));
    let (width, height) = size;
    let report = FuzzyReport { world: &args.world, width, height, threads, run };
    Ok((text, report))
}

fn text(run: &FuzzyRun, stage: &str) -> String {
    let remaining = 1.0 - run.hidden - run.visible;
    let [hidden, visible, remaining] = [run.hidden, run.visible, remaining].map(|of| of * 100.0);
    let mut out = format!(
        "{stage}, {} pictures, CPU time\n\nwalls      {:>8}    found in {:.0} ms\nboxes      {:>8}    {:.2} ms \
         each, {:.0} a second\nnodes      {hidden:>6.1} %    hidden, {visible:.1} % seen whole, {remaining:.1} % \
         remaining\nin time    {:>6.1} %\n\n{:24}{:>10}{:>10}{:>10}{:>12}{:>10}\n",
        run.pictures,
        run.walls,
        run.walls_ms,
        run.boxes,
        run.box_ms,
        run.boxes_per_s,
        run.hit_rate * 100.0,
        "of a picture",
        "whole",
        "less",
        "gain",
        "less tests",
        "gain",
    );
    for (name, [whole, less, untested]) in [("nodes", run.nodes), ("mask tests", run.mask_tests)] {
        let gains = [less, untested].map(|of| whole / of.max(1.0));
        out += &line(name, [whole, less, untested], gains, 0);
    }
    let [whole, less, untested] = run.picture_ms;
    out += &line("ms", [whole, less, untested], [run.gain[1], run.gain[2]], 3);
    let gains = [run.gain_all[1], run.gain_all[2]];
    let all = gains.map(|gain| whole / gain);
    out + &line("ms, boxes counted", [whole, all[0], all[1]], gains, 3)
}

fn line(name: &str, [whole, less, untested]: [f64; 3], gains: [f64; 2], digits: usize) -> String {
    format!(
        "{name:24}{whole:>10.digits$}{less:>10.digits$}{:>10.3}{untested:>12.digits$}{:>10.3}\n",
        gains[0], gains[1]
    )
}
