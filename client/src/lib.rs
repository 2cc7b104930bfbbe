//! The thin client.
//!
//! * [`replica`]: what this client knows of the others; no socket, no clock.
//! * [`render`]: the building drawn on the CPU from its octree; no window, no clock.
//! * [`walker`]: one's own body: walks, climbs, collides; no keyboard, no clock.
//! * `desktop`: the window, when the feature of that name is on.
//! * [`net`]: the connection, and the world's download and cache.
//! * [`in_sight`]: which movers a camera on its way may see.
//! * [`navigation`]: where a body can walk. [`swarm`]: visitors who walk there by themselves.
//! * [`trace`]: recorded walks. [`path`]: a way for a camera, through a trace or a building.
//! * [`mod@bench`]: what drawing costs, beside rays through the original triangles, and how pictures differ.

pub mod bench;
#[cfg(feature = "desktop")]
pub mod desktop;
pub mod in_sight;
pub mod navigation;
pub mod net;
pub mod path;
pub mod render;
pub mod replica;
pub mod swarm;
pub mod trace;
pub mod walker;
