//! What Sightline's server and client must agree on. No I/O, no async, no clock.
//!
//! * [`geometry`]: boxes and rectangles.
//! * [`octree`]: the static voxels that clients draw and walk on; and, apart, who moves where.
//! * [`world`]: the compiled world and its file: octree, cells, portals, PVS, mesh, spawns.
//! * [`motion`]: poses, bodies, speed limits and temporal bounding volumes.
//! * [`rooms`]: what an author knows about a building, and who may see whom by it.
//! * [`fuzzy`]: what no eye in a box can see, and what all of them see.
//! * [`shaft`]: whether every line between two boxes is blocked.
//! * [`protocol`]: wire types, quantisation and limits.
//!
//! Units are metres, seconds and radians; axes are right-handed with y up, as in glTF.

pub mod fuzzy;
pub mod geometry;
pub mod motion;
pub mod octree;
pub mod protocol;
pub mod rooms;
pub mod shaft;
pub mod world;
