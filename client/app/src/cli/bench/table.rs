//! The figures as tables for people.

use sightline_client::bench::{
    BenchRun, DepthAgreement, FrameCounts, MethodRow, ModeComparison, Shimmer, Spread,
};

use super::{BenchReport, Quality};

/// All tables of a report.
pub fn text(report: &BenchReport) -> String {
    let mut out = format!(
        "{}: {}³ voxels of {:.1} mm, {} opaque triangles; {} spawn points, {} frames along a path of {:.0} s\n",
        report.world,
        1u64 << report.depth,
        report.voxel_m * 1e3,
        report.triangles,
        report.spawns,
        report.frames,
        report.path_s
    );
    report.runs.iter().for_each(|run| out += &table(run));
    if !report.quality.is_empty() {
        out += "\nchanges of pixels on a slow path, in levels of 255; and pixels that agree with rays, in %\n";
        out += &line(
            "",
            &["change", "9 samples", "shimmer", "median %", "worst %"].map(str::to_owned),
        );
        report.quality.iter().for_each(|quality| out += &quality_line(quality));
    }
    if !report.comparisons.is_empty() {
        out += "\nmodes compared with perspective mode: pixels in %, projections in %\n";
        let head = [
            "differing",
            "worst",
            "unlike",
            "worst",
            "shifted",
            "worst",
            "by px",
            "projected",
            "worst",
        ];
        out += &line("", &head.map(str::to_owned));
        report.comparisons.iter().for_each(|comparison| out += &comparison_line(comparison));
    }
    out
}

/// A size and a number of threads, in words.
pub fn stage(size: (usize, usize), threads: usize) -> String {
    let (width, height) = size;
    let threads = if threads == 1 { "1 thread".to_owned() } else { format!("{threads} threads") };
    format!("{width} × {height}, {threads}")
}

fn table(run: &BenchRun) -> String {
    let mut out = format!("\n{}: ms per frame\n", stage((run.width, run.height), run.threads));
    let groups = ["spawns, CPU", "path, CPU", "spawns, busiest", "spawns, clock"];
    out += &format!("{:24}", "");
    groups.iter().for_each(|group| out += &format!("{group:>20}"));
    out += "\n";
    let spreads = ["median", "worst"].iter().cycle().take(8).map(|&name| name.to_owned());
    let rest = ["M rays/s", "/ BVH2", "/ CWBVH"].map(str::to_owned);
    out += &line("", &spreads.chain(rest).collect::<Vec<_>>());
    run.rows.iter().for_each(|row| out += &row_line(row));
    let head = ["projected", "nodes", "masked", "pixels"].map(str::to_owned);
    out += &line("spawns, mean", &head);
    for (row, counts) in run.rows.iter().filter_map(|row| Some((row, row.counts?))) {
        let FrameCounts { projections, nodes, mask_tests, pixels } = counts;
        let counts = [projections, nodes, mask_tests, pixels].map(|count| format!("{count:.0}"));
        out += &line(row.name, &counts);
    }
    out
}

fn row_line(row: &MethodRow) -> String {
    let (cpu, busiest, wall) = (row.cpu_ms, row.busiest_ms, row.wall_ms);
    let spreads = [cpu.spawns, cpu.path, busiest.spawns, wall.spawns];
    let spreads = spreads.iter().flat_map(|spread| [spread.median, spread.worst]);
    let mut figures: Vec<String> = spreads.map(|figure| format!("{figure:.1}")).collect();
    figures.push(format!("{:.2}", row.rays_per_us));
    let ratios = [row.ratio_bvh2, row.ratio_cwbvh];
    figures.extend(ratios.map(|ratio| ratio.map_or("-".into(), |ratio| format!("{ratio:.2}"))));
    line(row.name, &figures)
}

fn quality_line(quality: &Quality) -> String {
    let Shimmer { change, smooth, excess } = quality.shimmer;
    let mut figures = [change, smooth, excess].map(|level| format!("{level:.2}")).to_vec();
    if !quality.depths.is_empty() {
        let agreeing = |depths: &DepthAgreement| depths.agreeing * 100.0;
        let all: Vec<f64> = quality.depths.iter().map(agreeing).collect();
        let least = all.iter().copied().fold(100.0, f64::min);
        figures.extend([Spread::of(&all).median, least].map(|percent| format!("{percent:.3}")));
    }
    line(quality.mode, &figures)
}

fn comparison_line(comparison: &ModeComparison) -> String {
    let ModeComparison {
        mode,
        width,
        height,
        differing,
        unlike,
        shifted,
        shift_max,
        projections,
        ..
    } = comparison;
    let percent = |share: f64| format!("{:.3}", share * 100.0);
    let figures = [
        percent(differing.median),
        percent(differing.worst),
        percent(unlike.median),
        percent(unlike.worst),
        percent(shifted.median),
        percent(shifted.worst),
        shift_max.to_string(),
        percent(projections.median),
        percent(projections.worst),
    ];
    line(&format!("{mode}, {width} × {height}"), &figures)
}

/// A row: a name, and right-aligned figures.
fn line(name: &str, figures: &[String]) -> String {
    let figures: String = figures.iter().map(|figure| format!("{figure:>10}")).collect();
    format!("{name:24}{figures}\n")
}
