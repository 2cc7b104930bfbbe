//! The demo building: an office of any size, made from a seed and written as a GLB.
//!
//! A plan comes first ([`plan`]): spaces, openings and stairs on a lattice of 1/64 m. The shell
//! (walls, slabs) follows from it exactly, so that its faces meet without cracks; what is not a box
//! (arches, columns, plants) and furniture are added as detail.

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

/// The most rooms that one building has.
pub const ROOMS_MAX: usize = 10_000;

/// A building that has been made.
pub struct DemoBuilding {
    /// What was planned.
    pub plan: Plan,
    /// The building as a GLB 2.0 file.
    pub glb: Vec<u8>,
    /// How many triangles it has.
    pub triangles: usize,
}

/// Makes a building; the same one for the same arguments. `rooms` is held to 1..=[`ROOMS_MAX`].
pub fn build(rooms: usize, seed: u64) -> DemoBuilding {
    let plan = plan(rooms, seed);
    let mut scene = mesh::Scene::new(&plan);
    shell::build(&plan, &mut scene);
    fittings::build(&plan, &mut scene);
    furniture::build(&plan, seed, &mut scene);
    movers::build(&plan, &mut scene);
    DemoBuilding { triangles: scene.triangle_count(), glb: scene.to_glb(), plan }
}

/// The GLB of a building: [`build`] for those who want nothing else.
pub fn glb(rooms: usize, seed: u64) -> Vec<u8> {
    build(rooms, seed).glb
}

/// The plan of a building, without its geometry.
pub fn plan(rooms: usize, seed: u64) -> Plan {
    layout::plan(rooms.clamp(1, ROOMS_MAX), seed)
}

#[cfg(test)]
mod tests;
