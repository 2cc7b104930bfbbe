//! Pictures as PNG files.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use sightline_picture::Picture;

/// The largest number of frames in a film.
pub const FRAMES_MAX: usize = 100_000;

/// Writes pictures of equal height side by side. Each is given by its width and its pixels,
/// 0x00RRGGBB, row by row.
pub fn save(path: &Path, panels: &[(usize, &[u32])]) -> anyhow::Result<()> {
    let height = panels.first().map_or(0, |(width, pixels)| pixels.len() / (*width).max(1));
    let width: usize = panels.iter().map(|(width, _)| width).sum();
    let mut all = Vec::with_capacity(width * height);
    for y in 0..height {
        for (width, pixels) in panels {
            let row =
                pixels.get(y * width..(y + 1) * width).context("the pictures differ in height")?;
            all.extend(row.iter().map(|pixel| {
                let [_, red, green, blue] = pixel.to_be_bytes();
                [red, green, blue]
            }));
        }
    }
    let picture = Picture::from_pixels(width as u32, height as u32, all);
    let picture = picture.context("the picture has no size")?;
    picture.save(path).with_context(|| format!("cannot write {}", path.display()))
}

/// The files of a film's frames: in a folder, which is created, or by a pattern such as
/// `film-%04d.png`.
pub struct FrameFiles {
    before: String,
    digits: usize,
    after: String,
}

impl FrameFiles {
    /// Parses the value of `-o`.
    ///
    /// # Errors
    /// When the value is neither a folder nor a pattern, or the folder cannot be created.
    pub fn new(output: &Path) -> anyhow::Result<Self> {
        let text = output.to_str().context("the name of the output is not valid text")?;
        let create = |folder: &Path| {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("cannot create {}", folder.display()))
        };
        let Some((before, rest)) = text.split_once('%') else {
            ensure!(
                output.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("png")),
                "a film is many pictures: name a folder, or a pattern such as film-%04d.png"
            );
            create(output)?;
            let before = output.join("frame-").to_string_lossy().into_owned();
            return Ok(Self { before, digits: 4, after: ".png".into() });
        };
        let Some((digits, after)) = rest.split_once('d').filter(|(_, after)| !after.contains('%'))
        else {
            bail!("{text}: a pattern contains one number, as in film-%04d.png");
        };
        let digits = if digits.is_empty() { Some(1) } else { digits.parse().ok() };
        let digits = digits.filter(|digits| (1..=9).contains(digits));
        let digits = digits.with_context(|| {
            format!("{text}: a pattern contains a number of 1 to 9 digits, as in film-%04d.png")
        })?;
        create(output.parent().unwrap_or(Path::new("")))?;
        Ok(Self { before: before.to_owned(), digits, after: after.to_owned() })
    }

    /// The file of a frame.
    pub fn frame(&self, number: usize) -> PathBuf {
        let Self { before, digits, after } = self;
        format!("{before}{number:0digits$}{after}").into()
    }
}

#[cfg(test)]
mod tests {
    use sightline_picture::{DecodeLimits, Encoding, decode};

    use super::*;

    #[test]
    fn the_frames_of_a_film_go_into_a_folder_or_follow_a_pattern() {
        let folder = tempfile::tempdir().unwrap();
        let film = folder.path().join("a/film");
        let frame_files = FrameFiles::new(&film).unwrap();
        assert_eq!(frame_files.frame(7), film.join("frame-0007.png"));
        assert!(film.is_dir());
        let by = |pattern: &str| FrameFiles::new(Path::new(pattern)).map(|s| s.frame(12));
        assert_eq!(by("f-%05d.png").unwrap(), Path::new("f-00012.png"));
        assert_eq!(by("%d.png").unwrap(), Path::new("12.png"));
        for wrong in ["one.png", "%.png", "%xd.png", "%d-%d.png", "%0d.png", "%99d.png"] {
            assert!(by(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn panels_stand_side_by_side() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        save(&path, &[(2, &[1, 2, 3, 4]), (1, &[5, 6])]).unwrap();
        let limits = DecodeLimits { edge_max: 9, bytes_max: 99 };
        let read = decode(&std::fs::read(&path).unwrap(), Encoding::Marked, limits).unwrap();
        assert_eq!(read.dimensions(), (3, 2));
        assert_eq!([read.pixel(2, 0)[2], read.pixel(0, 1)[2]], [5, 3]);
        assert!(save(&path, &[(2, &[1, 2]), (1, &[])]).is_err());
        assert!(save(&path, &[]).is_err());
    }
}
