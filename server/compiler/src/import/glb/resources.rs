//! Buffers and images of a document, inside the file or beside it.

use std::{
    borrow::Cow,
    collections::HashMap,
    path::{Component, Path, PathBuf},
    sync::Arc,
};

use base64::{Engine, engine::general_purpose::STANDARD};
use gltf::{Document, buffer};
use sightline_picture::{Encoding, Picture};

use super::{compressed, error::GlbError};
use crate::import::limits;

/// The most bytes of all decoded textures: 256 MiB.
const TEXTURE_BYTES_MAX: usize = 256 << 20;
/// The most bytes of all buffers: 1 GiB.
const BUFFER_BYTES_MAX: usize = 1 << 30;

/// Buffers, and images as far as they were needed.
pub(super) struct Resources {
    buffers: Vec<Vec<u8>>,
    /// The bytes of views that were compressed.
    decompressed: Vec<Option<Vec<u8>>>,
    folder: Option<PathBuf>,
    images: Vec<Option<Option<Arc<Picture>>>>,
    /// The mean colours of images, by their indices, as far as they were needed.
    means: HashMap<usize, [f32; 3]>,
    texture_bytes_left: usize,
}

impl Resources {
    /// Loads every buffer of a document.
    pub(super) fn load(
        document: &Document,
        mut blob: Option<Vec<u8>>,
        folder: Option<&Path>,
    ) -> Result<Self, GlbError> {
        let mut left = BUFFER_BYTES_MAX;
        let mut buffers = Vec::new();
        for buffer in document.buffers() {
            let fault = |reason| GlbError::Buffer { index: buffer.index(), reason };
            if compressed::is_fallback(&buffer) {
                buffers.push(Vec::new());
                continue;
            }
            let bytes = match buffer.source() {
                buffer::Source::Bin => blob.take().ok_or_else(|| fault("is missing".into()))?,
                buffer::Source::Uri(uri) => fetch(uri, folder).map_err(fault)?,
            };
            if bytes.len() < buffer.length() {
                let (has, says) = (bytes.len(), buffer.length());
                return Err(fault(format!("has {has} bytes where {says} were promised")));
            }
            left = left.checked_sub(bytes.len()).ok_or(GlbError::TooMany("bytes in buffers"))?;
            buffers.push(bytes);
        }
        let decompressed = compressed::decompressed(document, &buffers, left)
            .ok_or(GlbError::TooMany("bytes in compressed views"))?;
        Ok(Self {
            buffers,
            decompressed,
            folder: folder.map(Path::to_owned),
            images: vec![None; document.images().len()],
            means: HashMap::new(),
            texture_bytes_left: TEXTURE_BYTES_MAX,
        })
    }

    /// How many bytes all buffers have.
    pub(super) fn byte_len(&self) -> usize {
        self.buffers.iter().chain(self.decompressed.iter().flatten()).map(Vec::len).sum()
    }

    /// The bytes of a view. `None` when it reaches beyond its buffer.
    pub(super) fn view(&self, view: &buffer::View<'_>) -> Option<&[u8]> {
        if let Some(Some(bytes)) = self.decompressed.get(view.index()) {
            return Some(bytes);
        }
        let end = view.offset().checked_add(view.length())?;
        self.buffers.get(view.buffer().index())?.get(view.offset()..end)
    }

    /// An image, decoded once. An image that cannot be read becomes `None`, with a warning.
    pub(super) fn image(
        &mut self,
        document: &Document,
        index: usize,
        warnings: &mut Vec<String>,
    ) -> Option<Arc<Picture>> {
        if let Some(Some(known)) = self.images.get(index) {
            return known.clone();
        }
        let loaded = self.load_image(document, index).map(Arc::new);
        if let Err(reason) = &loaded {
            warnings.push(format!("image {index} left out: {reason}"));
        }
        let loaded = loaded.ok();
        if let Some(slot) = self.images.get_mut(index) {
            *slot = Some(loaded.clone());
        }
        loaded
    }

    /// The mean linear colour of an image, found once. `None` for one that cannot be read.
    pub(super) fn mean(
        &mut self,
        document: &Document,
        index: usize,
        warnings: &mut Vec<String>,
    ) -> Option<[f32; 3]> {
        if let Some(mean) = self.means.get(&index) {
            return Some(*mean);
        }
        let image = self.image(document, index, warnings)?;
        let sum = image.pixels().iter().fold([0.0f64; 3], |sum, pixel| {
            [0, 1, 2].map(|i| sum[i] + f64::from(limits::linear(pixel[i])))
        });
        let mean = sum.map(|channel| (channel / image.pixels().len().max(1) as f64) as f32);
        self.means.insert(index, mean);
        Some(mean)
    }

    fn load_image(&mut self, document: &Document, index: usize) -> Result<Picture, String> {
        // The `gltf` crate takes for granted that an image has a source.
        let source = document.as_json().images.get(index).ok_or("it is not there")?;
        let view = source.buffer_view.and_then(|view| document.views().nth(view.value()));
        let bytes = match (&source.uri, view) {
            (Some(uri), _) => Cow::Owned(fetch(uri, self.folder.as_deref())?),
            (None, Some(view)) => {
                Cow::Borrowed(self.view(&view).ok_or("it reaches beyond its buffer")?)
            }
            (None, None) => return Err("it has no source".into()),
        };
        if let Some(what) = unreadable_picture(&bytes) {
            return Err(what.to_owned());
        }
        let picture = limits::decode_texture(&bytes, Encoding::Marked, self.texture_bytes_left)
            .map_err(|error| error.to_string())?;
        self.texture_bytes_left -= picture.byte_len().min(self.texture_bytes_left);
        Ok(picture)
    }
}

/// Why a picture of a known kind cannot be read.
fn unreadable_picture(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(b"\xabKTX 20\xbb") {
        Some(
            "it is KTX2, so the base colour is used; `npx @gltf-transform/cli ktxdecompress \
             IN.glb OUT.glb` converts it",
        )
    } else if bytes.get(4..12) == Some(b"ftypavif") {
        Some("it is AVIF, so the base colour is used; export PNG, JPEG or WebP")
    } else {
        None
    }
}

/// The bytes of a URI: data within it, or a file in the folder or below it.
fn fetch(uri: &str, folder: Option<&Path>) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let base64 = data.split_once(";base64,").map_or(data, |(_, base64)| base64);
        return STANDARD.decode(base64).map_err(|error| format!("bad data URI: {error}"));
    }
    let folder = folder.ok_or("there is no folder to look in")?;
    let path = file_of(uri, folder)?;
    limits::read_file(&path).map_err(|error| format!("cannot read {}: {error}", path.display()))
}

/// The file of a URI, in the folder or below it.
pub(super) fn file_of(uri: &str, folder: &Path) -> Result<PathBuf, String> {
    let name = urlencoding::decode(uri).map_err(|_| "its URI is not text")?;
    if !stays_inside(&name) || !stays_inside(uri) {
        return Err(format!("{uri:.200} is outside the model's folder"));
    }
    let path = folder.join(name.as_ref());
    // Some programs write names as they are, percent signs and all.
    let as_written = folder.join(uri);
    Ok(if !path.exists() && as_written.is_file() { as_written } else { path })
}

/// Whether a name leads to a file in a folder or below it.
fn stays_inside(name: &str) -> bool {
    let inside = |part| matches!(part, Component::Normal(_) | Component::CurDir);
    !name.contains("://") && !name.contains('\\') && Path::new(name).components().all(inside)
}
