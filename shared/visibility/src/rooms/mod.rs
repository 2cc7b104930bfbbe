//! Who may see whom by what an author says about rooms and windows. The data is
//! [`sightline_world::rooms`]. After Menon and Rossignac 1999 (US Patent 5,926,183).
//!
//! * [`RoomIndex`]: decides who may see whom, and finds the rooms at a place.
//! * [`RoomOverlap`]: the rooms that a region overlaps, found once for many questions.
//! * [`SealedRooms`]: the sealed rooms at a point.
//! * [`BuildingSight`]: which of the building's voxels rooms show to an eye.
//! * [`pieces`]: the convex pieces of a room's shapes.
//! * [`region`]: regions of space as boolean combinations of half-spaces.
//! * [`sight`]: what an eye, or a box of eyes, sees through windows.
//! * [`depth`]: rooms from near to far, and which of them nearer rooms hide.
//! * [`sets`]: everything that may be visible from a viewpoint, kept for viewpoints near it.
//!
//! # The rules
//!
//! Rooms can hide what cells show, and never show what cells hide. A viewer is told about an avatar
//! only if cells let it see the avatar and rooms do too. From the strongest rule to the weakest:
//!
//! 1. *Sealed rooms.* If one of two avatars is in a sealed room and the other is not, neither is
//!    told about the other.
//! 2. *Rooms with a set or windows.* A viewer in such a room is told about an avatar if the room's
//!    set names the avatar's place, or if a window shows it. A viewer in several such rooms is told
//!    what any of them shows. A room shows itself, unless its set hides it.
//! 3. *Opaque rooms.* A viewer outside an opaque room is not told about an avatar behind it, unless
//!    a window that faces the viewer may show the avatar.
//! 4. *Cells.* They decide what rooms leave open.
//!
//! Questions are about regions, and answers err on the safe side: a pair is ruled out only if it is
//! ruled out for every place in one region and every place in the other. So no avatar is missed
//! that the author leaves visible.

mod building_sight;
mod decide;
pub mod depth;
mod index;
mod locate;
mod opaque;
mod overlap;
pub mod pieces;
pub mod region;
mod sealed;
pub mod sets;
pub mod sight;
mod viewpoint;
mod window_part;

pub use building_sight::BuildingSight;
pub use decide::RoomVerdict;
pub use index::RoomIndex;
pub use overlap::RoomOverlap;
pub use sealed::SealedRooms;
