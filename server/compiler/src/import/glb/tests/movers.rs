use std::time::Duration;

use glam::DVec3;
use sightline_world::{Mover, motion::trajectory::Playback};

use super::*;

/// A point of a mover after a time, in the world.
fn place(mover: &Mover, point: [f64; 3], time_s: f64) -> [f64; 3] {
    let at = mover.trajectory.at(Duration::from_secs_f64(time_s));
    at.transform_point3(DVec3::from(point)).to_array().map(|v| (v * 1e4).round() / 1e4 + 0.0)
}

#[test]
fn a_sliding_door_is_a_mover_and_blocks_nothing() {
    let model = read_model(&GlbDraft::sliding_door());
    assert!(model.opaque.is_empty() && model.surfaces.is_empty());
    let [door] = &model.movers[..] else { panic!("{}", model.movers.len()) };
    assert_eq!((door.name.as_str(), door.colours()), ("door", &[[255; 3]; 2][..]));
    assert_eq!(door.trajectory.playback(), Playback::Loop);
    for (time_s, x) in [(0.0, 5.0), (1.0, 5.5), (2.0, 6.0), (2.5, 5.5), (4.0, 5.5)] {
        assert_eq!(place(door, [0.0; 3], time_s), [x, 0.0, 0.0], "at {time_s}");
    }
    assert!((door.everywhere().size() - Vec3::new(2.0, 1.0, 0.0)).length() < 1e-3);
}

#[test]
fn descendants_of_moving_nodes_move_along_and_others_stay() {
    let mut draft = GlbDraft::square();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    draft.root["nodes"] = json!([
        { "children": [1, 3], "translation": [0.0, 0.0, 7.0] },
        { "children": [2], "name": "lift", "translation": [1.0, 0.0, 0.0], "scale": [2.0, 2.0, 2.0] },
        { "mesh": 0, "name": "door", "rotation": [0.0, half, 0.0, half] },
        { "mesh": 0 },
    ]);
    draft.animate(
        1,
        "translation",
        "STEP",
        &[0.0, 1.0, 2.0],
        &[0.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 0.0],
    );
    let model = read_model(&draft);
    // One square stays where it is.
    assert_eq!((model.opaque.len(), model.movers.len()), (2, 1));
    assert_eq!(model.surfaces[0].positions[1], Vec3::new(1.0, 0.0, 7.0));
    let lift = &model.movers[0];
    assert_eq!(lift.name, "lift");
    // A quarter turn to the left takes +x to -z. The parent scales both.
    let corner = lift.mesh().positions[1].as_dvec3().to_array();
    for (time_s, y) in [(0.5, 0.0), (1.0, 9.0), (1.9, 9.0), (2.5, 0.0)] {
        assert_eq!(place(lift, corner, time_s), [0.0, y, 5.0], "at {time_s}");
    }

    // Now the door has an animation of its own: two joints move it.
    draft.animate(
        2,
        "rotation",
        "LINEAR",
        &[0.0, 1.0, 2.0],
        &[0.0, 0.0, 0.0, 1.0, 0.0, half, 0.0, half, 0.0, 0.0, 0.0, 1.0],
    );
    let model = read_model(&draft);
    let [door] = &model.movers[..] else { panic!("{}", model.movers.len()) };
    assert_eq!((door.name.as_str(), door.trajectory.joints().len()), ("door", 2));
    assert_eq!(place(door, [1.0, 0.0, 0.0], 1.0), [0.0, 9.0, 5.0]);
    assert_eq!(place(door, [1.0, 0.0, 0.0], 2.0), [2.0, 0.0, 7.0]);
    assert!(model.warnings.is_empty(), "{:?}", model.warnings);
}

#[test]
fn cubic_splines_become_straight_pieces_near_them() {
    let mut draft = GlbDraft::square();
    // Tangents of zero: it starts and ends slowly.
    let values = [
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, // before, at and after the first key
        0.0, 0.0, 0.0, 8.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    ];
    draft.animate(0, "translation", "CUBICSPLINE", &[1.0, 3.0], &values);
    let model = read_model(&draft);
    for (time_s, share) in [(0.0, 0.0f64), (1.5, 0.25), (2.0, 0.5), (2.5, 0.75), (2.9, 0.95)] {
        let expected = 8.0 * (3.0 - 2.0 * share) * share * share;
        let [x, ..] = place(&model.movers[0], [0.0; 3], time_s);
        assert!((x - expected).abs() < 0.05, "{x} at {time_s}, not {expected}");
    }
}

#[test]
fn scales_turns_and_several_channels_of_one_animation_go_together() {
    let mut draft = GlbDraft::square();
    draft.animate(0, "scale", "LINEAR", &[0.0, 4.0], &[1.0, 1.0, 1.0, 3.0, 1.0, 1.0]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    draft.animate(
        0,
        "rotation",
        "LINEAR",
        &[0.0, 2.0],
        &[0.0, 0.0, 0.0, 1.0, 0.0, half, 0.0, half],
    );
    // A second animation of the same node is left out ...
    let model = read_model(&draft);
    assert_eq!(model.warnings.len(), 1);
    assert_eq!(place(&model.movers[0], [1.0, 0.0, 0.0], 2.0), [2.0, 0.0, 0.0]);
    // ... but counts as a second channel of the first. The shorter channel stays where it ends.
    let second = draft.root["animations"].as_array_mut().unwrap().pop().unwrap();
    let animation = &mut draft.root["animations"][0];
    animation["samplers"].as_array_mut().unwrap().push(second["samplers"][0].clone());
    let target = json!({ "sampler": 1, "target": { "node": 0, "path": "rotation" } });
    animation["channels"].as_array_mut().unwrap().push(target);
    let model = read_model(&draft);
    assert!(model.warnings.is_empty());
    assert_eq!(place(&model.movers[0], [1.0, 0.0, 0.0], 2.0), [0.0, 0.0, -2.0]);
    assert_eq!(place(&model.movers[0], [1.0, 0.0, 0.0], 3.0), [0.0, 0.0, -2.5]);
}

#[test]
fn invalid_motions_leave_a_mover_that_stays() {
    for (path, times, value) in [
        ("translation", [0.0, 0.0], 1.0),
        ("translation", [1.0, 0.0], 1.0),
        ("translation", [0.0, f32::NAN], 1.0),
        ("translation", [-1.0, 1.0], 1.0),
        ("translation", [0.0, 1e9], 1.0),
        ("translation", [0.0, 1.0], f32::INFINITY),
        ("scale", [0.0, 1.0], 1e30),
        ("rotation", [0.0, 1.0], 0.0),
        ("rotation", [0.0, 1.0], f32::NAN),
    ] {
        let mut draft = GlbDraft::square();
        draft.root["nodes"][0]["translation"] = json!([3.0, 2.0, 1.0]);
        let size = if path == "rotation" { 8 } else { 6 };
        draft.animate(0, path, "LINEAR", &[0.0, 1.0], &vec![value; size]);
        let input = draft.root["animations"][0]["samplers"][0]["input"].as_u64().unwrap();
        let view = draft.root["accessors"][input as usize]["bufferView"].as_u64().unwrap();
        let start =
            draft.root["bufferViews"][view as usize]["byteOffset"].as_u64().unwrap() as usize;
        for (i, time_s) in times.iter().enumerate() {
            draft.bin[start + 4 * i..start + 4 * i + 4].copy_from_slice(&time_s.to_le_bytes());
        }
        let model = read_model(&draft);
        assert!(model.opaque.is_empty(), "it is still no occluder");
        assert_eq!(model.warnings.len(), 1, "{path} {times:?} {value}");
        for time_s in [0.0, 0.5, 9.0] {
            assert_eq!(place(&model.movers[0], [0.0; 3], time_s), [3.0, 2.0, 1.0]);
        }
    }
}

#[test]
fn a_channel_that_refers_to_nothing_is_refused() {
    let mut draft = GlbDraft::sliding_door();
    draft.root["animations"][0]["channels"][0]["target"]["node"] = json!(1);
    assert_eq!(read_error(&draft), "animation 0: a channel refers to something that is not there");
    let mut draft = GlbDraft::sliding_door();
    draft.root["animations"][0]["channels"][0]["sampler"] = json!(1);
    assert!(read_error(&draft).contains("not valid glTF"));
}
