//! The command `sightline-server compile`.

use std::{fmt::Write, path::PathBuf};

use anyhow::Context;
use serde::Serialize;
use sightline_cli::{exit::Interrupted, files::check_output, output, progress::Progress};
use sightline_compiler::{
    CompileError, CompileReport, compile,
    plan::{self, Overlay},
    rooms::{RoomErrors, text::FileError},
    verdict::Verdict,
};
use sightline_server::building_files::SourceError;
use sightline_world::{World, write_whole};

use super::{interrupt::Interrupt, model_flags::ModelFlags};

/// Compiles a building (.glb, .gltf or a Quake III .bsp) into a world (.slw).
///
/// The world holds what clients draw, and which parts of the building can be seen from which.
/// Beside it a picture shows which walls hide people.
/// Example: `sightline-server compile house.glb -o house.slw`.
#[derive(clap::Args)]
pub struct CompileArgs {
    /// The building: a .glb, .gltf or .bsp file.
    input: PathBuf,
    /// The world file to write.
    #[arg(short, long, value_name = "OUT.slw")]
    output: PathBuf,
    #[command(flatten)]
    model: ModelFlags,
    /// Also write the figures of the table to this file, as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &CompileArgs) -> anyhow::Result<()> {
    let interrupt = Interrupt::listen()?;
    check_output(&args.output)?;
    let picture = args.output.with_extension("plan.png");
    check_output(&picture)?;
    args.json.as_deref().map_or(Ok(()), check_output)?;
    let model = match args.model.files(&args.input).read() {
        Err(SourceError::Rooms(FileError::RoomErrors(errors))) => {
            return Err(report_errors(errors));
        }
        other => other?,
    };
    for warning in &model.warnings {
        output::note(&format!("warning: {warning}"));
    }
    let options = args.model.options();
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
    // These steps do not look for an interruption; it ends the program while none is written.
    let progress = Progress::new();
    progress.show("verdict", 0.0);
    let verdict = Verdict::new(&model, &world);
    let plan = plan::draw(&world, &overlay(&world, &verdict)).to_png()?;
    let bytes = world.to_bytes();
    progress.finish();
    // Until the end: a stop after this line must not deny a world that is written.
    let _writing = interrupt.hold_off();
    if interrupt.flow().is_break() {
        return Err(Interrupted.into());
    }
    write_whole(&args.output, &bytes)
        .with_context(|| format!("cannot write {}", args.output.display()))?;
    write_whole(&picture, &plan).with_context(|| format!("cannot write {}", picture.display()))?;
    output::print(&table(&report))?;
    output::print(&said(&verdict))?;
    let [world, picture] = [&args.output, &picture].map(|path| path.display().to_string());
    output::print(&format!(
        "\nwhich walls hide people: {picture}\nnext: sightline-server serve {world}\n"
    ))?;
    output::write_json(args.json.as_deref(), &CompileFigures { report: &report, verdict: &verdict })
}

#[derive(Serialize)]
struct CompileFigures<'a> {
    #[serde(flatten)]
    report: &'a CompileReport,
    verdict: &'a Verdict,
}

/// The verdict as a paragraph.
fn said(verdict: &Verdict) -> String {
    verdict.sentences().iter().map(|sentence| format!("\n* {sentence}.")).collect::<String>() + "\n"
}

/// The plan of a world with its walls, by whether they hide people.
fn overlay(world: &World, verdict: &Verdict) -> Overlay {
    let (marks, legend) = super::spawn_marks(world);
    Overlay {
        marks,
        legend: Some(legend),
        walls: verdict.walls.clone(),
        rooms: true,
        grid: true,
        ..Overlay::default()
    }
}

/// Prints all errors but the last, which becomes the command's error.
fn report_errors(RoomErrors(mut errors): RoomErrors) -> anyhow::Error {
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
    if let Some(light) = &report.light {
        for (name, value) in super::light_rows(light) {
            row(name, value);
        }
    }
    for &(stage, seconds) in &report.seconds {
        let cpu = report.cpu_seconds.iter().find(|(known, _)| *known == stage);
        let cpu = cpu.map(|(_, seconds)| format!(" ({seconds:.2} s CPU)")).unwrap_or_default();
        row(stage.name(), format!("{seconds:.2} s{cpu}"));
    }
    table
}
