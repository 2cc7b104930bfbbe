//! The commands: each reads its flags and returns one outcome. `sightline_cli::exit` makes the
//! exit code of it.

mod browsers;
pub mod compile;
pub mod demo_building;
pub mod inspect;
mod inspect_report;
pub mod interrupt;
mod joining;
pub mod light_check;
pub mod model_flags;
pub mod news;
pub mod operators;
pub mod people;
mod pieces_figures;
pub mod replay;
pub mod serve;
#[cfg(feature = "http")]
pub mod status;
#[cfg(feature = "http")]
mod status_table;
pub mod verification;

use glam::Vec3;
use sightline_compiler::{
    LightFigures, carve::CarveReport, octree_statistics::OctreeStatistics, plan::Mark,
};
use sightline_world::{Spawn, World, motion::Pose};

/// A text of a peer or a file without what a terminal takes for a command.
pub fn printable(text: &str) -> String {
    text.replace(char::is_control, "?")
}

/// A mark on a plan: a disc, or a ring.
pub fn mark(eye: Vec3, filled: bool) -> Mark {
    Mark { eye, forward: None, colour: [220, 60, 40], filled, number: None }
}

/// The numbered spawn points of a world on a plan, and what its legend says of them.
pub fn spawn_marks(world: &World) -> (Vec<Mark>, Vec<(&'static str, Mark)>) {
    let spawn_mark = |(number, spawn): (usize, &Spawn)| {
        let forward = Pose { yaw: spawn.yaw, ..Pose::default() }.forward();
        Mark { forward: Some(forward), number: Some(number), ..mark(spawn.eye, false) }
    };
    let marks = world.spawns.iter().enumerate().map(spawn_mark).collect();
    (marks, vec![("spawn point, with heading", mark(Vec3::ZERO, false))])
}

/// The rows about carving, for the tables of `compile` and `inspect`.
pub fn carving_rows(report: &CarveReport) -> [(&'static str, String); 9] {
    let sealed =
        if report.added > 0 { format!(" ({} sealed)", report.sealed) } else { String::new() };
    [
        ("polygons", report.polygons.to_string()),
        ("  axial", report.axial.to_string()),
        ("  semi-axial", report.semi_axial.to_string()),
        ("  non-axial", report.non_axial.to_string()),
        ("elements", report.elements.to_string()),
        ("clusters", report.clusters.to_string()),
        ("cuttings", report.cuttings.to_string()),
        ("polygons removed", report.removed.to_string()),
        ("polygons added", format!("{}{sealed}", report.added)),
    ]
}

/// The rows about radiosity, for the tables of `compile` and `light-check`.
pub fn light_rows(light: &LightFigures) -> [(&'static str, String); 5] {
    [
        ("light at", format!("{} points", light.points)),
        ("  exchanged by", format!("{} nodes", light.nodes)),
        ("  refined", format!("{} squares", light.refined)),
        ("  energy error", format!("{:.2} %", light.energy_error * 100.0)),
        ("  exposure", format!("{:.3}", light.exposure)),
    ]
}

/// The rows about the octree, for the tables of `compile` and `inspect`.
pub fn octree_rows(figures: &OctreeStatistics) -> [(&'static str, String); 5] {
    let bytes = |total: usize, each: f64| format!("{total} bytes, {each:.3} a voxel");
    [
        ("voxels", format!("{} of {:.1} mm", figures.voxels, figures.voxel_m * 1000.0)),
        ("  depth", format!("{}, {} inner nodes", figures.depth, figures.inner_nodes)),
        ("  materials", figures.materials.to_string()),
        ("  in memory", bytes(figures.memory_bytes, figures.memory_bytes_per_voxel)),
        ("  on the wire", bytes(figures.wire_bytes, figures.wire_bytes_per_voxel)),
    ]
}
