//! The thin client.
//!
//! * `desktop`: the window, when the feature of that name is on.
//! * [`net`]: the connection, and the world's download and cache.
//! * [`swarm`]: visitors who walk by themselves.
//! * [`camera_path`]: a way for a camera, through a trace or a building.
//! * [`mod@bench`]: what drawing costs, beside rays through the original triangles, and how pictures differ.

pub mod bench;
pub mod camera_path;
#[cfg(feature = "desktop")]
pub mod desktop;
pub mod net;
pub mod swarm;
