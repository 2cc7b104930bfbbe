//! The demo building: an office of any size, generated from a seed and written as a GLB file.
//!
//! [`build`] makes a [`DemoBuilding`]: a [`Plan`] and the file. [`glb`] gives the file alone, and
//! [`plan()`] the plan alone. The same number of rooms and the same seed give the same building.
//!
//! A [`Plan`] has spaces ([`PlanSpace`]), doors ([`PlanDoor`]) and stairs ([`Stair`]), whose
//! rectangles ([`LatticeRect`]) lie on a lattice of 1/64 m. The shell of walls and slabs follows
//! from the plan exactly, so that faces meet without cracks. Arches, columns, plants and furniture
//! are detail objects. A lift and some doors move.
//!
//! [`arched_floor()`] makes a second model: one floor with arched windows, on which carving is
//! shown.
//!
//! ```
//! use sightline_demo_building::{SpaceKind, build};
//!
//! let building = build(4, 1);
//! assert_eq!(building.plan.room_count(), 4);
//! assert_eq!(building.plan.storeys, 1);
//! assert!(building.plan.spaces.iter().any(|space| space.kind == SpaceKind::Corridor));
//! assert!(building.glb.starts_with(b"glTF"));
//! assert_eq!(building.glb, sightline_demo_building::glb(4, 1));
//! ```

mod arched_floor;
mod fittings;
mod furniture;
mod layout;
mod mesh;
mod movers;
mod plan;
mod rect;
mod shell;

pub use arched_floor::{ArchedFloor, arched_floor};
pub use plan::{Plan, PlanDoor, PlanSpace, SpaceKind, Stair};
pub use rect::LatticeRect;

/// Lattice units in a metre. Every wall, slab and opening lies on the lattice.
pub const UNITS_PER_METRE: i32 = 64;

/// The most rooms of one building.
pub const ROOMS_MAX: usize = 10_000;

/// A generated building.
pub struct DemoBuilding {
    /// The floor plan.
    pub plan: Plan,
    /// The building as a GLB 2.0 file.
    pub glb: Vec<u8>,
    /// The number of triangles.
    pub triangles: usize,
}

/// Makes a building. The same arguments give the same building. `rooms` is clamped to
/// 1..=[`ROOMS_MAX`].
pub fn build(rooms: usize, seed: u64) -> DemoBuilding {
    let plan = plan(rooms, seed);
    let mut scene = mesh::Scene::new(&plan);
    shell::build(&plan, &mut scene);
    fittings::build(&plan, &mut scene);
    furniture::build(&plan, seed, &mut scene);
    movers::build(&plan, &mut scene);
    DemoBuilding { triangles: scene.triangle_count(), glb: scene.to_glb(), plan }
}

/// The GLB file of a building, without its plan.
pub fn glb(rooms: usize, seed: u64) -> Vec<u8> {
    build(rooms, seed).glb
}

/// The plan of a building, without its geometry.
pub fn plan(rooms: usize, seed: u64) -> Plan {
    layout::plan(rooms.clamp(1, ROOMS_MAX), seed)
}

#[cfg(test)]
mod tests;
