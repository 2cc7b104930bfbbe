//! The client program as a library: everything in it that touches a network, a clock or a window.
//!
//! * [`net`]: a [`Dialer`](net::Dialer) connects to a server, downloads the world once, and gives a
//!   [`Session`](net::Session), which runs by itself.
//! * `desktop` (feature `desktop`): the window. It steps a
//!   [`Walker`](sightline_client_core::walker::Walker), draws with the
//!   [`Renderer`](sightline_renderer::Renderer), and reports poses to the session.
//! * [`swarm`]: simulated visitors, each with a session of its own, and what they receive.
//! * [`camera_path`]: a smooth path for a camera, along a recorded walk or through a building.
//! * [`mod@bench`]: the cost of drawing, compared with rays through the original triangles, and the
//!   quality of the pictures.
//!
//! The replica, the walker and the renderer live in crates of their own, which do no I/O.
//!
//! # Example
//!
//! Draw the picture half way along a walk through a building:
//!
//! ```
//! use sightline_client::camera_path::CameraPath;
//! use sightline_renderer::{Camera, Frame, Renderer};
//!
//! # let world = sightline_fixtures::voxel_floor::world(&[]);
//! let path = CameraPath::through(&world);
//! let pose = path.at(path.duration_s() / 2.0);
//! let mut frame = Frame::new(64, 36);
//! Renderer::default().draw(&world.octree, &Camera::at(&pose), &mut frame);
//! assert!(frame.depth.iter().any(|depth| depth.is_finite()), "the floor is in the picture");
//! ```

pub mod bench;
pub mod camera_path;
#[cfg(feature = "desktop")]
pub mod desktop;
pub mod net;
pub mod swarm;
