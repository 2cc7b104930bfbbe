//! From a model to a world.

pub mod bsp;
pub mod demo_building;
pub mod glb;
pub mod model;
pub mod occluders;
pub mod pvs;
pub mod subdivide;
pub mod voxelise;
