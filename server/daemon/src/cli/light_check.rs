//! The command `sightline-server light-check`.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use glam::Vec3;
use serde::Serialize;
use sightline_cli::{
    exit::Interrupted, files::check_output, flags::point, output, progress::Progress,
};
use sightline_compiler::{
    LightFigures, LightQuality, import,
    light_check::{CheckView, LightCheck},
    model::Model,
};
use sightline_picture::Picture;

use super::{interrupt::Interrupt, model_flags::light_quality};

/// The most pixels of a picture, across and down.
const SIZE_MAX: u32 = 4_096;
/// A view that follows from a spawn point looks at a point this far away, in metres.
const AHEAD_M: f32 = 4.0;

/// Compares the light of `compile --light radiosity` with a reference.
///
/// The reference follows many random paths of light from each pixel. The picture has radiosity on
/// the left and the reference on the right; both show the original triangles.
/// Example: `sightline-server light-check house.glb --samples 256 -o check.png`.
#[derive(clap::Args)]
pub struct LightCheckArgs {
    /// The building: a .glb or .gltf file.
    input: PathBuf,
    /// The picture to write. With several views, their numbers go before the ending.
    #[arg(short, long, value_name = "OUT.png")]
    output: PathBuf,
    /// The position of the eye, in metres; when absent, the model's spawn points.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "look")]
    eye: Option<Vec3>,
    /// A point to look at, in metres.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "eye")]
    look: Option<Vec3>,
    /// How many spawn points to look from.
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "eye")]
    views: usize,
    /// The number of paths from each pixel: 1 to 100000.
    #[arg(long, value_name = "N", default_value_t = 64)]
    samples: usize,
    /// Pixels across and down each picture.
    #[arg(long, value_name = "N", default_value_t = 240)]
    size: u32,
    /// The edge of a voxel that the light is for, in metres.
    #[arg(long, value_name = "METRES", default_value_t = 0.06)]
    voxel: f32,
    /// How much time radiosity takes: fast, good or best.
    #[arg(long, value_name = "QUALITY", default_value = "good", value_parser = light_quality)]
    light_quality: LightQuality,
    /// Turn the sun and the sky off.
    #[arg(long)]
    no_sky: bool,
    /// Also write the figures to this file, as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Serialize)]
struct CheckFigures {
    light: LightFigures,
    views: Vec<ViewFigures>,
    /// The ratio of the means of all views.
    ratio: f64,
}

#[derive(Serialize)]
struct ViewFigures {
    radiosity: f64,
    reference: f64,
    difference: f64,
}

/// Runs the command.
pub fn run(args: &LightCheckArgs) -> anyhow::Result<()> {
    ensure!((1..=100_000).contains(&args.samples), "--samples must be between 1 and 100000");
    ensure!((8..=SIZE_MAX).contains(&args.size), "--size must be between 8 and {SIZE_MAX}");
    ensure!((0.001..=10.0).contains(&args.voxel), "--voxel must be between 0.001 and 10");
    check_output(&args.output)?;
    args.json.as_deref().map_or(Ok(()), check_output)?;
    let interrupt = Interrupt::listen()?;
    let mut model = import::read(&args.input, &[])?;
    model.has_sky &= !args.no_sky;
    let views = views(args, &model)?;
    let progress = Progress::new();
    let check = LightCheck::new(&model, args.voxel, args.light_quality, &|share| {
        progress.show("light", share);
        interrupt.flow()
    });
    let check = check.ok_or(Interrupted)?;
    let mut figures = Vec::new();
    for (number, view) in views.iter().enumerate() {
        progress.show("paths", number as f32 / views.len() as f32);
        if interrupt.flow().is_break() {
            return Err(Interrupted.into());
        }
        let found = check.view(view, args.samples);
        let path = numbered(&args.output, number, views.len());
        side_by_side(&found.radiosity, &found.reference)
            .save(&path)
            .with_context(|| format!("cannot write {}", path.display()))?;
        let [radiosity, reference] = found.means;
        figures.push(ViewFigures { radiosity, reference, difference: found.difference });
    }
    progress.finish();
    let sum = |of: fn(&ViewFigures) -> f64| figures.iter().map(of).sum::<f64>();
    let ratio = sum(|view| view.radiosity) / sum(|view| view.reference).max(f64::MIN_POSITIVE);
    for (name, value) in super::light_rows(&check.figures()) {
        output::print(&format!("{name:<20} {value:>12}\n"))?;
    }
    output::print("view  radiosity  reference  difference\n")?;
    for (number, ViewFigures { radiosity, reference, difference }) in figures.iter().enumerate() {
        let difference = difference * 100.0;
        let row = format!("{number:>4}  {radiosity:>9.4}  {reference:>9.4}  {difference:>8.1} %\n");
        output::print(&row)?;
    }
    output::print(&format!("all views: radiosity is {:.1} % of the reference\n", ratio * 100.0))?;
    let figures = CheckFigures { light: check.figures(), views: figures, ratio };
    output::write_json(args.json.as_deref(), &figures)
}

fn views(args: &LightCheckArgs, model: &Model) -> anyhow::Result<Vec<CheckView>> {
    let size = [args.size, args.size];
    if let (Some(eye), Some(look)) = (args.eye, args.look) {
        return Ok(vec![CheckView { eye, look, size }]);
    }
    if model.spawns.is_empty() {
        bail!("the model has no spawn points: give --eye and --look");
    }
    let from = model.spawns.iter().take(args.views.max(1)).map(|spawn| {
        let ahead = Vec3::new(-spawn.yaw.sin(), -0.15, -spawn.yaw.cos());
        CheckView { eye: spawn.eye, look: spawn.eye + ahead * AHEAD_M, size }
    });
    Ok(from.collect())
}

fn side_by_side(left: &Picture, right: &Picture) -> Picture {
    let mut both =
        Picture::filled(left.width() + right.width(), left.height().max(right.height()), [0; 3]);
    both.paste(left, 0, 0);
    both.paste(right, left.width(), 0);
    both
}

fn numbered(path: &Path, number: usize, of: usize) -> PathBuf {
    if of == 1 {
        return path.to_owned();
    }
    path.with_extension(format!("{number}.png"))
}
