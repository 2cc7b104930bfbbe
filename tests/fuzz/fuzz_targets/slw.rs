//! Reads arbitrary sections as a world, in a file whose hash is right, and whole files.

#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use sightline_fixtures::two_rooms;
use sightline_world::World;

/// The magic number and the version, with which world files begin.
static BEGINNING: LazyLock<Vec<u8>> = LazyLock::new(|| two_rooms::world().to_bytes()[..8].to_vec());

fuzz_target!(|bytes: &[u8]| {
    let _ = World::from_bytes(bytes);
    let _ = World::from_bytes(&packed(bytes));
});

/// A world file of these sections.
fn packed(sections: &[u8]) -> Vec<u8> {
    let packed = zstd::encode_all(sections, 1).expect("memory is enough");
    let hashed = [&(sections.len() as u64).to_le_bytes()[..], &packed].concat();
    let id = blake3::hash(&hashed);
    [&BEGINNING[..], id.as_bytes(), &hashed].concat()
}
