//! What the server believes of a client's claims.
//!
//! A claim must keep to the [movement budget](movement_budget), be [walkable](walkability) through
//! gates with enough [clearance], and agree with [earlier claims](consistency).

mod clearance;
mod consistency;
mod movement_budget;
mod walkability;

pub(crate) use clearance::Clearance;
pub(crate) use consistency::{Arrival, ClaimConsistency, OnCourse};
pub use movement_budget::{Claim, ClaimLimits, ClaimVerdict, MovementBudget};
pub(crate) use walkability::{Walk, WalkState, Walkways, WaySearch};
