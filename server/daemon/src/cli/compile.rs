//! `sightline-server compile`.

use std::{fmt::Write, path::PathBuf};

use anyhow::Context;
use sightline_cli::{exit::Interrupted, output, progress::Progress};
use sightline_compiler::{
    CompileError, CompileOptions, CompileReport,
    carve::{self, CarvingUnits},
    compile, import,
    rooms::{self, text},
};
use sightline_world::write_whole;

use super::interrupt::Interrupt;

/// Makes a world (.slw) of a building (.glb, .gltf or a Quake III .bsp).
#[derive(clap::Args)]
pub struct Args {
    /// The building.
    input: PathBuf,
    /// The world to write.
    #[arg(short, long, value_name = "OUT.slw")]
    output: PathBuf,
    /// The width of the widest cell, in metres; by default chosen by how much there is to see.
    /// Narrower cells tell more exactly who sees whom, and take longer.
    #[arg(long, value_name = "METRES", value_parser = cell_size)]
    cell: Option<f32>,
    /// The edge of a voxel, in metres; by default chosen by the building's size.
    #[arg(long, value_name = "METRES", value_parser = voxel_size)]
    voxel: Option<f32>,
    /// What is carved at a time: clusters of non-axial polygons, or elements, which are smaller.
    #[arg(long, value_name = "UNITS", default_value = "clusters", value_parser = carving_units)]
    carving_units: CarvingUnits,
    /// An archive with the textures of a Quake III map; may be given several times.
    #[arg(long, value_name = "FILE.pk3")]
    pk3: Vec<PathBuf>,
    /// A file with rooms (TOML); by default the one beside the model that has its name and ends in .rooms.toml,
    /// if there is one.
    #[arg(long, value_name = "R.toml")]
    rooms: Option<PathBuf>,
    /// Write the figures of the closing table to this file too.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn cell_size(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(edge) if (0.25..=1_000.0).contains(&edge) => Ok(edge),
        _ => Err("a cell is between 0.25 and 1000 metres wide".into()),
    }
}

fn voxel_size(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(metres) if (0.001..=10.0).contains(&metres) => Ok(metres),
        _ => Err("a length from 0.001 to 10 metres, such as 0.03".into()),
    }
}

fn carving_units(text: &str) -> Result<CarvingUnits, String> {
    match text {
        "clusters" => Ok(CarvingUnits::Clusters),
        "elements" => Ok(CarvingUnits::Elements),
        _ => Err("clusters or elements".into()),
    }
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let interrupt = Interrupt::listen()?;
    let mut model = import::read(&args.input, &args.pk3)?;
    let beside = args.input.with_extension("rooms.toml");
    if let Some(path) = args.rooms.as_ref().or(Some(&beside).filter(|path| path.is_file())) {
        model.rooms.extend(told(text::read_file(path))?);
    }
    for warning in &model.warnings {
        output::note(&format!("warning: {warning}"));
    }
    let options = CompileOptions {
        voxel: args.voxel,
        cell: args.cell,
        carving: carve::CarveOptions { units: args.carving_units },
    };
    let progress = Progress::new();
    let outcome = compile(&model, &options, &|stage, share| {
        progress.show(stage.name(), share);
        interrupt.flow()
    });
    progress.finish();
    let (world, report) = match outcome {
        Err(CompileError::Cancelled) => return Err(Interrupted.into()),
        Err(CompileError::Rooms(faults)) => return Err(tell(faults)),
        other => other.with_context(|| args.input.display().to_string())?,
    };
    for warning in &report.room_warnings {
        output::note(&format!("warning: {warning}"));
    }
    let bytes = world.to_bytes();
    let writing = interrupt.hold_off();
    if interrupt.flow().is_break() {
        return Err(Interrupted.into());
    }
    write_whole(&args.output, &bytes)
        .with_context(|| format!("cannot write {}", args.output.display()))?;
    drop(writing);
    output::print(&table(&report))?;
    output::write_json(args.json.as_deref(), &report)
}

/// The rooms of a file, or each of its faults on a line of its own, and an error.
fn told(
    read: Result<Vec<rooms::RoomDeclaration>, text::FileError>,
) -> anyhow::Result<Vec<rooms::RoomDeclaration>> {
    match read {
        Err(text::FileError::RoomErrors(faults)) => Err(tell(faults)),
        other => Ok(other?),
    }
}

/// All faults but the last are told here: that one is the error.
fn tell(rooms::RoomErrors(mut faults): rooms::RoomErrors) -> anyhow::Error {
    let last = faults.pop();
    for fault in &faults {
        output::note(&format!("error: {fault}"));
    }
    last.map_or_else(|| anyhow::anyhow!("the rooms are faulty"), anyhow::Error::new)
}

fn table(report: &CompileReport) -> String {
    let mut table = String::new();
    let mut row = |name: &str, value: String| {
        let _ = writeln!(table, "{name:<20} {value:>12}");
    };
    row("triangles", report.triangles.to_string());
    row("opaque triangles", report.opaque.to_string());
    row("turned by", format!("{:.2} degrees", report.turn.to_degrees()));
    for (name, value) in super::carving_rows(&report.carving) {
        row(name, value);
    }
    row("spaces", report.spaces.to_string());
    row("gates", report.gates.to_string());
    row("cells", report.cells.to_string());
    row("portals", report.portals.to_string());
    row("PVS density", format!("{:.1} %", report.pvs_density * 100.0));
    row("movers", report.movers.to_string());
    row("rooms", report.rooms.to_string());
    row("windows", report.windows.to_string());
    for (name, value) in super::octree_rows(&report.octree) {
        row(name, value);
    }
    for &(stage, seconds) in &report.seconds {
        let cpu = report.cpu_seconds.iter().find(|(known, _)| *known == stage);
        let cpu = cpu.map(|(_, seconds)| format!(" ({seconds:.2} s CPU)")).unwrap_or_default();
        row(stage.name(), format!("{seconds:.2} s{cpu}"));
    }
    table
}
