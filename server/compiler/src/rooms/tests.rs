use std::ops::ControlFlow;

use glam::{Vec2, Vec3};
use serde_json::json;
use sightline_fixtures::glb_draft::GlbDraft;
use sightline_visibility::rooms::RoomIndex;
use sightline_world::{
    Spawn, World,
    geometry::Aabb,
    rooms::{RoomId, RoomVisibility, Rooms, Shape},
};

use super::*;
use crate::{CompileError, CompileOptions, CompileReport, LightMethod, import::glb, model::Model};

/// Two rooms of 4 × 3 × 4 m side by side, and a door in the wall between them, 1 m wide.
fn house() -> Model {
    let mut opaque = Vec::new();
    let mut wall = |corner: [f32; 3], u: [f32; 3], v: [f32; 3]| {
        let [a, u, v] = [corner, u, v].map(Vec3::from);
        opaque.extend([[a, a + u, a + u + v], [a, a + u + v, a + v]]);
    };
    for y in [0.0, 3.0] {
        wall([0.0, y, 0.0], [8.0, 0.0, 0.0], [0.0, 0.0, 4.0]);
    }
    for z in [0.0, 4.0] {
        wall([0.0, 0.0, z], [8.0, 0.0, 0.0], [0.0, 3.0, 0.0]);
    }
    for x in [0.0, 8.0] {
        wall([x, 0.0, 0.0], [0.0, 0.0, 4.0], [0.0, 3.0, 0.0]);
    }
    wall([4.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 3.0, 0.0]);
    wall([4.0, 0.0, 2.0], [0.0, 0.0, 2.0], [0.0, 3.0, 0.0]);
    wall([4.0, 2.0, 1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]);
    Model {
        nodes: vec![("table".into(), Aabb::around(Vec3::new(6.0, 0.4, 3.0), 0.4))],
        spawns: vec![Spawn { eye: Vec3::new(2.0, 1.6, 2.0), yaw: 0.0 }],
        ..Model::of_triangles("house", opaque, [200; 3])
    }
}

fn compiled(toml: &str) -> Result<(World, CompileReport), CompileError> {
    let mut model = house();
    model.rooms = text::read(toml, "house.rooms.toml")?;
    let options =
        CompileOptions { voxel: Some(0.2), light: LightMethod::None, ..CompileOptions::default() };
    crate::compile(&model, &options, &|_, _| ControlFlow::Continue(()))
}

const WEST: &str = r#"[[room]]
name = "west"
box = [[0, 0, 0], [4, 3, 4]]
"#;

const EAST: &str = r#"[[room]]
name = "east"
rectangle = [[8, 4], [4, 0]]
heights = [0, 3]
"#;

const DOOR: &str = r#"[[room.window]]
name = "door"
polygon = [[4, 0, 1], [4, 0, 2], [4, 2, 2], [4, 2, 1]]
"#;

/// Every key of the format reaches the world.
#[test]
fn every_key_reaches_the_world() {
    let toml = format!(
        r#"{WEST}title = "West room"
visible = {{ rooms = ["east"], objects = ["table"], cells = [[6.0, 1.5, 1.0], 0] }}
sealed = true
opaque = true
spawn = {{ eye = [1, 1.6, 1], yaw = 90 }}
capacity = 12
tag = "private"
{DOOR}{EAST}hidden = {{ rooms = ["west"] }}
overlaps = ["west"]
[[room]]
name = "plan"
polygon = [[0, 0], [1, 0], [0, 1]]
overlaps = ["west"]
[[room]]
name = "tent"
hull = [[5, 0, 1], [6, 0, 1], [5, 0, 2], [5, 1, 1]]
boxes = [[[5, 0, 2], [6, 1, 3]], [[6, 0, 2], [7, 1, 3]]]
"#
    );
    let (world, report) = compiled(&toml).unwrap();
    let world = World::from_bytes(&world.to_bytes()).unwrap();
    assert_eq!((report.rooms, report.windows), (4, 1));
    let [west, east, plan, tent] = world.rooms.list() else { panic!("four rooms") };
    assert_eq!(west.title(), "West room");
    assert_eq!(east.title(), "east");
    assert!(west.sealed && west.opaque && !east.sealed && !east.opaque);
    assert_eq!((west.capacity, west.tag.as_deref()), (Some(12), Some("private")));
    let spawn = west.spawn.unwrap();
    assert!((spawn.yaw - std::f32::consts::FRAC_PI_2).abs() < 1e-6 && spawn.eye.x == 1.0);
    let RoomVisibility::Only(set) = &west.sees else { panic!("a visible set") };
    assert_eq!((set.rooms.as_slice(), set.objects.as_slice()), (&[RoomId(1)][..], &[0][..]));
    assert_eq!(set.cells.len(), 2);
    assert_eq!(world.rooms.objects()[0].name, "table");
    assert!(matches!(&east.sees, RoomVisibility::AllBut(set) if set.rooms == [RoomId(0)]));
    let corners =
        [Vec2::new(4.0, 0.0), Vec2::new(8.0, 0.0), Vec2::new(8.0, 4.0), Vec2::new(4.0, 4.0)];
    assert_eq!(east.shapes, [Shape::Plan { corners: corners.into(), heights: Some([0.0, 3.0]) }]);
    assert!(matches!(&plan.shapes[..], [Shape::Plan { heights: None, .. }]));
    assert_eq!(tent.shapes.len(), 3);
    assert_eq!(west.windows[0].corners.len(), 4);
    // The index of rooms has it too.
    let index = RoomIndex::new(&world);
    assert_eq!(index.room_at(Vec3::new(2.0, 1.0, 2.0)), Some(RoomId(0)));
    assert!(!index.sealed_rooms_at(Vec3::new(2.0, 1.0, 2.0)).is_open());
}

/// Each error is one line that names the line of the file.
#[test]
fn errors_name_their_line() {
    let check = |toml: &str, expected: &str| {
        let error = compiled(toml).expect_err(expected).to_string();
        assert_eq!(error, format!("house.rooms.toml:{expected}"), "{toml}");
    };
    check("[[room]]\nname = ", "2: string values must be quoted, expected literal string");
    check(
        "[[room]]\nname = \"a\"\nheigth = 1",
        "3: unknown field `heigth`, expected one of \
        `name`, `title`, `rectangle`, `polygon`, `heights`, `box`, `boxes`, `hull`, `hulls`, `visible`, `hidden`, \
        `overlaps`, `sealed`, `opaque`, `spawn`, `capacity`, `tag`, `window`",
    );
    check("\n[[room]]\ntitle = \"a\"", "2: a room without a name");
    check(
        "[[room]]\nname = \"a\"",
        "1: room \"a\": it has no shape: give a rectangle, polygon, box or hull",
    );
    check(&format!("{WEST}{WEST}"), "5: there is a room \"west\" already");
    let flat = "[[room]]\nname = \"a\"\npolygon = [[0, 0], [1, 0], [2, 0]]";
    check(flat, "2: room \"a\": a shape of it is flat");
    let far = "[[room]]\nname = \"a\"\nbox = [[0, 0, 0], [1, 1, 1e9]]";
    check(
        far,
        "2: room \"a\": a room has an invalid number of corners, or coordinates out of range",
    );
    let set = |set: &str| format!("{WEST}visible = {{ {set} }}");
    check(&set("rooms = [\"est\"]"), "4: there is no room \"est\"");
    check(&set("objects = [\"tabel\"]"), "4: the model has no mover and no node \"tabel\"");
    check(&set("cells = [100000]"), "2: there is no cell 100000");
    check(&set("cells = [\"a\"]"), "4: a cell is a number, or a point [x, y, z] that is in it");
    let both = format!("{}\nhidden = {{}}", set(""));
    check(&both, "2: room \"west\" has a visible and a hidden set: a room has one of the two");
    check(&format!("{WEST}overlaps = [\"est\"]"), "4: there is no room \"est\"");
    let two = format!("{WEST}visible = {{ rooms = [\"a\", \"b\"] }}");
    check(&two, "4: there is no room \"a\" (and 1 more errors in rooms)");
}

#[test]
fn windows_are_on_the_boundary_of_their_room() {
    let check = |window: &str, expected: &str| {
        let toml = format!("{WEST}\n[[room.window]]\nname = \"w\"\n{window}");
        match compiled(&toml) {
            Ok(_) => assert_eq!(expected, "", "{window}"),
            Err(error) => {
                let at = "house.rooms.toml:6: window \"w\" of room \"west\"";
                let error = error.to_string();
                assert!(error.starts_with(&format!("{at}{expected}")), "{error}");
                assert_ne!(expected, "", "{error}");
            }
        }
    };
    let at = |x: f32, z: f32| {
        format!("polygon = [[{x}, 0, 1], [{x}, 0, {z}], [{x}, 2, {z}], [{x}, 2, 1]]")
    };
    check(&at(4.0, 2.0), "");
    check(&at(4.03, 2.0), "");
    check(&at(3.0, 2.0), " is inside its room");
    check(&at(4.5, 2.0), " is off the boundary of its room");
    check(&at(4.0, 5.0), " is off the boundary of its room");
    check("polygon = [[4, 0, 1], [4, 0, 2], [4, 2, 2], [3, 2, 1]]", " is not flat: its corner");
    check("polygon = [[4, 0, 1], [4, 0, 2], [4, 0, 3]]", " has no area");
    check(
        "polygon = [[4, 0, 1], [4, 0, 2]]",
        ": a window has an invalid number of corners, or coordinates out of range",
    );
    let behind = format!("{}\nbehind = \"v\"", at(4.0, 2.0));
    let toml = format!("{WEST}\n[[room.window]]\nname = \"w\"\n{behind}");
    let error = compiled(&toml).unwrap_err().to_string();
    let said = "window \"w\" of room \"west\" is behind \"v\", which is no window before it";
    assert_eq!(error, format!("house.rooms.toml:8: {said}"));
}

/// A narrow window may end a few millimetres farther than the gap that it fills.
#[test]
fn windows_may_end_where_another_part_of_the_room_begins() {
    let toml = r#"[[room]]
name = "west"
boxes = [[[0, 0, 0], [4, 3, 1]], [[0, 0, 1], [3, 3, 1.0434]], [[0, 0, 1.0434], [4, 3, 4]]]
[[room.window]]
name = "gap"
polygon = [[3, 0, 0.9967], [3, 0, 1.0467], [3, 2, 1.0467], [3, 2, 0.9967]]
"#;
    assert_eq!(compiled(toml).map(|(world, _)| world.rooms.list().len()).ok(), Some(1));
}

#[test]
fn undeclared_overlaps_are_warned_of() {
    let check = |toml: &str, expected: &[&str]| {
        let (_, report) = compiled(toml).unwrap();
        let told: Vec<String> = report.room_warnings.iter().map(ToString::to_string).collect();
        assert_eq!(told.len(), expected.len(), "{told:?}");
        for (told, expected) in told.iter().zip(expected) {
            assert!(told.starts_with(&format!("house.rooms.toml:{expected}")), "{told}");
        }
    };
    let other = |shape: &str| format!("{WEST}[[room]]\nname = \"b\"\n{shape}\n");
    check(&format!("{WEST}{EAST}"), &[]);
    let overlapping = "box = [[3, 0, 0], [5, 3, 4]]";
    check(&other(overlapping), &["5: room \"b\" overlaps room \"west\" at"]);
    check(&other(&format!("{overlapping}\noverlaps = [\"west\"]")), &[]);
    check(&other("box = [[3.96, 0, 0], [5, 3, 4]]"), &[]);
    // A room inside another one is meant.
    check(&other("box = [[1, 0, 1], [2, 3, 2]]"), &[]);
    check(&other("box = [[-1, -1, -1], [9, 4, 5]]"), &[]);
    // Their boxes meet, but the rooms do not.
    check(&other("polygon = [[4.5, -3], [9, -3], [9, 4.5]]"), &[]);
}

#[test]
fn settings_without_an_effect_are_warned_of() {
    let check = |settings: &str, expected: &[&str]| {
        let (_, report) = compiled(&format!("{WEST}{settings}\n")).unwrap();
        let warnings: Vec<String> = report.room_warnings.iter().map(ToString::to_string).collect();
        assert_eq!(warnings.len(), expected.len(), "{warnings:?}");
        for (warning, setting) in warnings.iter().zip(expected) {
            let start = format!("house.rooms.toml:2: room \"west\": {setting} has no effect yet: ");
            assert!(warning.starts_with(&start), "{warning}");
        }
    };
    check("opaque = true", &[]);
    check("capacity = 12", &["capacity"]);
    check("capacity = 0\nopaque = true", &["capacity"]);
    check("opaque = false\nsealed = true\ntag = \"private\"\ntitle = \"West\"", &[]);
}

#[test]
fn people_begin_at_the_spawn_points_of_rooms_too() {
    let (world, _) = compiled(WEST).unwrap();
    let (with_spawn, _) =
        compiled(&format!("{WEST}spawn = {{ eye = [1, 1.6, 1], yaw = 90 }}\n")).unwrap();
    let of_room = with_spawn.rooms.list()[0].spawn.unwrap();
    assert_eq!(with_spawn.spawns, [world.spawns, vec![of_room]].concat());
}

#[test]
fn plainly_visible_members_of_hidden_sets_are_warned_of() {
    let told = |toml: &str| -> Vec<String> {
        let (_, report) = compiled(toml).unwrap();
        report.room_warnings.iter().map(ToString::to_string).collect()
    };
    let hides = |hidden: &str| format!("{WEST}hidden = {{ {hidden} }}\n");
    let room = hides("rooms = [\"east\"]");
    let lines = told(&format!("{room}{EAST}"));
    assert_eq!(lines.len(), 1, "{lines:?}");
    let start = "house.rooms.toml:2: room \"west\" hides room \"east\", but from [";
    assert!(lines[0].starts_with(start), "{lines:?}");
    // A ray confirms the line in the warning.
    let numbers: Vec<f32> =
        lines[0].split(['[', ']', ',']).filter_map(|part| part.trim().parse().ok()).collect();
    let [eye, point] = [0, 3].map(|at| Vec3::from_slice(&numbers[at..at + 3]));
    let mesh = compiled(WEST).unwrap().0.mesh;
    assert!(
        eye.x < 4.0 && point.x > 4.0 && sightline_oracle::Oracle::new(&mesh).between(eye, point)
    );
    // What is visible through a window is meant to be visible.
    assert_eq!(told(&format!("{room}{DOOR}{EAST}")), [] as [&str; 0]);
    assert_eq!(told(&hides("objects = [\"table\"]")).len(), 1);
    assert_eq!(told(&hides("cells = [[6.0, 1.5, 1.0]]")).len(), 1);
    // A roof hides the east room here.
    let above = "[[room]]\nname = \"east\"\nbox = [[0, 3.2, 0], [8, 4, 4]]\n";
    assert_eq!(told(&format!("{room}{above}")), [] as [&str; 0]);
}

/// Nodes of a glTF have coordinates of their own.
#[test]
fn nodes_are_rooms_and_windows() {
    let mut draft = GlbDraft::square();
    draft.root["scenes"][0]["nodes"] = json!([0]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let level = json!([half, 0.0, 0.0, half]);
    draft.root["nodes"] = json!([
        { "name": "house", "mesh": 0, "children": [1, 2, 3, 4, 5], "translation": [10.0, 0.0, 0.0] },
        { "name": "room:hall", "mesh": 0, "rotation": level, "extras": {
            "heights": [0.0, 3.0], "visible": { "rooms": ["hall"], "objects": ["sofa"] },
            "sealed": true, "somebody's": 3 } },
        { "name": "room:hall.001", "mesh": 0, "rotation": level, "translation": [1.0, 0.0, 0.0] },
        { "name": "window:hall/C", "mesh": 0, "scale": [1.0, 2.0, 1.0], "extras": { "behind": "A" } },
        { "name": "window:hall/A", "mesh": 0 },
        { "name": "sofa", "children": [6] },
        { "mesh": 0, "translation": [0.0, 0.0, 5.0] },
    ]);
    let model = glb::read_slice(&draft.bytes(), None, "draft").unwrap();
    assert_eq!(model.opaque.len(), 4, "the house and the sofa only");
    assert_eq!(model.nodes.len(), 2);
    let sofa = Aabb::new(Vec3::new(10.0, 0.0, 5.0), Vec3::new(11.0, 1.0, 5.0));
    assert_eq!(model.nodes[1], ("sofa".to_owned(), sofa));
    let [hall] = &model.rooms[..] else { panic!("{:?}", model.rooms) };
    assert!(hall.sealed && hall.visible.as_ref().is_some_and(|set| set.objects[0].text == "sofa"));
    assert_eq!(hall.shapes.len(), 2);
    let bounds = hall.shapes[0].bounds().union(&hall.shapes[1].bounds());
    assert!((bounds.min.x - 10.0).abs() < 1e-5 && (bounds.max.x - 12.0).abs() < 1e-5, "{bounds:?}");
    let names: Vec<&str> = hall.windows.iter().map(|window| window.name.text.as_str()).collect();
    assert_eq!(names, ["A", "C"], "a window comes after the one that it is behind");
    assert_eq!(hall.windows[1].behind.as_ref().map(|name| name.text.as_str()), Some("A"));
    assert_eq!(hall.windows[1].corners.len(), 4);
    let fault = |change: &dyn Fn(&mut GlbDraft)| {
        let mut draft = GlbDraft::square();
        draft.root["nodes"] = json!([{ "name": "room:a", "mesh": 0 }]);
        change(&mut draft);
        glb::read_slice(&draft.bytes(), None, "draft").unwrap_err().to_string()
    };
    let extras = fault(&|draft| draft.root["nodes"][0]["extras"] = json!({ "sealed": 1 }));
    assert!(extras.starts_with("node \"room:a\": its extras: invalid type"), "{extras}");
    let none = fault(&|draft| drop(draft.root["nodes"][0].as_object_mut().unwrap().remove("mesh")));
    assert_eq!(none, "node \"room:a\": it has no mesh to take a shape from");
}

/// A hull with too many points keeps its corners.
#[test]
fn a_round_room_keeps_its_corners() {
    let cube = Aabb::around(Vec3::ZERO, 1.0).corners();
    let mut points: Vec<Vec3> = cube.to_vec();
    points.extend((0..200).map(|i| Vec3::splat((i as f32 * 0.1).sin() * 0.5)));
    let mut rooms = Vec::new();
    nodes::add(&mut rooms, "room:a", &nodes::NodeRole::Room("a"), &points, None).unwrap();
    let Shape::Hull(kept) = &rooms[0].shapes[0] else { panic!("a hull") };
    assert_eq!(kept.len(), 8);
    assert!(cube.iter().all(|corner| kept.contains(corner)));
}

#[test]
fn names_of_nodes_tell_their_role() {
    use nodes::{NodeRole, role};
    assert_eq!(role("room:hall"), Some(NodeRole::Room("hall")));
    assert_eq!(role("room:hall.001"), Some(NodeRole::Room("hall")));
    assert_eq!(role("room:hall.1"), Some(NodeRole::Room("hall.1")));
    assert_eq!(role("window:hall/door"), Some(NodeRole::Window("hall", "door")));
    assert_eq!(role("window:hall"), None);
    assert_eq!(role("bedroom:hall"), None);
}

/// An empty file declares no rooms.
#[test]
fn no_rooms_are_fine() {
    assert_eq!(compiled("").unwrap().0.rooms, Rooms::default());
}
