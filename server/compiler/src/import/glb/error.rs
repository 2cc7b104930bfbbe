//! Why a GLB or glTF file cannot be read, and the limits of the reader.

use std::path::PathBuf;

use crate::{import::limits, rooms::RoomError};

/// The most vertices and the most triangles of a model, instances counted one by one: 8 Mi of
/// each take at most 700 MB.
pub(super) const VERTICES_MAX: usize = 8 << 20;

pub(super) const TRIANGLES_MAX: usize = 8 << 20;

/// The most nodes that are visited, instances counted one by one.
pub(super) const NODES_MAX: usize = 1 << 20;

/// The most ancestors that a node has.
pub(super) const DEPTH_MAX: usize = 256;

/// Why a GLB or glTF file cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GlbError {
    /// The file itself cannot be had.
    #[error("cannot read {path}")]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not a glTF document, or an invalid one.
    #[error("not valid glTF 2.0: {0}")]
    Document(#[from] gltf::Error),
    /// The header of the GLB disagrees with the file.
    #[error("truncated GLB: the header says {header} bytes, the file has {file}")]
    Truncated {
        /// Bytes, by the header.
        header: u64,
        /// Bytes in the file.
        file: u64,
    },
    /// A buffer refers to something that may not or cannot be read.
    #[error("buffer {index}: {reason}")]
    Buffer {
        /// Which buffer of the document.
        index: usize,
        /// Why.
        reason: String,
    },
    /// An accessor reaches beyond its bytes, or is of a kind that does not fit its use.
    #[error("accessor {index}: {reason}")]
    Accessor {
        /// Which accessor of the document.
        index: usize,
        /// Why.
        reason: &'static str,
    },
    /// A channel of an animation has no sampler, accessor, or node.
    #[error("animation {index}: a channel refers to something that is not there")]
    Animation {
        /// Which animation of the document.
        index: usize,
    },
    /// An index points at no vertex.
    #[error("mesh {mesh}: index {index} is beyond its {vertices} vertices")]
    Index {
        /// Which mesh of the document.
        mesh: usize,
        /// The index.
        index: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A coordinate is not a number, infinite, or further out than anything real.
    #[error("mesh {mesh}: vertex {vertex} is not finite or beyond {} km", limits::EXTENT_MAX / 1000.0)]
    Coordinate {
        /// Which mesh of the document.
        mesh: usize,
        /// Which vertex of the primitive.
        vertex: usize,
    },
    /// A node that stands for a room or a window, and cannot.
    #[error(transparent)]
    Room(#[from] RoomError),
    /// More than this reader takes.
    #[error("too many {0}")]
    TooMany(&'static str),
    /// Nodes nest too deeply, or in a circle.
    #[error("nodes nest deeper than {DEPTH_MAX}")]
    Depth,
}
