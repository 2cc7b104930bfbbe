//! Reads arbitrary bytes as glTF: whole files, or JSON and data in a file whose lengths are right.

#![no_main]

use libfuzzer_sys::fuzz_target;
use sightline_compiler::import::glb;

fuzz_target!(|bytes: &[u8]| {
    let _ = if bytes.starts_with(b"glTF") {
        glb::read_slice(bytes, None, "fuzz")
    } else {
        glb::read_slice(&wrapped(bytes), None, "fuzz")
    };
});

/// A binary file of the JSON before the first zero byte and the data after it.
fn wrapped(bytes: &[u8]) -> Vec<u8> {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let (json, data) = (&bytes[..end], bytes.get(end + 1..).unwrap_or_default());
    let mut chunks = Vec::new();
    for (kind, content, filler) in [(b"JSON", json, b' '), (b"BIN\0", data, 0)] {
        let length = content.len().next_multiple_of(4);
        chunks.extend((length as u32).to_le_bytes());
        chunks.extend(kind);
        chunks.extend(content);
        chunks.resize(chunks.len() + length - content.len(), filler);
    }
    let length = 12 + chunks.len() as u32;
    [&b"glTF"[..], &2_u32.to_le_bytes(), &length.to_le_bytes(), &chunks].concat()
}
