//! `sightline-client bench --moving`.

use std::path::PathBuf;

use serde::Serialize;
use sightline_cli::progress::Progress;
use sightline_client::bench::{self, BenchOptions, MovingCost, MovingKind, MovingRow, MovingRun};
use sightline_world::World;

use super::{Args, sizes, table};

/// The figures for machines.
#[derive(Serialize)]
pub struct MovingReport<'a> {
    world: &'a PathBuf,
    width: usize,
    height: usize,
    threads: usize,
    pictures: usize,
    #[serde(flatten)]
    run: MovingRun,
}

/// Measures with up to `most` moving things. Returns the text for people and the JSON for machines.
pub fn run<'a>(
    args: &'a Args,
    world: World,
    most: usize,
    progress: &Progress,
) -> anyhow::Result<(String, MovingReport<'a>)> {
    let (size, threads) = (sizes(args)[0], args.threads.first().copied().unwrap_or(1).into());
    let options = BenchOptions { size, threads, repeats: args.repeats.into(), mode: None };
    let pictures = args.frames.max(2);
    let show = &mut |share| progress.show("moving things", share);
    let run = bench::moving(world, most, pictures, &options, show)?;
    let text = text(&run, &table::stage(size, threads), pictures);
    let (width, height) = size;
    let report = MovingReport { world: &args.world, width, height, threads, pictures, run };
    Ok((text, report))
}

fn text(run: &MovingRun, stage: &str, pictures: usize) -> String {
    let mut out = format!(
        "{stage}, {pictures} pictures around the first spawn point; the building alone takes {:.2} ms of CPU time\n\n{:24}",
        run.building_ms, ""
    );
    let groups = ["everything", "hierarchical Z", "and bounding volumes"];
    groups.iter().for_each(|group| out += &format!("{group:>30}"));
    out += &format!("\n{:24}", "");
    for _ in groups {
        ["ratio", "ms", "drawn", "placed"].iter().zip([9, 7, 7, 7]).for_each(|(head, width)| {
            out += &format!("{head:>width$}");
        });
    }
    out += "\n";
    run.rows.iter().for_each(|row| out += &line(row));
    out
}

fn line(row: &MovingRow) -> String {
    let kind = match row.kind {
        MovingKind::Chairs => "chairs",
        MovingKind::People => "people",
    };
    let place = if row.hidden { ", hidden" } else { "" };
    let mut out = format!("{:<24}", format!("{:>6} {kind}{place}", row.count));
    for MovingCost { ratio, cpu_ms, drawn, placed, .. } in row.ways {
        out += &format!("{ratio:>9.3}{cpu_ms:>7.2}{drawn:>7.1}{placed:>7.1}");
    }
    out + "\n"
}
