//! The command `sightline-server inspect`.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use anyhow::Context;
use glam::Vec3;
use serde::Serialize;
use sightline_cli::{
    exit::Interrupted,
    files::{check_output, world_bytes},
    flags::point,
    output,
    progress::Progress,
};
use sightline_compiler::{
    carve::CarveReport,
    carve_preview::{self, View},
    octree_statistics::{self, OctreeStatistics},
    plan::{self, Overlay},
    suggest, verify,
};
use sightline_world::{
    Mover, Spawn, World, content_id, motion::trajectory::Playback, rooms::Room, write_whole,
};

use super::{
    inspect_report::{self, TableRow},
    interrupt::Interrupt,
    pieces_figures::PiecesFigures,
    printable,
    verification::VerificationFigures,
};

/// How many movers the table lists; the JSON file has all.
const MOVERS_SHOWN: usize = 40;

/// How many spawn points the table lists; the JSON file has all.
const SPAWNS_SHOWN: usize = 40;

/// How many rooms the table lists; the JSON file has all.
const ROOMS_SHOWN: usize = 40;

/// Shows what is in a world, draws its plan, and verifies its PVS.
///
/// Example: `sightline-server inspect house.slw --map house.png --pvs-from 2,1.6,3`.
#[derive(clap::Args)]
pub struct InspectArgs {
    /// The world file (.slw).
    world: PathBuf,
    /// Draw each storey from above, with coordinates, cells, portals, rooms,
    /// windows and numbered spawn points.
    #[arg(long, value_name = "OUT.png")]
    map: Option<PathBuf>,
    /// Write the plan, a view from each spawn point and all tables into one page.
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
    /// Beside each storey of the map, draw how much of the building each cell may see.
    #[arg(long, requires = "map")]
    density: bool,
    /// On the map, show in grey what cannot be visible from this point.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, requires = "map",
          allow_hyphen_values = true)]
    pvs_from: Option<Vec3>,
    /// Draw the carved model twice: with its cuttings, and without them.
    #[arg(long, value_name = "OUT.png")]
    carved: Option<PathBuf>,
    /// The eye of the carved picture; by default the first spawn point.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, requires = "carved",
          allow_hyphen_values = true)]
    eye: Option<Vec3>,
    /// The point that the carved picture looks at; by default straight ahead.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, requires = "carved",
          allow_hyphen_values = true)]
    look: Option<Vec3>,
    /// Suggest rooms and windows, as TOML, in this file; without a file, on stdout in place of the
    /// table. Edit the file and give it to `compile --rooms`.
    #[arg(long, value_name = "R.toml", num_args = 0..=1, default_missing_value = "-")]
    suggest_rooms: Option<PathBuf>,
    /// Compare the PVS with rays between N random pairs of points by volume, and N by cell. Exits
    /// with 1 when a visible pair is missing from the PVS.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000))]
    verify: Option<u64>,
    /// The seed of the random pairs; the same seed verifies the same pairs.
    #[arg(long, default_value_t = 1, requires = "verify")]
    seed: u64,
    /// How many entries of the PVS to test for looseness: whether any line can be found for them.
    #[arg(long, value_name = "N", default_value_t = 2_000, requires = "verify",
          value_parser = clap::value_parser!(u32).range(..=10_000_000))]
    entries: u32,
    /// How many random lines to try before an entry counts as loose.
    #[arg(long, value_name = "N", default_value_t = 100_000, requires = "verify",
          value_parser = clap::value_parser!(u32).range(1..))]
    lines: u32,
    /// Also test loose entries by fuzzy projection, which proves some of them closed.
    #[arg(long, requires = "verify")]
    fuzzy: bool,
    /// Cut the world into pieces, as clients fetch it, and measure what may be seen from where.
    #[arg(long)]
    pieces: bool,
    /// Also write the figures to this file, as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Serialize)]
struct InspectFigures {
    title: String,
    content_id: String,
    bytes: usize,
    size_m: [f32; 3],
    cells: usize,
    portals: usize,
    pvs_density: f64,
    opaque_triangles: usize,
    movers: Vec<MoverFigures>,
    rooms: Vec<RoomFigures>,
    #[serde(flatten)]
    octree: OctreeStatistics,
    spawns: usize,
    spawn_points: Vec<SpawnFigures>,
    speed_max_m_s: f32,
    /// What carving does, with `--carved`.
    carving: Option<CarveReport>,
    /// With `--suggest-rooms`.
    suggested: Option<SuggestedFigures>,
    /// With `--pieces`.
    pieces: Option<PiecesFigures>,
    #[serde(flatten)]
    verified: Option<VerificationFigures>,
}

/// How much the building suggests.
#[derive(Serialize)]
struct SuggestedFigures {
    rooms: usize,
    windows: usize,
}

#[derive(Serialize)]
struct RoomFigures {
    name: String,
    title: String,
    windows: usize,
    sealed: bool,
    capacity: Option<u32>,
    tag: Option<String>,
}

impl RoomFigures {
    fn new(room: &Room) -> Self {
        Self {
            name: printable(&room.name),
            title: printable(room.title()),
            windows: room.windows.len(),
            sealed: room.sealed,
            capacity: room.capacity,
            tag: room.tag.as_deref().map(printable),
        }
    }
}

#[derive(Serialize)]
struct SpawnFigures {
    eye_m: [f32; 3],
    /// Anticlockwise from -z.
    yaw_degrees: f32,
}

impl SpawnFigures {
    fn new(spawn: &Spawn) -> Self {
        Self { eye_m: spawn.eye.to_array(), yaw_degrees: spawn.yaw.to_degrees() }
    }
}

#[derive(Serialize)]
struct MoverFigures {
    name: String,
    triangles: usize,
    course: &'static str,
    length_s: f32,
    /// The size of the box that it never leaves.
    everywhere_m: [f32; 3],
    /// The size of its box at the start.
    size_m: [f32; 3],
}

impl MoverFigures {
    fn new(mover: &Mover) -> Self {
        let course = match mover.trajectory.playback() {
            Playback::Loop => "for ever",
            Playback::Once => "once",
            Playback::Triggered => "when set off",
        };
        Self {
            name: printable(&mover.name),
            triangles: mover.colours().len(),
            course,
            length_s: mover.trajectory.length_s(),
            everywhere_m: mover.everywhere().size().to_array(),
            size_m: mover.swept(Duration::ZERO, Duration::ZERO).size().to_array(),
        }
    }
}

/// Runs the command.
pub fn run(args: &InspectArgs) -> anyhow::Result<()> {
    let named = || args.world.display().to_string();
    let rooms = args.suggest_rooms.as_deref().filter(|path| *path != Path::new("-"));
    let outputs = [&args.map, &args.report, &args.carved, &args.json].map(Option::as_deref);
    for file in outputs.into_iter().chain([rooms]).flatten() {
        check_output(file)?;
    }
    let bytes = world_bytes(&args.world)?;
    let world = World::from_bytes(&bytes).with_context(named)?;
    let suggested = args.suggest_rooms.as_ref().map(|_| suggested(&world)).transpose()?;
    let mut figures = InspectFigures {
        title: world.title.clone(),
        content_id: content_id(&bytes)?.to_string(),
        bytes: bytes.len(),
        size_m: size(&world).to_array(),
        cells: world.cells.cells.len(),
        portals: world.cells.portals.len(),
        pvs_density: world.cells.density(),
        opaque_triangles: world.mesh.triangles.len(),
        movers: world.movers.iter().map(MoverFigures::new).collect(),
        rooms: world.rooms.list().iter().map(RoomFigures::new).collect(),
        octree: OctreeStatistics::of(&world.octree),
        spawns: world.spawns.len(),
        spawn_points: world.spawns.iter().map(SpawnFigures::new).collect(),
        speed_max_m_s: world.speed_max,
        carving: None,
        suggested: None,
        pieces: None,
        verified: None,
    };
    let suggested = suggested.map(|(toml, counts)| {
        let SuggestedFigures { rooms, windows } = counts;
        output::note(&format!("suggested: {rooms} rooms and {windows} windows"));
        figures.suggested = Some(counts);
        toml
    });
    match (&args.suggest_rooms, &suggested) {
        (Some(path), Some(toml)) if path.as_os_str() == "-" => output::print(toml)?,
        (Some(path), Some(toml)) => {
            write_whole(path, toml.as_bytes())
                .with_context(|| format!("cannot write {}", path.display()))?;
            output::print(&as_text(&rows(&figures)))?;
        }
        _ => output::print(&as_text(&rows(&figures)))?,
    }
    if args.pieces {
        let pieces = PiecesFigures::of(&world).with_context(named)?;
        output::print(&pieces.table())?;
        figures.pieces = Some(pieces);
    }
    if let Some(path) = &args.map {
        let picture = plan::draw(&world, &overlay(&world, args));
        picture.save(path).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if let Some(path) = &args.carved {
        let (picture, carved) = carve_preview::draw(&world.mesh, &view(&world, args)?);
        let rows = super::carving_rows(&carved.report);
        let rows = rows.map(|(name, value)| format!("{name:<18} {value}\n"));
        output::print(&rows.concat())?;
        picture.save(path).with_context(|| format!("cannot write {}", path.display()))?;
        figures.carving = Some(carved.report);
    }
    if let Some(pairs) = args.verify {
        let InspectArgs { entries, lines, seed, fuzzy, .. } = *args;
        let options = verify::VerifyOptions { pairs, entries, lines, seed, fuzzy };
        let found = VerificationFigures::find(&world, &options).with_context(named)?;
        output::print(&found.table())?;
        figures.verified = Some(found);
    }
    if let Some(path) = &args.report {
        let verified = figures.verified.as_ref().map(VerificationFigures::table);
        let plan = plan::draw(&world, &overlay(&world, args));
        let page = inspect_report::page(&world, &plan, &rows(&figures), verified.as_deref())?;
        write_whole(path, page.as_bytes())
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    output::write_json(args.json.as_deref(), &figures)?;
    figures.verified.as_ref().map_or(Ok(()), VerificationFigures::verdict).with_context(named)
}

/// The size of what is drawn, without the margin in which eyes can be.
fn size(world: &World) -> Vec3 {
    let occupied = octree_statistics::occupied(&world.octree);
    if occupied.is_empty() { Vec3::ZERO } else { occupied.size() }
}

/// The rooms and windows that the building suggests, as TOML, and how many there are.
fn suggested(world: &World) -> anyhow::Result<(String, SuggestedFigures)> {
    let interrupt = Interrupt::listen()?;
    let progress = Progress::new();
    let rooms = suggest::suggest(world, &mut |share| {
        progress.show("rooms", share);
        interrupt.flow()
    });
    progress.finish();
    let rooms = rooms.ok_or(Interrupted)?;
    let windows = rooms.iter().map(|room| room.windows.len()).sum();
    let counts = SuggestedFigures { rooms: rooms.len(), windows };
    Ok((suggest::to_toml(world, &rooms), counts))
}

fn view(world: &World, args: &InspectArgs) -> anyhow::Result<View> {
    let spawn = world.spawns.first().context("the world has no spawn point: give --eye X,Y,Z")?;
    let eye = args.eye.unwrap_or(spawn.eye);
    let (sin, cos) = spawn.yaw.sin_cos();
    let look = args.look.unwrap_or(eye + Vec3::new(-sin, 0.0, -cos));
    Ok(View { eye, look })
}

fn overlay(world: &World, args: &InspectArgs) -> Overlay {
    let (mut marks, mut legend) = super::spawn_marks(world);
    if let Some(eye) = args.pvs_from {
        let mark = super::mark(eye, true);
        legend.push(("eye; what it cannot see is grey", mark.clone()));
        marks.push(mark);
    }
    Overlay {
        marks,
        visible: args.pvs_from.map(|eye| world.cells.visible_from_point(eye)),
        cells: true,
        rooms: true,
        grid: true,
        density: args.density,
        walls: Vec::new(),
        legend: Some(legend),
    }
}

fn as_text(rows: &[TableRow]) -> String {
    rows.iter().map(|(name, value)| format!("{name:<18} {value}\n")).collect()
}

fn rows(figures: &InspectFigures) -> Vec<TableRow> {
    let mut rows = Vec::new();
    let mut row = |name: &str, value: String| rows.push((name.to_owned(), value));
    let [x, y, z] = figures.size_m;
    row("title", printable(&figures.title));
    row("content id", figures.content_id.clone());
    row("bytes", figures.bytes.to_string());
    row("size", format!("{x:.1} x {y:.1} x {z:.1} m"));
    row("cells", figures.cells.to_string());
    row("portals", figures.portals.to_string());
    row("PVS density", format!("{:.1} %", figures.pvs_density * 100.0));
    row("opaque triangles", figures.opaque_triangles.to_string());
    for (name, value) in super::octree_rows(&figures.octree) {
        row(name, value);
    }
    row("movers", figures.movers.len().to_string());
    for mover in figures.movers.iter().take(MOVERS_SHOWN) {
        let [[x, y, z], [a, b, c]] = [mover.size_m, mover.everywhere_m];
        let MoverFigures { name, course, length_s, .. } = mover;
        let sizes = format!("{x:.1} x {y:.1} x {z:.1} m in {a:.1} x {b:.1} x {c:.1} m");
        row(&format!("  {name}"), format!("{sizes}, {course}, {length_s:.1} s"));
    }
    row("rooms", figures.rooms.len().to_string());
    for room in figures.rooms.iter().take(ROOMS_SHOWN) {
        let sealed = if room.sealed { ", sealed" } else { "" };
        let what = match room.windows {
            1 => format!("1 window{sealed}"),
            windows => format!("{windows} windows{sealed}"),
        };
        row(&format!("  {}", room.title), what);
    }
    row("spawn points", figures.spawns.to_string());
    for (number, spawn) in figures.spawn_points.iter().enumerate().take(SPAWNS_SHOWN) {
        let SpawnFigures { eye_m: [x, y, z], yaw_degrees } = spawn;
        row(
            &format!("  {number}"),
            format!("{x:.2},{y:.2},{z:.2} facing {yaw_degrees:.0} degrees"),
        );
    }
    row("speed limit", format!("{} m/s", figures.speed_max_m_s));
    rows
}
