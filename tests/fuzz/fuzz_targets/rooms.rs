//! Reads arbitrary text as a file of rooms.

#![no_main]

use libfuzzer_sys::fuzz_target;
use sightline_compiler::rooms::text;

fuzz_target!(|text: &str| {
    let _ = text::read(text, "fuzz.rooms.toml");
});
