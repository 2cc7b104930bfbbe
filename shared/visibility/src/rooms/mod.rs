//! Who may see whom by what an author says of rooms and windows. The data is [`sightline_world::rooms`].
//!
//! * [`RoomIndex`]: who may see whom, as the engine asks it; which room is where.
//! * [`pieces`]: the convex pieces of a room's shapes.
//! * [`region`]: regions of space as boolean combinations of half-spaces.
//! * [`sight`]: what an eye, or a box of eyes, sees through windows.
//! * [`depth`]: rooms from near to far, and which of them nearer ones hide.
//! * [`sets`]: all that may be visible from a viewpoint, kept for viewpoints near by.
//!
//! # The rule
//!
//! Rooms take away from what cells give, and never add to it: a viewer is told of whom cells *and*
//! rooms let it see. From strongest to weakest:
//!
//! 1. *Sealed.* Of two people, one of whom is in a sealed room that the other is not in, neither
//!    is told of the other.
//! 2. *Rooms.* Who is in rooms that say what can be seen is told of whom at least one of these shows:
//!    by its set, or through its windows. A room always shows itself, unless it hides itself.
//! 3. *Cells.* Who is in no such room is told of whom cells let it see.
//!
//! Regions are decided on their safe side: a pair is ruled out only when it is for every place in
//! the one region and every place in the other. So the promise that nobody visible is missed holds
//! for all whom the author's word leaves visible.

pub mod depth;
mod index;
mod overlap;
pub mod pieces;
pub mod region;
pub mod sets;
pub mod sight;

pub use index::{RoomIndex, RoomVerdict};
pub use overlap::{RoomOverlap, SealedRooms};
