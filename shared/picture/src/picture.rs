//! A picture in memory.

use std::{
    fs::File,
    io::{self, BufWriter, Write},
    path::Path,
};

/// Pixels in sRGB, without transparency.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    width: u32,
    height: u32,
    /// Row by row from the top; `width * height` of them.
    pixels: Vec<[u8; 3]>,
}

impl Picture {
    /// A picture of one colour.
    pub fn filled(width: u32, height: u32, colour: [u8; 3]) -> Self {
        let pixels = vec![colour; width as usize * height as usize];
        Self { width, height, pixels }
    }

    /// A picture whose pixels are given by column and row.
    pub fn from_fn(width: u32, height: u32, colour: impl Fn(u32, u32) -> [u8; 3]) -> Self {
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let pixels = places.map(|(x, y)| colour(x, y)).collect();
        Self { width, height, pixels }
    }

    /// A picture of pixels in rows from the top. `None` unless they fill all rows.
    pub fn from_pixels(width: u32, height: u32, pixels: Vec<[u8; 3]>) -> Option<Self> {
        let count = (width as usize).checked_mul(height as usize)?;
        (pixels.len() == count).then_some(Self { width, height, pixels })
    }

    /// The number of columns.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// The number of rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The numbers of columns and rows.
    pub fn dimensions(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// All pixels, row by row from the top.
    pub fn pixels(&self) -> &[[u8; 3]] {
        &self.pixels
    }

    /// All pixels, row by row from the top, to change them.
    pub fn pixels_mut(&mut self) -> &mut [[u8; 3]] {
        &mut self.pixels
    }

    /// The size of the pixels, in bytes.
    pub fn byte_len(&self) -> usize {
        self.pixels.len() * 3
    }

    /// The pixel of a column and a row.
    ///
    /// # Panics
    /// When it lies outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        assert!(x < self.width, "a column inside the picture");
        self.pixels[y as usize * self.width as usize + x as usize]
    }

    /// The pixel of a column and a row, to change it. `None` outside the picture.
    pub fn pixel_mut(&mut self, x: u32, y: u32) -> Option<&mut [u8; 3]> {
        if x >= self.width {
            return None;
        }
        self.pixels.get_mut(y as usize * self.width as usize + x as usize)
    }

    /// Copies a picture into this one, with its upper left corner at a place. What reaches beyond
    /// this picture is left out.
    pub fn paste(&mut self, other: &Self, left: u32, top: u32) {
        for y in 0..other.height {
            for x in 0..other.width {
                if let Some(pixel) = self.pixel_mut(left + x, top + y) {
                    *pixel = other.pixel(x, y);
                }
            }
        }
    }

    /// The picture scaled down: each pixel is the mean of those that it covers.
    ///
    /// # Panics
    /// When the new size is zero or larger than the old one.
    #[must_use]
    pub fn scaled_down(&self, width: u32, height: u32) -> Self {
        assert!((1..=self.width).contains(&width), "a width of at most {}", self.width);
        assert!((1..=self.height).contains(&height), "a height of at most {}", self.height);
        let [columns, rows] = [(self.width, width), (self.height, height)].map(|(old, new)| {
            let ratio = old as f32 / new as f32;
            move |i: u32| {
                let low = i as f32 * ratio;
                let first = (low.ceil() as u32).min(old - 1);
                first..((low + ratio).ceil() as u32).clamp(first + 1, old)
            }
        });
        Self::from_fn(width, height, |x, y| {
            let covered = rows(y).flat_map(|y| columns(x).map(move |x| (x, y)));
            let (mut sum, mut count) = ([0u32; 3], 0);
            for (x, y) in covered {
                let pixel = self.pixel(x, y);
                (0..3).for_each(|i| sum[i] += u32::from(pixel[i]));
                count += 1;
            }
            sum.map(|sum| ((sum + count / 2) / count) as u8)
        })
    }

    /// The picture as a PNG file.
    ///
    /// # Errors
    /// When the picture has no pixels.
    pub fn to_png(&self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.write_png(&mut bytes)?;
        Ok(bytes)
    }

    /// Writes a PNG file.
    ///
    /// # Errors
    /// When the picture has no pixels, or the file cannot be written.
    pub fn save(&self, path: &Path) -> io::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        self.write_png(&mut file)?;
        file.flush()
    }

    fn write_png(&self, file: impl Write) -> io::Result<()> {
        let mut encoder = png::Encoder::new(file, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        encoder.set_filter(png::Filter::Adaptive);
        let mut writer = encoder.write_header()?;
        Ok(writer.write_image_data(self.pixels.as_flattened())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_outside_has_no_pixel() {
        let mut picture = Picture::filled(2, 3, [1, 2, 3]);
        *picture.pixel_mut(1, 2).unwrap() = [9; 3];
        assert_eq!((picture.pixel(1, 2), picture.pixel(0, 2)), ([9; 3], [1, 2, 3]));
        assert!(picture.pixel_mut(2, 0).is_none() && picture.pixel_mut(0, 3).is_none());
        assert_eq!((picture.byte_len(), picture.pixels().len()), (18, 6));
    }

    #[test]
    fn pixels_must_fill_all_rows() {
        assert!(Picture::from_pixels(2, 2, vec![[0; 3]; 3]).is_none());
        let picture = Picture::from_pixels(2, 1, vec![[0; 3], [7; 3]]).unwrap();
        assert_eq!(picture, Picture::from_fn(2, 1, |x, _| [7 * x as u8; 3]));
    }

    #[test]
    fn a_pasted_picture_is_cut_at_the_edge() {
        let mut picture = Picture::filled(3, 2, [0; 3]);
        picture.paste(&Picture::filled(2, 2, [5; 3]), 2, 1);
        assert_eq!(picture.pixels().iter().filter(|pixel| **pixel == [5; 3]).count(), 1);
        assert_eq!(picture.pixel(2, 1), [5; 3]);
    }

    #[test]
    fn a_picture_without_pixels_is_not_written() {
        assert!(Picture::filled(0, 3, [0; 3]).to_png().is_err());
    }
}
