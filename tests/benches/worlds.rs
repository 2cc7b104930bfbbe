//! The cost of compiling worlds, and their quality: generated buildings of growing size, and Quake
//! III maps beside the figures of their own compiler.
//!
//! ```text
//! cargo bench -p sightline-tests --bench worlds -- --rooms 100,500 --pairs 100000 --map house.glb
//! ```
//!
//! Writes nothing except the file that `--json` names. Also compiles the maps in the folder
//! `shared/maps` beside the repository, or in `SIGHTLINE_SHARED`. Fails when there is a miss.
//!
//! CPU seconds are the sum over all threads, so other programs disturb them little.

use std::{fmt::Write, ops::ControlFlow, path::PathBuf, time::Instant};

use anyhow::Context;
use clap::Parser;
use serde::Serialize;
use sightline_compiler::{
    CompileOptions, Stage, compile,
    import::{self, glb},
    model::Model,
    verify::{self, PairCounts, PvsTally, VerifySummary},
};
use sightline_fixtures::shared_files::shared_file;
use sightline_tests::bench_flags::BenchFlags;
use sightline_world::{Pvs, World};

/// The median CPU time of q3map2's full vis per portal, over 33 maps, in milliseconds.
const Q3MAP2_MEDIAN_MS: f64 = 0.79;

/// q3map2's full vis, measured on one thread of an AMD EPYC: the map, the number of portals that
/// q3map2 makes, and CPU seconds. The machine that this bench runs on may differ.
const Q3MAP2: [(&str, u32, f64); 3] =
    [("oa_dm4", 704, 0.14), ("aggressor", 1_129, 1.03), ("oa_dm2", 2_268, 1.55)];

/// The stages that find out which cells see each other.
const SIGHT_STAGES: [Stage; 3] = [Stage::Carving, Stage::Cells, Stage::Pvs];

/// Compiles generated buildings and Quake III maps, verifies them, and prints cost and quality.
#[derive(Parser)]
struct Args {
    /// The numbers of rooms of the generated buildings, ascending. Without a number, none are
    /// generated.
    #[arg(long, value_delimiter = ',', num_args = 0.., value_name = "N,N,...")]
    rooms: Option<Vec<usize>>,
    /// The number of pairs of points for each of the two ways of sampling.
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    pairs: u64,
    /// The number of PVS entries tested for looseness, by 100,000 rays each.
    #[arg(long, value_name = "N", default_value_t = 0)]
    entries: u32,
    /// Another building: .glb, .gltf or .bsp; may be given several times.
    #[arg(long, value_name = "FILE")]
    map: Vec<PathBuf>,
    /// Leave out the maps beside the repository.
    #[arg(long)]
    no_maps: bool,
    /// The generated building that gets voxels of the default size; all others get coarse ones.
    #[arg(long, value_name = "ROOMS", default_value_t = 2_000)]
    full: usize,
    /// The edge of coarse voxels, in metres.
    #[arg(long, value_name = "METRES", default_value_t = 1.0)]
    voxel: f32,
    /// The seed of the generated buildings and of the sampled points.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    flags: BenchFlags,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let mut rows = Vec::new();
    let default: &[usize] = if args.flags.bench { &[100, 500, 2_000, 5_000] } else { &[4] };
    for &rooms in args.rooms.as_deref().unwrap_or(default) {
        let glb = sightline_demo_building::glb(rooms, args.seed);
        let name = format!("{rooms} rooms");
        let voxel = (rooms != args.full).then_some(args.voxel);
        rows.push(WorldRow::new(name, Some(rooms), voxel, &args, || {
            Ok(glb::read_slice(&glb, None, "generated")?)
        })?);
    }
    let found = if args.flags.bench && !args.no_maps { found_maps()? } else { Vec::new() };
    for path in found.iter().chain(&args.map) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        rows.push(WorldRow::new(name, None, Some(args.voxel), &args, || {
            Ok(import::read(path, &[])?)
        })?);
    }
    for i in 1..rows.len() {
        rows[i].growth = rows[i].growth_since(&rows[i - 1]);
    }
    println!("{}", report(&rows, &args));
    args.flags.write(&rows)?;
    let misses: u64 = rows.iter().map(|row| row.principal.misses).sum();
    anyhow::ensure!(misses == 0, "the PVS misses {misses} visible pairs");
    Ok(())
}

/// The maps beside the repository, sorted by name. Says so when there are none.
fn found_maps() -> anyhow::Result<Vec<PathBuf>> {
    let Some(folder) = shared_file("maps") else { return Ok(Vec::new()) };
    let mut maps = Vec::new();
    for entry in folder.read_dir()? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bsp")) {
            maps.push(path);
        }
    }
    maps.sort();
    Ok(maps)
}

/// The figures of a building.
#[derive(Serialize)]
struct WorldRow {
    name: String,
    /// The number of rooms of a generated building.
    rooms: Option<usize>,
    spaces: usize,
    gates: usize,
    cells: usize,
    portals: usize,
    /// CPU seconds of carving, subdivision and PVS.
    cpu_seconds: [f64; 3],
    /// CPU milliseconds of these three stages, per portal between cells.
    portal_ms: f64,
    /// CPU milliseconds of these three stages, per gate: the portals between spaces, which portal
    /// flow goes through.
    gate_ms: f64,
    /// q3map2's CPU seconds for the map, and its milliseconds per portal.
    q3map2: Option<[f64; 2]>,
    /// The exponent with which CPU seconds grow with the number of rooms, since the row before.
    growth: Option<f64>,
    /// Whether the voxels have the default size.
    full: bool,
    /// Wall-clock seconds from the file to the world.
    seconds: f64,
    /// Wall-clock seconds of voxelising, which are part of `seconds`.
    voxel_seconds: f64,
    density: f64,
    entries_per_cell: f64,
    /// The approximate size of the PVS in memory, and its size in the world file before
    /// compression, in 10^6 bytes.
    pvs_mb: [f64; 2],
    /// The number of pairs of points that counted, in both ways of sampling.
    pairs: u64,
    #[serde(flatten)]
    principal: VerifySummary,
}

impl WorldRow {
    /// Compiles a building and verifies it. Voxels have the default size when `voxel` is `None`.
    fn new(
        name: String,
        rooms: Option<usize>,
        voxel: Option<f32>,
        args: &Args,
        read: impl FnOnce() -> anyhow::Result<Model>,
    ) -> anyhow::Result<Self> {
        eprintln!("{name}: compiling");
        let start = Instant::now();
        let model = read().with_context(|| name.clone())?;
        let options = CompileOptions { voxel, ..Default::default() };
        let (world, report) = compile(&model, &options, &|_, _| ControlFlow::Continue(()))
            .with_context(|| name.clone())?;
        let seconds = start.elapsed().as_secs_f64();
        let cpu_seconds = SIGHT_STAGES.map(|stage| of_stage(&report.cpu_seconds, stage));
        let cpu_ms = cpu_seconds.iter().sum::<f64>() * 1e3;
        // Print the main figures early: verifying takes long.
        let (cells, cpu_s) = (report.cells, cpu_ms / 1e3);
        eprintln!("{name}: {cells} cells in {cpu_s:.2} s CPU, {seconds:.1} s in all; verifying");
        let verified = verified(&world, args)?;
        let entries: u64 = world.cells.pvs.iter().map(|row| row.len()).sum();
        let by_volume = &verified.by_volume;

        Ok(Self {
            rooms,
            spaces: report.spaces,
            gates: report.gates,
            cells: report.cells,
            portals: report.portals,
            cpu_seconds,
            portal_ms: cpu_ms / report.portals.max(1) as f64,
            gate_ms: cpu_ms / report.gates.max(1) as f64,
            q3map2: q3map2(&name),
            growth: None,
            full: voxel.is_none(),
            seconds,
            voxel_seconds: of_stage(&report.seconds, Stage::Voxels),
            density: report.pvs_density,
            entries_per_cell: entries as f64 / report.cells.max(1) as f64,
            pvs_mb: pvs_bytes(&world.cells.pvs).map(|bytes| bytes as f64 / 1e6),
            pairs: by_volume.pairs + verified.by_cell.pairs,
            principal: verified.summary(),
            name,
        })
    }

    fn cpu_s(&self) -> f64 {
        self.cpu_seconds.iter().sum()
    }

    fn growth_since(&self, before: &Self) -> Option<f64> {
        let more = self.rooms? as f64 / before.rooms? as f64;
        (more > 1.0).then(|| (self.cpu_s() / before.cpu_s()).ln() / more.ln())
    }
}

fn verified(world: &World, args: &Args) -> anyhow::Result<verify::VerifyReport> {
    let mut options = verify::VerifyOptions::new(args.pairs);
    options.entries = args.entries;
    options.seed = args.seed;
    let report = verify::verify(world, &options, &|_, _| ())?;
    for PairCounts { ours: PvsTally { first_misses, .. }, .. } in
        [&report.by_volume, &report.by_cell]
    {
        first_misses.iter().for_each(|miss| eprintln!("miss: {} sees {}", miss.from, miss.to));
    }
    Ok(report)
}

fn of_stage(seconds: &[(Stage, f64)], stage: Stage) -> f64 {
    seconds.iter().filter(|(of, _)| *of == stage).map(|(_, seconds)| seconds).sum()
}

fn q3map2(map: &str) -> Option<[f64; 2]> {
    let (_, portals, seconds) = Q3MAP2.iter().find(|(name, ..)| *name == map)?;
    Some([*seconds, seconds * 1e3 / f64::from(*portals)])
}

/// The approximate size of a PVS in memory, and in a world file, which stores each pair once.
fn pvs_bytes(pvs: &Pvs) -> [u64; 2] {
    let (mut memory, mut file) = (0, 0);
    for (cell, row) in (0..).zip(pvs) {
        let of = row.statistics();
        let values = 2 * u64::from(of.n_values_array_containers)
            + 8_192 * u64::from(of.n_bitset_containers)
            + of.n_bytes_run_containers;
        // The row itself, and the header of each container.
        memory += 24 + 48 * u64::from(of.n_containers) + values;
        let mut half = row.clone();
        half.remove_range(..cell);
        half.optimize();
        file += half.serialized_size() as u64;
    }
    [memory, file]
}

fn report(rows: &[WorldRow], args: &Args) -> String {
    let mut text = String::from("\nCPU seconds of all threads; ms are of all three stages.\n");
    let names = "|spaces|gates|cells|portals|carving s|cells s|PVS s|together s|ms/portal|/0.79|\
                 ms/gate|growth|q3map2 s|its ms/portal";
    let costs = rows.iter().map(|row| {
        let [carving, cells, pvs] = row.cpu_seconds;
        let mut line = vec![row.name.clone()];
        line.extend([row.spaces, row.gates, row.cells, row.portals].map(|n| n.to_string()));
        line.extend([carving, cells, pvs, row.cpu_s()].map(|s| format!("{s:.2}")));
        line.push(format!("{:.3}", row.portal_ms));
        line.push(format!("{:.2}", row.portal_ms / Q3MAP2_MEDIAN_MS));
        line.push(format!("{:.3}", row.gate_ms));
        line.push(number(row.growth, 2));
        line.push(number(row.q3map2.map(|[seconds, _]| seconds), 2));
        line.push(number(row.q3map2.map(|[_, ms]| ms), 3));
        line
    });
    put_table(&mut text, names, costs.collect());
    let names = "|density %|entries/cell|PVS MB|in file MB|pairs|misses|over-send|own misses|\
                 own over-send|loose %|own loose %|whole s (wall)|of it voxels";
    let yields = rows.iter().map(|row| {
        let percent = |share: Option<f64>| number(share.map(|share| share * 100.0), 2);
        let [memory, file] = row.pvs_mb;
        let full = if row.full { " full" } else { "" };
        vec![
            row.name.clone(),
            format!("{:.1}", row.density * 100.0),
            format!("{:.0}", row.entries_per_cell),
            format!("{memory:.2}"),
            format!("{file:.2}"),
            row.pairs.to_string(),
            row.principal.misses.to_string(),
            number(row.principal.over_send, 3),
            row.principal.own_misses.map_or("-".into(), |misses| misses.to_string()),
            number(row.principal.own_over_send, 3),
            percent(row.principal.looseness),
            percent(row.principal.own_looseness),
            format!("{:.1}{full}", row.seconds),
            format!("{:.1}{full}", row.voxel_seconds),
        ]
    });
    put_table(&mut text, names, yields.collect());
    let voxel = args.voxel;
    let _ = writeln!(
        text,
        "growth: the exponent of CPU against rooms; 1 is linear. own: the map's vis lump. full: \
         default voxels; else of {voxel} m.\nq3map2: full vis, one thread, as measured on an AMD \
         EPYC; 0.79 ms a portal is its median over 33 maps."
    );
    text
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".into(), |value| format!("{value:.digits$}"))
}

/// Appends rows under column names separated by bars. The first column is left-aligned.
fn put_table(text: &mut String, names: &str, rows: Vec<Vec<String>>) {
    let mut lines = vec![names.split('|').map(str::to_owned).collect::<Vec<_>>()];
    lines.extend(rows);
    let width = |column: usize| lines.iter().map(|line| line[column].len()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..lines[0].len()).map(width).collect();
    text.push('\n');
    for line in &lines {
        let _ = write!(text, "{:<1$}", line[0], widths[0]);
        for (cell, width) in line.iter().zip(&widths).skip(1) {
            let _ = write!(text, "  {cell:>width$}");
        }
        text.push('\n');
    }
}
