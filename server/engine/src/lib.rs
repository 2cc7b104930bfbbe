//! The visibility engine: a pure state machine. Inputs and a clock in, outputs out.
//!
//! [`Engine::handle`] takes in what clients say, [`Engine::tick`], called at a fixed rate, gives what
//! they are to be told. The engine opens no socket, reads no clock and draws no random numbers: the
//! same calls give the same outputs, bit for bit. Time is what has passed since the server's start.
//!
//! An avatar is *live* while somebody may see it or it may see somebody; otherwise it is *quiet*
//! in a TBV (temporal bounding volume), and *asked* when that expires or is revealed. A client begins live.
//!
//! # A host's loop
//!
//! An [`Engine`] is made for a [`World`], which [`World::read`] takes from the file that `sightline-server compile`
//! makes. What then happens is told to it as it happens, as an [`Input`]:
//!
//! 1. [`Join`](Input::Join), by an id that is never used twice.
//! 2. [`RoundTrip`](Input::RoundTrip), whenever it is measured: how far ahead is decided follows from it.
//! 3. [`Report`](Input::Report), once the client was told that it is in: at every tick while it is live, and while it
//!    is quiet when it is asked, or when its TBV does not [hold](Tbv::holds) its next step.
//! 4. [`Relocate`](Input::Relocate), when the host itself puts somebody elsewhere; [`Chat`](Input::Chat).
//! 5. [`Leave`](Input::Leave).
//!
//! Every [`Config::tick`] follows a [`tick`](Engine::tick). Each [`Output`] goes [to](Output::to) one client, in order
//! and without loss. Only of an avatar's poses the earlier may be lost; the last may not, since who stands still has
//! no news:
//!
//! 1. [`Entered`](Output::Entered) comes first. [`Drop`](Output::Drop) comes last: the avatar is gone already.
//! 2. [`Live`](Output::Live), [`Quiet`](Output::Quiet) and [`Ask`](Output::Ask) say when to report: at every tick, in
//!    no case but those above, once.
//! 3. [`Correct`](Output::Correct) puts a client back whose claim cannot be true.
//! 4. [`Appear`](Output::Appear), then [`Poses`](Output::Poses), then [`Vanish`](Output::Vanish): an avatar may come into
//!    view, is here now, and cannot be seen any more.
//! 5. [`Chat`](Output::Chat) is what somebody in view said, or the client itself.
//!
//! [`Engine::explain`] says why somebody is told of somebody, or is not: which rule decided, where the one's eye and
//! the other's body can be, and the line between them that is free.
//!
//! ```
//! use std::{sync::Arc, time::Duration};
//!
//! use glam::Vec3;
//! use sightline_engine::{Config, Engine, Input, Output};
//! use sightline_world::motion::AvatarId;
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
//! // Neither can see the other before long, so both are let in, and then may be silent.
//! assert_eq!(outputs.len(), 4);
//! assert!(outputs[..2].iter().all(|output| matches!(output, Output::Entered { .. })));
//! for output in &outputs[2..] {
//!     let Output::Quiet { to, tbv } = output else { panic!("{output:?}") };
//!     assert!(tbv.contains(engine.pose(*to).unwrap().eye));
//! }
//!
//! // Ben walks into the doorway. A client may always say more than it must.
//! outputs.clear();
//! let tick = engine.config().tick;
//! for step in 1..=80 {
//!     for (avatar, goal) in [(ada, Vec3::new(3.0, 1.6, 5.0)), (ben, Vec3::new(6.5, 1.6, 0.5))] {
//!         let mut pose = engine.pose(avatar).unwrap();
//!         pose.velocity = (goal - pose.eye).clamp_length_max(1.5); // In metres a second.
//!         pose.eye += pose.velocity * tick.as_secs_f32();
//!         engine.handle(tick * step, Input::Report { avatar, sequence: step, pose });
//!     }
//!     engine.tick(tick * step, &mut outputs);
//! }
//!
//! // Before they could see each other, each was told of the other.
//! let appear = |output: &&Output| matches!(output, Output::Appear { .. });
//! assert_eq!(outputs.iter().filter(appear).count(), 2);
//! assert!(engine.held_by(ada).eq([ben]) && engine.held_by(ben).eq([ada]));
//! println!("{}", engine.explain(ada, ben).unwrap());
//! ```
//!
//! The example `embed` goes on from there, with clients that keep to what they are told.
//!
//! # How far ahead
//!
//! Interest is decided for regions, not for points: where each eye and each body can be until the
//! word of the next tick stands at the viewer. What follows shows that this misses nothing, and what bounds it.
//!
#![doc = include_str!("timing/horizon.md")]

mod baselines;
mod bit_set;
mod building;
mod claims;
mod config;
mod engine;
mod generation;
mod interest;
mod messages;
mod pair;
mod population;
mod regions;
mod session_events;
mod silence;
mod slot;
mod sphere;
mod stats;
#[cfg(test)]
mod tests;
mod timing;
mod view;
mod worker_pool;

pub use claims::{Claim, ClaimLimits, ClaimVerdict, MovementBudget};
pub use config::{Config, FaultInjection, Margin, Policy, PolicyError, TbvShape, Validity};
pub use engine::Engine;
pub use interest::{Explanation, Reason};
pub use messages::{Input, Output};
pub use stats::{Counts, Stats};
