//! GLB and glTF 2.0: the triangles of the scene with their colours, opaque ones among them.
//! Animated nodes become movers and block nothing.
//!
//! The `gltf` crate parses and validates the document. Offsets, counts and indices are checked here
//! before use. A file can neither make the reader panic, nor make it allocate more than a small
//! multiple of the limits in `error`.
//!
//! * `document` parses and checks, with the extensions of `extensions`.
//! * `survey` and `placing` see how large the model is, and place it in the world.
//! * `resources` has buffers and images, and `compressed` views; `accessor` takes numbers from
//!   them.
//! * `sky` finds what encloses everything.
//! * `scene` walks the nodes: their `names`, `material`s, `instances` and `animation`.

mod accessor;
mod animation;
mod compressed;
mod document;
mod error;
mod extensions;
mod instances;
mod material;
mod names;
mod placing;
mod resources;
mod scene;
mod sky;
mod survey;

use std::path::{Path, PathBuf};

use super::{LeftOut, left_out::PatternCounts, limits};
use crate::model::Model;
pub use error::GlbError;
pub use placing::{Placing, UpAxis};
use resources::Resources;
use survey::Survey;

/// Reads a .glb, or a .gltf with the files beside it.
pub fn read(path: &Path) -> Result<Model, GlbError> {
    let io = |source| GlbError::Io { path: path.to_owned(), source };
    let bytes = limits::read_file(path).map_err(io)?;
    read_slice(&bytes, path.parent(), &limits::title_of(path))
}

/// Reads a .glb or .gltf from bytes. Files that it names are read from `folder` only.
pub fn read_slice(bytes: &[u8], folder: Option<&Path>, title: &str) -> Result<Model, GlbError> {
    read_placed(bytes, folder, title, &Placing::default(), &LeftOut::default())
}

/// Reads a .glb or .gltf from bytes, places the model in the world, and leaves nodes out.
pub fn read_placed(
    bytes: &[u8],
    folder: Option<&Path>,
    title: &str,
    placing: &Placing,
    left_out: &LeftOut,
) -> Result<Model, GlbError> {
    let (document, blob) = document::read(bytes)?;
    let survey = Survey::of(&document);
    let root = placing.root(survey.as_ref())?;
    let resources = Resources::load(&document, blob, folder)?;
    let left_out = PatternCounts::new(left_out);
    let reader = scene::Reader::new(&document, resources, title, root.transform, left_out);
    let mut model = reader.read()?;
    sky::leave_out_of_sight(&mut model);
    model.warnings.splice(0..0, root.notes);
    Ok(model)
}

/// The files in a folder that a .glb or .gltf refers to, whether or not they are there.
pub fn referred_files(bytes: &[u8], folder: &Path) -> Vec<PathBuf> {
    let files = document::uris(bytes).into_iter();
    files.filter_map(|uri| resources::file_of(&uri, folder).ok()).collect()
}

#[cfg(test)]
mod tests;
