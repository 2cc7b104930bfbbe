use std::time::Duration;

use sightline_fixtures::shared_files::shared_file;
use sightline_world::{Mover, motion::trajectory::Playback};

use super::*;

/// A panel 64 units wide, 2 deep and 96 high, with its least corner where its entity is.
const PANEL: [f32; 3] = [64.0, 2.0, 96.0];

/// A room with a panel as brush model 1, and some entities.
fn with_panel(entities: &str) -> Model {
    let mut draft = BspDraft::room();
    let stone = draft.shader("textures/panel", 0, SOLID);
    let first = (draft.lumps[13].len() / 104) as i32;
    let [x, y, z] = PANEL;
    let corners = [[0.0, 0.0, 0.0], [x, 0.0, 0.0], [x, 0.0, z], [0.0, 0.0, z]];
    draft.face(1, stone, &corners, &[0, 1, 2, 0, 2, 3], [0, 0]);
    draft.face(1, stone, &corners.map(|[x, _, z]| [x, y, z]), &[0, 1, 2, 0, 2, 3], [0, 0]);
    draft.world_faces -= 2;
    draft.models.extend(floats(&[0.0, 0.0, 0.0, x, y, z]));
    draft.models.extend(ints(&[first, 2, 0, 0]));
    draft.lumps[0].extend_from_slice(entities.as_bytes());
    draft.model()
}

fn panel(keys: &str) -> Model {
    with_panel(&format!("{{ \"model\" \"*1\" {keys} }}"))
}

fn mover(model: &Model) -> &Mover {
    let [mover] = &model.movers[..] else { panic!("{:?}", model.movers.len()) };
    mover
}

/// The origin of the entity after a time, in Quake's units and axes.
fn place(mover: &Mover, time_s: f64) -> [f64; 3] {
    let at = mover.trajectory.at(Duration::from_secs_f64(time_s)).translation / UNIT;
    [at.x, -at.z, at.y].map(|value| (value * 100.0).round() / 100.0 + 0.0)
}

#[test]
fn movers_are_neither_drawn_nor_solid_where_they_stand() {
    let (with, without) = (panel("\"classname\" \"func_door\""), BspDraft::room().model());
    assert_eq!(with.opaque, without.opaque);
    assert_eq!(with.solids, without.solids);
    assert_eq!(with.surfaces.len(), without.surfaces.len());
    let mover = mover(&with);
    assert_eq!(mover.name, "func_door *1");
    // Divided, so that light is kept.
    assert!(mover.colours().len() >= 4);
    let size = mover.bounds().size() - metres(PANEL.map(f64::from)).abs();
    assert!(size.length() < 1e-4, "{size}");
}

#[test]
fn doors_and_plats_go_and_come_back() {
    // The size along the path and a unit on each side, less the lip of 8.
    let wide = 64.0 + 2.0 - 8.0;
    let high = 96.0 + 2.0 - 8.0;
    for (keys, times) in [
        (
            "\"classname\" \"func_door\" \"speed\" \"58\"",
            vec![
                (0.0, [0.0; 3]),
                (0.5, [wide / 2.0, 0.0, 0.0]),
                (2.0, [wide, 0.0, 0.0]),
                (3.5, [wide / 2.0, 0.0, 0.0]),
                (9.0, [0.0; 3]),
            ],
        ),
        (
            "\"classname\" \"func_door\" \"angle\" \"-1\" \"speed\" \"90\" \"wait\" \"-1\"",
            vec![(0.5, [0.0, 0.0, high / 2.0]), (99.0, [0.0, 0.0, high])],
        ),
        (
            "\"classname\" \"func_door\" \"angle\" \"-2\" \"lip\" \"0\"",
            vec![(1.0, [0.0, 0.0, -98.0])],
        ),
        (
            "\"classname\" \"func_door\" \"angle\" \"90\" \"lip\" \"-96\" \"speed\" \"100\" \"spawnflags\" \"1\"",
            vec![
                (0.0, [0.0, 100.0, 0.0]),
                (0.25, [0.0, 75.0, 0.0]),
                (1.0, [0.0; 3]),
                (4.0, [0.0, 100.0, 0.0]),
            ],
        ),
        (
            "\"classname\" \"func_plat\" \"origin\" \"8 8 8\"",
            vec![(0.0, [8.0, 8.0, 8.0 - high]), (1.0, [8.0; 3]), (5.0, [8.0, 8.0, 8.0 - high])],
        ),
        (
            "\"classname\" \"func_plat\" \"height\" \"200\"",
            vec![(0.0, [0.0, 0.0, -200.0]), (0.5, [0.0, 0.0, -100.0]), (1.5, [0.0; 3])],
        ),
    ] {
        let model = panel(keys);
        let mover = mover(&model);
        assert_eq!(mover.trajectory.playback(), Playback::Triggered, "{keys}");
        for (time_s, expected) in times {
            assert_eq!(place(mover, time_s), expected, "{keys} at {time_s}");
        }
    }
}

#[test]
fn a_train_goes_from_corner_to_corner() {
    let corners = r#"
        { "classname" "path_corner" "targetname" "in" "target" "a" "origin" "0 0 900" }
        { "classname" "path_corner" "targetname" "a" "target" "b" "origin" "0 0 0" "wait" "1" }
        { "classname" "path_corner" "targetname" "b" "target" "c" "origin" "100 0 0" "speed" "25" }
        { "classname" "path_corner" "targetname" "c" "target" "a" "origin" "100 50 0" }
        { "classname" "path_corner" "targetname" "x" "target" "y" "origin" "0 0 0" }
        { "classname" "path_corner" "targetname" "y" "origin" "0 80 0" }"#;
    let train = |target: &str| {
        let entity = format!(
            r#"{corners} {{ "classname" "func_train" "model" "*1" "target" "{target}" "speed" "50" }}"#
        );
        with_panel(&entity)
    };
    for start in ["a", "in"] {
        let round = train(start);
        let round = mover(&round);
        assert_eq!(round.trajectory.playback(), Playback::Loop);
        // 1 s of waiting, 100 units at 50, 50 at 25, and back at 50.
        let whole = 1.0 + 2.0 + 2.0 + (100f64.hypot(50.0)) / 50.0;
        assert!((f64::from(round.trajectory.length_s()) - whole).abs() < 1e-5);
        for (time_s, expected) in [
            (0.5, [0.0; 3]),
            (2.0, [50.0, 0.0, 0.0]),
            (4.0, [100.0, 25.0, 0.0]),
            (whole + 2.0, [50.0, 0.0, 0.0]),
        ] {
            assert_eq!(place(round, time_s), expected, "{start} at {time_s}");
        }
    }
    let line = train("x");
    assert_eq!(mover(&line).trajectory.playback(), Playback::Once);
    assert_eq!(place(mover(&line), 100.0), [0.0, 80.0, 0.0]);
    for nowhere in ["", "none"] {
        let model = train(nowhere);
        assert!(model.movers.is_empty() && model.warnings.len() == 1, "{:?}", model.warnings);
        assert_eq!(model.surfaces.len(), BspDraft::room().model().surfaces.len() + 1);
    }
}

#[test]
fn bobbing_swinging_and_turning_never_end() {
    let bobbing = panel("\"classname\" \"func_bobbing\" \"height\" \"10\" \"phase\" \"0.25\"");
    for (time_s, height) in [(0.0, -10.0), (1.0, 0.0), (2.0, 10.0), (42.0, 10.0)] {
        assert_eq!(place(mover(&bobbing), time_s), [0.0, 0.0, height], "at {time_s}");
    }
    let aside = panel("\"classname\" \"func_bobbing\" \"spawnflags\" \"2\"");
    assert_eq!(place(mover(&aside), 5.0), [0.0, 32.0, 0.0]);

    // A point one unit along Quake's x and z, in Quake's axes.
    let turned = |model: &Model, time_s: f64| {
        let at = mover(model).trajectory.at(Duration::from_secs_f64(time_s));
        let to = at.transform_vector3(DVec3::new(1.0, 1.0, 0.0));
        [to.x, -to.z, to.y].map(|value| (value * 1e4).round() / 1e4 + 0.0)
    };
    let rotating = panel("\"classname\" \"func_rotating\" \"speed\" \"90\"");
    assert_eq!(turned(&rotating, 1.0), [0.0, 1.0, 1.0]);
    assert_eq!(turned(&rotating, 6.0), [-1.0, 0.0, 1.0]);
    let pitching = panel("\"classname\" \"func_rotating\" \"speed\" \"90\" \"spawnflags\" \"8\"");
    assert_eq!(turned(&pitching, 1.0), [1.0, 0.0, -1.0]);
    let rolling = panel("\"classname\" \"func_rotating\" \"speed\" \"90\" \"spawnflags\" \"4\"");
    assert_eq!(turned(&rolling, 1.0), [1.0, -1.0, 0.0]);

    let pendulum = panel("\"classname\" \"func_pendulum\" \"speed\" \"90\"");
    let cycle_s = f64::from(mover(&pendulum).trajectory.length_s());
    // It does not hang below its origin, so it counts as 8 units long.
    assert!((cycle_s - std::f64::consts::TAU * (24f64 / 800.0).sqrt()).abs() < 1e-6);
    assert_eq!(turned(&pendulum, cycle_s / 4.0), [1.0, -1.0, 0.0]);
    assert_eq!(turned(&pendulum, cycle_s / 2.0), [1.0, 0.0, 1.0]);
}

#[test]
fn entities_with_invalid_keys_do_not_move() {
    for keys in [
        "\"classname\" \"func_door\" \"lip\" \"1e300\"",
        "\"classname\" \"func_door\" \"speed\" \"1e-300\"",
        "\"classname\" \"func_bobbing\" \"speed\" \"-4\"",
        "\"classname\" \"func_bobbing\" \"origin\" \"1e300 0 0\"",
        "\"classname\" \"func_rotating\" \"speed\" \"1e-9\"",
        "\"classname\" \"func_pendulum\" \"origin\" \"0 1e300 0\"",
        "\"classname\" \"func_static\"",
        "\"classname\" \"func_door\" \"model\" \"*2\"",
        "\"classname\" \"func_door\" \"model\" \"*0\"",
        "\"classname\" \"func_door\" \"model\" \"*-1\"",
    ] {
        let model = panel(keys);
        assert!(model.movers.is_empty(), "{keys}");
        assert_eq!(model.surfaces.len(), BspDraft::room().model().surfaces.len() + 1, "{keys}");
    }
}

#[test]
fn the_doors_lifts_and_the_train_of_a_real_map_are_found() {
    let Some(map) = shared_file("maps/oa_dm2.bsp") else { return };
    let model = read(&map, &[]).unwrap();
    let count = |class: &str| model.movers.iter().filter(|m| m.name.starts_with(class)).count();
    let classes = ["func_door", "func_plat", "func_train", "func_bobbing"];
    assert_eq!(classes.map(count), [11, 2, 1, 1]);
    // Some doors slide into outer walls.
    let building = model.bounds().unwrap().grown(0.5);
    for mover in &model.movers {
        assert!(building.contains_box(&mover.everywhere()), "{}", mover.name);
    }
}
