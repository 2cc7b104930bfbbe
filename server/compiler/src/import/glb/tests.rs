mod extensions;
mod lamps;
mod leaving_out;
mod movers;
mod sight;

use std::f32::consts::FRAC_PI_2;

use base64::Engine;
use glam::Vec3;
use serde_json::{Value, json};
use sightline_fixtures::glb_draft::GlbDraft;

use super::*;

/// Reads a draft.
fn read_draft(draft: &GlbDraft) -> Result<Model, GlbError> {
    read_slice(&draft.bytes(), None, "draft")
}

/// The model of a draft. Drafts are small, and the warning of that is left out.
fn read_model(draft: &GlbDraft) -> Model {
    let mut model = read_draft(draft).unwrap();
    model.warnings.retain(|warning| !warning.contains("which is small"));
    model
}

fn read_error(draft: &GlbDraft) -> String {
    read_draft(draft).expect_err("read without an error").to_string()
}

#[test]
fn a_square_is_two_opaque_triangles() {
    let model = read_model(&GlbDraft::square());
    assert_eq!(model.title, "draft");
    assert_eq!(model.opaque.len(), 2);
    assert_eq!(model.surfaces[0].triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(model.surfaces[0].material.colour, [255; 3]);
    assert!(model.warnings.is_empty() && model.solids.is_empty());
}

#[test]
fn transforms_of_all_ancestors_apply_and_quarter_turns_stay_exact() {
    let mut draft = GlbDraft::square();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    draft.root["nodes"] = json!([
        { "children": [1], "translation": [10.0, 0.0, 0.0] },
        { "mesh": 0, "rotation": [0.0, half, 0.0, half], "scale": [2.0, 3.0, 1.0] },
    ]);
    let model = read_model(&draft);
    // A quarter turn to the left takes +x to -z.
    let expected = [
        Vec3::new(10.0, 0.0, 0.0),
        Vec3::new(10.0, 0.0, -2.0),
        Vec3::new(10.0, 3.0, -2.0),
        Vec3::new(10.0, 3.0, 0.0),
    ];
    for (position, expected) in model.surfaces[0].positions.iter().zip(expected) {
        assert_eq!(position.x, 10.0);
        assert!((*position - expected).length() < 1e-5, "{position} {expected}");
    }
}

#[test]
fn indices_of_every_width_and_none_give_the_same_triangles() {
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0];
    let bytes = |width: usize| -> Vec<u8> {
        (0..3u32).flat_map(|i| i.to_le_bytes()[..width].to_vec()).collect()
    };
    for component in [None, Some((5121, 1)), Some((5123, 2)), Some((5125, 4))] {
        let mut draft = GlbDraft::new();
        let positions = draft.floats("VEC3", &corners);
        let mut primitive = json!({ "attributes": { "POSITION": positions } });
        if let Some((component, width)) = component {
            primitive["indices"] = json!(draft.accessor(component, "SCALAR", 3, &bytes(width)));
        }
        draft.primitive(primitive);
        assert_eq!(read_model(&draft).surfaces[0].triangles, [[0, 1, 2]], "{component:?}");
    }
}

#[test]
fn strips_and_fans_become_triangles_and_lines_are_left_out_with_a_warning() {
    for (mode, expected) in [
        (5, vec![[0, 1, 2], [2, 1, 3]]),
        (6, vec![[0, 1, 2], [0, 2, 3]]),
        (0, vec![]),
        (1, vec![]),
        (3, vec![]),
    ] {
        let mut draft = GlbDraft::new();
        let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0];
        let positions = draft.floats("VEC3", &corners);
        draft.primitive(json!({ "attributes": { "POSITION": positions }, "mode": mode }));
        let model = read_model(&draft);
        let triangles: Vec<[u32; 3]> =
            model.surfaces.iter().flat_map(|s| s.triangles.clone()).collect();
        let sorted = |mut t: [u32; 3]| {
            t.sort_unstable();
            t
        };
        let sets = |t: &[[u32; 3]]| t.iter().copied().map(sorted).collect::<Vec<_>>();
        assert_eq!(sets(&triangles), sets(&expected), "mode {mode}");
        assert_eq!(model.warnings.len(), usize::from(expected.is_empty()), "mode {mode}");
    }
}

#[test]
fn a_strip_keeps_its_winding() {
    let mut draft = GlbDraft::new();
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];
    let positions = draft.floats("VEC3", &corners);
    draft.primitive(json!({ "attributes": { "POSITION": positions }, "mode": 5 }));
    for [a, b, c] in read_model(&draft).opaque {
        assert!((b - a).cross(c - a).z > 0.0);
    }
}

#[test]
fn what_blocks_sight_follows_the_material() {
    let colour = |alpha: f32| json!({ "baseColorFactor": [1.0, 0.5, 0.0, alpha] });
    for (material, opaque) in [
        (json!({ "pbrMetallicRoughness": colour(1.0) }), true),
        (json!({ "pbrMetallicRoughness": colour(0.5) }), false),
        (json!({ "pbrMetallicRoughness": colour(1.0), "alphaMode": "BLEND" }), false),
        (json!({ "pbrMetallicRoughness": colour(1.0), "alphaMode": "MASK" }), false),
    ] {
        let mut draft = GlbDraft::square();
        draft.root["materials"] = json!([material]);
        draft.root["meshes"][0]["primitives"][0]["material"] = json!(0);
        let model = read_model(&draft);
        assert_eq!(model.opaque.len(), if opaque { 2 } else { 0 }, "{material}");
        assert_eq!(model.surfaces[0].material.glass, !opaque, "{material}");
        // A linear half is 188 in sRGB.
        assert_eq!(model.surfaces[0].material.colour, [255, 188, 0]);
    }
}

#[test]
fn textures_and_vertex_colours_are_read() {
    let pixels = sightline_picture::Picture::filled(2, 2, [10, 20, 30]);
    let picture = pixels.to_png().unwrap();
    let mut draft = GlbDraft::square();
    let view = draft.view(&picture);
    let uvs = draft.floats("VEC2", &[0.0, 0.0, 4.0, 0.0, 4.0, 4.0, 0.0, 4.0]);
    let colours = draft.accessor(5121, "VEC4", 4, &[255; 16]);
    draft.root["accessors"][colours]["normalized"] = json!(true);
    draft.root["images"] = json!([{ "bufferView": view, "mimeType": "image/png" }]);
    draft.root["textures"] = json!([{ "source": 0 }]);
    let texture = json!({ "index": 0, "texCoord": 1, "extensions": {
        "KHR_texture_transform": { "scale": [0.5, 1.0], "offset": [0.25, 0.0] },
    } });
    draft.root["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": texture } }]);
    let primitive = &mut draft.root["meshes"][0]["primitives"][0];
    primitive["material"] = json!(0);
    primitive["attributes"]["TEXCOORD_0"] = json!(uvs);
    primitive["attributes"]["TEXCOORD_1"] = json!(uvs);
    primitive["attributes"]["COLOR_0"] = json!(colours);
    let model = read_model(&draft);
    let surface = &model.surfaces[0];
    assert_eq!(surface.material.texture.as_deref(), Some(&pixels));
    assert_eq!(surface.uvs[2].to_array(), [2.25, 4.0]);
    assert_eq!(surface.colours, [[255; 3]; 4]);

    for image in [json!({ "uri": "missing.png" }), json!({}), json!({ "bufferView": 0 })] {
        draft.root["images"][0] = image;
        let model = read_model(&draft);
        assert!(model.surfaces[0].material.texture.is_none());
        assert_eq!(model.warnings.len(), 1, "{:?}", model.warnings);
    }
}

#[test]
fn a_spawn_point_is_where_feet_stand() {
    let mut draft = GlbDraft::square();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    draft.root["extensionsUsed"] = json!(["OMI_spawn_point"]);
    draft.root["scenes"] = json!([{ "nodes": [0, 1], "name": "Town hall" }]);
    draft.list(
        "nodes",
        json!({
            "translation": [1.0, 2.0, 3.0], "rotation": [0.0, half, 0.0, half],
            "extensions": { "OMI_spawn_point": { "title": "gate" } },
        }),
    );
    let model = read_model(&draft);
    assert_eq!(model.title, "Town hall");
    assert_eq!(model.spawns.len(), 1);
    assert!((model.spawns[0].eye - Vec3::new(1.0, 3.6, 3.0)).length() < 1e-6);
    assert!((model.spawns[0].yaw - FRAC_PI_2).abs() < 1e-6, "{:?}", model.spawns);
}

#[test]
fn a_node_with_the_name_of_a_spawn_point_is_one_and_is_not_drawn() {
    for (name, marks) in [
        ("spawn", true),
        ("Spawn.001", true),
        ("SPAWN_2", true),
        ("spawn:lobby", true),
        ("spawning pool", false),
        ("spawn_platform", false),
        ("respawn", false),
        ("späwn", false),
    ] {
        let mut draft = GlbDraft::square();
        draft.root["nodes"][0]["name"] = json!(name);
        draft.root["nodes"][0]["translation"] = json!([1.0, 2.0, 3.0]);
        let model = read_model(&draft);
        assert_eq!(model.spawns.len(), usize::from(marks), "{name}");
        assert_eq!(model.surfaces.is_empty(), marks, "{name}");
        if marks {
            assert_eq!(model.spawns[0].eye, Vec3::new(1.0, 3.6, 3.0));
        }
    }
}

#[test]
fn triangles_without_area_are_dropped() {
    let mut draft = GlbDraft::new();
    let positions = draft.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0]);
    draft.primitive(json!({ "attributes": { "POSITION": positions } }));
    let model = read_model(&draft);
    assert!(model.opaque.is_empty() && model.surfaces.is_empty());
}

#[test]
fn hostile_documents_are_refused_with_a_reason() {
    let check = |edit: &dyn Fn(&mut Value), expected: &str| {
        let mut draft = GlbDraft::square();
        edit(&mut draft.root);
        let error = read_error(&draft);
        assert!(error.contains(expected), "{error:?} does not contain {expected:?}");
    };
    check(&|root| root["accessors"][0]["count"] = json!(5), "beyond its bytes");
    check(&|root| root["accessors"][0]["count"] = json!(u32::MAX), "too many");
    check(&|root| root["accessors"][1]["count"] = json!(u64::MAX / 2), "too many");
    check(&|root| root["accessors"][0]["byteOffset"] = json!(u64::MAX), "beyond its bytes");
    check(&|root| root["bufferViews"][0]["byteOffset"] = json!(u64::MAX), "beyond its bytes");
    check(&|root| root["bufferViews"][0]["byteLength"] = json!(1u64 << 40), "beyond its bytes");
    check(&|root| root["accessors"][0]["type"] = json!("VEC2"), "too few components");
    check(&|root| root["accessors"][1]["componentType"] = json!(5126), "not made of indices");
    check(&|root| root["buffers"][0]["byteLength"] = json!(1 << 30), "bytes where");
    check(&|root| root["nodes"][0]["scale"] = json!([1e30, 1.0, 1.0]), "would be");
    check(&|root| root["nodes"][0]["children"] = json!([0]), "nest deeper");
    check(&|root| root["nodes"][0]["children"] = json!([0, 0, 0]), "nest deeper");
    let attributes = json!({ "POSITION": 99 });
    check(
        &|root| root["meshes"][0]["primitives"][0]["attributes"] = attributes.clone(),
        "accessor 99: is not there",
    );
    check(&|root| root["nodes"][0]["mesh"] = json!(7), "not valid glTF");
    check(&|root| root["asset"]["version"] = json!(7), "not valid glTF");
}

#[test]
fn indices_beyond_the_vertices_are_refused() {
    let mut draft = GlbDraft::new();
    let positions = draft.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0]);
    let indices = draft.accessor(5121, "SCALAR", 3, &[0, 1, 3]);
    draft.primitive(json!({ "attributes": { "POSITION": positions }, "indices": indices }));
    assert_eq!(read_error(&draft), "mesh 0: index 3 is beyond its 3 vertices");
}

#[test]
fn files_beside_the_model_are_read_and_those_elsewhere_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let mut draft = GlbDraft::square();
    std::fs::create_dir(folder.path().join("models")).unwrap();
    std::fs::write(folder.path().join("models/my data.bin"), &draft.bin).unwrap();
    std::fs::write(folder.path().join("data.bin"), &draft.bin).unwrap();
    let path = folder.path().join("models/square.gltf");
    let data = base64::engine::general_purpose::STANDARD.encode(&draft.bin);
    let mut read_with = |uri: &str| {
        draft.root["buffers"][0]["uri"] = json!(uri);
        std::fs::write(&path, draft.root.to_string()).unwrap();
        read(&path)
    };
    let within = format!("data:application/octet-stream;base64,{data}");
    for uri in ["my%20data.bin", &within, &format!("data:{data}")] {
        assert_eq!(read_with(uri).unwrap().opaque.len(), 2, "{uri}");
    }
    let absolute = folder.path().join("data.bin").display().to_string();
    for uri in ["../data.bin", "models/../../data.bin", "..%2Fdata.bin", &absolute] {
        let error = read_with(uri).unwrap_err().to_string();
        assert!(error.contains("outside the model's folder"), "{uri}: {error}");
    }
    std::fs::write(folder.path().join("models/100%25.bin"), &GlbDraft::square().bin).unwrap();
    assert_eq!(read_with("100%25.bin").unwrap().opaque.len(), 2, "a name as it is written");
    let missing = folder.path().join("models/no data.bin").display().to_string();
    let error = read_with("no%20data.bin").unwrap_err().to_string();
    assert!(error.contains(&format!("cannot read {missing}: ")), "{error}");
    for uri in ["http://localhost/data.bin", "file:///etc/passwd", "%FF", "nothing.bin", "data:,x"]
    {
        assert!(read_with(uri).is_err(), "{uri}");
    }
}
