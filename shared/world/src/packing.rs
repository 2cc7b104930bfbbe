//! Packing bytes with zstd (RFC 8878), and unpacking them.
//!
//! Natively the C library does both. In a browser (`wasm32`) a library in pure Rust does. Each
//! reads what the other wrote, but the packed bytes differ, and so do the content ids made of them.

#[cfg(not(target_arch = "wasm32"))]
pub(crate) use native::{Unpacker, pack};
#[cfg(target_arch = "wasm32")]
pub(crate) use portable::{Unpacker, pack};

#[cfg(not(target_arch = "wasm32"))]
mod native {
    use std::io::{self, Read};

    use zstd::stream::read::Decoder;

    /// One frame with all the bytes, at a compression level of zstd.
    pub(crate) fn pack(bytes: &[u8], level: i32) -> Vec<u8> {
        zstd::bulk::compress(bytes, level)
            .expect("zstd into memory fails only when memory runs out")
    }

    /// Reads what is in a frame. It takes memory for one window, whatever the frame claims.
    pub(crate) struct Unpacker<'a>(Decoder<'a, &'a [u8]>);

    impl<'a> Unpacker<'a> {
        pub(crate) fn new(packed: &'a [u8]) -> io::Result<Self> {
            Decoder::with_buffer(packed).map(Self)
        }
    }

    impl Read for Unpacker<'_> {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            self.0.read(into)
        }
    }
}

/// Compiled natively only for tests, which compare it with the C library.
#[cfg(any(target_arch = "wasm32", test))]
mod portable {
    use std::io::{self, Read};

    use ruzstd::{
        decoding::StreamingDecoder,
        encoding::{CompressionLevel, compress_to_vec},
    };

    /// One frame with all the bytes. There is one compression level only.
    pub(crate) fn pack(bytes: &[u8], _level: i32) -> Vec<u8> {
        compress_to_vec(bytes, CompressionLevel::Fastest)
    }

    /// Reads what is in a frame. It takes memory for one window, whatever the frame claims.
    pub(crate) struct Unpacker<'a>(StreamingDecoder<&'a [u8], ruzstd::decoding::FrameDecoder>);

    impl<'a> Unpacker<'a> {
        pub(crate) fn new(packed: &'a [u8]) -> io::Result<Self> {
            StreamingDecoder::new(packed).map(Self).map_err(io::Error::other)
        }
    }

    impl Read for Unpacker<'_> {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            let count = self.0.read(into)?;
            // The C library refuses bytes after the frame; here they would go unnoticed.
            if count == 0 && !into.is_empty() && !self.0.get_ref().is_empty() {
                return Err(io::Error::other("bytes after the end of a zstd frame"));
            }
            Ok(count)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{self, Read};

    use proptest::prelude::*;

    use super::{native, portable};

    fn unpack(mut unpacker: impl Read) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        unpacker.read_to_end(&mut bytes).map(|_| bytes)
    }

    fn check(bytes: &[u8]) {
        for level in [3, 6, 7, 19] {
            let packed = native::pack(bytes, level);
            assert_eq!(unpack(portable::Unpacker::new(&packed).unwrap()).unwrap(), bytes);
            assert_eq!(unpack(native::Unpacker::new(&packed).unwrap()).unwrap(), bytes);
        }
        let packed = portable::pack(bytes, 0);
        assert_eq!(unpack(native::Unpacker::new(&packed).unwrap()).unwrap(), bytes);
    }

    #[test]
    fn each_library_reads_what_the_other_wrote() {
        check(&[]);
        check(&[7; 100_000]);
        // Longer than a window, with matches near and far.
        let mut state = 1u32;
        let noise = (0..3 << 20).map(|i: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            if i % 1_000 < 600 { (i / 7) as u8 } else { (state >> 24) as u8 & 0x1f }
        });
        check(&noise.collect::<Vec<_>>());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn both_libraries_survive_damage(
            bytes in prop::collection::vec(0u8..4, 0..2_000),
            at in any::<prop::sample::Index>(),
            flip in 1u8..,
            cut in any::<prop::sample::Index>(),
        ) {
            let mut packed = native::pack(&bytes, 6);
            let part = &packed[..cut.index(packed.len())];
            prop_assert!(portable::Unpacker::new(part).and_then(unpack).is_err());
            let at = at.index(packed.len());
            packed[at] ^= flip;
            // Without a checksum a damaged frame may unpack to other bytes.
            let _ = portable::Unpacker::new(&packed).and_then(unpack);
            let longer = [native::pack(&bytes, 6).as_slice(), &[0]].concat();
            prop_assert!(portable::Unpacker::new(&longer).and_then(unpack).is_err());
            prop_assert!(native::Unpacker::new(&longer).and_then(unpack).is_err());
        }
    }
}
