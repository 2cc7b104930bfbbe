//! What is refused: files beyond a size, and damaged ones.

use thiserror::Error;

/// What a file may ask for. A few bytes can stand for a picture that fills the memory.
#[derive(Clone, Copy, Debug)]
pub struct DecodeLimits {
    /// The greatest width and height, in pixels.
    pub edge_max: u32,
    /// The greatest size of the decoded pixels, in bytes.
    pub bytes_max: usize,
}

/// Why a file is not decoded.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The file is neither PNG, JPEG nor WebP.
    #[error("it is neither PNG, JPEG nor WebP")]
    Unmarked,
    /// The picture has no pixels.
    #[error("it has no pixels")]
    Empty,
    /// The picture is too large.
    #[error("it is larger than {0} pixels along an edge")]
    Edge(u32),
    /// The pixels take too much memory.
    #[error("the textures take too much memory")]
    Memory,
    /// The file is not valid PNG.
    #[error(transparent)]
    Png(#[from] png::DecodingError),
    /// The file is not valid JPEG.
    #[error("{0:?}")]
    Jpeg(zune_jpeg::errors::DecodeErrors),
    /// The file is not valid WebP.
    #[error(transparent)]
    WebP(#[from] image_webp::DecodingError),
    /// The file is not valid TGA, or a kind of TGA that nobody writes.
    #[error("bad TGA: {0}")]
    Tga(&'static str),
}

impl DecodeLimits {
    /// Checks a size before anything is decoded.
    pub(crate) fn check(
        self,
        width: usize,
        height: usize,
        bytes_per_pixel: usize,
    ) -> Result<(), DecodeError> {
        let edge = width.max(height);
        if width.min(height) == 0 {
            Err(DecodeError::Empty)
        } else if edge > self.edge_max as usize {
            Err(DecodeError::Edge(self.edge_max))
        } else if width * height > self.bytes_max / bytes_per_pixel.max(3) {
            Err(DecodeError::Memory)
        } else {
            Ok(())
        }
    }
}
