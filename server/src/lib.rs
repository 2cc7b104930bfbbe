//! The server: what compiles buildings, decides interest and speaks QUIC.
//!
//! * [`compile`]: a model in, a [`World`](sightline_shared::world::World) out.
//! * [`engine`]: who is told what, who is asked when; no socket, no clock.
//! * [`net`]: the only place that knows QUIC.
//! * [`octree_figures`]: what an octree takes.
//! * [`plan`]: pictures of a world from above.
//! * [`portrait`]: pictures of a carved model.
//! * [`progress`]: how long tasks show that they go on.
//! * [`replay`]: the engine over a recorded [`trace`], without sockets.
//! * [`sight`]: rays against the original triangles, the oracle that all else is checked against.
//! * [`suggest`]: rooms and windows as a building itself suggests them.
//! * [`verify`]: a compiled world against that oracle.

pub mod compile;
pub mod engine;
pub mod net;
pub mod octree_figures;
pub mod plan;
pub mod portrait;
pub mod progress;
pub mod replay;
pub mod sight;
pub mod suggest;
pub mod trace;
pub mod verify;
