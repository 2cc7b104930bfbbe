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
    /// The file itself cannot be had.
    #[error("cannot read {path}")]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// There is nothing in it.
    #[error("{0} is empty")]
    Empty(PathBuf),
    /// It is none of the formats that can be read.
    #[error("{0} is neither GLB, glTF nor a Quake III BSP")]
    Format(PathBuf),
    /// A faulty GLB or glTF file.
    #[error("{path}: {source}")]
    Glb {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        source: GlbError,
    },
    /// A faulty BSP file.
    #[error("{path}: {source}")]
    Bsp {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        source: BspError,
    },
}

/// Reads a building: a .glb, a .gltf with what lies beside it, or a Quake III .bsp with textures
/// from the archives in which the game keeps them.
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
