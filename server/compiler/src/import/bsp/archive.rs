//! Archives (pk3) with images and shader scripts.

use std::{
    collections::HashMap,
    fs::File,
    io::{BufReader, Read},
    path::{Path, PathBuf},
    sync::Arc,
};

use sightline_picture::{Encoding, Picture};
use zip::ZipArchive;

use super::{error::BspError, shader_script::Scripts};
use crate::import::limits;

/// The most files in all archives together.
const FILES_MAX: usize = 1 << 20;
/// The largest file in an archive: 32 MiB.
const FILE_BYTES_MAX: u64 = 32 << 20;
/// The most text of all shader scripts together: 32 MiB.
const SCRIPT_BYTES_MAX: usize = 32 << 20;
/// The most bytes of one decoded image.
const DECODE_BYTES_MAX: usize = 256 << 20;
/// Larger images are scaled down to this width and height: voxels are never finer.
const TEXTURE_EDGE: u32 = 128;
/// The extensions of images, in order of preference.
const EXTENSIONS: [(&str, Encoding); 4] = [
    ("jpg", Encoding::Marked),
    ("tga", Encoding::Tga),
    ("png", Encoding::Marked),
    ("jpeg", Encoding::Marked),
];

/// Open archives, and their files by name in lower case.
pub(super) struct Archives {
    archives: Vec<ZipArchive<BufReader<File>>>,
    files: HashMap<String, (usize, usize)>,
    scripts: Scripts,
}

impl Archives {
    /// Opens archives. When several hold a file, the last one counts.
    pub(super) fn open(paths: &[PathBuf]) -> Result<Self, BspError> {
        let mut all =
            Self { archives: Vec::new(), files: HashMap::new(), scripts: Scripts::default() };
        for path in paths {
            all.add(path)?;
        }
        all.read_scripts();
        Ok(all)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.archives.is_empty()
    }

    /// The image of a shader, if it can be read.
    pub(super) fn texture(&mut self, shader: &str) -> Option<Arc<Picture>> {
        let shown = self.scripts.image(shader).map(str::to_owned);
        let image = self.image(shader).or_else(|| self.image(&shown?))?;
        let (width, height) = image.dimensions();
        let scaled = width.max(height) > TEXTURE_EDGE;
        let mut image = if scaled {
            let edge = |size: u32| size.min(TEXTURE_EDGE);
            image.scaled_down(edge(width), edge(height))
        } else {
            image
        };
        image.pixels_mut().iter_mut().for_each(|pixel| *pixel = pixel.map(lifted));
        Some(Arc::new(image))
    }

    /// An image by name, with any extension.
    fn image(&mut self, name: &str) -> Option<Picture> {
        let (stem, _) = split_extension(name);
        EXTENSIONS.iter().find_map(|&(extension, encoding)| {
            let bytes = self.file(&format!("{stem}.{extension}"))?;
            limits::decode_texture(&bytes, encoding, DECODE_BYTES_MAX).ok()
        })
    }

    fn add(&mut self, path: &Path) -> Result<(), BspError> {
        let fault = |reason: String| BspError::Archive { path: path.to_owned(), reason };
        let file = File::open(path).map_err(|error| fault(error.to_string()))?;
        let archive =
            ZipArchive::new(BufReader::new(file)).map_err(|error| fault(error.to_string()))?;
        if self.files.len() + archive.len() > FILES_MAX {
            return Err(BspError::TooMany("files in archives"));
        }
        for index in 0..archive.len() {
            if let Some(name) = archive.name_for_index(index) {
                let place = (self.archives.len(), index);
                self.files.insert(name.to_ascii_lowercase(), place);
            }
        }
        self.archives.push(archive);
        Ok(())
    }

    fn read_scripts(&mut self) {
        let is_script = |name: &&String| name.starts_with("scripts/") && name.ends_with(".shader");
        let mut names: Vec<String> = self.files.keys().filter(is_script).cloned().collect();
        names.sort();
        let mut bytes_left = SCRIPT_BYTES_MAX;
        for name in names {
            let Some(bytes) = self.file(&name).filter(|bytes| bytes.len() <= bytes_left) else {
                continue;
            };
            bytes_left -= bytes.len();
            self.scripts.read(&String::from_utf8_lossy(&bytes));
        }
    }

    fn file(&mut self, name: &str) -> Option<Vec<u8>> {
        let &(archive, index) = self.files.get(name)?;
        let entry = self.archives.get_mut(archive)?.by_index(index).ok()?;
        let mut bytes = Vec::new();
        entry.take(FILE_BYTES_MAX).read_to_end(&mut bytes).ok()?;
        Some(bytes)
    }
}

/// The game doubles all brightness and clips. This doubles dark values, and bright ones less and
/// less.
fn lifted(channel: u8) -> u8 {
    let dark = 255 - u32::from(channel);
    (255 - (dark * dark + 127) / 255) as u8
}

fn split_extension(name: &str) -> (&str, &str) {
    match name.rsplit_once('.') {
        Some((stem, extension)) if !extension.contains('/') => (stem, extension),
        _ => (name, ""),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dark_values_are_doubled_and_bright_ones_are_not_clipped() {
        assert_eq!([0, 10, 128, 254, 255].map(lifted), [0, 20, 192, 255, 255]);
        assert!((0..255).all(|channel| lifted(channel) <= lifted(channel + 1)));
    }
}
