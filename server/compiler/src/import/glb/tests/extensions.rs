//! Extensions that are understood, ignored or refused; and faulty parts.

use super::*;

#[test]
fn a_required_extension_is_understood_harmless_or_refused_with_its_name() {
    let mut draft = GlbDraft::square();
    for name in ["KHR_mesh_quantization", "KHR_materials_sheen", "KHR_xmp_json_ld", "OMI_seat"] {
        draft.root["extensionsRequired"] = json!([name]);
        draft.root["extensionsUsed"] = json!([name]);
        assert_eq!(read_model(&draft).opaque.len(), 2, "{name}");
    }
    draft.root["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    let error = read_error(&draft);
    assert!(error.contains("requires KHR_draco_mesh_compression"), "{error}");
    assert!(error.contains("npx @gltf-transform/cli copy"), "{error}");
    draft.root["extensionsRequired"] = json!(["ACME_a", "KHR_texture_transform", "ACME_b"]);
    assert!(read_error(&draft).contains("requires ACME_a, ACME_b, which cannot be read"));
}

#[test]
fn every_instance_of_a_mesh_is_read() {
    let mut draft = GlbDraft::square();
    let moved = draft.floats("VEC3", &[0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 9.0, 0.0, 1.0]);
    let scaled = draft.floats("VEC3", &[1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 1.0, 1.0, -1.0]);
    let attributes = json!({ "TRANSLATION": moved, "SCALE": scaled });
    draft.root["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    let model = read_model(&draft);
    assert_eq!(model.opaque.len(), 6);
    assert_eq!(model.surfaces[1].positions[1], Vec3::new(7.0, 0.0, 0.0));
    assert_eq!(model.surfaces[2].positions[0], Vec3::new(9.0, 0.0, 1.0));

    draft.root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] =
        json!({ "TRANSLATION": 99 });
    assert!(read_error(&draft).contains("accessor 99: is not there"));
}

#[test]
fn mirrored_meshes_keep_their_fronts() {
    let mut draft = GlbDraft::square();
    draft.root["nodes"][0]["scale"] = json!([-1.0, 1.0, 1.0]);
    let model = read_model(&draft);
    for [a, b, c] in model.opaque {
        assert!((b - a).cross(c - a).z > 0.0);
    }
    assert!(model.warnings[0].starts_with("1 meshes are mirrored"), "{:?}", model.warnings);
}

#[test]
fn faulty_parts_are_left_out_and_counted() {
    let mut draft = GlbDraft::square();
    let positions = draft.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, f32::NAN, 1.0, 0.0]);
    draft.primitive(json!({ "attributes": { "POSITION": positions } }));
    let indices = draft.accessor(5121, "SCALAR", 3, &[0, 1, 9]);
    draft.primitive(json!({ "attributes": { "POSITION": 0 }, "indices": indices }));
    let model = read_model(&draft);
    assert_eq!(model.opaque.len(), 2);
    let [warning] = &model.warnings[..] else { panic!("{:?}", model.warnings) };
    assert!(warning.starts_with("2 parts left out, because they are faulty: mesh 0: vertex 2 is"));
}

#[test]
fn textures_come_from_the_extension_that_can_be_read() {
    let webp: Vec<u8> = {
        let mut bytes = Vec::new();
        let encoder = image_webp::WebPEncoder::new(&mut bytes);
        encoder.encode(&[10, 20, 30].repeat(4), 2, 2, image_webp::ColorType::Rgb8).unwrap();
        bytes
    };
    let mut draft = GlbDraft::square();
    let uvs = draft.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    let view = draft.view(&webp);
    let ktx = draft.view(b"\xabKTX 20\xbb\r\n\x1a\n");
    draft.root["images"] = json!([{ "bufferView": view }, { "bufferView": ktx }]);
    draft.root["materials"] =
        json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
    let primitive = &mut draft.root["meshes"][0]["primitives"][0];
    primitive["material"] = json!(0);
    primitive["attributes"]["TEXCOORD_0"] = json!(uvs);
    draft.root["textures"] =
        json!([{ "extensions": { "EXT_texture_webp": { "source": 0 } }, "source": 1 }]);
    let model = read_model(&draft);
    let texture = model.surfaces[0].material.texture.as_deref().unwrap();
    assert_eq!(texture.pixel(0, 0), [10, 20, 30]);

    draft.root["textures"] = json!([{ "extensions": { "KHR_texture_basisu": { "source": 1 } } }]);
    let model = read_model(&draft);
    assert!(model.surfaces[0].material.texture.is_none());
    let [warning] = &model.warnings[..] else { panic!("{:?}", model.warnings) };
    assert!(warning.contains("KTX2") && warning.contains("ktxdecompress"), "{warning}");

    draft.root["textures"] = json!([{}]);
    assert!(read_model(&draft).warnings[0].contains("it has no source"));
}

#[test]
fn compressed_views_are_decompressed_and_hostile_ones_are_left_out() {
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]];
    let words = corners.map(|corner| corner.map(f32::to_bits));
    let vertices = meshopt::encode_vertex_buffer(&words).unwrap();
    let indices = meshopt::encode_index_buffer(&[0, 1, 2], 3).unwrap();
    let mut draft = GlbDraft::new();
    let compressed = |draft: &mut GlbDraft, bytes: &[u8], mode: &str, stride: usize| {
        let view = draft.view(bytes);
        let place = draft.root["bufferViews"][view].clone();
        let extension = json!({
            "buffer": 0, "byteOffset": place["byteOffset"], "byteLength": bytes.len(),
            "mode": mode, "byteStride": stride, "count": 3,
        });
        draft.root["bufferViews"][view] = json!({
            "buffer": 1, "byteLength": 3 * stride,
            "extensions": { "EXT_meshopt_compression": extension },
        });
        view
    };
    let positions = compressed(&mut draft, &vertices, "ATTRIBUTES", 12);
    let triangle = compressed(&mut draft, &indices, "TRIANGLES", 2);
    draft.list(
        "buffers",
        json!({
            "byteLength": 42, "extensions": { "EXT_meshopt_compression": { "fallback": true } },
        }),
    );
    draft.list(
        "accessors",
        json!({
            "bufferView": positions, "componentType": 5126, "type": "VEC3", "count": 3,
            "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 0.0],
        }),
    );
    draft.list(
        "accessors",
        json!({ "bufferView": triangle, "componentType": 5123, "type": "SCALAR", "count": 3 }),
    );
    draft.primitive(json!({ "attributes": { "POSITION": 0 }, "indices": 1 }));
    assert_eq!(read_model(&draft).opaque, [corners.map(Vec3::from)]);

    let extension = |draft: &mut GlbDraft, key: &str, value: Value| {
        draft.root["bufferViews"][positions]["extensions"]["EXT_meshopt_compression"][key] = value;
    };
    for (key, value) in [
        ("count", json!(u64::MAX)),
        ("count", json!(1 << 24)),
        ("byteStride", json!(1u64 << 40)),
        ("byteLength", json!(3)),
        ("buffer", json!(7)),
        ("mode", json!("TRIANGLES")),
        ("filter", json!("QUATERNION")),
    ] {
        let view = &draft.root["bufferViews"][positions];
        let before = view["extensions"]["EXT_meshopt_compression"][key].clone();
        extension(&mut draft, key, value);
        assert!(read_error(&draft).contains("beyond its bytes"), "{key}");
        extension(&mut draft, key, if before.is_null() { json!("NONE") } else { before });
    }
}

#[test]
fn compressed_views_that_share_their_bytes_are_bounded_together() {
    let zeros = vec![[0u32; 16]; 1 << 14];
    let packed = meshopt::encode_vertex_buffer(&zeros).unwrap();
    let mut draft = GlbDraft::square();
    let view = draft.view(&packed);
    let place = draft.root["bufferViews"][view].clone();
    let extension = json!({
        "buffer": 0, "byteOffset": place["byteOffset"], "byteLength": packed.len(),
        "mode": "ATTRIBUTES", "byteStride": 64, "count": zeros.len(),
    });
    // Each becomes 1 MiB.
    for _ in 0..1 << 10 {
        draft.list(
            "bufferViews",
            json!({
                "buffer": 0, "byteLength": packed.len(),
                "extensions": { "EXT_meshopt_compression": extension },
            }),
        );
    }
    assert!(read_error(&draft).contains("too many bytes in compressed views"));
}

#[test]
fn points_and_lines_are_left_out_and_counted() {
    let mut draft = GlbDraft::square();
    for mode in [0, 1, 3] {
        draft.primitive(json!({ "attributes": { "POSITION": 0 }, "mode": mode }));
    }
    let model = read_model(&draft);
    assert_eq!(model.opaque.len(), 2);
    let [lines] = &model.warnings[..] else { panic!("{:?}", model.warnings) };
    assert!(lines.starts_with("3 primitives are left out: they are points or lines"), "{lines}");
}

#[test]
fn nodes_that_name_their_children_twice_place_a_bounded_number_of_primitives() {
    let mut draft = GlbDraft::square();
    for _ in 0..15 {
        draft.primitive(json!({ "attributes": { "POSITION": 0 }, "mode": 0 }));
    }
    let last = 19;
    let nodes: Vec<Value> = (0..last)
        .map(|at| json!({ "mesh": 0, "children": [at + 1, at + 1] }))
        .chain([json!({ "mesh": 0 })])
        .collect();
    draft.root["nodes"] = json!(nodes);
    draft.root["scenes"] = json!([{ "nodes": [0] }]);
    assert!(read_error(&draft).contains("too many copies of meshes"));
}

#[test]
fn a_few_bytes_cannot_ask_for_much_memory() {
    let mut draft = GlbDraft::square();
    let indices = draft.view(&[0; 4]);
    let values = draft.view(&[0; 12]);
    draft.root["accessors"][0] = json!({
        "componentType": 5126, "type": "VEC3", "count": 20_000_000,
        "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 0.0],
        "sparse": {
            "count": 1, "indices": { "bufferView": indices, "componentType": 5125 },
            "values": { "bufferView": values },
        },
    });
    let error = read_error(&draft);
    assert!(error.contains("has no bytes") || error.contains("too many"), "{error}");
}
