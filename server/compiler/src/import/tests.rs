use std::path::Path;

use sightline_fixtures::{glb_draft::GlbDraft, shared_files::shared_file};

use super::*;
use crate::model::ConvexSolid;

/// The error of `read` for a file with these bytes, in one line.
fn error_of(name: &str, bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    line(read(&path, &[]).expect_err("read without an error"))
}

fn line(error: ReadError) -> String {
    let line = format!("{:#}", anyhow::Error::new(error));
    assert!(!line.contains('\n'), "{line:?}");
    line
}

#[test]
fn invalid_files_are_refused_with_one_clear_line() {
    let glb = sightline_demo_building::glb(1, 1);
    let mut nan = glb.clone();
    // Positions of every mesh, and all else.
    let json_length = u32::from_le_bytes(nan[12..16].try_into().unwrap()) as usize;
    let chunk = 20 + json_length + 8;
    for float in nan[chunk..].chunks_exact_mut(4) {
        float.copy_from_slice(&f32::NAN.to_le_bytes());
    }
    let mut old_bsp = b"IBSP".to_vec();
    old_bsp.extend(38i32.to_le_bytes());
    old_bsp.resize(144, 0);
    for (name, bytes, expected) in [
        ("notes.txt", &b"Dear diary"[..], "neither GLB, glTF nor a Quake III BSP"),
        ("notes.glb", b"Dear diary", "neither GLB, glTF nor a Quake III BSP"),
        ("notes.gltf", b"Dear diary", "not valid glTF 2.0"),
        ("empty.glb", b"", "is empty"),
        ("cut.glb", &glb[..glb.len() / 2], "truncated GLB"),
        ("cut.glb", &glb[..9], "truncated GLB"),
        ("nan.glb", &nan, "not finite"),
        ("old.bsp", &old_bsp, "BSP version 38; only version 46 can be read"),
        ("cut.bsp", b"IBSP\x2e\0\0\0", "truncated BSP"),
    ] {
        let error = error_of(name, bytes);
        assert!(error.contains(expected) && error.contains(name), "{name}: {error}");
    }
    let folder = tempfile::tempdir().unwrap();
    assert!(line(read(folder.path(), &[]).unwrap_err()).contains("not a regular file"));
    let missing = folder.path().join("missing.glb");
    assert!(line(read(&missing, &[]).unwrap_err()).contains("cannot read"));
}

/// A reader of hostile bytes, which tells whether they gave a model.
type Attempt<'a> = &'a dyn Fn(&[u8]) -> bool;

/// Changes every byte, and tries every length. The reader gives an error or a model, and never
/// panics.
fn damage(bytes: &[u8], attempt: Attempt<'_>) {
    assert!(attempt(bytes));
    for length in 0..bytes.len() {
        attempt(&bytes[..length]);
    }
    let mut damaged = bytes.to_vec();
    for i in 0..bytes.len() {
        for flip in [0x01, 0x10, 0x80, 0xff, bytes[i], !bytes[i]] {
            damaged[i] = bytes[i] ^ flip;
            attempt(&damaged);
        }
        damaged[i] = bytes[i];
    }
}

#[test]
fn no_damage_to_a_glb_makes_its_reader_panic() {
    for draft in [GlbDraft::square(), GlbDraft::sliding_door()] {
        damage(&draft.bytes(), &|bytes| glb::read_slice(bytes, None, "damaged").is_ok());
    }
}

#[test]
fn no_damage_to_a_bsp_makes_its_reader_panic() {
    let bsp = bsp::tests::BspDraft::unlit_room().bytes();
    damage(&bsp, &|bytes| bsp::read_slice(bytes, &[], "damaged").is_ok());
}

/// A real map or building; none when it is absent.
fn real(file: &str) -> Option<Model> {
    Some(read(&shared_file(file)?, &[]).unwrap())
}

#[test]
fn real_maps_have_surfaces_solids_and_spawn_points() {
    for (map, solids_min) in
        [("oa_dm4", 600), ("aggressor", 600), ("oa_dm2", 1_200), ("delta", 300)]
    {
        let Some(model) = real(&format!("maps/{map}.bsp")) else { return };
        let drawn: usize = model.surfaces.iter().map(|s| s.triangles.len()).sum();
        assert!(drawn > 5_000, "{map}: {drawn} drawn");
        assert!(model.opaque.len() > 3_000, "{map}: {} opaque", model.opaque.len());
        assert!(model.solids.len() >= solids_min, "{map}: {} solids", model.solids.len());
        assert!(!model.spawns.is_empty(), "{map}");
        for spawn in &model.spawns {
            let inside = |solid: &&ConvexSolid| solid.contains(spawn.eye.as_dvec3(), -1e-3);
            assert!(model.solids.iter().find(inside).is_none(), "{map}: {spawn:?}");
        }
        let bounds = model.bounds().unwrap();
        assert!(bounds.size().max_element() < 300.0, "{map}: {bounds:?}");
        assert!(model.warnings.is_empty(), "{map}: {:?}", model.warnings);
    }
}

#[test]
fn the_building_of_the_crowd_trace_is_read_without_a_warning() {
    let Some(model) = real("traces/rooms400.glb") else { return };
    assert!(model.warnings.is_empty(), "{:?}", model.warnings);
    assert!(model.opaque.len() > 10_000);
}

#[test]
fn the_demo_building_is_read_back_whole() {
    let building = sightline_demo_building::build(12, 3);
    let model = glb::read_slice(&building.glb, None, "demo").unwrap();
    assert_eq!(model.title, "Demo building");
    assert!(model.warnings.is_empty(), "{:?}", model.warnings);
    assert!(model.spawns.len() >= 10);
    let drawn: usize = model.surfaces.iter().map(|s| s.triangles.len()).sum();
    assert!(drawn > building.triangles * 95 / 100);
    assert!(model.surfaces.iter().any(|s| s.material.glass));
    assert!(Path::new(&title_of(Path::new("a/b.glb"))).ends_with("b"));
}
