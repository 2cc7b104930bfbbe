//! Doors that stand closed.

use glam::Vec3;
use sightline_world::World;

use crate::model::Model;

/// The heights of doors, in metres.
const HIGH_M: std::ops::Range<f32> = 1.5..4.0;
/// The widths of doors, in metres.
const WIDE_M: std::ops::Range<f32> = 0.5..4.0;
/// A door is no thicker, in metres.
const THICK_MAX_M: f32 = 0.5;
/// The places before and behind a door are this far from it, in metres.
const BESIDE_M: f32 = 0.4;

/// The nodes that are named doors and have the size of one, with places before and behind that no
/// sight line joins.
pub(super) fn closed(model: &Model, world: &World) -> Vec<String> {
    let doors = model.nodes.iter().filter(|(name, _)| name.to_ascii_lowercase().contains("door"));
    let closed = doors.filter(|(_, bounds)| {
        let size = bounds.size();
        let (thin, wide) = (size.x.min(size.z), size.x.max(size.z));
        if !(HIGH_M.contains(&size.y) && WIDE_M.contains(&wide) && thin < THICK_MAX_M) {
            return false;
        }
        let through = if size.x < size.z { Vec3::X } else { Vec3::Z };
        let away = through * (thin / 2.0 + BESIDE_M);
        let sides = [away, -away].map(|away| world.cells.at(bounds.centre() + away));
        matches!(sides, [Some(before), Some(behind)] if !world.cells.sees(before, behind))
    });
    closed.map(|(name, _)| name.clone()).collect()
}
