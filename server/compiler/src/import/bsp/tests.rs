mod movers;

use glam::Vec3;

use sightline_world::geometry::Aabb;

use super::*;

/// A map under construction: the records of each lump, as bytes.
pub(crate) struct BspDraft {
    lumps: [Vec<u8>; 17],
    world_brushes: i32,
    world_faces: i32,
    /// Records of models other than the world.
    models: Vec<u8>,
}

const SOLID: i32 = CONTENTS_SOLID;

fn ints(values: &[i32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

impl BspDraft {
    /// A map with nothing in it.
    fn new() -> Self {
        Self { lumps: Default::default(), world_brushes: 0, world_faces: 0, models: Vec::new() }
    }

    /// A small map: two brushes, a lit floor, a patch, a spawn point.
    pub fn room() -> Self {
        let mut draft = Self::new();
        draft.lumps[0] = br#"{ "classname" "worldspawn" "message" "Cell" }
            { "classname" "info_player_start" "origin" "32 32 24" "angle" "90" }"#
            .to_vec();
        let stone = draft.shader("textures/stone", 0, SOLID);
        let glass = draft.shader("textures/glass", 0, SOLID | CONTENTS_TRANSLUCENT);
        draft.brush(stone, [0.0, 0.0, -16.0], [64.0, 64.0, 0.0]);
        draft.brush(glass, [64.0, 0.0, 0.0], [66.0, 64.0, 64.0]);
        draft.tree();
        draft.lumps[14] = vec![100; 128 * 128 * 3];
        let corners = [[0.0, 0.0], [64.0, 0.0], [64.0, 64.0], [0.0, 64.0]];
        let floor: Vec<[f32; 3]> = corners.iter().map(|&[x, y]| [x, y, 0.0]).collect();
        draft.face(1, stone, &floor, &[0, 1, 2, 0, 2, 3], [0, 0]);
        let arch: Vec<[f32; 3]> = (0..9)
            .map(|i| [(i % 3) as f32 * 32.0, (i / 3) as f32 * 32.0, [40.0, 80.0, 40.0][i % 3]])
            .collect();
        draft.face(2, stone, &arch, &[], [3, 3]);
        draft
    }

    /// The small map without its lightmap, which is most of its bytes.
    pub fn unlit_room() -> Self {
        let mut draft = Self::room();
        draft.lumps[14].clear();
        draft
    }

    fn shader(&mut self, name: &str, flags: i32, contents: i32) -> i32 {
        let mut record = name.as_bytes().to_vec();
        record.resize(64, 0);
        record.extend(ints(&[flags, contents]));
        self.lumps[1].extend(record);
        (self.lumps[1].len() / 72) as i32 - 1
    }

    fn brush(&mut self, shader: i32, min: [f32; 3], max: [f32; 3]) {
        let first = (self.lumps[9].len() / 8) as i32;
        for axis in 0..3 {
            for (sign, distance) in [(1.0, max[axis]), (-1.0, -min[axis])] {
                let mut plane = [0.0, 0.0, 0.0, distance];
                plane[axis] = sign;
                let index = (self.lumps[2].len() / 16) as i32;
                self.lumps[2].extend(floats(&plane));
                self.lumps[9].extend(ints(&[index, shader]));
            }
        }
        self.lumps[8].extend(ints(&[first, 6, shader]));
        self.world_brushes += 1;
    }

    /// Cluster 1 lies above plane 4, the top of the floor, and sees only itself. Cluster 0 lies
    /// below plane 5, the bottom of the floor, and sees both. Between the planes is solid space.
    fn tree(&mut self) {
        for (plane, sides) in [(4, [-1, 1]), (5, [-3, -2])] {
            self.lumps[3].extend(ints(&[plane, sides[0], sides[1]]));
            self.lumps[3].extend(vec![0; 24]);
        }
        for (cluster, min, max) in [(1, 0, 64), (-1, -16, 0), (0, -64, -16)] {
            self.lumps[4].extend(ints(&[cluster, 0, 0, 0, min, 64, 64, max]));
            self.lumps[4].extend(vec![0; 16]);
        }
        self.lumps[16].extend(ints(&[2, 8]));
        for row in [0b11u8, 0b10] {
            self.lumps[16].extend([row, 0, 0, 0, 0, 0, 0, 0]);
        }
    }

    fn face(&mut self, kind: i32, shader: i32, points: &[[f32; 3]], mesh: &[i32], size: [i32; 2]) {
        let (vertex, index) = (self.lumps[10].len() / 44, self.lumps[11].len() / 4);
        for point in points {
            let uv = [point[0] / 64.0, point[1] / 64.0];
            self.lumps[10].extend(floats(point));
            self.lumps[10].extend(floats(&[uv[0], uv[1], uv[0], uv[1], 0.0, 0.0, 1.0]));
            self.lumps[10].extend([200, 100, 50, 255]);
        }
        self.lumps[11].extend(ints(mesh));
        let (points, mesh) = (points.len() as i32, mesh.len() as i32);
        self.lumps[13].extend(ints(&[
            shader,
            -1,
            kind,
            vertex as i32,
            points,
            index as i32,
            mesh,
            0,
        ]));
        self.lumps[13].extend(vec![0; 64]);
        self.lumps[13].extend(ints(&size));
        self.world_faces += 1;
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut lumps = self.lumps.clone();
        lumps[7] = vec![0; 24];
        lumps[7].extend(ints(&[0, self.world_faces, 0, self.world_brushes]));
        lumps[7].extend(&self.models);
        let mut bytes = b"IBSP".to_vec();
        bytes.extend(ints(&[46]));
        let mut offset = 8 + 17 * 8;
        for lump in &lumps {
            bytes.extend(ints(&[offset, lump.len() as i32]));
            offset += lump.len() as i32;
        }
        bytes.extend(lumps.concat());
        bytes
    }

    fn model(&self) -> Model {
        read_slice(&self.bytes(), &[], "draft").unwrap()
    }

    fn error(&self) -> String {
        read_slice(&self.bytes(), &[], "draft").expect_err("read without an error").to_string()
    }
}

fn metres(units: [f64; 3]) -> Vec3 {
    placed(DVec3::from(units))
}

#[test]
fn a_room_has_its_box_its_patch_its_title_and_its_spawn() {
    let model = BspDraft::room().model();
    assert_eq!(model.title, "Cell");
    assert_eq!(model.body, Body::QUAKE);
    // Quake's y is our -z.
    let (min, max) = (metres([0.0, 64.0, -16.0]), metres([64.0, 0.0, 0.0]));
    assert_eq!(model.solids.len(), 1);
    assert_eq!(model.solids[0].bounds(), Aabb::new(min, max));
    let box_corners = model.opaque[model.opaque.len() - 12..].as_flattened();
    assert!(box_corners.iter().all(|p| (0..3).all(|a| p[a] == min[a] || p[a] == max[a])));
    assert!((model.spawns[0].eye - Vec3::new(0.8128, 1.27, -0.8128)).length() < 1e-5);
    // The arch rises to the middle of its control points' height.
    let top = model.opaque.as_flattened().iter().map(|p| p.y).fold(0.0, f32::max);
    assert!((top - metres([0.0, 0.0, 60.0]).y).abs() < UNIT as f32, "{top}");
    assert!(model.surfaces.iter().all(|s| s.colours.len() == s.positions.len()));
}

#[test]
fn a_map_tells_its_own_brushes_clusters_and_pvs() {
    let origin = BspDraft::room().model().origin.unwrap();
    // The glass blocks nothing.
    assert_eq!(origin.solids.len(), 1);
    let inside = |z: f64| {
        let point = metres([32.0, 32.0, z]).as_dvec3();
        origin.sides(&origin.solids[0]).all(|side| side.height(point) < 0.0)
    };
    assert_eq!([-20.0, -8.0, 4.0].map(inside), [false, true, false]);
    let tree = origin.tree.as_ref().unwrap();
    let cluster = |z: f64| {
        let leaf = origin.leaf_at(metres([32.0, 32.0, z]).as_dvec3()).unwrap();
        tree.leafs[leaf as usize].cluster
    };
    assert_eq!([-20.0, -8.0, 4.0].map(cluster), [Some(0), None, Some(1)]);
    assert_eq!(tree.visible, [0b11, 0b10]);
    let bounds = tree.leafs[0].bounds;
    assert_eq!(bounds, Aabb::new(metres([0.0, 64.0, 0.0]), metres([64.0, 0.0, 64.0])));
}

#[test]
fn rooms_behind_teleporters_are_inside_and_unused_rooms_are_not() {
    // Three closed chambers side by side along x, in one block of stone.
    let mut draft = BspDraft::room();
    let shader = draft.shader("textures/wall", 0, SOLID);
    for chamber in 0..3 {
        let x = 200.0 * chamber as f32 + 1_000.0;
        draft.brush(shader, [x - 100.0, -100.0, -100.0], [x + 100.0, 100.0, -50.0]);
        draft.brush(shader, [x - 100.0, -100.0, 50.0], [x + 100.0, 100.0, 100.0]);
        for [min, max] in [[-100.0, -50.0], [50.0, 100.0]] {
            draft.brush(shader, [x - 100.0, min, -50.0], [x + 100.0, max, 50.0]);
            draft.brush(shader, [x + min, -50.0, -50.0], [x + max, 50.0, 50.0]);
        }
    }
    draft.lumps[0] = br#"{ "classname" "info_player_start" "origin" "1000 0 -20" }
        { "classname" "misc_teleporter_dest" "origin" "1400 0 -20" }"#
        .to_vec();
    let options = crate::CompileOptions { voxel: Some(1.0), ..Default::default() };
    let go_on = |_, _| std::ops::ControlFlow::Continue(());
    let (world, _) = crate::compile(&draft.model(), &options, &go_on).unwrap();
    let has_cell = |x: f64| world.cells.at(metres([x, 0.0, 0.0])).is_some();
    assert_eq!([1_000.0, 1_200.0, 1_400.0, 1_100.0].map(has_cell), [true, false, true, false]);
}

#[test]
fn glass_water_and_the_parts_of_doors_do_not_block_sight() {
    for (contents, blocks) in [(SOLID, true), (SOLID | CONTENTS_TRANSLUCENT, false), (0x20, false)]
    {
        let mut draft = BspDraft::new();
        let shader = draft.shader("textures/some", 0, contents);
        draft.brush(shader, [0.0; 3], [8.0; 3]);
        assert_eq!(draft.model().opaque.len(), if blocks { 12 } else { 0 }, "{contents:#x}");
        draft.world_brushes = 0;
        assert!(draft.model().opaque.is_empty(), "a brush of another model");
    }
}

#[test]
fn sky_and_nodraw_are_not_drawn() {
    let corners = [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [8.0, 8.0, 0.0]];
    for (flags, drawn) in [(0, 1), (0x4, 0), (0x80, 0), (0x100, 0), (0x200, 0), (0x10, 1)] {
        let mut draft = BspDraft::new();
        let shader = draft.shader("textures/some", flags, SOLID);
        draft.face(1, shader, &corners, &[0, 1, 2], [0, 0]);
        assert_eq!(draft.model().surfaces.len(), drawn, "{flags:#x}");
    }
}

#[test]
fn large_faces_are_divided_so_that_light_is_kept() {
    let mut draft = BspDraft::new();
    let shader = draft.shader("textures/floor", 0, SOLID);
    // The lightmap is dark on its left half.
    let pixel = |i: usize| if i / 3 % 128 < 64 { 0 } else { 120 };
    draft.lumps[14] = (0..128 * 128 * 3).map(pixel).collect();
    let corners = [[0.0, 0.0, 0.0], [64.0, 0.0, 0.0], [64.0, 64.0, 0.0], [0.0, 64.0, 0.0]];
    draft.face(3, shader, &corners, &[0, 1, 2, 0, 2, 3], [0, 0]);
    let model = draft.model();
    let surface = &model.surfaces[0];
    assert!(surface.triangles.len() >= 16, "{}", surface.triangles.len());
    let middle = metres([32.0, 0.0, 0.0]).x;
    for (position, [light, ..]) in surface.positions.iter().zip(&surface.colours) {
        let apart = position.x - middle;
        assert!(apart < 0.1 || *light > 150, "{position} {light}");
        assert!(apart > -0.1 || *light < 100, "{position} {light}");
    }
    let area: f32 = surface.corners().map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum();
    assert!((area - (64.0 * UNIT as f32).powi(2)).abs() < 1e-3, "{area}");
}

#[test]
fn faulty_records_are_refused_with_a_reason() {
    let check = |edit: &dyn Fn(&mut BspDraft), expected: &str| {
        let mut draft = BspDraft::room();
        edit(&mut draft);
        let error = draft.error();
        assert!(error.contains(expected), "{error:?} does not contain {expected:?}");
    };
    let set = |lump: usize, at: usize, value: i32| {
        move |draft: &mut BspDraft| {
            draft.lumps[lump][at..at + 4].copy_from_slice(&value.to_le_bytes());
        }
    };
    check(&set(8, 0, -1), "a brush refers");
    check(&set(8, 4, i32::MAX), "a brush refers");
    check(&set(8, 8, 2), "a brush refers");
    check(&set(9, 0, 99), "a brush refers");
    check(&set(13, 0, 2), "a face refers");
    check(&set(13, 12, 99), "a face refers");
    check(&set(13, 16, i32::MAX), "a face refers");
    check(&set(13, 104 + 96, 1_000_003), "a face refers");
    check(&set(11, 0, 4), "a mesh vertex refers");
    check(&set(3, 0, 99), "a node refers");
    check(&set(3, 4, 2), "a node refers");
    check(&set(3, 4, -4), "a node refers");
    // A node that leads to itself, and two that lead to one.
    check(&set(3, 36 + 4, 1), "a node refers");
    check(&set(3, 4, 1), "a node refers");
    check(&set(4, 0, 2), "a leaf refers");
    check(&set(16, 0, 3), "lump 16");
    check(&set(16, 4, i32::MAX), "lump 16");
    check(&set(16, 4, 0), "lump 16");
    check(&set(10, 0, f32::NAN.to_bits() as i32), "not finite");
    check(&set(10, 4, f32::INFINITY.to_bits() as i32), "not finite");
    check(&|draft| draft.world_faces = 99, "a model refers");
    check(&|draft| draft.lumps[13].truncate(100), "lump 13");
    check(&|draft| draft.lumps[0] = vec![b'{'; 9 << 20], "too many bytes of entities");
}

#[test]
fn textures_come_from_archives_by_name_or_by_script_and_the_last_one_counts() {
    use std::io::Write;

    let folder = tempfile::tempdir().unwrap();
    let picture = |colour: [u8; 3]| {
        // True colour without compression, 256 × 64 pixels of 24 bits.
        let [red, green, blue] = colour;
        let mut bytes = vec![0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 64, 0, 24, 0];
        bytes.extend([blue, green, red].repeat(256 * 64));
        bytes
    };
    let pack = |name: &str, files: &[(&str, Vec<u8>)]| {
        let path = folder.path().join(name);
        let mut archive = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
        for (name, bytes) in files {
            archive.start_file(*name, zip::write::SimpleFileOptions::default()).unwrap();
            archive.write_all(bytes).unwrap();
        }
        archive.finish().unwrap();
        path
    };
    let script = b"textures/lamp { { map $lightmap } { map gfx/Glow.TGA } }".to_vec();
    let first = pack("a.pk3", &[("textures/wall.tga", picture([1, 2, 3]))]);
    let second = pack(
        "b.pk3",
        &[
            ("Textures/WALL.tga", picture([9, 8, 7])),
            ("scripts/lights.shader", script),
            ("gfx/glow.tga", picture([5, 5, 5])),
        ],
    );
    let mut archives = Archives::open(&[first, second.clone()]).unwrap();
    let wall = archives.texture("textures/wall").unwrap();
    assert_eq!((wall.dimensions(), wall.pixel(0, 0)), ((128, 64), [18, 16, 14]));
    assert_eq!(archives.texture("textures/lamp").unwrap().pixel(0, 0), [10, 10, 10]);
    assert!(archives.texture("textures/none").is_none());

    let whole = std::fs::read(&second).unwrap();
    std::fs::write(&second, &whole[..whole.len() / 2]).unwrap();
    let error = Archives::open(std::slice::from_ref(&second)).err().unwrap().to_string();
    assert!(error.contains("b.pk3"), "{error}");
}
