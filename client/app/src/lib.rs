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
//! Draw the middle of a walk through a building without doors:
//!
//! ```
//! use glam::Vec3;
//! use sightline_client::camera_path::CameraPath;
//! use sightline_renderer::{Camera, Frame, Renderer};
//! use sightline_world::{
//!     Cells, Mesh, Spawn, World, geometry::Aabb, motion::Body, octree::Octree,
//! };
//!
//! let world = World {
//!     title: "an empty room".to_owned(),
//!     octree: Octree::empty(Vec3::ZERO, 4.0, 4),
//!     cells: Cells::whole(Aabb::new(Vec3::ZERO, Vec3::splat(4.0))),
//!     mesh: Mesh::default(),
//!     spawns: vec![Spawn { eye: Vec3::splat(2.0), yaw: 0.0 }],
//!     body: Body::PERSON,
//!     speed_max: 4.0,
//!     movers: Vec::new(),
//!     rooms: Default::default(),
//!     origin: None,
//! };
//! let path = CameraPath::through(&world);
//! let pose = path.at(path.duration_s() / 2.0);
//! let mut frame = Frame::new(64, 36);
//! Renderer::default().draw(&world.octree, &Camera::at(&pose), &mut frame);
//! assert!(frame.depth.iter().all(|depth| depth.is_infinite()), "nothing is solid here");
//! ```

pub mod bench;
pub mod camera_path;
#[cfg(feature = "desktop")]
pub mod desktop;
pub mod net;
pub mod swarm;
