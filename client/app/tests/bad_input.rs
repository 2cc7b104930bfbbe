//! Kinds of bad input to `sightline-client`. Each gets one line that says what is wrong and what to
//! do, and leaves nothing behind.

use std::{
    collections::BTreeSet,
    ffi::OsString,
    fs,
    path::Path,
    process::{Command, Stdio},
};

use sightline_fixtures::voxel_floor;

const PROGRAM: &str = env!("CARGO_BIN_EXE_sightline-client");

/// A command, its exit code, and what its error says: what is wrong, and what to do.
type Row = (&'static str, i32, &'static [&'static str]);

const ROWS: &[Row] = &[
    ("shot absent.slw -o p.png", 1, &["cannot read absent.slw", "No such file"]),
    ("shot house.glb -o p.png", 1, &["house.glb is a model", "compile house.glb -o house.slw"]),
    ("shot text.txt -o p.png", 1, &["text.txt is not a world", "sightline-server compile"]),
    ("shot damaged.slw -o p.png", 1, &["damaged.slw: ", "damaged"]),
    ("shot good.slw -o no/p.png", 1, &["cannot write no/p.png", "there is no folder no"]),
    ("shot good.slw -o p.png --spawn 99", 1, &["no spawn point 99", "from 0 to 0"]),
    ("shot good.slw -o p.png --fov 0", 1, &["--fov must be between 1 and 170 degrees"]),
    ("shot good.slw -o p.png --path text.txt", 1, &["--path makes a film: give --frames too"]),
    ("shot good.slw -o p.png --frames 3", 1, &["name a folder, or a pattern"]),
    ("shot good.slw -o f-%d.png --frames 3 --path text.txt", 1, &["text.txt: "]),
    ("shot good.slw -o p.png --size 0x9", 2, &["--size", "such as 960x540"]),
    ("shot good.slw", 2, &["--output <OUT.png>", "see --help"]),
    ("bench house.glb", 1, &["house.glb is a model", "compile house.glb -o house.slw"]),
    ("bench good.slw --json no/f.json", 1, &["cannot write no/f.json"]),
    ("bench good.slw --frames 0", 1, &["--frames must be from 1 to 100000"]),
    ("swarm nowhere", 1, &["no such address: nowhere", "host:port"]),
    ("swarm 127.0.0.1:1 --seconds 0", 1, &["--seconds must be between 0.1 and 86400"]),
    ("swarm 127.0.0.1:1 --trace absent.csv", 1, &["absent.csv"]),
    ("swarm 127.0.0.1:1 --json no/f.json", 1, &["cannot write no/f.json"]),
    ("swarm 127.0.0.1:1 --clients 0", 2, &["--clients", "0 is not in 1.."]),
    ("swarm 127.0.0.1:1 --fingerprint ab", 2, &["--fingerprint", "64 hexadecimal digits"]),
    ("wlak", 2, &["wlak", "see --help"]),
];

fn make_files(folder: &Path) {
    let write = |name: &str, bytes: &[u8]| fs::write(folder.join(name), bytes).unwrap();
    let world = voxel_floor::world(&[]).to_bytes();
    let mut damaged = world.clone();
    damaged[60] ^= 1;
    write("good.slw", &world);
    write("damaged.slw", &damaged);
    write("house.glb", b"glTF and so on");
    write("text.txt", b"a house\n");
}

fn listing(folder: &Path) -> BTreeSet<OsString> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect()
}

/// What is wrong with how a row is answered; `None` when nothing is.
fn fault(folder: &Path, row: &Row, before: &BTreeSet<OsString>) -> Option<String> {
    let (command, code, says) = *row;
    let output = Command::new(PROGRAM)
        .current_dir(folder)
        .args(command.split(' '))
        .env("HOME", folder.join("home"))
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let errors: Vec<&str> =
        said.lines().filter(|line| line.starts_with("sightline-client: ")).collect();
    let is_one_line = errors.len() == 1 && said.lines().last() == errors.last().copied();
    let holds = output.status.code() == Some(code)
        && is_one_line
        && says.iter().all(|part| errors.iter().all(|error| error.contains(part)))
        && listing(folder) == *before;
    let left = listing(folder);
    (!holds).then(|| {
        format!("{command}\n  exits with {:?}, there is {left:?}; it says:\n{said}", output.status)
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
