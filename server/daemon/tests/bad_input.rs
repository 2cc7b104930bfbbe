//! Kinds of bad input to `sightline-server`. Each gets one line that says what is wrong and what to
//! do, and leaves nothing behind. `client/app/tests/bad_input.rs` has those of the client.

use std::{
    collections::BTreeSet,
    fs,
    net::UdpSocket,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use sightline_fixtures::voxel_floor;

const PROGRAM: &str = env!("CARGO_BIN_EXE_sightline-server");

/// A command and what its error says: what is wrong, and what to do.
struct Row {
    command: &'static str,
    code: i32,
    says: &'static [&'static str],
}

const fn fails(command: &'static str, says: &'static [&'static str]) -> Row {
    Row { command, code: 1, says }
}

const fn wrong_usage(command: &'static str, says: &'static [&'static str]) -> Row {
    Row { command, code: 2, says }
}

/// The files are made by [`make_files`].
const ROWS: &[Row] = &[
    // Models.
    fails("compile absent.glb -o o.slw", &["cannot read absent.glb", "No such file"]),
    fails("compile empty.glb -o o.slw", &["empty.glb is empty", "export it again"]),
    fails("compile folder -o o.slw", &["cannot read folder", "not a regular file"]),
    fails("compile text.glb -o o.slw", &["text.glb is neither GLB", "export it as GLB"]),
    fails("compile cut.glb -o o.slw", &["cut.glb: truncated GLB", "export it again"]),
    fails("compile json.gltf -o o.slw", &["json.gltf: "]),
    fails("compile lost.gltf -o o.slw", &["lost.gltf: ", "cannot read", "lost.bin"]),
    fails("compile outside.gltf -o o.slw", &["outside the model's folder"]),
    fails("compile draco.gltf -o o.slw", &["KHR_draco_mesh_compression", "npx"]),
    fails("compile nothing.gltf -o o.slw", &["has no triangles", "export its meshes"]),
    fails("compile house.ifc -o o.slw", &["is IFC", "IfcConvert house.ifc house.glb"]),
    fails("compile house.fbx -o o.slw", &["is FBX", "assimp export house.fbx house.glb"]),
    fails("compile house.obj -o o.slw", &["is OBJ", "assimp export house.obj house.glb"]),
    fails("compile good.slw -o o.slw", &["is a world", "sightline-server serve good.slw"]),
    fails("compile cut.bsp -o o.slw", &["cut.bsp: "]),
    fails("compile cut.bsp -o o.slw --scale 2", &["leave out --scale"]),
    // Sizes that cannot be done.
    fails("compile good.glb -o o.slw --voxel 0.001", &["--voxel"]),
    fails("compile large.gltf -o o.slw", &["large.gltf: ", "--scale"]),
    // Rooms.
    fails("compile good.glb -o o.slw --rooms absent.toml", &["cannot read absent.toml"]),
    fails("compile good.glb -o o.slw --rooms text.toml", &["text.toml:1"]),
    fails("compile good.glb -o o.slw --rooms unknown.toml", &["unknown.toml:4", "no room"]),
    // Files to write.
    fails("compile good.glb -o no/o.slw", &["cannot write no/o.slw", "there is no folder no"]),
    fails("compile good.glb -o folder", &["cannot write folder", "it is a folder"]),
    fails("compile good.glb -o o.slw --json no/f.json", &["cannot write no/f.json"]),
    fails("demo-building -o no/b.glb", &["cannot write no/b.glb", "there is no folder no"]),
    fails("inspect good.slw --map no/m.png", &["cannot write no/m.png"]),
    fails("inspect good.slw --report no/r.html", &["cannot write no/r.html"]),
    fails("replay good.slw good.csv --dump folder", &["cannot write folder", "it is a folder"]),
    // Worlds.
    fails("inspect absent.slw", &["cannot read absent.slw", "No such file"]),
    fails("inspect text.glb", &["text.glb is a model", "compile text.glb -o text.slw"]),
    fails("inspect text.toml", &["text.toml is not a world", "sightline-server compile"]),
    fails("inspect damaged.slw", &["damaged.slw: ", "damaged"]),
    fails("inspect old.slw", &["old.slw: ", "version 1", "compile again"]),
    fails("replay good.glb good.csv", &["good.glb is a model", "compile good.glb -o good.slw"]),
    // Traces.
    fails("replay good.slw absent.csv", &["absent.csv"]),
    fails("replay good.slw text.csv", &["text.csv"]),
    fails("replay good.slw good.csv --speed-max 0", &["--speed-max must be above 0"]),
    // Serving.
    fails("serve absent.glb", &["cannot read absent.glb", "No such file"]),
    fails("serve cut.glb", &["cut.glb: "]),
    fails("serve house.ifc", &["is IFC", "IfcConvert house.ifc house.glb"]),
    fails("serve damaged.slw", &["damaged.slw: ", "damaged"]),
    fails("serve good.slw --voxel 0.1", &["good.slw is a world", "leave out"]),
    fails("serve --watch", &["--watch needs a building"]),
    fails("serve --voxel 0.1", &["name its file"]),
    fails("serve good.slw --config absent.toml", &["cannot read absent.toml"]),
    fails(
        "serve good.slw --config field.toml",
        &["field.toml: ", "line 1", "did you mean `tick_hz`?"],
    ),
    fails("serve good.slw --config range.toml", &["range.toml: tick_hz must be 1 to 128"]),
    fails("serve good.slw --http 192.0.2.1:1", &["cannot listen on 192.0.2.1:1", "--http"]),
    fails("serve good.slw --data text.toml", &["text.toml"]),
    // Status.
    fails("status 127.0.0.1:9", &["no server answers at http://127.0.0.1:9", "`serve` prints"]),
    wrong_usage("status nowhere", &["nowhere", "such as 4778"]),
    // Flags.
    wrong_usage("compile good.glb", &["--output <OUT.slw>", "see --help"]),
    wrong_usage("compile good.glb -o o.slw --voxel 0", &["--voxel", "from 0.001 to 10 metres"]),
    wrong_usage("compile good.glb -o o.slw --cell wide", &["--cell", "from 0.25 to 1000 metres"]),
    wrong_usage("compile good.glb -o o.slw --up x", &["--up", "use y or z"]),
    wrong_usage("compile good.glb -o o.slw --spawn 1,2", &["--spawn", "such as 1.5,1.6,-2,90"]),
    wrong_usage("compile good.glb -o o.slw --voxl 1", &["--voxl", "--voxel", "see --help"]),
    wrong_usage("demo-building -o b.glb --rooms 0", &["--rooms", "0 is not in 1.."]),
    wrong_usage("inspect good.slw --density", &["--map <OUT.png>", "see --help"]),
    wrong_usage("replay good.slw good.csv --loss 51", &["--loss", "from 0 to 50"]),
    wrong_usage("serve --listen nowhere", &["--listen", "such as 4777"]),
    wrong_usage("serve --http nowhere", &["--http", "such as 4778"]),
    wrong_usage("sevre", &["sevre", "serve", "see --help"]),
];

fn make_files(folder: &Path) {
    let write = |name: &str, bytes: &[u8]| fs::write(folder.join(name), bytes).unwrap();
    let glb = sightline_demo_building::glb(1, 1);
    let world = voxel_floor::world(&[]).to_bytes();
    let (mut damaged, mut old) = (world.clone(), world.clone());
    damaged[60] ^= 1;
    old[4..8].copy_from_slice(&1u32.to_le_bytes());
    let gltf = |more: &str| format!(r#"{{"asset":{{"version":"2.0"}}{more}}}"#);
    let buffer = |uri: &str| gltf(&format!(r#","buffers":[{{"byteLength":4,"uri":"{uri}"}}]"#));
    fs::create_dir(folder.join("folder")).unwrap();
    write("good.glb", &glb);
    write("cut.glb", &glb[..glb.len() / 2]);
    write("empty.glb", b"");
    write("text.glb", b"a house");
    write("json.gltf", b"{\"asset\": ");
    write("lost.gltf", buffer("lost.bin").as_bytes());
    write("outside.gltf", buffer("../secret.bin").as_bytes());
    let draco = r#","extensionsUsed":["KHR_draco_mesh_compression"],
                   "extensionsRequired":["KHR_draco_mesh_compression"]"#;
    write("draco.gltf", gltf(draco).as_bytes());
    write("nothing.gltf", gltf("").as_bytes());
    let large = r#","buffers":[{"byteLength":36,"uri":"lost.bin"}],
        "bufferViews":[{"buffer":0,"byteLength":36}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3",
                      "min":[0,0,0],"max":[9000,3,9000]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}],"scene":0"#;
    write("large.gltf", gltf(large).as_bytes());
    write("cut.bsp", b"IBSP\x2e\0\0\0");
    for name in ["house.ifc", "house.fbx", "house.obj"] {
        write(name, b"ISO-10303-21; v 1 2 3");
    }
    write("good.slw", &world);
    write("damaged.slw", &damaged);
    write("old.slw", &old);
    write("text.toml", b"a house\n");
    write(
        "unknown.toml",
        b"[[room]]\nname = \"r\"\nbox = [[0, 0, 0], [4, 3, 4]]\nvisible = { rooms = [\"s\"] }\n",
    );
    write("field.toml", b"ticks = 3");
    write("range.toml", b"tick_hz = 0");
    write("good.csv", b"t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n0,7,2,1.8,4,0,0,0,0,0\n");
    write("text.csv", b"a house\n");
}

/// All paths below a folder, apart from what servers keep.
fn listing(folder: &Path) -> BTreeSet<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let entries = entries.filter(|path| !path.ends_with("data"));
    let below = |path: PathBuf| {
        let inner = if path.is_dir() { listing(&path) } else { BTreeSet::new() };
        inner.into_iter().chain([path])
    };
    entries.flat_map(below).collect()
}

/// What is wrong with how a row is answered; `None` when nothing is.
fn fault(folder: &Path, row: &Row, before: &BTreeSet<PathBuf>) -> Option<String> {
    let mut command = Command::new(PROGRAM);
    command.current_dir(folder).args(row.command.split(' ')).stdin(Stdio::null());
    if row.command.starts_with("serve") && !row.command.contains("--data") {
        command.args(["--data", "data"]);
    }
    if row.command.starts_with("serve") && !row.command.contains("--listen") {
        command.args(["--listen", "localhost:0"]);
    }
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    // Progress, the log and warnings come before the error.
    let errors: Vec<&str> =
        said.lines().filter(|line| line.starts_with("sightline-server: ")).collect();
    let is_last = said.lines().last() == errors.last().copied();
    let says_all = |error: &&str| row.says.iter().all(|part| error.contains(part));
    let is_one_line = errors.len() == 1 && is_last && !said.contains("panicked");
    let left: Vec<_> = listing(folder).symmetric_difference(before).cloned().collect();
    let holds = output.status.code() == Some(row.code)
        && is_one_line
        && errors.first().is_some_and(says_all)
        && left.is_empty();
    (!holds).then(|| {
        format!(
            "{}\n  exits with {:?}, leaves {left:?} and says:\n{said}",
            row.command, output.status
        )
    })
}

#[test]
fn bad_input_gets_one_line_and_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    make_files(folder);
    let before = listing(folder);
    let faults: Vec<String> = ROWS.iter().filter_map(|row| fault(folder, row, &before)).collect();
    assert!(faults.is_empty(), "{} of {}:\n{}", faults.len(), ROWS.len(), faults.join("\n"));
}

#[test]
fn an_address_in_use_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    make_files(folder);
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let output = Command::new(PROGRAM)
        .current_dir(folder)
        .args(["serve", "good.slw", "--data", "data", "--listen", &address])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    let expected = format!("sightline-server: cannot listen on {address}: ");
    let last = said.lines().last().unwrap_or_default();
    assert!(last.starts_with(&expected) && last.contains("choose another address"), "{said}");
    assert_eq!(output.status.code(), Some(1));
}
