//! Importers: each reads one format and makes a [`Model`].

pub mod bsp;
pub mod glb;
mod left_out;
mod limits;
mod movers;

use std::{
    ffi::OsStr,
    path::{Path, PathBuf},
};

use crate::model::Model;
use bsp::BspError;
use glb::{GlbError, Placing};
pub use left_out::LeftOut;
use limits::{read_file, title_of};

/// Why a building cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be read.
    #[error("cannot read {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The file is empty.
    #[error("{0} is empty: copy or export it again")]
    Empty(PathBuf),
    /// The format is unknown.
    #[error("{0} is neither GLB, glTF nor a Quake III BSP: export it as GLB")]
    Format(PathBuf),
    /// The format is known, and is not read.
    #[error("{path} is {format}, which is not read: `{command}` converts it")]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Its format.
        format: &'static str,
        /// The command that converts it.
        command: String,
    },
    /// The file is a world.
    #[error("{0} is a world, which is compiled already: `sightline-server serve {0}` serves it")]
    World(PathBuf),
    /// A Quake map was to be placed.
    #[error(
        "{0} is a Quake III BSP, which tells its own unit: leave out --scale, --up and --recentre"
    )]
    Placing(PathBuf),
    /// Parts of a Quake map were to be left out.
    #[error("{0} is a Quake III BSP, which names no nodes: leave out --drop and --open-doors")]
    LeftOut(PathBuf),
    /// A faulty GLB or glTF file.
    #[error("{path}: {source}")]
    Glb {
        /// The file.
        path: PathBuf,
        /// The fault.
        source: GlbError,
    },
    /// A faulty BSP file.
    #[error("{path}: {source}")]
    Bsp {
        /// The file.
        path: PathBuf,
        /// The fault.
        source: BspError,
    },
}

/// Reads a building: a .glb, a .gltf with the files beside it, or a Quake III .bsp with textures
/// from the archives of the game.
pub fn read(path: &Path, pk3s: &[PathBuf]) -> Result<Model, ReadError> {
    read_placed(path, pk3s, &Placing::default(), &LeftOut::default())
}

/// Reads a building, as [`read`] does, places it in the world, and leaves nodes out. Quake maps
/// tell their own unit and stay where they are, and they have no named nodes.
pub fn read_placed(
    path: &Path,
    pk3s: &[PathBuf],
    placing: &Placing,
    left_out: &LeftOut,
) -> Result<Model, ReadError> {
    let io = |source| ReadError::Io { path: path.to_owned(), source };
    let bytes = read_file(path).map_err(io)?;
    let title = title_of(path);
    let is_gltf = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf"));
    if bytes.is_empty() {
        Err(ReadError::Empty(path.to_owned()))
    } else if bytes.starts_with(b"IBSP") && *placing != Placing::default() {
        Err(ReadError::Placing(path.to_owned()))
    } else if bytes.starts_with(b"IBSP") && *left_out != LeftOut::default() {
        Err(ReadError::LeftOut(path.to_owned()))
    } else if bytes.starts_with(b"IBSP") {
        bsp::read_slice(&bytes, pk3s, &title)
            .map_err(|source| ReadError::Bsp { path: path.to_owned(), source })
    } else if bytes.starts_with(b"glTF") || is_gltf {
        glb::read_placed(&bytes, path.parent(), &title, placing, left_out)
            .map_err(|source| ReadError::Glb { path: path.to_owned(), source })
    } else if sightline_world::is_world_file(&bytes) {
        Err(ReadError::World(path.to_owned()))
    } else {
        Err(foreign(path))
    }
}

/// What is wrong with a file that is no model, by its ending.
fn foreign(path: &Path) -> ReadError {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    let converter = match ending.as_deref().and_then(OsStr::to_str) {
        Some("ifc") => Some(("IFC", "IfcConvert")),
        Some("fbx") => Some(("FBX", "assimp export")),
        Some("obj") => Some(("OBJ", "assimp export")),
        Some("dae") => Some(("COLLADA", "assimp export")),
        Some("3ds") => Some(("3DS", "assimp export")),
        Some("stl") => Some(("STL", "assimp export")),
        Some("ply") => Some(("PLY", "assimp export")),
        _ => None,
    };
    match converter {
        Some((format, converter)) => {
            let converted = path.with_extension("glb");
            let command = format!("{converter} {} {}", path.display(), converted.display());
            ReadError::Foreign { path: path.to_owned(), format, command }
        }
        None => ReadError::Format(path.to_owned()),
    }
}

/// The files that a building is read from besides its own: those that a glTF refers to, whether or
/// not they are there.
pub fn referred_files(path: &Path) -> Vec<PathBuf> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let is_gltf = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf"));
    match read_file(path) {
        Ok(bytes) if is_gltf || bytes.starts_with(b"glTF") => glb::referred_files(&bytes, folder),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests;
