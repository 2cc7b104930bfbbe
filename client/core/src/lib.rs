//! The client without I/O: what it knows of other avatars, and how its own body moves.
//!
//! * [`replica::Replica`] takes in the messages of the server. It gives the poses of other avatars
//!   to draw, and the messages to send.
//! * [`presence::Presence`] is a client in the worlds of a server: it moves over, and comes back.
//! * [`reporting::Reporter`] decides when the client reports. A replica has one; simulated clients
//!   use it alone.
//! * [`walker::Walker`] moves the own body through the voxels of a world, as a
//!   [`MoveInput`](walker::MoveInput) wants. Its poses go to [`replica::Replica::set_pose`].
//! * [`footing::Footing`] finds the way back for a body that has fallen out of the world.
//! * [`navigation::Navigation`] finds paths, and a [`route::Route`] walks along them.
//! * [`fetching::PieceFetcher`] says which pieces of a world to fetch next, and takes them in. An
//!   [`arriving::ArrivingWorld`] is the world that one is in, whether all of it is here or not.
//! * [`gaze::Gaze`] is where a person looks, and [`words`] are what it is told.
//!
//! There is no socket, no clock and no thread: callers pass in times, as durations since some
//! start.
//!
//! # Example
//!
//! A client enters the world at the place that the server gives it, and walks:
//!
//! ```
//! use std::time::Duration;
//!
//! use sightline_client_core::{
//!     replica::{Event, Outgoing, Replica},
//!     walker::{MoveInput, Walker},
//! };
//! use sightline_fixtures::voxel_floor;
//! use sightline_protocol::message::ServerMessage;
//! use sightline_world::motion::{Agility, AvatarId, Tolerance};
//!
//! let world = voxel_floor::world(&[]);
//! let mut walker = Walker::new(&world, voxel_floor::SPAWN);
//! let tick = Duration::from_millis(50);
//! let agility = Agility::of(&world.body, world.speed_max);
//! let mut replica = Replica::new(AvatarId(1), tick, agility);
//!
//! let entered = ServerMessage::Entered { pose: (&walker.pose()).into(), tick: 1 };
//! assert!(matches!(replica.message(tick, entered)?, Some(Event::Entered(_))));
//! let ahead = Duration::from_millis(200);
//! let tolerance = Tolerance { metres: 0.1, radians: 0.1, ahead };
//! replica.message(tick, ServerMessage::Live { tolerance: (&tolerance).into() })?;
//!
//! // One second of walking straight on. Few reports are due.
//! let start = walker.pose().eye;
//! let mut reports = 0;
//! for i in 1..=20 {
//!     let forward = MoveInput { forward: 1.0, ..MoveInput::default() };
//!     replica.set_pose(walker.step(&world.octree, forward, tick.as_secs_f32()));
//!     let sent = replica.tick(tick * i, tick);
//!     reports += usize::from(matches!(sent, Some(Outgoing::Message(_))));
//! }
//! assert!((1..10).contains(&reports), "{reports} reports");
//! let way = start.distance(walker.pose().eye);
//! assert!(way > 2.0 && way <= world.speed_max, "{way} m");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod arriving;
pub mod fetching;
pub mod footing;
pub mod gaze;
pub mod navigation;
mod own_motion;
pub mod presence;
pub mod replica;
pub mod reporting;
pub mod route;
pub mod walker;
pub mod words;
