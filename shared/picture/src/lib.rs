//! Pictures of sRGB pixels: textures that are read, plans and views that are written.
//!
//! * [`Picture`]: the pixels, row by row from the top.
//! * [`decode`]: reads PNG, JPEG and TGA, within [`DecodeLimits`].
//! * [`Picture::save`] and [`Picture::to_png`]: write PNG.
//!
//! Transparency is dropped: an opaque material has no use for it.
//!
//! # Example
//!
//! ```
//! use sightline_picture::{DecodeLimits, Encoding, Picture, decode};
//!
//! let checks = Picture::from_fn(8, 4, |x, y| if (x + y) % 2 == 0 { [0; 3] } else { [200, 40, 0] });
//! let bytes = checks.to_png()?;
//! let limits = DecodeLimits { edge_max: 16, bytes_max: 1_000 };
//! assert_eq!(decode(&bytes, Encoding::Marked, limits)?, checks);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod decode;
mod limits;
mod picture;
mod tga;

pub use decode::{Encoding, decode};
pub use limits::{DecodeError, DecodeLimits};
pub use picture::Picture;
