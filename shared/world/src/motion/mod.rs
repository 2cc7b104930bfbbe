//! Poses, courses, bodies, what bodies can do in a given time, and regions sure to contain them.

mod agility;
mod body;
mod course;
mod pose;
mod report;
mod tbv;
pub mod trajectory;

pub use agility::Agility;
pub use body::Body;
pub use course::{ACUITY_DISTANCES, COURSE_MAX, KEEP_ALIVE, Tolerance, turn_between};
pub use pose::{AvatarId, FREE_FALL, Pose, Spawn};
pub use report::Report;
pub use tbv::{ReportingState, Tbv};
