//! Importers: each reads one format and makes a [`Model`].

pub mod bsp;
pub mod glb;
mod limits;
mod movers;

use std::path::{Path, PathBuf};

use crate::model::Model;
use bsp::BspError;
use glb::GlbError;
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
    #[error("{0} is empty")]
    Empty(PathBuf),
    /// The format is unknown.
    #[error("{0} is neither GLB, glTF nor a Quake III BSP")]
    Format(PathBuf),
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
    let io = |source| ReadError::Io { path: path.to_owned(), source };
    let bytes = read_file(path).map_err(io)?;
    let title = title_of(path);
    let is_gltf = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf"));
    if bytes.is_empty() {
        Err(ReadError::Empty(path.to_owned()))
    } else if bytes.starts_with(b"IBSP") {
        bsp::read_slice(&bytes, pk3s, &title)
            .map_err(|source| ReadError::Bsp { path: path.to_owned(), source })
    } else if bytes.starts_with(b"glTF") || is_gltf {
        glb::read_slice(&bytes, path.parent(), &title)
            .map_err(|source| ReadError::Glb { path: path.to_owned(), source })
    } else {
        Err(ReadError::Format(path.to_owned()))
    }
}

#[cfg(test)]
mod tests;
