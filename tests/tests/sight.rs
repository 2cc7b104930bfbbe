//! What a model says of sight, from the file to the engine: somebody behind a wall is told of or
//! not, as the wall's material, name or extension says.

use std::{ops::ControlFlow, sync::Arc, time::Duration};

use glam::Vec3;
use serde_json::{Value, json};
use sightline_compiler::{CompileOptions, LightMethod, compile, import::glb};
use sightline_engine::{Config, Engine, Input, Output};
use sightline_fixtures::{boxes::box_triangles, glb_draft::GlbDraft};
use sightline_world::{World, geometry::Aabb, motion::AvatarId};

const HERE: AvatarId = AvatarId(1);
const THERE: AvatarId = AvatarId(2);
/// The wall that parts the hall.
const WALL: [[f32; 3]; 2] = [[5.9, 0.0, 0.0], [6.1, 3.0, 6.0]];

/// Adds a mesh of boxes, and gives its index.
fn boxes(draft: &mut GlbDraft, boxes: &[[[f32; 3]; 2]]) -> usize {
    let triangles: Vec<[Vec3; 3]> = boxes
        .iter()
        .flat_map(|[min, max]| box_triangles(&Aabb::new(Vec3::from(*min), Vec3::from(*max))))
        .collect();
    let corners: Vec<f32> = triangles.as_flattened().iter().flat_map(|c| c.to_array()).collect();
    let positions = draft.floats("VEC3", &corners);
    draft.root["accessors"][positions]["max"] = json!([13.0, 4.0, 7.0]);
    draft.list("meshes", json!({ "primitives": [{ "attributes": { "POSITION": positions } }] }))
}

/// A closed hall of 12 m × 6 m that a wall parts. The wall has a material and a node as given.
fn hall(material: &Value, node: &Value) -> World {
    let mut draft = GlbDraft::new();
    let shell = [
        [[0.0, -0.2, 0.0], [12.0, 0.0, 6.0]],
        [[0.0, 3.0, 0.0], [12.0, 3.2, 6.0]],
        [[0.0, 0.0, -0.2], [12.0, 3.0, 0.0]],
        [[0.0, 0.0, 6.0], [12.0, 3.0, 6.2]],
        [[-0.2, 0.0, 0.0], [0.0, 3.0, 6.0]],
        [[12.0, 0.0, 0.0], [12.2, 3.0, 6.0]],
    ];
    draft.root["meshes"] = json!([]);
    boxes(&mut draft, &shell);
    let wall = boxes(&mut draft, &[WALL]);
    draft.root["materials"] = json!([material]);
    draft.root["meshes"][wall]["primitives"][0]["material"] = json!(0);
    let mut node = node.clone();
    node["mesh"] = json!(wall);
    draft.root["nodes"] = json!([{ "mesh": 0 }, node]);
    draft.root["scenes"] = json!([{ "nodes": [0, 1] }]);
    let model = glb::read_slice(&draft.bytes(), None, "hall").unwrap();
    let options = CompileOptions {
        voxel: Some(0.1),
        cell: Some(3.0),
        light: LightMethod::None,
        ..Default::default()
    };
    compile(&model, &options, &|_, _| ControlFlow::Continue(())).unwrap().0
}

/// Whether somebody on one side of the wall is told of somebody on the other.
fn is_told(world: World) -> bool {
    let mut engine = Engine::new(Arc::new(world), Config::default());
    for (avatar, x) in [(HERE, 3.0), (THERE, 9.0)] {
        let place = Some(Vec3::new(x, 1.7, 3.0));
        let join = Input::Join { avatar, name: String::new(), colour: [255; 3], place };
        engine.handle(Duration::ZERO, join);
        let round_trip = Duration::ZERO;
        engine.handle(Duration::ZERO, Input::RoundTrip { avatar, round_trip });
    }
    let mut outputs = Vec::new();
    for tick in 0..4 {
        engine.tick(Duration::from_millis(50 * tick), &mut outputs);
    }
    let mut told = outputs.iter().filter(|output| matches!(output, Output::Appear { .. }));
    told.any(|output| output.to() == HERE)
}

#[test]
fn each_way_of_being_transparent_tells_of_people_behind() {
    let extension = |name: &str, value: Value| json!({ "extensions": { name: value } });
    let alpha = json!({ "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 0.4] } });
    let plain = json!({});
    let hidden = extension("KHR_node_visibility", json!({ "visible": false }));
    for (material, node) in [
        (json!({ "alphaMode": "BLEND" }), plain.clone()),
        (json!({ "alphaMode": "MASK" }), plain.clone()),
        (alpha, plain.clone()),
        (
            extension("KHR_materials_transmission", json!({ "transmissionFactor": 1.0 })),
            plain.clone(),
        ),
        (extension("KHR_materials_volume", json!({ "thicknessFactor": 0.2 })), plain.clone()),
        (
            extension(
                "KHR_materials_diffuse_transmission",
                json!({ "diffuseTransmissionFactor": 0.5 }),
            ),
            plain.clone(),
        ),
        (extension("ACME_materials_fog", json!({})), plain.clone()),
        (plain.clone(), hidden),
        (plain.clone(), json!({ "name": "detail:curtain" })),
        (plain.clone(), json!({ "name": "curtain-noocc" })),
        (plain.clone(), json!({ "name": "collider:rope" })),
        (plain.clone(), json!({ "name": "rope-col" })),
    ] {
        assert!(is_told(hall(&material, &node)), "{material} {node}");
    }
}

#[test]
fn each_way_of_being_opaque_keeps_people_behind_secret() {
    let extension = |name: &str, value: Value| json!({ "extensions": { name: value } });
    let plain = json!({});
    for (material, node) in [
        (plain.clone(), plain.clone()),
        (json!({ "alphaMode": "OPAQUE", "doubleSided": true }), plain.clone()),
        (extension("KHR_materials_transmission", json!({})), plain.clone()),
        (extension("KHR_materials_sheen", json!({})), plain.clone()),
        (plain.clone(), extension("KHR_node_visibility", json!({ "visible": true }))),
        (plain.clone(), json!({ "scale": [1, 1, -1], "translation": [0, 0, 6] })),
        (plain.clone(), json!({ "name": "occluder:wall" })),
        (json!({ "alphaMode": "BLEND" }), json!({ "name": "wall-occ" })),
    ] {
        assert!(!is_told(hall(&material, &node)), "{material} {node}");
    }
}

#[test]
fn occluders_let_bodies_through_and_colliders_do_not() {
    for (name, stops) in [("occluder:wall", false), ("detail:wall", true), ("collider:wall", true)]
    {
        let world = hall(&json!({}), &json!({ "name": name }));
        let body_in_wall = world.body.around(Vec3::new(6.0, 1.8, 3.0));
        assert_eq!(world.octree.solid_in(&body_in_wall), stops, "{name}");
    }
}
