//! Lamps, surfaces that give light, and nodes that are named as lights.

use super::*;
use crate::model::LampSource;

/// Adds a node to the scene.
fn add_node(draft: &mut GlbDraft, node: Value) {
    let index = draft.list("nodes", node);
    draft.root["scenes"][0]["nodes"].as_array_mut().expect("nodes").push(json!(index));
}

fn with_lights(lights: Value) -> GlbDraft {
    let mut draft = GlbDraft::square();
    draft.root["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    draft.root["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    draft
}

#[test]
fn punctual_lights_are_lamps_where_their_nodes_are() {
    let mut draft = with_lights(json!([
        { "type": "point", "intensity": 80.0, "color": [1.0, 0.5, 0.25] },
        { "type": "spot", "intensity": 10.0, "spot": { "outerConeAngle": 0.5 } },
        { "type": "directional" },
        { "type": "moon" },
    ]));
    for light in 0..4 {
        let node = json!({
            "translation": [1.0, 2.0, light as f32],
            "extensions": { "KHR_lights_punctual": { "light": light } },
        });
        add_node(&mut draft, node);
    }
    let model = read_model(&draft);
    let [point, spot, parallel] = &model.lamps[..] else { panic!("{:?}", model.lamps) };
    assert_eq!(point.source, LampSource::Point(Vec3::new(1.0, 2.0, 0.0)));
    assert_eq!(point.intensity, [80.0, 40.0, 20.0]);
    let cosines = [1.0, 0.5f64.cos() as f32];
    let (at, along) = (Vec3::new(1.0, 2.0, 1.0), Vec3::NEG_Z);
    assert_eq!(spot.source, LampSource::Spot { at, along, cosines });
    assert_eq!(parallel.source, LampSource::Parallel(Vec3::NEG_Z));
    let [warning] = &model.warnings[..] else { panic!("{:?}", model.warnings) };
    assert!(warning.contains("unknown kind"), "{warning}");
}

#[test]
fn materials_and_names_make_surfaces_give_light() {
    let mut draft = GlbDraft::square();
    draft.root["materials"] = json!([{
        "emissiveFactor": [1.0, 0.5, 0.0],
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 4.0 } },
    }]);
    draft.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    assert_eq!(read_model(&draft).surfaces[0].material.emission, [4.0, 2.0, 0.0]);

    let mut draft = GlbDraft::square();
    assert_eq!(read_model(&draft).surfaces[0].material.emission, [0.0; 3]);
    draft.root["nodes"][0]["name"] = json!("light:panel");
    let bulb = json!({ "name": "light:bulb", "translation": [0.0, 3.0, 0.0] });
    add_node(&mut draft, bulb);
    let model = read_model(&draft);
    assert_eq!(model.surfaces[0].material.emission, [8.0; 3]);
    assert_eq!(model.opaque.len(), 2, "a panel blocks sight");
    let [bulb] = &model.lamps[..] else { panic!("{:?}", model.lamps) };
    assert_eq!(bulb.source, LampSource::Point(Vec3::Y * 3.0));
}
