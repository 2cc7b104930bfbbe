//! What can be seen from where. No I/O, no clock.
//!
//! * [`portal_flow`]: sight lines through sequences of portals; the PVS is made of them.
//! * [`box_visibility`]: whether every line between two boxes is blocked.
//! * [`fuzzy`]: what no eye in a box can see, and what all of them see.
//! * [`rooms`]: who may see whom by what an author says of rooms and windows.

pub mod box_visibility;
pub mod fuzzy;
pub mod portal_flow;
pub mod rooms;
