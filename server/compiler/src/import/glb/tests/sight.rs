//! What blocks sight, what is drawn, and what stops bodies.

use super::*;

/// How many triangles of a square block sight and are drawn, and whether they are drawn as glass.
fn shown(draft: &GlbDraft) -> (usize, usize, Option<bool>) {
    let model = read_model(draft);
    let drawn = model.surfaces.iter().map(|surface| surface.triangles.len()).sum();
    (model.opaque.len(), drawn, model.surfaces.first().map(|surface| surface.material.glass))
}

fn with_material(material: &Value) -> GlbDraft {
    let mut draft = GlbDraft::square();
    draft.root["materials"] = json!([material]);
    draft.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    draft
}

#[test]
fn what_transmits_light_lets_sight_through() {
    let with = |name: &str, value: Value| json!({ "extensions": { name: value } });
    for (material, is_opaque) in [
        (with("KHR_materials_transmission", json!({ "transmissionFactor": 0.9 })), false),
        (with("KHR_materials_transmission", json!({})), true),
        (with("KHR_materials_volume", json!({ "thicknessFactor": 0.1 })), false),
        (
            with("KHR_materials_diffuse_transmission", json!({ "diffuseTransmissionFactor": 1 })),
            false,
        ),
        (with("KHR_materials_clearcoat", json!({ "clearcoatFactor": 1.0 })), true),
        (with("KHR_materials_unlit", json!({})), true),
        (
            with("KHR_materials_pbrSpecularGlossiness", json!({ "diffuseFactor": [1, 1, 1, 0.4] })),
            false,
        ),
    ] {
        let (hides, drawn, glass) = shown(&with_material(&material));
        assert_eq!((hides, drawn, glass), (if is_opaque { 2 } else { 0 }, 2, Some(!is_opaque)));
    }
}

#[test]
fn an_unknown_extension_of_a_material_hides_nobody_and_is_named() {
    let material = json!({ "extensions": { "ACME_materials_smoke": {} } });
    let draft = with_material(&material);
    assert_eq!(shown(&draft), (0, 2, Some(false)));
    let [warning] = &read_model(&draft).warnings[..] else { panic!() };
    assert!(warning.starts_with("1 meshes have materials with ACME_materials_smoke"), "{warning}");
}

#[test]
fn names_of_nodes_and_of_their_ancestors_tell_the_purpose() {
    for (name, told) in [
        ("occluder:wall", (2, 0, None)),
        ("wall-occ.001", (2, 0, None)),
        ("detail:plant", (0, 2, Some(false))),
        ("plant-noocc", (0, 2, Some(false))),
        ("collider:rail", (0, 2, Some(true))),
        ("rail-col", (0, 2, Some(true))),
    ] {
        let mut draft = GlbDraft::square();
        draft.root["nodes"] =
            json!([{ "name": name, "children": [1] }, { "mesh": 0, "name": "a" }]);
        assert_eq!(shown(&draft), told, "{name}");
        if name.contains("rail") {
            assert!(read_model(&draft).surfaces[0].material.is_unseen(), "{name}");
        }
    }
}

#[test]
fn black_glass_is_not_taken_for_a_collider() {
    let material = json!({
        "pbrMetallicRoughness": { "baseColorFactor": [0, 0, 0, 0.5] }, "alphaMode": "BLEND",
    });
    assert!(!read_model(&with_material(&material)).surfaces[0].material.is_unseen());
}

#[test]
fn hidden_nodes_and_their_descendants_are_left_out() {
    let mut draft = GlbDraft::square();
    draft.root["nodes"] = json!([{ "children": [1] }, { "mesh": 0 }]);
    for (visible, count) in [(true, 2), (false, 0)] {
        draft.root["nodes"][0]["extensions"] =
            json!({ "KHR_node_visibility": { "visible": visible } });
        assert_eq!(read_model(&draft).opaque.len(), count);
    }
}
