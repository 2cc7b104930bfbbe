//! Why a BSP file cannot be read.

use std::path::PathBuf;

use crate::import::limits;

/// Why a BSP file cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BspError {
    /// The file itself cannot be had.
    #[error("cannot read {path}")]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// An archive with textures cannot be had.
    #[error("{path}: {reason}")]
    Archive {
        /// Which archive.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Shorter than its header.
    #[error("truncated BSP")]
    Truncated,
    /// Another format.
    #[error("not a Quake III BSP")]
    Magic,
    /// Another version.
    #[error("BSP version {0}; only version 46 can be read")]
    Version(i32),
    /// A lump reaches beyond the file or holds a broken record.
    #[error("lump {lump} reaches beyond the file or is cut off")]
    Lump {
        /// Which of the seventeen.
        lump: usize,
    },
    /// A record refers to something that is not there.
    #[error("a {what} refers to something that is not there")]
    Index {
        /// What kind of record.
        what: &'static str,
    },
    /// A coordinate is not a number, infinite, or further out than anything real.
    #[error("a vertex is not finite or beyond {} km", limits::EXTENT_MAX / 1000.0)]
    Coordinate,
    /// There is no world model.
    #[error("there is no world model")]
    NoWorld,
    /// More than this reader takes.
    #[error("too many {0}")]
    TooMany(&'static str),
}
