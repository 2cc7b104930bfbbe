//! The program as a shell runs it: a reader that goes away, and Ctrl-C.

use std::{
    fs,
    io::{BufRead, BufReader},
    path::Path,
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use sightline_fixtures::voxel_floor;
use sightline_protocol::{
    fingerprint::KeyFingerprint,
    text::{ChatLine, Name},
};
use sightline_server::{
    net::{HttpAddress, ServeConfig},
    people::{People, Role},
};
use sightline_world::World;

const PROGRAM: &str = env!("CARGO_BIN_EXE_sightline-server");

fn building(folder: &Path, rooms: u32) {
    let rooms = rooms.to_string();
    let made = Command::new(PROGRAM)
        .current_dir(folder)
        .args(["demo-building", "-o", "b.glb", "--rooms", &rooms])
        .stdout(Stdio::null())
        .status()
        .unwrap();
    assert!(made.success());
}

/// Runs a command nobody listens to; its exit code.
fn unheard(folder: &Path, arguments: &[&str]) -> Option<i32> {
    let mut child = Command::new(PROGRAM)
        .current_dir(folder)
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop((child.stdout.take(), child.stderr.take()));
    child.wait().unwrap().code()
}

#[test]
fn a_reader_that_has_gone_is_no_fault() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let check =
        |arguments: &[&str]| assert_eq!(unheard(folder, arguments), Some(0), "{arguments:?}");
    check(&["demo-building", "-o", "b.glb", "--rooms", "2"]);
    check(&[
        "compile", "b.glb", "-o", "b.slw", "--light", "none", "--voxel", "0.25", "--cell", "3",
    ]);
    assert!(folder.join("b.plan.png").is_file(), "the plan is beside the world");
    check(&["inspect", "b.slw"]);
    assert_eq!(unheard(folder, &["inspect", "absent.slw"]), Some(1));
}

#[test]
fn owners_and_invitations_are_made_without_a_server() {
    let folder = tempfile::tempdir().unwrap();
    let said = |arguments: &[&str]| {
        let output = Command::new(PROGRAM)
            .args(arguments)
            .args(["--data", folder.path().to_str().unwrap()])
            .output()
            .unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code(), text(output.stdout), text(output.stderr))
    };
    let key = "3f2a-90bc-11d2-7f80-aa01";
    assert_eq!(said(&["owner", key]).1, format!("{key} is an owner\n"));
    assert_eq!(said(&["allow", "FFFF90BC11D27F80AA01"]).0, Some(0));
    let (code, invitation, _) = said(&["invite", "--uses", "2"]);
    assert_eq!((code, invitation.trim().len()), (Some(0), 32));
    let people = People::open(Some(folder.path()), 7).unwrap();
    let (owner, guest) = (key.parse().unwrap(), KeyFingerprint([7; 10]));
    assert_eq!(people.standing(owner).role, Role::Owner);
    assert!(people.accept_invitation(guest, &invitation));
    let name = Name::new("Ada").unwrap();
    people.note_chat(guest, &name, &ChatLine::new("good morning").unwrap());
    people.finish();
    let chat = said(&["chat"]).1;
    assert!(chat.ends_with("  0707-0707-0707-0707-0707  Ada: good morning\n"), "{chat}");
    let audit = said(&["audit", "--lines", "3"]).1;
    assert!(audit.contains(&format!("operator  make owner {key}\n")), "{audit}");
    let (code, _, error) = said(&["owner", "Ada"]);
    assert_eq!(code, Some(2));
    assert!(error.contains("20 hexadecimal digits"), "{error}");
    drop(people);
    fs::write(folder.path().join("people.db"), "x".repeat(5_000)).unwrap();
    let (code, _, error) = said(&["owner", key]);
    assert_eq!(code, Some(1));
    assert!(error.contains("people.db") && error.lines().count() == 1, "{error}");
}

#[test]
fn a_world_that_misses_somebody_fails_its_verification() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    building(folder, 2);
    assert_eq!(
        unheard(
            folder,
            &[
                "compile", "b.glb", "-o", "b.slw", "--light", "none", "--voxel", "0.25", "--cell",
                "3"
            ]
        ),
        Some(0)
    );
    let verify = || {
        let arguments = ["inspect", "b.slw", "--verify", "2000", "--entries", "5", "--lines", "99"];
        Command::new(PROGRAM)
            .current_dir(folder)
            .args(arguments)
            .args(["--json", "f.json"])
            .output()
            .unwrap()
    };
    let misses = || {
        let text = fs::read_to_string(folder.join("f.json")).unwrap();
        let figures: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert!(figures["over_send"].is_f64() && figures["own_misses"].is_null(), "{text}");
        figures["misses"].as_u64().unwrap()
    };
    let output = verify();
    assert_eq!((output.status.code(), misses()), (Some(0), 0));

    let path = folder.join("b.slw");
    let mut world = World::read(&path).unwrap();
    for (cell, row) in (0..).zip(&mut world.cells.pvs) {
        row.clear();
        row.insert(cell);
    }
    world.write(&path).unwrap();
    let output = verify();
    assert_eq!(output.status.code(), Some(1));
    assert!(misses() > 0);
    let errors = String::from_utf8(output.stderr).unwrap();
    let expected = format!("sightline-server: b.slw: the PVS denies {} of", misses());
    assert!(errors.lines().last().unwrap().starts_with(&expected), "{errors}");
    assert!(String::from_utf8(output.stdout).unwrap().contains("missed, by cell: "));
}

#[test]
fn compile_ends_with_a_verdict_and_the_next_command() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    building(folder, 4);
    let arguments = [
        "compile", "b.glb", "-o", "b.slw", "--light", "none", "--voxel", "0.25", "--cell", "3",
        "--json", "f.json",
    ];
    let output = Command::new(PROGRAM)
        .current_dir(folder)
        .args(arguments)
        .args(["--drop", "nothing*"])
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("% of pairs of standing places see each other"), "{text}");
    assert!(text.ends_with("next: sightline-server serve b.slw\n"), "{text}");
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.contains("--drop nothing*: no node of the model has such a name"), "{errors}");
    let figures = fs::read_to_string(folder.join("f.json")).unwrap();
    let figures: serde_json::Value = serde_json::from_str(&figures).unwrap();
    assert!(figures["verdict"]["seen_share"].is_f64(), "{figures}");
    let names = ["triangles", "spaces", "gates", "cells", "portals", "rooms", "windows"];
    assert_agreement(&text, &figures, &names);
    let inspect = ["inspect", "b.slw", "--carved", "c.png", "--json", "f.json"];
    let output = Command::new(PROGRAM).current_dir(folder).args(inspect).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let figures = fs::read_to_string(folder.join("f.json")).unwrap();
    let figures: serde_json::Value = serde_json::from_str(&figures).unwrap();
    assert_agreement(&text, &figures, &["bytes", "cells", "portals"]);
    assert_agreement(&text, &figures["carving"], &["polygons", "elements", "clusters"]);
}

/// Counts with these names are the same in a table and in JSON.
#[track_caller]
fn assert_agreement(table: &str, figures: &serde_json::Value, names: &[&str]) {
    for name in names {
        let words = |line: &str| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        let expected = [(*name).to_owned(), figures[name].as_u64().unwrap().to_string()];
        assert!(table.lines().any(|line| words(line) == expected), "{expected:?} in {table}");
    }
}

/// What inspect suggests, compile finds beside the model; a mistake in it is a line that tells
/// where.
#[test]
fn rooms_are_suggested_edited_and_compiled() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    building(folder, 4);
    let run = |arguments: &[&str]| {
        let output = Command::new(PROGRAM).current_dir(folder).args(arguments).output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code(), text(output.stdout), text(output.stderr))
    };
    let compile = |more: &[&str]| {
        let arguments =
            ["compile", "b.glb", "-o", "b.slw", "--light", "none", "--voxel", "0.1", "--cell", "3"];
        run(&[&arguments[..], more].concat())
    };
    assert_eq!(compile(&[]).0, Some(0));
    let (code, toml, _) = run(&["inspect", "b.slw", "--suggest-rooms"]);
    assert_eq!(code, Some(0));
    let rooms = toml.matches("[[room]]").count();
    assert!((4..=6).contains(&rooms), "{toml}");
    fs::write(folder.join("b.rooms.toml"), &toml).unwrap();
    let (code, table, _) = compile(&[]);
    assert_eq!(code, Some(0));
    assert!(
        table
            .lines()
            .any(|line| line.starts_with("rooms ") && line.ends_with(&format!(" {rooms}")))
    );
    let (_, table, _) = run(&["inspect", "b.slw", "--map", "b.png"]);
    assert!(table.contains("  room 0.1 ") && table.contains(" windows"), "{table}");

    let sealed = "title = \"Private\"\nsealed = true\nvisible = { rooms = [\"rom 0.2\"] }";
    let line = 3 + toml.lines().position(|line| line == "[[room]]").unwrap();
    let name = "name = \"room 0.1\"";
    fs::write(folder.join("r.toml"), toml.replace(name, &format!("{name}\n{sealed}"))).unwrap();
    let (code, _, errors) = compile(&["--rooms", "r.toml"]);
    assert_eq!(code, Some(1));
    let expected = format!("sightline-server: r.toml:{}: there is no room \"rom 0.2\"", line + 2);
    assert_eq!(errors.lines().last(), Some(expected.as_str()));
    assert_eq!(compile(&["--rooms", "absent.toml"]).0, Some(1));
}

#[cfg(unix)]
#[test]
fn an_interrupted_compilation_leaves_nothing_and_says_so_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    building(folder, 30);
    // Later stages begin sooner with wide cells and voxels, and without light.
    let (fine, wide) = ([].as_slice(), ["--cell", "6"].as_slice());
    let dark = ["--cell", "6", "--light", "none", "--voxel", "0.125"].as_slice();
    let stages = [
        ("carving", "-INT", fine),
        ("cells and portals", "-TERM", fine),
        ("sight lines", "-INT", fine),
        ("light", "-TERM", wide),
        ("voxels", "-INT", dark),
        ("spawn points", "-TERM", dark),
        ("verdict", "-INT", dark),
    ];
    for (stage, signal, more) in stages {
        let mut child = Command::new(PROGRAM)
            .current_dir(folder)
            .args(["compile", "b.glb", "-o", "b.slw"])
            .args(more)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        // The first sign of a stage: now it is at work.
        let begins = |line: &String| line.starts_with(&format!("{stage}: "));
        assert!(lines.by_ref().map(Result::unwrap).any(|line| begins(&line)), "{stage}");
        let start = Instant::now();
        let killed = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        let last = lines.map(Result::unwrap).last().unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{stage}: {last}");
        // Within a second, and one more for a machine that is busy.
        let passed = start.elapsed();
        println!("{stage}: ended after {passed:?}");
        assert!(passed < Duration::from_secs(2), "{stage}: {passed:?}");
        assert_eq!(last, "sightline-server: interrupted; nothing was written");
        let left: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left, ["b.glb"]);
    }
}

/// What is printed of the settings is what they are, and can be changed and read again.
#[test]
fn serve_prints_its_settings_and_limits() {
    let folder = tempfile::tempdir().unwrap();
    let print = |more: &[&str]| {
        let arguments = [&["serve", "--print-config"], more].concat();
        let output = Command::new(PROGRAM).current_dir(&folder).args(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let text = print(&[]);
    assert_eq!(ServeConfig::from_toml(&text).unwrap(), ServeConfig::default());
    fs::write(folder.path().join("c.toml"), text.replace("chat_burst = 5.0", "chat_burst = 9"))
        .unwrap();
    let changed = print(&["--config", "c.toml", "--http", "off"]);
    let changed = ServeConfig::from_toml(&changed).unwrap();
    assert_eq!((changed.limits.chat_burst, changed.http), (9.0, HttpAddress::Off));
}

/// With `--log json` all of stderr is JSON, one object a line, and a reader knows when it serves.
#[cfg(unix)]
#[test]
fn serve_logs_json_on_request() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("w.slw"), voxel_floor::world(&[]).to_bytes()).unwrap();
    let mut child = Command::new(PROGRAM)
        .current_dir(&folder)
        .args(["serve", "w.slw", "--listen", "127.0.0.1:0", "--http", "127.0.0.1:0"])
        .args(["--data", "data", "--log", "json"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let mut is_stopped = false;
    for line in lines.map(Result::unwrap) {
        let event: serde_json::Value = serde_json::from_str(&line).expect(&line);
        assert!(event["level"].is_string() && event["message"].is_string(), "{line}");
        if event["message"] == "serving" && !is_stopped {
            let stopped = Command::new("kill").arg(child.id().to_string()).status().unwrap();
            is_stopped = stopped.success();
        }
    }
    assert!(is_stopped && child.wait().unwrap().success());
}

#[test]
fn a_share_of_lost_messages_that_is_none_is_wrong_usage() {
    let folder = tempfile::tempdir().unwrap();
    for loss in ["51", "-1", "NaN", "many"] {
        let loss = format!("--loss={loss}");
        assert_eq!(unheard(folder.path(), &["replay", "w.slw", "t.csv", &loss]), Some(2), "{loss}");
    }
}

#[test]
fn light_is_compared_with_paths_of_light() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    building(folder, 1);
    let output = Command::new(PROGRAM)
        .current_dir(folder)
        .args(["light-check", "b.glb", "-o", "l.png", "--voxel", "0.5"])
        .args(["--light-quality", "fast", "--size", "8", "--samples", "1"])
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains("all views: radiosity is "), "{text}");
    assert!(folder.join("l.png").is_file(), "a picture is written");
}

#[test]
fn an_unknown_light_is_wrong_usage() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    building(folder, 1);
    let output = Command::new(PROGRAM)
        .current_dir(folder)
        .args(["compile", "b.glb", "-o", "b.slw", "--light", "candle"])
        .output()
        .unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(errors.contains("use radiosity, ambient or none"), "{errors}");
}
