//! The commands: flags in, one outcome out. Exit codes: 0 done, 1 failed, 2 wrong usage.

pub mod compile;
pub mod demo_building;
pub mod inspect;
pub mod interrupt;
pub mod replay;
pub mod serve;
pub mod verification;

use std::{
    io::{self, Write},
    path::Path,
};

use anyhow::Context;
use serde::Serialize;
use sightline_compiler::{carve::CarveReport, octree_statistics::OctreeStatistics};

/// Writes to stdout. When nobody reads it any more, that is no fault: the work is done.
///
/// # Errors
/// When stdout is there and refuses, such as a full disk.
pub fn print(text: &str) -> anyhow::Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(error).context("cannot write to stdout")
        }
        _ => Ok(()),
    }
}

/// Writes a line to stderr, whether or not somebody reads it.
pub fn note(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// Writes the figures of a table for machines, where a file is given.
pub fn write_json(path: Option<&Path>, figures: &impl Serialize) -> anyhow::Result<()> {
    let Some(path) = path else { return Ok(()) };
    let text = serde_json::to_string_pretty(figures)?;
    std::fs::write(path, text + "\n").with_context(|| format!("cannot write {}", path.display()))
}

/// What carving did, for a table.
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

/// What an octree takes, for the tables of `compile` and `inspect`.
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

/// Three numbers with commas between them, in metres.
pub fn point(text: &str) -> Result<glam::Vec3, String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if x.is_finite() && y.is_finite() && z.is_finite() => {
            Ok(glam::Vec3::new(x, y, z))
        }
        _ => Err("three numbers with commas between them, such as 1.5,1.6,-3".into()),
    }
}

/// An error and its causes on one line, whatever characters a file or a peer put into it.
pub fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        // Many errors name their cause already.
        if line.is_empty() {
            line = cause;
        } else if !line.ends_with(&cause) {
            line = format!("{line}: {cause}");
        }
    }
    line.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_told_once() {
        let cause = io::Error::other("no\nsuch file");
        let named = anyhow::Error::new(cause).context("cannot read w.slw: no\nsuch file");
        assert_eq!(one_line(&named), "cannot read w.slw: no such file");
        let unnamed = anyhow::anyhow!("no such file").context("cannot read w.slw");
        assert_eq!(one_line(&unnamed), "cannot read w.slw: no such file");
    }
}
