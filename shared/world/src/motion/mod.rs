//! Poses, bodies, what bodies can do in a given time, and regions sure to contain them.

mod agility;
mod body;
mod pose;
mod tbv;
pub mod trajectory;

pub use agility::Agility;
pub use body::Body;
pub use pose::{AvatarId, Pose, Spawn};
pub use tbv::{ReportingState, Tbv};
