//! The recipes of the guides, run on a building whose parts are known.

use std::{
    ops::ControlFlow,
    path::{Path, PathBuf},
    process::Command,
};

use glam::Vec3;
use sightline_compiler::{CompileOptions, compile, import::LeftOut};
use sightline_server::building_files::BuildingFiles;
use sightline_world::World;

/// The places of the test's building, in metres.
const KITCHEN: Vec3 = Vec3::new(2.0, 1.5, -1.5);
const SALON: Vec3 = Vec3::new(6.0, 1.5, -1.5);
const GARDEN: Vec3 = Vec3::new(8.9, 1.5, -1.5);

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn python(arguments: &[&Path]) -> bool {
    let status = Command::new("python3").args(arguments).status();
    status.is_ok_and(|status| status.success())
}

fn has_ifc() -> bool {
    let probe = Command::new("python3").args(["-c", "import ifcopenshell, numpy"]).output();
    probe.is_ok_and(|output| output.status.success())
}

fn compiled(model: &Path, left_out: LeftOut) -> World {
    let files = BuildingFiles { left_out, ..BuildingFiles::of(model) };
    let options = CompileOptions { voxel: Some(0.1), cell: Some(4.0), ..Default::default() };
    let model = files.read().unwrap();
    let (world, report) = compile(&model, &options, &|_, _| ControlFlow::Continue(())).unwrap();
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    world
}

fn sees(world: &World, from: Vec3, to: Vec3) -> bool {
    let [from, to] = [from, to].map(|at| world.cells.at(at).expect("inside of the world"));
    world.cells.sees(from, to)
}

#[test]
fn an_ifc_building_keeps_its_rooms_its_glass_and_its_doors() {
    if !has_ifc() {
        println!("skipped: python3 has no ifcopenshell and numpy");
        return;
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("guides");
    std::fs::create_dir_all(&folder).unwrap();
    let (ifc, glb) = (folder.join("two_rooms.ifc"), folder.join("two_rooms.glb"));
    let maker = repository().join("tests/tests/guides/two_rooms.py");
    let converter = repository().join("docs/guides/ifc_to_glb.py");
    assert!(python(&[&maker, &ifc]), "the test's building is made");
    assert!(python(&[&converter, &ifc, Path::new("-o"), &glb]), "it is converted");

    let closed = compiled(&glb, LeftOut::default());
    let titles: Vec<&str> = closed.rooms.list().iter().map(|room| room.title()).collect();
    assert_eq!(titles, ["Küche", "Salon"]);
    assert!(sees(&closed, SALON, GARDEN), "through glass");
    assert!(!sees(&closed, KITCHEN, SALON), "the door is closed");

    let doors = LeftOut { open_doors: vec!["IfcDoor*".into()], ..LeftOut::default() };
    let open = compiled(&glb, doors);
    assert!(sees(&open, KITCHEN, SALON), "through the open door");

    let narrow = [&*converter, &ifc, Path::new("-o"), &glb, Path::new("--windows")];
    assert!(python(&narrow), "it is converted with windows");
    let world = compiled(&glb, LeftOut::default());
    let windows: Vec<usize> = world.rooms.list().iter().map(|room| room.windows.len()).collect();
    assert_eq!(windows, [1, 1], "the doorway is a window of both rooms");
}
