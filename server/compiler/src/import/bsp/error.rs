//! Why a BSP file cannot be read.

use std::path::PathBuf;

use crate::import::limits;

/// Why a BSP file cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BspError {
    /// The file cannot be read.
    #[error("cannot read {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// An archive with textures cannot be read.
    #[error("{path}: {reason}")]
    Archive {
        /// The archive.
        path: PathBuf,
        /// The cause.
        reason: String,
    },
    /// The file is shorter than its header.
    #[error("truncated BSP")]
    Truncated,
    /// The file has another format.
    #[error("not a Quake III BSP")]
    Magic,
    /// The file has another version.
    #[error("BSP version {0}; only version 46 can be read")]
    Version(i32),
    /// A lump reaches beyond the file or holds a broken record.
    #[error("lump {lump} reaches beyond the file or is cut off")]
    Lump {
        /// The index of the lump.
        lump: usize,
    },
    /// A record refers to something that does not exist.
    #[error("a {what} refers to something that is not there")]
    Index {
        /// The kind of record.
        what: &'static str,
    },
    /// A coordinate is not finite, or out of range.
    #[error("a vertex is not finite or beyond {} km", limits::EXTENT_MAX / 1000.0)]
    Coordinate,
    /// The map has no world model.
    #[error("there is no world model")]
    NoWorld,
    /// The map exceeds a limit of the reader.
    #[error("too many {0}")]
    TooMany(&'static str),
}
