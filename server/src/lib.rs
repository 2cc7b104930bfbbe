//! The server: what compiles buildings, decides interest and speaks QUIC.
//!
//! [`engine`] is there always: who is told what, who is asked when; no socket, no clock. It needs
//! none of what the rest does, so whoever wants no more depends on this crate with `default-features = false`.
//! The others come with cargo features, which are all on by default:
//!
//! `compile`: worlds, from models to pictures.
//!
//! * [`compile`]: a model in, a [`World`](sightline_shared::world::World) out.
//! * [`octree_figures`]: what an octree takes.
//! * [`plan`]: pictures of a world from above.
//! * [`portrait`]: pictures of a carved model.
//! * [`suggest`]: rooms and windows as a building itself suggests them.
//! * [`verify`]: a compiled world against the oracle.
//!
//! `replay`: what the engine does with recorded walks.
//!
//! * [`replay`]: the engine over a recorded [`trace`], without sockets.
//!
//! Either of the two:
//!
//! * [`sight`]: rays against the original triangles, the oracle that all else is checked against.
//!
//! `net`: over the network.
//!
//! * [`net`]: the only place that knows QUIC.
//!
//! `cli`: the binary, with all of these.
//!
//! * [`progress`]: how long tasks show that they go on.

// The list above names modules that are not there without their features.
#![cfg_attr(not(feature = "cli"), allow(rustdoc::broken_intra_doc_links))]

#[cfg(feature = "compile")]
pub mod compile;
pub mod engine;
#[cfg(feature = "net")]
pub mod net;
#[cfg(feature = "compile")]
pub mod octree_figures;
#[cfg(feature = "compile")]
pub mod plan;
#[cfg(feature = "compile")]
pub mod portrait;
#[cfg(feature = "cli")]
pub mod progress;
#[cfg(feature = "replay")]
pub mod replay;
#[cfg(any(feature = "compile", feature = "replay"))]
pub mod sight;
#[cfg(feature = "compile")]
pub mod suggest;
#[cfg(feature = "replay")]
pub mod trace;
#[cfg(feature = "compile")]
pub mod verify;
