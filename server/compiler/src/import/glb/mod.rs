//! GLB and glTF 2.0: the scene's triangles in world space, their colours and what blocks sight; and
//! what its animations move, which blocks nothing.
//!
//! The `gltf` crate parses and validates the document. What the document says of its bytes
//! (offsets, counts, indices) is checked here before it is used: a file cannot make the reader
//! panic, nor make it allocate more than a small multiple of the limits below.

mod accessor;
mod animation;
mod resources;
mod scene;

use std::path::{Path, PathBuf};

use gltf::{
    Document, Semantic,
    json::{Index, Root, validation::Checked},
};

use super::limits;
use crate::{model::Model, rooms::RoomError};
use resources::Resources;

/// The most vertices and the most triangles of a model, instances counted one by one: 8 Mi of
/// each take at most 700 MB.
const VERTICES_MAX: usize = 8 << 20;
const TRIANGLES_MAX: usize = 8 << 20;
/// The most nodes that are visited, instances counted one by one.
const NODES_MAX: usize = 1 << 20;
/// The most ancestors that a node has.
const DEPTH_MAX: usize = 256;

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

/// Reads a .glb, or a .gltf with what lies beside it.
pub fn read(path: &Path) -> Result<Model, GlbError> {
    let io = |source| GlbError::Io { path: path.to_owned(), source };
    let bytes = limits::read_file(path).map_err(io)?;
    read_slice(&bytes, path.parent(), &limits::title_of(path))
}

/// Reads the bytes of a .glb or .gltf. Files that it names are looked for in `folder` only.
pub fn read_slice(bytes: &[u8], folder: Option<&Path>, title: &str) -> Result<Model, GlbError> {
    check_length(bytes)?;
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice_without_validation(bytes)?;
    check_positions(document.as_json())?;
    let document = Document::from_json(document.into_json())?;
    let resources = Resources::load(&document, blob, folder)?;
    scene::Reader::new(&document, resources, title).read()
}

/// The `gltf` crate trusts that the length in a GLB's header covers the header.
fn check_length(bytes: &[u8]) -> Result<(), GlbError> {
    if !bytes.starts_with(b"glTF") {
        return Ok(());
    }
    let file = bytes.len() as u64;
    let header = match bytes.get(8..12) {
        Some(&[a, b, c, d]) => u64::from(u32::from_le_bytes([a, b, c, d])),
        _ => 20,
    };
    if header < 20 || header > file {
        return Err(GlbError::Truncated { header, file });
    }
    Ok(())
}

/// Validation by the `gltf` crate looks into the accessors of positions without checking that they
/// are there.
fn check_positions(root: &Root) -> Result<(), GlbError> {
    let positions = Checked::Valid(Semantic::Positions);
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let mut indices = primitives.filter_map(|p| p.attributes.get(&positions)).map(Index::value);
    match indices.find(|&index| index >= root.accessors.len()) {
        Some(index) => Err(GlbError::Accessor { index, reason: "is not there" }),
        None => Ok(()),
    }
}

#[cfg(test)]
pub(crate) mod tests;
