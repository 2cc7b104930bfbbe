//! The visibility engine: decides which avatars each client is told of, and which client may be
//! silent.
//!
//! The engine is a pure state machine. It opens no socket, reads no clock and draws no random
//! numbers, so the same calls give the same outputs, bit for bit. Times are measured from the start
//! of the server.
//!
//! # Principal types
//!
//! - [`Engine`] is made for a [`World`](sightline_world::World) and a [`Config`]. The host calls
//!   [`Engine::handle`] for each [`Input`], and [`Engine::tick`] at a fixed rate, which gives
//!   [`Output`]s.
//! - [`ReportingState`](sightline_world::motion::ReportingState) says what is expected of a client.
//!   It is *live* while somebody may see its avatar or its avatar may see somebody; every client
//!   begins so. A live client reports when its avatar departs from its course by more than a
//!   [`Tolerance`](sightline_world::motion::Tolerance). Otherwise it is *quiet* in a
//!   [`Tbv`](sightline_world::motion::Tbv) (temporal bounding volume). It is *asked* when the TBV
//!   expires or is revealed.
//! - [`MovementBudget`] judges each [`Claim`] that a client makes of its place, within
//!   [`ClaimLimits`].
//! - [`Explanation`] says why a viewer is told of an avatar, or is not: the [`Reason`], both
//!   regions as boxes, and the free line if there is one.
//!
//! # A host's loop
//!
//! [`World::read`](sightline_world::World::read) reads a world from the file that
//! `sightline-server compile` makes. The host then tells the engine what happens, as it happens:
//!
//! 1. [`Join`](Input::Join), with an id that is never used twice.
//! 2. [`RoundTrip`](Input::RoundTrip), whenever it is measured. It decides how far ahead the engine
//!    looks.
//! 3. [`Report`](Input::Report), once the client has been told that it is in. A live client reports
//!    when its tolerance does not [hold](sightline_world::motion::Tolerance::holds) any more, and
//!    after a [keep-alive](sightline_world::motion::KEEP_ALIVE). A quiet one reports when it
//!    is asked, or when its TBV does not [hold](sightline_world::motion::Tbv::holds) its next step.
//!    Reports by exception must arrive: the engine takes silence for a claim.
//! 4. [`Relocate`](Input::Relocate), when the host itself puts an avatar elsewhere or pushes it;
//!    [`Respawn`](Input::Respawn), when a client asks to go back to a spawn point;
//!    [`Chat`](Input::Chat).
//! 5. [`Leave`](Input::Leave).
//!
//! After every [`Config::tick`] the host calls [`tick`](Engine::tick). Each [`Output`] goes
//! [to](Output::to) one client, in order and without loss. Only poses may be lost, as long as the
//! last pose of each avatar arrives: an avatar that stands still has no further news.
//!
//! 1. [`Entered`](Output::Entered) comes first. [`Drop`](Output::Drop) comes last, when the avatar
//!    is already gone.
//! 2. [`Live`](Output::Live), [`Quiet`](Output::Quiet) and [`Ask`](Output::Ask) say when to report:
//!    when the avatar departs from its course, when it leaves its TBV, or once. A report says how
//!    many of the first two its client has heard.
//! 3. [`Correct`](Output::Correct) puts a client back whose claim cannot be true.
//! 4. [`Appear`](Output::Appear), then [`Poses`](Output::Poses), then [`Vanish`](Output::Vanish):
//!    an avatar may come into view, is here now, and can no longer be seen.
//! 5. [`Chat`](Output::Chat) is what an avatar in view said, or the client's own.
//!
//! ```
//! use std::{sync::Arc, time::Duration};
//!
//! use glam::Vec3;
//! use sightline_engine::{Config, Engine, Input, Output};
//! use sightline_world::motion::{AvatarId, Report};
//!
//! // Two rooms of 6 m side by side, and a door at one end of the wall between them, at x = 6.
//! let mut engine = Engine::new(Arc::new(sightline_fixtures::two_rooms::world()), Config::default());
//! let (ada, ben) = (AvatarId(1), AvatarId(2));
//! for (avatar, name, x) in [(ada, "Ada", 3.0), (ben, "Ben", 9.0)] {
//!     let (name, colour, place) = (name.to_owned(), [255, 0, 0], Some(Vec3::new(x, 1.6, 5.0)));
//!     engine.handle(Duration::ZERO, Input::Join { avatar, name, colour, place });
//! }
//! let mut outputs = Vec::new();
//! engine.tick(Duration::ZERO, &mut outputs);
//!
//! // Neither can soon see the other. Both are let in, and may then be silent.
//! assert_eq!(outputs.len(), 4);
//! assert!(outputs[..2].iter().all(|output| matches!(output, Output::Entered { .. })));
//! for output in &outputs[2..] {
//!     let Output::Quiet { to, tbv } = output else { panic!("{output:?}") };
//!     assert!(tbv.contains(engine.pose(*to).unwrap().eye));
//! }
//!
//! // Ben walks into the doorway. A client may always report more than it must.
//! outputs.clear();
//! let tick = engine.config().tick;
//! for step in 1..=80 {
//!     for (avatar, goal) in [(ada, Vec3::new(3.0, 1.6, 5.0)), (ben, Vec3::new(6.5, 1.6, 0.5))] {
//!         let mut pose = engine.pose(avatar).unwrap();
//!         pose.velocity = (goal - pose.eye).clamp_length_max(1.5); // Metres a second.
//!         pose.eye += pose.velocity * tick.as_secs_f32();
//!         let report = Report { made: tick * step, orders: 0, pose };
//!         engine.handle(tick * step, Input::Report { avatar, report });
//!     }
//!     engine.tick(tick * step, &mut outputs);
//! }
//!
//! // Each was told of the other before they could see each other.
//! let appear = |output: &&Output| matches!(output, Output::Appear { .. });
//! assert_eq!(outputs.iter().filter(appear).count(), 2);
//! assert!(engine.held_by(ada).eq([ben]) && engine.held_by(ben).eq([ada]));
//! println!("{}", engine.explain(ada, ben).unwrap());
//! ```
//!
//! The example `embed` continues from here, with clients that keep to what they are told.
//!
//! # Parts of the engine
//!
//! An engine holds an immutable building, a population of avatars, indices of where they can be,
//! deadlines, and budgets. Algorithms are grouped by what happens to the data:
//!
//! - `claims`: what the server believes of a client.
//! - `timing`: how far ahead the engine decides, and how unevenly messages arrive.
//! - `regions`: where an avatar can be within some time.
//! - `interest`: who is told of whom, by regions that may see each other.
//! - `acuity`: how far off its true place a viewer can hardly tell an avatar to be.
//! - `orders`: what a client was told to leave unsaid, and what it is known to have heard.
//! - `silence`: which avatars are hidden, and for how long.
//! - `stations`: other engines that share the building, and what they are told.
//! - `baselines`: policies that exist only for comparison.
//!
//! # How far ahead
//!
//! Interest is decided for regions, not for points: where each eye and each body can be until the
//! word of the next tick stands at the viewer. The argument below shows what silence says of a live
//! client, that nothing is missed, and what bounds it.
//!
#![doc = include_str!("timing/horizon.md")]

mod acuity;
mod baselines;
mod bit_set;
mod building;
mod bus;
mod claims;
mod config;
mod engine;
mod generation;
mod interest;
mod messages;
mod newcomers;
mod orders;
mod pair;
mod pairs;
mod population;
mod regions;
mod session_events;
mod silence;
mod slot;
mod sphere;
mod station_events;
mod stations;
mod stats;
#[cfg(test)]
mod tests;
mod tick_context;
mod timing;
mod worker_pool;

pub use bus::{
    GuestReport, HeardOf, Heartbeat, Lags, StationId, StationMessage, StationOutput, StationWord,
    Stay,
};
pub use claims::{Claim, ClaimLimits, ClaimVerdict, MovementBudget};
pub use config::{
    Config, FaultInjection, Margin, Policy, PolicyError, StationFault, TbvShape, Validity,
};
pub use engine::Engine;
pub use interest::{Explanation, Reason};
pub use messages::{Input, Output};
pub use population::KnownCourse;
pub use stats::{Counts, Stats};
