//! Why a GLB or glTF file cannot be read, and the limits of the reader.

use std::path::PathBuf;

use glam::DVec3;

use crate::{import::limits, rooms::RoomError};

/// The most vertices of a model, instances counted one by one. Together with as many triangles they
/// take at most 700 MB.
pub(super) const VERTICES_MAX: usize = 8 << 20;

/// The most triangles of a model, instances counted one by one.
pub(super) const TRIANGLES_MAX: usize = 8 << 20;

/// The most nodes, instances counted one by one.
pub(super) const NODES_MAX: usize = 1 << 20;

/// The most primitives that nodes place, with each copy counted.
pub(super) const PLACED_MAX: usize = 4 << 20;

/// The most ancestors of a node.
pub(super) const DEPTH_MAX: usize = 256;

/// Why a GLB or glTF file cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GlbError {
    /// The file cannot be read.
    #[error("cannot read {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The document is not valid glTF.
    #[error("not valid glTF 2.0: {0}")]
    Document(#[from] gltf::Error),
    /// The document is not JSON, or not in the shape of glTF.
    #[error("not valid glTF 2.0: {0}")]
    Json(String),
    /// The file requires extensions that cannot be read.
    #[error("the file requires {names}, which cannot be read: {how}")]
    Extensions {
        /// The names of the extensions.
        names: String,
        /// What to do.
        how: String,
    },
    /// The model is larger than buildings are. Holds the length of each side, in metres.
    #[error("the building would be {:.0} x {:.0} x {:.0} m: for millimetres give --scale 0.001, for \
             centimetres 0.01, for inches 0.0254, and if it is so large --scale 1", .0.x, .0.y, .0.z)]
    Large(DVec3),
    /// The header of the GLB disagrees with the file.
    #[error(
        "truncated GLB: the header says {header} bytes, the file has {file}; copy or export it again"
    )]
    Truncated {
        /// The length in the header, in bytes.
        header: u64,
        /// The length of the file, in bytes.
        file: u64,
    },
    /// A buffer cannot be read, or lies outside the folder.
    #[error("buffer {index}: {reason}")]
    Buffer {
        /// The index of the buffer.
        index: usize,
        /// The cause.
        reason: String,
    },
    /// An accessor reaches beyond its bytes, or has an unsuitable type.
    #[error("accessor {index}: {reason}")]
    Accessor {
        /// The index of the accessor.
        index: usize,
        /// The cause.
        reason: &'static str,
    },
    /// A channel of an animation has no sampler, accessor, or node.
    #[error("animation {index}: a channel refers to something that is not there")]
    Animation {
        /// The index of the animation.
        index: usize,
    },
    /// An index refers to no vertex.
    #[error("mesh {mesh}: index {index} is beyond its {vertices} vertices")]
    Index {
        /// The index of the mesh.
        mesh: usize,
        /// The index of the vertex.
        index: u32,
        /// The number of vertices.
        vertices: usize,
    },
    /// A coordinate is not finite, or out of range.
    #[error("mesh {mesh}: vertex {vertex} is not finite or beyond {} km; if the model is large or far \
             away, try --scale or --recentre", limits::EXTENT_MAX / 1000.0)]
    Coordinate {
        /// The index of the mesh.
        mesh: usize,
        /// The vertex of the primitive.
        vertex: usize,
    },
    /// A node declares an invalid room or window.
    #[error(transparent)]
    Room(#[from] RoomError),
    /// The document exceeds a limit of the reader.
    #[error("too many {0}")]
    TooMany(&'static str),
    /// Nodes nest too deeply, or in a cycle.
    #[error("nodes nest deeper than {DEPTH_MAX}")]
    Depth,
}

impl GlbError {
    /// Whether only a part of the model is faulty, which can be left out.
    pub(super) fn is_of_a_part(&self) -> bool {
        matches!(self, Self::Accessor { .. } | Self::Index { .. } | Self::Coordinate { .. })
    }
}
