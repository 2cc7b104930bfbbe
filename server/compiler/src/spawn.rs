//! A spawn point for a model that names none.

use glam::Vec3;
use sightline_oracle::Oracle;
use sightline_world::{Cell, Cells, Mesh, Spawn, motion::Body};

/// Feet begin this far above the floor, in metres.
const ABOVE_FLOOR_M: f32 = 0.05;

/// Finds a spawn point: on a floor, under a roof if there is one, in the largest such cell.
pub(crate) fn find_spawn(body: &Body, cells: &Cells, mesh: &Mesh) -> Spawn {
    let oracle = Oracle::new(mesh);
    let stand = |at: Vec3| {
        let floor = oracle.distance(at, Vec3::NEG_Y)?;
        let roofed = oracle.distance(at, Vec3::Y).is_some();
        Some((roofed, at - Vec3::Y * (floor - body.below_eye - ABOVE_FLOOR_M)))
    };
    let world = |cell: &Cell| cells.axes.world_box(&cell.bounds);
    let mut by_size: Vec<_> = cells.cells.iter().map(world).collect();
    by_size.sort_by(|a, b| b.size().element_product().total_cmp(&a.size().element_product()));
    // A little off the centre, where the diagonals of floors and roofs tend to meet.
    let places: Vec<_> = by_size
        .iter()
        .filter_map(|b| stand(b.centre() + b.size() * Vec3::new(0.037, 0.0, 0.023)))
        .collect();
    let eye = places
        .iter()
        .find(|(roofed, _)| *roofed)
        .or(places.first())
        .map_or(cells.axes.world(cells.bounds.centre()), |(_, eye)| *eye);
    Spawn { eye, yaw: 0.0 }
}
