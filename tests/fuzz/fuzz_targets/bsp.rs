//! Reads arbitrary bytes as a map of Quake III.

#![no_main]

use libfuzzer_sys::fuzz_target;
use sightline_compiler::import::bsp;

fuzz_target!(|bytes: &[u8]| {
    let _ = bsp::read_slice(bytes, &[], "fuzz");
});
