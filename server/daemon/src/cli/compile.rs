//! The command `sightline-server compile`.

use std::{fmt::Write, path::PathBuf};

use anyhow::Context;
use sightline_cli::{exit::Interrupted, flags::spawn, output, progress::Progress};
use sightline_compiler::{
    CompileError, CompileOptions, CompileReport,
    carve::{self, CarvingUnits},
    compile,
    import::{
        self,
        glb::{Placing, UpAxis},
    },
    rooms::{self, text},
};
use sightline_world::{Spawn, write_whole};

use super::interrupt::Interrupt;

/// Compiles a building (.glb, .gltf or a Quake III .bsp) into a world (.slw).
///
/// The world holds what clients draw, and which parts of the building can be seen from which.
/// Example: `sightline-server compile house.glb -o house.slw`.
#[derive(clap::Args)]
pub struct CompileArgs {
    /// The building: a .glb, .gltf or .bsp file.
    input: PathBuf,
    /// The world file to write.
    #[arg(short, long, value_name = "OUT.slw")]
    output: PathBuf,
    /// The greatest width of a cell, in metres: 0.25 to 1000. By default the compiler chooses it.
    /// Narrower cells tell more exactly who sees whom, but compiling takes longer.
    #[arg(long, value_name = "METRES", value_parser = cell_size)]
    cell: Option<f32>,
    /// The edge of a voxel, in metres: 0.001 to 10. By default it depends on the building's size.
    #[arg(long, value_name = "METRES", value_parser = voxel_size)]
    voxel: Option<f32>,
    /// What is carved at a time: clusters of non-axial polygons, or elements, which are smaller.
    #[arg(long, value_name = "UNITS", default_value = "clusters", value_parser = carving_units)]
    carving_units: CarvingUnits,
    /// An archive with the textures of a Quake III map; may be given several times.
    #[arg(long, value_name = "FILE.pk3")]
    pk3: Vec<PathBuf>,
    /// A TOML file with rooms and windows. By default the file beside the building that has its name
    /// and the ending .rooms.toml, if there is one.
    #[arg(long, value_name = "R.toml")]
    rooms: Option<PathBuf>,
    /// How many metres one unit of the model is, such as 0.001 for millimetres; by default 1. A model
    /// larger than 5 km needs this flag.
    #[arg(long, value_name = "METRES", value_parser = scale)]
    scale: Option<f64>,
    /// The axis of the model that points up: y, as glTF has it, or z.
    #[arg(long, value_name = "AXIS", default_value = "y", value_parser = up_axis)]
    up: UpAxis,
    /// Move the middle of the model's ground to the origin. A model that is too far away for exact
    /// coordinates is moved anyway.
    #[arg(long)]
    recentre: bool,
    /// Where visitors begin, in place of what the building says: the eye in metres and the heading in
    /// degrees, anticlockwise from -z; may be given several times. Without any, places are found.
    #[arg(long, value_name = "X,Y,Z[,YAW]", value_parser = spawn, allow_hyphen_values = true)]
    spawn: Vec<Spawn>,
    /// Also write the figures of the table to this file, as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn scale(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(scale) if (1e-6..=1e6).contains(&scale) => Ok(scale),
        _ => Err("a unit is from 0.000001 to 1000000 metres, such as 0.001".into()),
    }
}

fn up_axis(text: &str) -> Result<UpAxis, String> {
    match text {
        "y" => Ok(UpAxis::Y),
        "z" => Ok(UpAxis::Z),
        _ => Err("use y or z".into()),
    }
}

fn cell_size(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(edge) if (0.25..=1_000.0).contains(&edge) => Ok(edge),
        _ => Err("a cell is from 0.25 to 1000 metres wide, such as 4".into()),
    }
}

fn voxel_size(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(metres) if (0.001..=10.0).contains(&metres) => Ok(metres),
        _ => Err("a voxel is from 0.001 to 10 metres wide, such as 0.03".into()),
    }
}

fn carving_units(text: &str) -> Result<CarvingUnits, String> {
    match text {
        "clusters" => Ok(CarvingUnits::Clusters),
        "elements" => Ok(CarvingUnits::Elements),
        _ => Err("use clusters or elements".into()),
    }
}

/// Runs the command.
pub fn run(args: &CompileArgs) -> anyhow::Result<()> {
    let interrupt = Interrupt::listen()?;
    let placing = Placing { scale: args.scale, up: args.up, recentre: args.recentre };
    let mut model = import::read_placed(&args.input, &args.pk3, &placing)?;
    let beside = args.input.with_extension("rooms.toml");
    if let Some(path) = args.rooms.as_ref().or(Some(&beside).filter(|path| path.is_file())) {
        model.rooms.extend(declared_rooms(text::read_file(path))?);
    }
    if !args.spawn.is_empty() {
        model.spawns = args.spawn.clone();
        model.rooms.iter_mut().for_each(|room| room.spawn = None);
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
        Err(CompileError::Rooms(errors)) => return Err(report_errors(errors)),
        other => other.with_context(|| args.input.display().to_string())?,
    };
    for warning in &report.warnings {
        output::note(&format!("warning: {warning}"));
    }
    for warning in &report.room_warnings {
        output::note(&format!("warning: {warning}"));
    }
    let bytes = world.to_bytes();
    // Until the end: a stop after this line must not deny a world that is written.
    let _writing = interrupt.hold_off();
    if interrupt.flow().is_break() {
        return Err(Interrupted.into());
    }
    write_whole(&args.output, &bytes)
        .with_context(|| format!("cannot write {}", args.output.display()))?;
    output::print(&table(&report))?;
    output::write_json(args.json.as_deref(), &report)
}

/// The rooms of a file. Each of its errors but the last is printed; the last one is returned.
fn declared_rooms(
    read: Result<Vec<rooms::RoomDeclaration>, text::FileError>,
) -> anyhow::Result<Vec<rooms::RoomDeclaration>> {
    match read {
        Err(text::FileError::RoomErrors(errors)) => Err(report_errors(errors)),
        other => Ok(other?),
    }
}

/// Prints all errors but the last, which becomes the command's error.
fn report_errors(rooms::RoomErrors(mut errors): rooms::RoomErrors) -> anyhow::Error {
    let last = errors.pop();
    for error in &errors {
        output::note(&format!("error: {error}"));
    }
    last.map_or_else(|| anyhow::anyhow!("the rooms have errors"), anyhow::Error::new)
}

fn table(report: &CompileReport) -> String {
    let mut table = String::new();
    let mut row = |name: &str, value: String| {
        let _ = writeln!(table, "{name:<20} {value:>12}");
    };
    let [x, y, z] = report.size_m;
    row("size", format!("{x:.1} x {y:.1} x {z:.1} m"));
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
    row("spawn points", report.spawns.to_string());
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
