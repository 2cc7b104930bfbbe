//! The compiled building: what server and client know about it.
//!
//! A [`World`] is made by the compiler, kept in a `.slw` file, and read by everybody. Its parts are
//! modules that build on one another, from the bottom up:
//!
//! * [`tolerance`]: every margin of length, derived from one quantum.
//! * [`geometry`]: boxes, frustums, and the building's own axes.
//! * [`motion`]: poses, bodies, trajectories, and the temporal bounding volume ([`motion::Tbv`]).
//! * [`octree`]: the voxels that are drawn; [`octree::occupants`] is an octree of moving objects.
//! * [`cells`]: the spatial subdivision, with portals between cells, gates between spaces, and the
//!   PVS.
//! * [`light`]: probes, which light avatars and movers.
//! * [`rooms`]: what the author says may be seen from where. Data only: `sightline-visibility`
//!   evaluates it.
//! * [`plan`]: a storey from above.
//! * [`Mesh`], [`Mover`] and [`Origin`]: the occluding triangles, the objects on trajectories, and
//!   what a Quake map says of itself.
//!
//! Nothing here opens a socket or reads a clock. The crate also builds for browsers (`wasm32`).
//!
//! ```
//! use glam::Vec3;
//! use sightline_world::{
//!     Cells, Mesh, Spawn, World, geometry::Aabb, motion::Body, octree::Octree, rooms::Rooms,
//! };
//!
//! // One empty hall: a single cell that sees itself.
//! let hall = Aabb::new(Vec3::ZERO, Vec3::new(20.0, 4.0, 30.0));
//! let world = World {
//!     title: "The hall".into(),
//!     octree: Octree::empty(Vec3::ZERO, 32.0, 8),
//!     cells: Cells::whole(hall),
//!     mesh: Mesh::default(),
//!     movers: Vec::new(),
//!     rooms: Rooms::default(),
//!     light: None,
//!     spawns: vec![Spawn { eye: Vec3::new(10.0, 1.6, 15.0), yaw: 0.0 }],
//!     body: Body::PERSON,
//!     speed_max: 4.0,
//!     origin: None,
//! };
//! let here = world.cells.at(world.spawns[0].eye).expect("the hall is one cell");
//! assert!(world.cells.sees(here, here));
//! assert_eq!(World::from_bytes(&world.to_bytes())?, world);
//! # Ok::<(), sightline_world::ReadError>(())
//! ```

pub mod cells;
mod file;
pub mod geometry;
pub mod light;
mod mesh;
pub mod motion;
mod mover;
pub mod octree;
mod origin;
mod packing;
pub mod plan;
pub mod rooms;
pub mod tolerance;
mod world;

pub use cells::{Cell, CellId, Cells, Gate, Node, Polygon, Portal, Pvs, Space};
pub use file::{
    ContentId, PieceId, ReadError, Viewpoints, WorldHead, WorldPieces, content_id, is_world_file,
    write_whole,
};
pub use mesh::Mesh;
pub use motion::Spawn;
pub use mover::{MOVER_TRIANGLES_MAX, MOVERS_MAX, Mover};
pub use origin::{Origin, OriginLeaf, OriginNode, OriginPlane, OriginSide, OriginTree, Solid};
pub use world::World;
