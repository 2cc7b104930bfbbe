//! The flags of `compile` and `serve` about a model.

use std::path::{Path, PathBuf};

use sightline_cli::flags::spawn;
use sightline_compiler::{
    CompileOptions, LightMethod, LightQuality,
    carve::{CarveOptions, CarvingUnits},
    import::{
        LeftOut,
        glb::{Placing, UpAxis},
    },
};
use sightline_server::building_files::BuildingFiles;
use sightline_world::Spawn;

/// How a model becomes a world.
#[derive(clap::Args)]
pub struct ModelFlags {
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
    /// How a model that brings no light of its own is lit: by radiosity, where surfaces pass light
    /// on to each other; by ambient light, which is quick; or none.
    #[arg(long, value_name = "METHOD", default_value = "radiosity", value_parser = light_method)]
    light: LightMethod,
    /// How much time radiosity takes: fast, good or best.
    #[arg(long, value_name = "QUALITY", default_value = "fast", value_parser = light_quality)]
    light_quality: LightQuality,
    /// Light a Quake III map anew, in place of the light that it brings.
    #[arg(long)]
    relight: bool,
    /// An archive with the textures of a Quake III map; may be given several times.
    #[arg(long, value_name = "FILE.pk3")]
    pk3: Vec<PathBuf>,
    /// A TOML file with rooms and windows. By default the file beside the building that has its
    /// name and the ending .rooms.toml, if there is one.
    #[arg(long, value_name = "R.toml")]
    rooms: Option<PathBuf>,
    /// How many metres one unit of the model is, such as 0.001 for millimetres; by default 1. A
    /// model larger than 5 km needs this flag.
    #[arg(long, value_name = "METRES", value_parser = scale)]
    scale: Option<f64>,
    /// The axis of the model that points up: y, as glTF has it, or z.
    #[arg(long, value_name = "AXIS", default_value = "y", value_parser = up_axis)]
    up: UpAxis,
    /// Move the middle of the model's ground to the origin. A model that is too far away for exact
    /// coordinates is moved anyway.
    #[arg(long)]
    recentre: bool,
    /// Where visitors begin, in place of what the building says: the eye in metres and the heading
    /// in degrees, anticlockwise from -z; may be given several times. Without any, places are
    /// found.
    #[arg(long, value_name = "X,Y,Z[,YAW]", value_parser = spawn, allow_hyphen_values = true)]
    spawn: Vec<Spawn>,
    /// Leave out nodes of this name, with all below them; may be given several times. * stands for
    /// any letters and ? for one, as in 'Sky*'.
    #[arg(long, value_name = "PATTERN")]
    drop: Vec<String>,
    /// Take doors of this name for open: they are neither drawn nor in anybody's way. May be given
    /// several times, with * and ?, as in '*Door*'.
    #[arg(long, value_name = "PATTERN")]
    open_doors: Vec<String>,
}

impl ModelFlags {
    /// What a model on disk is compiled from.
    pub fn files(&self, model: &Path) -> BuildingFiles {
        BuildingFiles {
            model: model.to_owned(),
            pk3: self.pk3.clone(),
            rooms: self.rooms.clone(),
            placing: Placing { scale: self.scale, up: self.up, recentre: self.recentre },
            left_out: LeftOut { dropped: self.drop.clone(), open_doors: self.open_doors.clone() },
            spawns: self.spawn.clone(),
            relight: self.relight,
        }
    }

    /// How a model is compiled.
    pub fn options(&self) -> CompileOptions {
        let carving = CarveOptions { units: self.carving_units };
        CompileOptions {
            voxel: self.voxel,
            cell: self.cell,
            carving,
            light: self.light,
            light_quality: self.light_quality,
            ..CompileOptions::default()
        }
    }

    /// Whether any of the flags was given, as far as it makes a difference.
    pub fn are_given(&self) -> bool {
        let files = self.files(Path::new(""));
        let has_files = !files.pk3.is_empty() || files.rooms.is_some() || !files.spawns.is_empty();
        let has_sizes = self.cell.is_some() || self.voxel.is_some();
        let is_carved_otherwise = self.carving_units != CarveOptions::default().units;
        let is_placed = files.placing != Placing::default();
        let is_whole = files.left_out == LeftOut::default();
        let options = self.options();
        let default = CompileOptions::default();
        let is_lit_otherwise = files.relight
            || options.light != LightMethod::Radiosity
            || options.light_quality != default.light_quality;
        has_files || has_sizes || is_carved_otherwise || is_placed || !is_whole || is_lit_otherwise
    }
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

fn light_method(text: &str) -> Result<LightMethod, String> {
    match text {
        "radiosity" => Ok(LightMethod::Radiosity),
        "ambient" => Ok(LightMethod::Ambient),
        "none" => Ok(LightMethod::None),
        _ => Err("use radiosity, ambient or none".into()),
    }
}

/// Reads the name of a quality of light.
pub fn light_quality(text: &str) -> Result<LightQuality, String> {
    match text {
        "fast" => Ok(LightQuality::Fast),
        "good" => Ok(LightQuality::Good),
        "best" => Ok(LightQuality::Best),
        _ => Err("use fast, good or best".into()),
    }
}

fn carving_units(text: &str) -> Result<CarvingUnits, String> {
    match text {
        "clusters" => Ok(CarvingUnits::Clusters),
        "elements" => Ok(CarvingUnits::Elements),
        _ => Err("use clusters or elements".into()),
    }
}
