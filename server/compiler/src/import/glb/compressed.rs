//! Views that are compressed by meshoptimizer (`EXT_meshopt_compression`).

use gltf::{Document, buffer::View};
use serde_json::Value;

/// The names of the extension, before and after its adoption.
const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
/// The most bytes of a view for each of its compressed bytes. Constant data compress to a part in
/// about 500.
const RATIO_MAX: usize = 1_024;
/// The widest element, in bytes.
const STRIDE_MAX: usize = 64;

/// How a view is compressed.
struct Compressed<'a> {
    buffer: usize,
    offset: usize,
    length: usize,
    stride: usize,
    count: usize,
    mode: &'a str,
    filter: &'a str,
}

/// Whether a buffer is only there for readers that cannot decompress, and holds nothing.
pub(super) fn is_fallback(buffer: &gltf::Buffer<'_>) -> bool {
    NAMES.iter().any(|name| {
        let extension = buffer.extension_value(name);
        extension.and_then(|value| value.get("fallback")?.as_bool()).unwrap_or(false)
    })
}

/// The bytes of each view that is compressed, by its index. Views that cannot be decompressed have
/// none, and what needs them is left out. All of them together may have
/// `left` bytes. None when that does not suffice.
pub(super) fn decompressed(
    document: &Document,
    buffers: &[Vec<u8>],
    mut left: usize,
) -> Option<Vec<Option<Vec<u8>>>> {
    let read = |view: View<'_>| {
        let Some(compressed) = Compressed::of(&view) else { return Some(None) };
        let Some((source, size)) = compressed.source(buffers) else {
            return Some(Some(Vec::new()));
        };
        left = left.checked_sub(size)?;
        Some(Some(compressed.bytes(source).unwrap_or_default()))
    };
    document.views().map(read).collect()
}

impl<'a> Compressed<'a> {
    fn of(view: &'a View<'a>) -> Option<Self> {
        let extension = NAMES.iter().find_map(|name| view.extension_value(name))?;
        let number = |key: &str| {
            extension.get(key).and_then(Value::as_u64).and_then(|value| usize::try_from(value).ok())
        };
        let text = |key: &str| extension.get(key).and_then(Value::as_str);
        Some(Self {
            buffer: number("buffer").unwrap_or(usize::MAX),
            offset: number("byteOffset").unwrap_or(0),
            length: number("byteLength").unwrap_or(0),
            stride: number("byteStride").unwrap_or(0),
            count: number("count").unwrap_or(0),
            mode: text("mode").unwrap_or_default(),
            filter: text("filter").unwrap_or("NONE"),
        })
    }

    /// The compressed bytes, and how many they become. `None` when that cannot be.
    fn source<'b>(&self, buffers: &'b [Vec<u8>]) -> Option<(&'b [u8], usize)> {
        let end = self.offset.checked_add(self.length)?;
        let source = buffers.get(self.buffer)?.get(self.offset..end)?;
        let size = self.stride.checked_mul(self.count)?;
        let is_likely = size <= source.len().checked_mul(RATIO_MAX)? && self.stride <= STRIDE_MAX;
        is_likely.then_some((source, size))
    }

    /// The bytes, decompressed. `None` when they are invalid.
    fn bytes(&self, source: &[u8]) -> Option<Vec<u8>> {
        match self.mode {
            "ATTRIBUTES" => self.attributes(source),
            "TRIANGLES" if self.count.is_multiple_of(3) => {
                self.indices(meshopt::decode_index_buffer::<u32>(source, self.count).ok()?)
            }
            "INDICES" => {
                self.indices(meshopt::decode_index_sequence::<u32>(source, self.count).ok()?)
            }
            _ => None,
        }
    }

    fn attributes(&self, source: &[u8]) -> Option<Vec<u8>> {
        macro_rules! of_words {
            ($($words:literal)*) => {
                match self.stride {
                    $(stride if stride == 4 * $words => {
                        let decoded = meshopt::decode_vertex_buffer::<[u32; $words]>(source, self.count);
                        decoded.ok()?.into_iter().flatten().collect::<Vec<u32>>()
                    })*
                    _ => return None,
                }
            };
        }
        let words = of_words!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16);
        let bytes: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
        self.filtered(bytes)
    }

    /// Undoes the filter. The one of directions is left: nobody reads normals.
    fn filtered(&self, bytes: Vec<u8>) -> Option<Vec<u8>> {
        Some(match (self.filter, self.stride) {
            ("NONE" | "OCTAHEDRAL", _) => bytes,
            ("EXPONENTIAL", _) => {
                let (words, _) = bytes.as_chunks::<4>();
                let mut words: Vec<[u32; 1]> =
                    words.iter().map(|word| [u32::from_le_bytes(*word)]).collect();
                meshopt::decode_filter_exp(&mut words);
                words.into_iter().flatten().flat_map(u32::to_le_bytes).collect()
            }
            ("QUATERNION", 8) => {
                let (turns, _) = bytes.as_chunks::<8>();
                let short = |turn: &[u8; 8], i: usize| i16::from_le_bytes([turn[i], turn[i + 1]]);
                let mut turns: Vec<[i16; 4]> =
                    turns.iter().map(|turn| [0, 2, 4, 6].map(|i| short(turn, i))).collect();
                meshopt::decode_filter_quat(&mut turns);
                turns.into_iter().flatten().flat_map(i16::to_le_bytes).collect()
            }
            ("COLOR", 4) => {
                let mut colours = bytes.as_chunks::<4>().0.to_vec();
                meshopt::decode_filter_color(&mut colours);
                colours.into_flattened()
            }
            _ => return None,
        })
    }

    /// Indices as the bytes that they have in a file.
    fn indices(&self, indices: Vec<u32>) -> Option<Vec<u8>> {
        let narrow = |index: u32| index.to_le_bytes().into_iter().take(self.stride);
        matches!(self.stride, 2 | 4).then(|| indices.into_iter().flat_map(narrow).collect())
    }
}
