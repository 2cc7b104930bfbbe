//! `bench` and films, run as a script runs them.

use std::{
    path::Path,
    process::{Command, Output},
};

use glam::{UVec3, Vec3};
use sightline_picture::{DecodeLimits, Encoding, Picture, decode};
use sightline_world::{
    Cells, Mesh, Spawn, World,
    geometry::Aabb,
    motion::Body,
    octree::{Octree, Voxel, morton},
};

/// A picture that a command wrote.
fn picture(path: &Path) -> Picture {
    let limits = DecodeLimits { edge_max: 1024, bytes_max: 1 << 24 };
    decode(&std::fs::read(path).unwrap(), Encoding::Marked, limits).unwrap()
}

/// A hall of 8 m with a floor and two walls, as voxels and as triangles.
fn hall() -> World {
    let place =
        |a: u32, b: u32| [UVec3::new(a, 0, b), UVec3::new(a, b / 2, 0), UVec3::new(0, b / 2, a)];
    let places = (0..64).flat_map(|a| (0..64).flat_map(move |b| place(a, b)));
    let mut keys: Vec<u64> = places.map(morton).collect();
    keys.sort_unstable();
    keys.dedup();
    let voxel = |key| Voxel { key, colour: [(key % 251) as u8, 140, 90], ..Voxel::default() };
    let voxels = keys.into_iter().map(voxel).collect();
    let corners = [[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]];
    let floor = corners.map(|[a, b]| Vec3::new(a, 0.05, b));
    let walls = corners.map(|[a, b]| [Vec3::new(a, b / 2.0, 0.05), Vec3::new(0.05, b / 2.0, a)]);
    let positions = floor.into_iter().chain(walls.map(|[a, _]| a)).chain(walls.map(|[_, b]| b));
    let triangles = [0, 4, 8].into_iter().flat_map(|i| [[i, i + 1, i + 2], [i, i + 2, i + 3]]);
    World {
        title: "hall".into(),
        octree: Octree::from_voxels(Vec3::ZERO, 0.125, 6, voxels).expect("small"),
        cells: Cells::whole(Aabb::new(Vec3::ZERO, Vec3::splat(8.0))),
        mesh: Mesh { positions: positions.collect(), triangles: triangles.collect() },
        spawns: [2.0, 6.0].map(|x| Spawn { eye: Vec3::new(x, 1.725, 6.0), yaw: 0.3 }).into(),
        body: Body::PERSON,
        speed_max: 4.0,
        movers: Vec::new(),
        rooms: Default::default(),
        light: None,
        origin: None,
    }
}

fn client(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sightline-client"));
    command.current_dir(folder).args(line.split(' ')).output().expect("the client runs")
}

fn stdout(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn a_bench_writes_its_figures_for_people_and_machines_and_draws() {
    let folder = tempfile::tempdir().unwrap();
    hall().write(&folder.path().join("hall.slw")).unwrap();
    let output = client(
        folder.path(),
        "bench hall.slw --size 96x64 --size 64x48 --threads 1,2 --frames 4 --repeats 1 --pictures p \
         --json f.json",
    );
    let text = stdout(&output);
    let json = std::fs::read_to_string(folder.path().join("f.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let runs = json["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 4, "two sizes, each on one thread and on two");
    for run in runs {
        let of = |name: &str, figure: &str| {
            let rows = run["rows"].as_array().unwrap().iter();
            let row = rows.clone().find(|row| row["name"] == name);
            row.unwrap_or_else(|| panic!("no {name}"))[figure].as_f64().unwrap()
        };
        assert_eq!((of("rays, BVH2", "ratio_bvh2"), of("rays, CWBVH", "ratio_cwbvh")), (1.0, 1.0));
        let ratio = of("orthogonal", "ratio_bvh2");
        assert!(ratio > 0.0, "{ratio}");
        assert_eq!(run["rows"][0]["path_cpu_ms"].as_array().unwrap().len(), 4);
    }
    for quality in json["quality"].as_array().unwrap() {
        let depths = quality["depths"].as_array().unwrap();
        assert_eq!(depths.len(), 2);
        assert!(depths.iter().all(|d| d["agreeing"].as_f64() > Some(0.999)), "{depths:?}");
    }
    for expected in ["96 × 64, 1 thread:", "64 × 48, 2 threads:", "rays, CWBVH", "shimmer"] {
        assert!(text.contains(expected), "{expected} in {text}");
    }
    for file in ["spawn-000.png", "spawn-001.png", "path-0003.png"] {
        let picture = picture(&folder.path().join("p").join(file));
        assert_eq!((picture.width(), picture.height()), (4 * 96, 64), "{file}");
    }
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("96 × 64, 2 threads: 100 %"), "{said}");
}

#[test]
fn the_modes_of_the_renderer_are_compared() {
    let folder = tempfile::tempdir().unwrap();
    hall().write(&folder.path().join("hall.slw")).unwrap();
    let text = stdout(&client(
        folder.path(),
        "bench hall.slw --compare --size 96x64 --size 160x120 --frames 3 --json f.json",
    ));
    assert!(text.contains("160 × 120"), "{text}");
    let json = std::fs::read_to_string(folder.path().join("f.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["runs"].as_array().unwrap().len(), 0);
    for comparison in json["comparisons"].as_array().unwrap() {
        assert_eq!(comparison["views"].as_array().unwrap().len(), 5);
        assert_eq!(comparison["shifted"]["worst"].as_f64(), Some(0.0), "{comparison}");
        let projected = comparison["projections"]["worst"].as_f64().unwrap();
        assert!(projected > 0.0 && projected <= 1.0, "{projected}");
    }
}

#[test]
fn a_film_follows_a_trace() {
    let folder = tempfile::tempdir().unwrap();
    hall().write(&folder.path().join("hall.slw")).unwrap();
    let rows = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n\
                500,7,2,1.7,6,0,0,0,0,0\n500,9,6,1.7,6,0,0,0,0,0\n800,9,6,1.7,5,0,0,0,0,0\n";
    std::fs::write(folder.path().join("trace.csv"), rows).unwrap();
    let film = |flags: &str| {
        client(folder.path(), &format!("shot hall.slw --size 80x60 --path trace.csv {flags}"))
    };
    stdout(&film("--id 9 --frames 3 -o film/%03d.png"));
    stdout(&client(
        folder.path(),
        "shot hall.slw --size 80x60 --eye 6,1.7,5 --look 6,1.7,0 -o last.png",
    ));
    let picture = |name: &str| picture(&folder.path().join(name));
    assert_eq!(picture("film/002.png"), picture("last.png"));
    assert_ne!(picture("film/001.png"), picture("last.png"));
    // Without --path, the film is a walk from spawn point to spawn point.
    let text = stdout(&client(folder.path(), "shot hall.slw --size 80x60 --frames 2 -o walk"));
    assert!(text.contains("s of the path"), "{text}");
    assert_ne!(picture("walk/frame-0000.png"), picture("walk/frame-0001.png"));
}

#[test]
fn wrong_arguments_give_one_clear_line() {
    let folder = tempfile::tempdir().unwrap();
    hall().write(&folder.path().join("hall.slw")).unwrap();
    std::fs::write(folder.path().join("bad.csv"), "nonsense\n").unwrap();
    std::fs::write(
        folder.path().join("trace.csv"),
        "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n0,7,2,1.7,6,0,0,0,0,0\n",
    )
    .unwrap();
    for (line, code, expected) in [
        ("bench nowhere.slw", 1, "cannot read nowhere.slw"),
        ("bench hall.slw --path bad.csv", 1, "bad.csv"),
        ("bench hall.slw --path trace.csv --id 8", 1, "no such avatar; the ids go from 7 to 7"),
        ("bench hall.slw --frames 0", 1, "--frames"),
        ("bench hall.slw --threads 0", 2, "--threads"),
        ("bench hall.slw --size 0x9", 2, "a size is WIDTHxHEIGHT, such as 960x540"),
        ("shot hall.slw --path trace.csv -o a", 1, "give --frames too"),
        ("shot hall.slw --frames 2 -o one.png", 1, "a film is many pictures"),
        ("shot hall.slw --frames 2 --eye 1,1,1 -o film", 2, "cannot be used with"),
    ] {
        let output = client(folder.path(), line);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{line}: {said}");
        assert!(said.contains(expected), "{line}: {said}");
        assert!(code == 2 || said.lines().count() == 1, "{line}: {said}");
    }
}
