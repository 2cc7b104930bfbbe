//! What an author leaves out by name, and the sky, which is recognised.

use super::*;

fn read_without(draft: &GlbDraft, dropped: &[&str], open_doors: &[&str]) -> Model {
    let texts = |all: &[&str]| all.iter().map(|&text| text.to_owned()).collect();
    let left_out = LeftOut { dropped: texts(dropped), open_doors: texts(open_doors) };
    let bytes = draft.bytes();
    let mut model =
        read_placed(&bytes, None, "test", &Placing::default(), &left_out).expect("a good file");
    model.warnings.retain(|warning| !warning.contains("which is small"));
    model
}

/// A wall, a door in it, and a handle on the door.
fn wall_with_door() -> GlbDraft {
    let mut draft = GlbDraft::square();
    draft.root["scenes"] = json!([{ "nodes": [0, 1] }]);
    draft.root["nodes"] = json!([
        { "mesh": 0, "name": "Wall" },
        { "mesh": 0, "name": "Door_01", "children": [2] },
        { "mesh": 0, "name": "Handle" },
    ]);
    draft
}

#[test]
fn nodes_are_left_out_by_name_with_all_below_them() {
    let draft = wall_with_door();
    assert_eq!(read_without(&draft, &[], &[]).opaque.len(), 6);
    for (dropped, open_doors, left) in [
        (&["handle"][..], &[][..], 4),
        (&[], &["*door*"], 2),
        (&["Door_0?"], &[], 2),
        (&["Wall", "Handle"], &[], 2),
    ] {
        let model = read_without(&draft, dropped, open_doors);
        assert_eq!(model.opaque.len(), left, "{dropped:?} {open_doors:?}");
        assert_eq!(model.surfaces.len(), left / 2);
        assert!(model.warnings.is_empty(), "{:?}", model.warnings);
    }
}

#[test]
fn a_pattern_that_fits_nothing_is_told() {
    let model = read_without(&wall_with_door(), &["roof*"], &["gate"]);
    assert_eq!(model.opaque.len(), 6);
    let [drop, door] = &model.warnings[..] else { panic!("{:?}", model.warnings) };
    assert!(drop.starts_with("--drop roof*") && door.starts_with("--open-doors gate"));
}

/// A square of 1 m, and around it triangles with these corners.
fn inside(name: &str, triangles: &[[[f32; 3]; 3]]) -> GlbDraft {
    let mut draft = GlbDraft::square();
    let corners: Vec<f32> = triangles.as_flattened().as_flattened().to_vec();
    let positions = draft.floats("VEC3", &corners);
    let primitive = json!({ "attributes": { "POSITION": positions } });
    let mesh = draft.list("meshes", json!({ "primitives": [primitive] }));
    let node = draft.list("nodes", json!({ "mesh": mesh, "name": name }));
    draft.root["scenes"] = json!([{ "nodes": [0, node] }]);
    draft
}

/// The corners of a square of this width about the square of 1 m, and a little below it.
fn around(width: f32) -> [[f32; 3]; 4] {
    let half = width / 2.0;
    [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, z]| [x + 0.5, -0.1, z])
}

/// A square of 1 m under a pyramid.
fn under_a_tent(name: &str, width: f32, height: f32) -> GlbDraft {
    let ([a, b, c, d], top) = (around(width), [0.5, height, 0.0]);
    inside(name, &[[a, b, top], [b, c, top], [c, d, top], [d, a, top]])
}

/// A square of 1 m in a box without a bottom, with as many triangles of its sides as said.
fn in_a_box(triangles: usize) -> GlbDraft {
    let low = around(9.0);
    let high = low.map(|[x, y, z]| [x, y + 9.0, z]);
    let mut sides = vec![[high[0], high[1], high[2]], [high[2], high[3], high[0]]];
    for (from, to) in [(0, 1), (1, 2), (2, 3), (3, 0)] {
        sides.push([low[from], low[to], high[to]]);
        sides.push([high[to], high[from], low[from]]);
    }
    inside("around", &sides[..triangles])
}

#[test]
fn an_enclosing_sky_is_drawn_and_hides_nobody() {
    let model = read_without(&under_a_tent("dome", 9.0, 5.0), &[], &[]);
    assert_eq!((model.opaque.len(), model.surfaces.len()), (2, 2));
    let [warning] = &model.warnings[..] else { panic!("{:?}", model.warnings) };
    assert!(warning.contains("count as sky"), "{warning}");
    // A roof is hardly wider than what is under it, and ground is flat.
    for (width, height) in [(1.2, 5.0), (9.0, 1.2)] {
        let model = read_without(&under_a_tent("roof", width, height), &[], &[]);
        assert_eq!(model.opaque.len(), 6, "{width} {height}");
        assert!(model.warnings.is_empty());
    }
}

#[test]
fn a_closed_box_around_everything_is_a_sky_and_one_with_an_opening_is_not() {
    let opaque = |triangles| read_without(&in_a_box(triangles), &[], &[]).opaque.len();
    assert_eq!((opaque(10), opaque(9)), (2, 11));
}
