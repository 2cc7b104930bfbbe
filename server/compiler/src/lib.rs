//! From a model to a world.
//!
//! An importer ([`import`]) makes a [`model::Model`]: coloured surfaces to draw, opaque triangles
//! that block sight, and spawn points. [`compile()`] turns the model into a
//! [`World`](sightline_world::World), in stages:
//!
//! 1. [`carve`] merges coplanar triangles to polygons and cuts out what is not axial.
//! 2. `occluders` groups the opaque polygons by plane.
//! 3. `subdivide` splits space along these planes into spaces, and spaces into cells.
//! 4. [`pvs`] finds which cells see which.
//! 5. `light` lights models that bring no light of their own.
//! 6. [`voxelise`] makes the octree that clients draw.
//!
//! [`rooms`] resolves the rooms that an author declares, once the cells are known. Whatever a stage
//! cannot handle makes the PVS larger, never wrong.
//!
//! Other modules look at a compiled world: [`verdict`] says in plain words what walls hide,
//! [`verify`] compares its PVS with rays, [`plan`] draws it from above, [`suggest`] proposes rooms,
//! [`light_check`] compares light with traced paths, [`carve_preview`] draws what carving does, and
//! [`octree_statistics`] counts voxels and bytes. [`storeys()`] finds the storeys of a building.
//!
//! ```
//! use std::ops::ControlFlow;
//!
//! use sightline_compiler::{CompileOptions, compile, import::glb};
//!
//! // An office of four rooms, with coarse voxels and cells.
//! let file = sightline_demo_building::glb(4, 1);
//! let model = glb::read_slice(&file, None, "office")?;
//! let options = CompileOptions { voxel: Some(0.5), cell: Some(4.0), ..Default::default() };
//! let (world, report) = compile(&model, &options, &|_, _| ControlFlow::Continue(()))?;
//!
//! assert_eq!(world.cells.cells.len(), report.cells);
//! let cell = world.cells.at(world.spawns[0].eye).expect("a spawn point lies in a cell");
//! assert!(world.cells.sees(cell, cell));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod carve;
pub mod carve_preview;
mod compile;
mod drawing;
mod error;
pub mod import;
mod light;
pub mod light_check;
pub mod model;
mod occluders;
pub mod octree_statistics;
mod palette;
pub mod plan;
mod progress;
pub mod pvs;
mod report;
pub mod rooms;
mod spawn;
mod split_plane;
mod storeys;
mod subdivide;
pub mod suggest;
pub mod verdict;
pub mod verify;
pub mod voxelise;

pub use compile::{CompileOptions, Quality, compile};
pub use error::CompileError;
pub use light::{LightFigures, LightMethod, LightQuality};
pub use progress::Stage;
pub use report::CompileReport;
pub use storeys::storeys;
