//! GLB and glTF 2.0: the triangles of the scene with their colours, opaque ones among them.
//! Animated nodes become movers and block nothing.
//!
//! The `gltf` crate parses and validates the document. Offsets, counts and indices are checked here
//! before use. A file can neither make the reader panic, nor make it allocate more than a small
//! multiple of the limits in `error`.

mod accessor;
mod animation;
mod error;
mod resources;
mod scene;

use std::path::Path;

use gltf::{
    Document, Semantic,
    json::{Index, Root, validation::Checked},
};

use super::limits;
use crate::model::Model;
pub use error::GlbError;
use resources::Resources;

/// Reads a .glb, or a .gltf with the files beside it.
pub fn read(path: &Path) -> Result<Model, GlbError> {
    let io = |source| GlbError::Io { path: path.to_owned(), source };
    let bytes = limits::read_file(path).map_err(io)?;
    read_slice(&bytes, path.parent(), &limits::title_of(path))
}

/// Reads a .glb or .gltf from bytes. Files that it names are read from `folder` only.
pub fn read_slice(bytes: &[u8], folder: Option<&Path>, title: &str) -> Result<Model, GlbError> {
    check_length(bytes)?;
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice_without_validation(bytes)?;
    check_positions(document.as_json())?;
    let document = Document::from_json(document.into_json())?;
    let resources = Resources::load(&document, blob, folder)?;
    scene::Reader::new(&document, resources, title).read()
}

/// Checks the length in the header of a GLB. The `gltf` crate trusts that it covers the header.
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

/// Checks that the accessors of positions exist. The validation of the `gltf` crate takes that for
/// granted.
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
mod tests;
